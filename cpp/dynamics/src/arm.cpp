#include "arm.hpp"

#include "arm_bodies.hpp"
#include "reduced_arm.hpp"

namespace proact::dynamics {

std::unique_ptr<Arm> make_arm(const ArmSurroundings& surroundings) {
  if (surroundings.model.options.arm == ArmEquations::reduced) return std::make_unique<ReducedArm>(surroundings);
  return std::make_unique<ArmBodies>(surroundings);
}

}  // namespace proact::dynamics
