#include "block_bodies.hpp"

#include <algorithm>
#include <stdexcept>

namespace proact::dynamics {

namespace {

// How long a block must be slow before it sleeps.
constexpr int sleep_ticks = 250;
// A block sleeps once it has been slower than this for sleep_ticks. Slow enough that a rolling or
// tipping block is still well above it. ODE's own rule is not used, because its countdown cannot be saved.
constexpr double sleep_speed = 1e-3;       // m/s
constexpr double sleep_turn_speed = 2e-2;  // rad/s
// Blocks start at rest, so that they need not prove it for long.
constexpr int first_sleep_ticks = 10;

dMass block_mass(const Block& block) {
  dMass mass;
  const auto& size = block.shape.size;
  switch (block.shape.kind) {
    case ShapeKind::box: dMassSetBoxTotal(&mass, block.mass, size[0], size[1], size[2]); break;
    case ShapeKind::sphere: dMassSetSphereTotal(&mass, block.mass, size[0]); break;
    case ShapeKind::cylinder: dMassSetCylinderTotal(&mass, block.mass, 3, size[0], size[1]); break;
    case ShapeKind::capsule: dMassSetCapsuleTotal(&mass, block.mass, 3, size[0], size[1]); break;
  }
  return mass;
}

}  // namespace

BlockBodies::BlockBodies(const Model& model, dWorldID world)
    : model_(model), ticks_until_sleep_(model.blocks.size(), first_sleep_ticks) {
  for (const Block& block : model.blocks) {
    const dMass mass = block_mass(block);
    const dBodyID body = dBodyCreate(world);
    dBodySetMass(body, &mass);
    set_body_pose(body, block.pose);
    dBodySetAutoDisableFlag(body, 0);
    bodies_.push_back(body);
    states_.push_back({block.pose, {}, {}});
  }
}

bool BlockBodies::all_asleep() const {
  return std::none_of(bodies_.begin(), bodies_.end(), [](dBodyID body) { return dBodyIsEnabled(body) != 0; });
}

void BlockBodies::put_to_sleep(const BlockAttachment& carrying) {
  for (std::size_t k = 0; k < bodies_.size() && model_.options.sleep; ++k) {
    if (is_asleep(k) || carrying.is_attached(k)) continue;
    if (!count_idle_tick(k)) continue;
    set_body_velocity(bodies_[k], {}, {});
    dBodyDisable(bodies_[k]);
  }
}

bool BlockBodies::count_idle_tick(std::size_t block) {
  const dBodyID body = bodies_[block];
  const bool idle = norm(linear_velocity(body)) <= sleep_speed && norm(angular_velocity(body)) <= sleep_turn_speed;
  ticks_until_sleep_[block] = idle ? ticks_until_sleep_[block] - 1 : sleep_ticks;
  return ticks_until_sleep_[block] <= 0;
}

void BlockBodies::keep_awake(std::size_t block) { ticks_until_sleep_[block] = sleep_ticks; }

void BlockBodies::wake(std::size_t block) {
  dBodyEnable(bodies_[block]);
  keep_awake(block);
}

void BlockBodies::apply_rolling_resistance(std::size_t block) const {
  const Shape& shape = model_.blocks[block].shape;
  if (shape.kind == ShapeKind::box) return;
  const dBodyID body = bodies_[block];
  const Vec3 turning = angular_velocity(body);
  const double speed = norm(turning);
  if (speed < 1e-9) return;
  const double mass = model_.blocks[block].mass;
  const double radius = shape.size[0];
  // At most what stops a solid cylinder within two ticks, so that the torque never turns it back.
  const double stopping = 0.25 * mass * radius * radius * speed / tick_secs;
  const double torque =
      std::min(model_.options.rolling_resistance * mass * norm(model_.options.gravity) * radius, stopping) / speed;
  dBodyAddTorque(body, -torque * turning.x, -torque * turning.y, -torque * turning.z);
}

void BlockBodies::read(std::size_t block) {
  const dBodyID body = bodies_[block];
  states_[block] = {body_pose(body), linear_velocity(body), angular_velocity(body)};
}

void BlockBodies::reset_body(std::size_t block) {
  const dBodyID body = bodies_[block];
  const BodyState& state = states_[block];
  set_body_pose(body, state.pose);
  set_body_velocity(body, state.linear, state.angular);
  wake(block);
}

void BlockBodies::check_finite() const {
  for (std::size_t k = 0; k < bodies_.size(); ++k) {
    if (!is_finite(bodies_[k])) {
      throw std::runtime_error("block \"" + model_.blocks[k].name + "\" left the finite numbers");
    }
  }
}

std::vector<OdeBodyState> BlockBodies::ode_states() const {
  std::vector<OdeBodyState> bits;
  for (const dBodyID body : bodies_) bits.push_back(OdeBodyState::capture(body));
  return bits;
}

void BlockBodies::restore(const std::vector<BodyState>& states, const std::vector<int>& until_sleep) {
  states_ = states;
  ticks_until_sleep_ = until_sleep;
}

void BlockBodies::restore_bodies(const std::vector<OdeBodyState>& bits) const {
  for (std::size_t k = 0; k < bodies_.size(); ++k) bits[k].restore(bodies_[k]);
}

}  // namespace proact::dynamics
