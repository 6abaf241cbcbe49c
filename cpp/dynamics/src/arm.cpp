#include "arm.hpp"

#include "engines/ode/ode_arm.hpp"
#include "engines/reduced/reduced_arm.hpp"

namespace proact::dynamics {

std::unique_ptr<Arm> make_arm(const ArmContext& surroundings) {
  if (surroundings.model.options.engine == Engine::reduced) return std::make_unique<ReducedArm>(surroundings);
  return std::make_unique<OdeArm>(surroundings);
}

}  // namespace proact::dynamics
