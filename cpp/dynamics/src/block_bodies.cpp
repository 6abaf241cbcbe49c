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
    : model_(model), until_sleep_(model.blocks.size(), first_sleep_ticks) {
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

void BlockBodies::put_to_sleep(const Carrying& carrying) {
  for (std::size_t k = 0; k < bodies_.size() && model_.options.sleep; ++k) {
    if (asleep(k) || carrying.carries(k)) continue;
    if (!idle_long(k)) continue;
    set_body_velocity(bodies_[k], {}, {});
    dBodyDisable(bodies_[k]);
  }
}

bool BlockBodies::idle_long(std::size_t block) {
  const dBodyID body = bodies_[block];
  const bool idle = norm(linear_velocity(body)) <= sleep_speed && norm(angular_velocity(body)) <= sleep_turn_speed;
  until_sleep_[block] = idle ? until_sleep_[block] - 1 : sleep_ticks;
  return until_sleep_[block] <= 0;
}

void BlockBodies::keep_awake(std::size_t block) { until_sleep_[block] = sleep_ticks; }

void BlockBodies::wake(std::size_t block) {
  dBodyEnable(bodies_[block]);
  keep_awake(block);
}

void BlockBodies::resist_rolling(std::size_t block) const {
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

void BlockBodies::set_free(std::size_t block) {
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

std::vector<BodyBits> BlockBodies::bits() const {
  std::vector<BodyBits> bits;
  for (const dBodyID body : bodies_) bits.push_back(BodyBits::of(body));
  return bits;
}

void BlockBodies::restore(const std::vector<BodyState>& states, const std::vector<int>& until_sleep) {
  states_ = states;
  until_sleep_ = until_sleep;
}

void BlockBodies::put(const std::vector<BodyBits>& bits) const {
  for (std::size_t k = 0; k < bodies_.size(); ++k) bits[k].put(bodies_[k]);
}

}  // namespace proact::dynamics
