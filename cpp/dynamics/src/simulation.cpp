// One tick.

#include "simulation.hpp"

#include <algorithm>
#include <stdexcept>
#include <utility>

namespace proact::dynamics {

namespace {

// Below this speed Coulomb friction fades to zero, so that a joint at rest is not pushed to and fro, rad/s.
constexpr double friction_fade = 0.01;
// A joint is at its stop from this far beyond its limit, rad: a command to the limit itself ends a little
// beside it.
constexpr double stop_slack = 1e-4;

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

bool finite_body(dBodyID body) {
  return is_finite(to_vec(dBodyGetPosition(body))) && is_finite(to_quat(dBodyGetQuaternion(body))) &&
         is_finite(to_vec(dBodyGetLinearVel(body))) && is_finite(to_vec(dBodyGetAngularVel(body)));
}

}  // namespace

World::Simulation::Simulation(Model model) : model_(std::move(model)) {
  validate(model_);
  prepare_ode_in_this_thread();

  // Worlds on ODE's default threading share its job queue and abort when two of them step at once.
  threading_.reset(dThreadingAllocateSelfThreadedImplementation());
  world_.reset(dWorldCreate());
  if (!threading_ || !world_) throw std::runtime_error("ODE could not make a world");
  dWorldSetStepThreadingImplementation(world_.get(), dThreadingImplementationGetFunctions(threading_.get()),
                                       threading_.get());
  contact_group_.reset(dJointGroupCreate(0));

  const Options& options = model_.options;
  dWorldSetGravity(world_.get(), options.gravity.x, options.gravity.y, options.gravity.z);
  dWorldSetERP(world_.get(), options.joint_erp);
  dWorldSetCFM(world_.get(), options.joint_cfm);
  dWorldSetContactSurfaceLayer(world_.get(), options.surface_layer);
  dWorldSetContactMaxCorrectingVel(world_.get(), options.correcting_speed);
  dWorldSetQuickStepNumIterations(world_.get(), options.iterations);
  dWorldSetAutoDisableFlag(world_.get(), 0);

  const std::size_t joints = model_.moving.size();
  moving_of_joint_.assign(model_.joints.size(), npos);
  for (std::size_t k = 0; k < joints; ++k) moving_of_joint_[model_.moving[k]] = k;
  positions_ = model_.positions;
  velocities_.assign(joints, 0.0);
  efforts_.assign(joints, 0.0);
  last_command_ = positions_;
  gains_command_ = positions_;
  last_complaint_.reserve(message_size);
  held_.assign(joints, false);
  still_ticks_.assign(joints, 0);
  stop_.assign(joints, 0);
  for (std::size_t k = model_.arm_count; k < joints && options.hold_still_hand; ++k) {
    held_[k] = true;
    still_ticks_[k] = options.hold_ticks;
  }
  world_from_base_ = model_.world_from_base;
  body_of_.assign(model_.links.size(), 0);
  body_from_link_.assign(model_.links.size(), Pose{});
  motions_.assign(model_.links.size(), LinkMotion{});
  parted_.assign(model_.links.size() * model_.blocks.size(), true);
  until_sleep_.assign(model_.blocks.size(), first_sleep_ticks);
  motor_states_.assign(joints, 0);
  halfway_ = positions_;
  slot_.assign(model_.blocks.size(), npos);
  engaged_.reserve(model_.blocks.size());
  waiting_.reserve(contact_capacity);
  contacts_.reserve(contact_capacity);
  measured_.reserve(contact_capacity);

  for (const Block& block : model_.blocks) {
    const dMass mass = block_mass(block);
    const dBodyID body = dBodyCreate(world_.get());
    dBodySetMass(body, &mass);
    set_body_pose(body, block.pose);
    dBodySetAutoDisableFlag(body, 0);
    block_bodies_.push_back(body);
    blocks_.push_back({block.pose, {}, {}});
  }
  make_geoms();
  build_arm();
  refuse_overlaps();
}

void World::Simulation::check_command(const double* position, const double* velocity, const Pose& world_from_base) {
  if (!failure_.empty()) throw std::runtime_error(failure_);
  for (std::size_t k = 0; k < model_.moving.size(); ++k) {
    if (!std::isfinite(position[k]) || !std::isfinite(velocity[k])) {
      throw std::invalid_argument("the command of joint \"" + model_.joints[model_.moving[k]].name + "\" is not finite");
    }
  }
  if (!is_finite(world_from_base)) throw std::invalid_argument("the pose of the base is not finite");
}

/// Whether a base that is told to go to `target` would have to jump.
bool World::Simulation::jumps(const Pose& target) const {
  const Quat turn = target.rotation * conjugate(world_from_base_.rotation);
  const double speed = norm(target.position - world_from_base_.position) / tick_secs;
  const double turn_speed = norm(rotation_vector(turn)) / tick_secs;
  return speed > model_.options.base_speed || turn_speed > model_.options.base_turn_speed;
}

void World::Simulation::step(const double* position, const double* velocity, const Pose& world_from_base) {
  check_command(position, velocity, world_from_base);
  try {
    if (choose_rigid_joints(position, velocity)) build_arm();
    const Pose asked{world_from_base.position, normalized(world_from_base.rotation)};
    base_held_ = jumps(asked);
    const Pose target = base_held_ ? world_from_base_ : asked;
    const Vec3 linear_before = base_linear_;
    const Vec3 angular_before = base_angular_;
    base_linear_ = (target.position - world_from_base_.position) * (1.0 / tick_secs);
    base_angular_ = rotation_vector(target.rotation * conjugate(world_from_base_.rotation)) * (1.0 / tick_secs);
    if (reduced()) {
      const BaseMotion base{base_linear_, (angular_before + base_angular_) * 0.5,
                            (base_linear_ - linear_before) * (1.0 / tick_secs),
                            (base_angular_ - angular_before) * (1.0 / tick_secs)};
      advance_tree(position, velocity, base);
    } else {
      dBodySetLinearVel(bodies_[0], base_linear_.x, base_linear_.y, base_linear_.z);
      dBodySetAngularVel(bodies_[0], base_angular_.x, base_angular_.y, base_angular_.z);
      drive(position, velocity);
      collide();
      advance();
      // Takes away the rounding of ODE's own integration, so that it cannot add up.
      set_body_pose(bodies_[0], target);
    }
    world_from_base_ = target;
    read_state();
  } catch (const std::exception& error) {
    failure_ = std::string("the world is unusable since an earlier failure: ") + error.what();
    throw;
  }
}

/// Whether a joint is on a stop: once beyond its limit, and until the control alone can hold it.
int World::Simulation::stop_of(std::size_t moving) const {
  const Joint& joint = model_.joints[model_.moving[moving]];
  if (stop_[moving] != 0) {
    const double control = joint.proportional_gain > 0.0 ? -stop_[moving] * gains_torque(moving, 0.0) : joint.effort;
    return -stop_[moving] * efforts_[moving] > control ? stop_[moving] : 0;
  }
  if (positions_[moving] > joint.upper + stop_slack) return 1;
  return positions_[moving] < joint.lower - stop_slack ? -1 : 0;
}

/// Position control as a speed constraint with bounded torque: at the end of the tick the joint has the speed
/// that closes the gap, unless that takes more than the effort limit. Gravity therefore leaves no sag.
///
/// A stop is the same constraint at the limit without a bound. ODE's own stops are not used: a motor that drives
/// away from one acts with its full torque for a tick, which throws light fingers.
World::Simulation::Motor World::Simulation::motor_of(std::size_t moving, double position, double velocity) {
  const Options& options = model_.options;
  const Joint& joint = model_.joints[model_.moving[moving]];
  stop_[moving] = stop_of(moving);
  const bool stopped = stop_[moving] != 0;
  const double command = stopped ? (stop_[moving] > 0 ? joint.upper : joint.lower) : position;
  const double ahead = stopped ? 0.0 : velocity;
  const double target = std::clamp(command, joint.lower, joint.upper);
  // The command is for the end of the tick: what its own speed covers is no error.
  const double error = target - positions_[moving] - ahead * tick_secs;
  const double fastest = options.catch_up * joint.velocity;
  return {std::clamp(ahead + options.position_gain * error, -fastest, fastest), stopped ? dInfinity : joint.effort,
          joint.damping + joint.friction / std::max(std::fabs(velocities_[moving]), friction_fade), 0.0, 0.0};
}

/// Torque of a joint's gains at angle positions_ while its command moves at `speed` and the joint does not.
double World::Simulation::gains_torque(std::size_t moving, double speed) const {
  const Joint& joint = model_.joints[model_.moving[moving]];
  const double command = std::clamp(gains_command_[moving], joint.lower, joint.upper);
  return joint.proportional_gain * (command - positions_[moving]) + joint.derivative_gain * speed;
}

/// Proportional and derivative gain on the difference to a command of bounded speed, as it is at the end of the tick:
/// taken from its start, such gains would shake light fingers. Nothing bears gravity, so that the arm sags.
World::Simulation::Motor World::Simulation::motor_by_gains(std::size_t moving, double position) {
  const Joint& joint = model_.joints[model_.moving[moving]];
  const double farthest = model_.options.gains_command_speed * tick_secs;
  const double way = std::clamp(position - gains_command_[moving], -farthest, farthest);
  gains_command_[moving] += way;
  Motor motor = motor_of(moving, gains_command_[moving], 0.0);
  if (stop_[moving] != 0) return motor;
  motor.limit = 0.0;
  motor.torque = gains_torque(moving, way / tick_secs);
  motor.slope = joint.derivative_gain + joint.proportional_gain * tick_secs;
  motor.rubbing += motor.slope;
  return motor;
}

/// Damping and friction act as they do at the end of the tick (implicit Euler, of each joint by itself): taken from
/// its start, they would shake light fingers that no control holds ever faster.
void World::Simulation::drive(const double* position, const double* velocity) {
  for (const Hinge& hinge : hinges_) {
    const std::size_t k = hinge.moving;
    const Motor motor = motor_of(k, position[k], velocity[k]);
    dJointSetHingeParam(hinge.joint, dParamVel, motor.speed);
    dJointSetHingeParam(hinge.joint, dParamFMax, motor.limit);
    const double torque = -motor.rubbing * velocities_[k] / (1.0 + tick_secs * motor.rubbing / hinge.inertia);
    dJointAddHingeTorque(hinge.joint, torque);
  }
}

/// Puts blocks to sleep that have rested long enough. What touches a sleeping block wakes it.
void World::Simulation::put_to_sleep() {
  for (std::size_t k = 0; k < block_bodies_.size() && model_.options.sleep; ++k) {
    const dBodyID body = block_bodies_[k];
    if (dBodyIsEnabled(body) == 0 || slot_[k] != npos || (attached_ && attached_->block == k)) continue;
    const bool idle = norm(to_vec(dBodyGetLinearVel(body))) <= sleep_speed &&
                      norm(to_vec(dBodyGetAngularVel(body))) <= sleep_turn_speed;
    until_sleep_[k] = idle ? until_sleep_[k] - 1 : sleep_ticks;
    if (until_sleep_[k] > 0) continue;
    dBodySetLinearVel(body, 0, 0, 0);
    dBodySetAngularVel(body, 0, 0, 0);
    dBodyDisable(body);
  }
}

void World::Simulation::advance() {
  put_to_sleep();
  const unsigned long before = ode_message_count();
  int done = 1;
  if (reduced() && std::none_of(block_bodies_.begin(), block_bodies_.end(), [](dBodyID body) { return dBodyIsEnabled(body) != 0; })) {
    // Nothing is left for ODE to move.
  } else if (model_.options.solver == Solver::direct) {
    done = dWorldStep(world_.get(), tick_secs);
  } else {
    // The order of constraints comes from a generator that all worlds share: each brings its own seed.
    const std::lock_guard<std::mutex> turn(generator_mutex());
    dRandSetSeed(model_.options.seed);
    done = dWorldQuickStep(world_.get(), tick_secs);
    model_.options.seed = dRandGetSeed();
  }
  if (const unsigned long heard = ode_message_count() - before; heard > 0) {
    complaints_ += heard;
    last_complaint_ = ode_last_message();
  }
  if (done == 0) throw std::runtime_error("out of memory in a step");
  for (const double value : velocities_) {
    if (!std::isfinite(value)) throw std::runtime_error("the arm left the finite numbers");
  }
  for (const dBodyID body : bodies_) {
    if (!finite_body(body)) throw std::runtime_error("the arm left the finite numbers");
  }
  for (std::size_t k = 0; k < block_bodies_.size(); ++k) {
    if (!finite_body(block_bodies_[k])) {
      throw std::runtime_error("block \"" + model_.blocks[k].name + "\" left the finite numbers");
    }
  }
}

void World::Simulation::read_state() {
  if (!reduced()) std::fill(efforts_.begin(), efforts_.end(), 0.0);
  for (const Hinge& hinge : hinges_) {
    const std::size_t k = hinge.moving;
    positions_[k] = dJointGetHingeAngle(hinge.joint);
    velocities_[k] = dJointGetHingeAngleRate(hinge.joint);
    // The torque on the child about the axis; the bearing's force is taken out by its lever.
    dVector3 anchor_at;
    dVector3 axis_at;
    dJointGetHingeAnchor(hinge.joint, anchor_at);
    dJointGetHingeAxis(hinge.joint, axis_at);
    const Vec3 lever = to_vec(anchor_at) - to_vec(dBodyGetPosition(dJointGetBody(hinge.joint, 0)));
    efforts_[k] = dot(to_vec(axis_at), to_vec(hinge.feedback.t1) - cross(lever, to_vec(hinge.feedback.f1)));
  }
  for (const Measured& measured : measured_) {
    Contact& contact = contacts_[measured.contact];
    contact.force = std::max(0.0, dot(to_vec(measured.feedback.f1), contact.normal));
  }
  for (std::size_t k = 0; k < blocks_.size(); ++k) {
    const bool carried = attached_ && attached_->block == k;
    if (carried && !carried_apart()) {
      const std::size_t body = body_of_[attached_->link];
      const FrameMotion motion = body_motion(body);
      const Pose pose = motion.pose * body_from_link_[attached_->link] * attached_->link_from_block;
      const Vec3 linear = motion.linear + cross(motion.angular, pose.position - motion.pose.position);
      blocks_[k] = {pose, linear, motion.angular};
    } else {
      const dBodyID body = block_bodies_[k];
      blocks_[k] = {body_pose(body), to_vec(dBodyGetLinearVel(body)), to_vec(dBodyGetAngularVel(body))};
    }
  }
}

FrameMotion World::Simulation::body_motion(std::size_t body) const {
  if (reduced()) return tree_.motion(body, {world_from_base_, base_linear_, base_angular_}, positions_, velocities_);
  const dBodyID id = bodies_[body];
  return {body_pose(id), to_vec(dBodyGetLinearVel(id)), to_vec(dBodyGetAngularVel(id))};
}

Pose World::Simulation::link_pose(std::size_t link) const {
  if (link >= body_of_.size()) {
    throw std::invalid_argument("link " + std::to_string(link) + ", there are " + std::to_string(body_of_.size()));
  }
  return body_motion(body_of_[link]).pose * body_from_link_[link];
}

void World::Simulation::attach(std::size_t block, std::size_t link) {
  if (!failure_.empty()) throw std::runtime_error(failure_);
  if (block >= blocks_.size()) {
    throw std::invalid_argument("block " + std::to_string(block) + ", there are " + std::to_string(blocks_.size()));
  }
  if (attached_) {
    throw std::invalid_argument("block \"" + model_.blocks[attached_->block].name + "\" is attached already, release it first");
  }
  const Pose link_from_block = inverse(link_pose(link)) * blocks_[block].pose;
  attached_ = Attachment{block, link, link_from_block};
  if (carried_apart()) {
    dBodyEnable(block_bodies_[block]);
  } else {
    dBodyDisable(block_bodies_[block]);
  }
  std::fill_n(parted_.begin() + static_cast<std::ptrdiff_t>(block * model_.links.size()), model_.links.size(), false);
  build_arm();
}

void World::Simulation::release() {
  if (!attached_) return;
  const std::size_t block = attached_->block;
  attached_.reset();
  const dBodyID body = block_bodies_[block];
  const BodyState& state = blocks_[block];
  set_body_pose(body, state.pose);
  dBodySetLinearVel(body, state.linear.x, state.linear.y, state.linear.z);
  dBodySetAngularVel(body, state.angular.x, state.angular.y, state.angular.z);
  dBodyEnable(body);
  until_sleep_[block] = sleep_ticks;
  build_arm();
}

}  // namespace proact::dynamics
