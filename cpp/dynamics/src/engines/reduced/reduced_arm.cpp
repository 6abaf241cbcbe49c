#include "engines/reduced/reduced_arm.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace proact::dynamics {

namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();

// The speeds in the middle of a tick have settled when none changes by more than this, rad/s.
constexpr double speed_tolerance = 1e-6;
constexpr int max_rounds = 10;
// Turns between the arm and a heap in a tick; the next tick goes on where they end.
constexpr int max_heap_exchanges = 2;
// What a heap does to the arm is known no better than the turns leave it: the arm's part is not repeated to the end either.
constexpr int rounds_in_heap = 2;
constexpr int bounds_in_heap = 6;
// A joint is braked beyond this speed, rad/s, two hundred times the fastest that a hand is asked for: limp fingers without
// stops would whip round by half a radian in a tick, which no tick of 1 ms can follow.
constexpr double max_joint_speed = 400.0;
// From a joint to where the arm may be held while its base moves, metres.
constexpr double min_lever = 0.05;
// From the base to any joint that slides, metres.
constexpr double max_reach = 1.0;

/// Two directions across a unit vector.
std::array<Vec3, 2> tangents(const Vec3& normal) {
  const dVector3 n{normal.x, normal.y, normal.z};
  dVector3 first;
  dVector3 second;
  dPlaneSpace(n, first, second);
  return {to_vec(first), to_vec(second)};
}

/// Takes the angle of a joint without stops into -pi to pi.
double wrap_angle(const Joint& joint, double angle) {
  if (joint.upper != infinity || joint.kind == JointKind::prismatic) return angle;
  return angle > pi ? angle - 2.0 * pi : (angle < -pi ? angle + 2.0 * pi : angle);
}

}  // namespace

ReducedArm::ReducedArm(const ArmContext& surroundings)
    : Arm(surroundings.model.links.size()),
      model_(surroundings.model),
      base_(surroundings.base),
      joints_(surroundings.joints),
      control_(surroundings.control),
      blocks_(surroundings.blocks),
      carrying_(surroundings.carrying),
      geoms_(surroundings.geoms),
      islands_(surroundings.islands),
      broad_phase_(surroundings.geoms),
      coupled_blocks_(surroundings.model, surroundings.blocks, surroundings.contact_joints, surroundings.islands),
      motor_states_(surroundings.model.moving.size(), 0),
      midpoint_positions_(surroundings.model.positions) {}

/// Depends on no place in the world, so that it gives the same bits whenever it is called.
void ReducedArm::build() {
  join_links();
  sum_masses();
  resize_scratch();
  for (std::size_t k = 0; k < joints_.locked().size(); ++k) {
    if (!joints_.locked()[k]) continue;
    motor_states_[k] = 0;
    joints_.clear_effort(k);
  }
  broad_phase_.attach_shapes(links_);
  attach_block_shapes();
  tree_.place(base_.pose(), joints_.positions());
}

/// Joins links across rigid joints to the bodies of tree_.
void ReducedArm::join_links() {
  links_.join(model_, joints_);
  tree_.bodies.assign(links_.body_count(), {});
  tree_.resize();
  links_.body_from_link(0) = Pose{};
  for (std::size_t k = 0; k < model_.joints.size(); ++k) {
    const Joint& joint = model_.joints[k];
    const std::size_t moving = joints_.moving_index(k);
    const Pose from_parent = links_.body_from_link(joint.parent) * joint.origin;
    Pose& pose = links_.body_from_link(k + 1);
    if (joints_.rigid(k)) {
      pose = moving == no_index ? from_parent : joint_pose(from_parent, joint.kind, joint.axis, joints_.positions()[moving]);
    } else {
      ArmTree::Body& body = tree_.bodies[links_.body_of(k + 1)];
      body.parent = links_.body_of(joint.parent);
      body.moving = moving;
      body.parent_from_hinge = from_parent;
      body.kind = joint.kind;
      body.axis = joint.axis;
      pose = Pose{};
    }
  }
}

/// Gives the bodies of tree_ the masses of their links and of a carried block.
void ReducedArm::sum_masses() {
  for (std::size_t k = 0; k < model_.links.size(); ++k) {
    const Link& link = model_.links[k];
    if (link.mass <= 0.0) continue;
    const Pose pose = links_.body_from_link(k) * link.inertial;
    const auto& [ixx, ixy, ixz, iyy, iyz, izz] = link.inertia;
    add_mass(links_.body_of(k), link.mass, pose.position, rotated(pose.rotation, {ixx, ixy, ixz, iyy, iyz, izz}));
  }
  if (const auto& attached = carrying_.attached(); attached) {
    dMass mass;
    dBodyGetMass(blocks_.body(attached->block), &mass);
    const Pose pose = links_.body_from_link(attached->link) * attached->link_from_block;
    const SymmetricMatrix3 own{mass.I[0], mass.I[1], mass.I[2], mass.I[5], mass.I[6], mass.I[10]};
    add_mass(links_.body_of(attached->link), mass.mass, pose.position, rotated(pose.rotation, own));
  }
  for (ArmTree::Body& body : tree_.bodies) {
    if (body.mass <= 0.0) continue;
    body.center = body.center * (1.0 / body.mass);
    body.inertia = body.inertia + point_inertia(-body.mass, body.center);
  }
}

/// Adds a mass about the body's origin, until sum_masses() has them all.
void ReducedArm::add_mass(std::size_t body, double mass, const Vec3& center, const SymmetricMatrix3& about_center) {
  ArmTree::Body& sum = tree_.bodies[body];
  sum.mass += mass;
  sum.center = sum.center + center * mass;
  sum.inertia = sum.inertia + about_center + point_inertia(mass, center);
}

/// Brings all that is kept by hinge or body to the present number of them.
void ReducedArm::resize_scratch() {
  const std::size_t hinges = tree_.hinge_count();
  problem_.hinges.assign(hinges, {});
  problem_.mass.assign(hinges * hinges, 0.0);
  motors_.assign(hinges, {});
  for (std::vector<double>* scratch : {&speeds_, &accelerations_, &torques_, &momenta_}) scratch->assign(hinges, 0.0);
  // Never made shorter, which would give back the memory of its parts.
  if (chains_.size() < tree_.bodies.size()) chains_.resize(tree_.bodies.size());
  chains_[0].clear();
  for (std::size_t k = 1; k < tree_.bodies.size(); ++k) {
    chains_[k] = chains_[tree_.bodies[k].parent];
    chains_[k].push_back(k - 1);
  }
}

/// The shape of a block is moved by its body of ODE, unless the block is carried.
void ReducedArm::attach_block_shapes() {
  for (const Geom& geom : geoms_.blocks) {
    dGeomSetBody(geom.id.get(), carrying_.is_attached(geom.owner) ? nullptr : blocks_.body(geom.owner));
  }
}

void ReducedArm::drive(const double* position, const double* velocity) {
  midpoint_positions_ = joints_.positions();
  for (std::size_t i = 0; i < tree_.hinge_count(); ++i) {
    const std::size_t k = moving(i);
    motors_[i] = control_.motor(k, position[k], velocity[k]);
    midpoint_positions_[k] += 0.5 * tick_secs * joints_.velocities()[k];
  }
  const FrameMotion base = base_.motion();
  tree_.place(integrate_pose(base.pose, base.linear, base.angular, 0.5 * tick_secs), midpoint_positions_);
}

void ReducedArm::place_geoms() {
  if (const auto& attached = carrying_.attached(); attached) {
    const Pose link = tree_.placed()[links_.body_of(attached->link)].pose * links_.body_from_link(attached->link);
    set_geom_pose(geoms_.blocks[attached->block].id.get(), link * attached->link_from_block);
  }
  Geoms::update(geoms_.blocks);
  broad_phase_.update(tree_);
}

bool ReducedArm::resolve_contacts(Collisions& collisions) {
  coupled_blocks_.find(islands_.remaining_constraints());
  islands_.begin_solve();
  const bool shared = coupled_blocks_.find_shared();
  if (!shared) islands_.solve();
  const bool free = coupled_blocks_.constraints().empty() && step_without_contacts();
  const bool solved = free || solve_with_contacts(collisions, shared);
  const std::size_t hinges = tree_.hinge_count();
  for (std::size_t i = 0; i < hinges; ++i) {
    const std::size_t k = moving(i);
    const double speed = problem_.velocity[i];
    const double position = wrap_angle(model_.joints[model_.moving[k]], midpoint_positions_[k] + 0.5 * tick_secs * speed);
    const double torque = problem_.hinges[i].impulse / tick_secs + motors_[i].torque - motors_[i].gain_damping * speed;
    const double stop = control_.limit_effort(k, torque);
    joints_.set_state(k, position, speed, torque - stop, stop + problem_.hinges[i].brake_impulse / tick_secs);
    motor_states_[k] = problem_.hinges[i].saturation;
  }
  coupled_blocks_.integrate(problem_, hinges);
  coupled_blocks_.disable_in_ode();
  return solved;
}

void ReducedArm::finish() { coupled_blocks_.enable_in_ode(); }

/// The tick of an arm that touches nothing and whose motors can do what they are asked: the speeds are known and the
/// torques follow. False, and nothing has changed, if it is not one.
bool ReducedArm::step_without_contacts() {
  const std::size_t hinges = tree_.hinge_count();
  const std::vector<double>& velocities = joints_.velocities();
  problem_.velocity.resize(hinges);
  for (std::size_t i = 0; i < hinges; ++i) {
    const std::size_t k = moving(i);
    if (motor_states_[k] != 0 || motors_[i].limit <= 0.0) return false;
    problem_.velocity[i] = motors_[i].speed;
    speeds_[i] = 0.5 * (velocities[k] + motors_[i].speed);
    accelerations_[i] = (motors_[i].speed - velocities[k]) / tick_secs;
  }
  tree_.inverse_dynamics(base_.tick_motion(), model_.options.gravity, speeds_.data(), accelerations_.data(), torques_.data());
  for (std::size_t i = 0; i < hinges; ++i) {
    torques_[i] += motors_[i].damping * motors_[i].speed;
    if (std::fabs(torques_[i]) > motors_[i].limit) return false;
  }
  for (std::size_t i = 0; i < hinges; ++i) {
    problem_.hinges[i].saturation = 0;
    problem_.hinges[i].impulse = torques_[i] * tick_secs;
    problem_.hinges[i].brake_impulse = 0.0;
  }
  return true;
}

bool ReducedArm::solve_with_contacts(Collisions& collisions, bool shared) {
  const std::vector<ContactConstraint>& touches = coupled_blocks_.constraints();
  set_up_hinges();
  coupled_blocks_.add_to(problem_, tree_.hinge_count());
  problem_.normal_softness = model_.options.contact_cfm;
  problem_.contacts.clear();
  problem_.columns.clear();
  for (const ContactConstraint& touch : touches) add_contact(touch);
  problem_.invalidate_factors();
  problem_.max_bound_iterations = shared ? bounds_in_heap : VelocityProblem::max_bound_rounds;
  const bool solved = shared ? iterate_with_heap() : iterate_velocities(max_rounds);
  for (std::size_t k = 0; k < touches.size(); ++k) {
    if (touches[k].contact_index == no_index) continue;
    collisions.set_force(touches[k].contact_index, problem_.contacts[k].impulse[0] / tick_secs);
  }
  return solved;
}

void ReducedArm::set_up_hinges() {
  const std::size_t hinges = tree_.hinge_count();
  const std::vector<double>& velocities = joints_.velocities();
  tree_.mass_matrix(problem_.mass);
  problem_.velocity.assign(hinges + 6 * coupled_blocks_.count(), 0.0);
  for (std::size_t i = 0; i < hinges; ++i) {
    const std::size_t k = moving(i);
    // A motor that did what it was asked will most likely do so again.
    problem_.velocity[i] = motor_states_[k] == 0 ? motors_[i].speed : velocities[k];
    momenta_[i] = 0.0;
    for (std::size_t j = 0; j < hinges; ++j) momenta_[i] += problem_.mass[i * hinges + j] * velocities[moving(j)];
  }
  // A base that carries the arm into something turns its joints: gears give way to it.
  const double linear = norm(base_.motion().linear);
  const double angular = norm(base_.motion().angular);
  for (std::size_t i = 0; i < hinges; ++i) {
    double& own = problem_.mass[i * hinges + i];
    own *= std::max(1.0, std::fabs(velocities[moving(i)]) / max_joint_speed);
    own += tick_secs * motors_[i].damping;
    VelocityProblem::Hinge& hinge = problem_.hinges[i];
    hinge.speed = motors_[i].speed;
    hinge.limit = motors_[i].limit * tick_secs;
    const double yielding = tree_.bodies[i + 1].slides() ? linear + angular * max_reach : linear / min_lever + 2.0 * angular;
    hinge.max_speed = motors_[i].max_speed + yielding;
    hinge.brake_gain = motors_[i].brake_gain * tick_secs;
  }
}

/// Centrifugal torques belong to the speeds in the middle of the tick, which are repeated until they settle. False if
/// the problem was not solved in each round.
bool ReducedArm::iterate_velocities(int rounds) {
  const std::size_t hinges = tree_.hinge_count();
  const std::vector<double>& velocities = joints_.velocities();
  bool solved = true;
  double changed = infinity;
  for (int round = 0; round < rounds && changed > speed_tolerance; ++round) {
    for (std::size_t i = 0; i < hinges; ++i) {
      speeds_[i] = 0.5 * (velocities[moving(i)] + problem_.velocity[i]);
      accelerations_[i] = 0.0;
    }
    tree_.inverse_dynamics(base_.tick_motion(), model_.options.gravity, speeds_.data(), accelerations_.data(), torques_.data());
    for (std::size_t i = 0; i < hinges; ++i) {
      problem_.hinges[i].momentum = momenta_[i] + tick_secs * (motors_[i].torque - torques_[i]);
    }
    solved = problem_.solve() && solved;
    changed = 0.0;
    for (std::size_t i = 0; i < hinges; ++i) {
      const double speed = 0.5 * (velocities[moving(i)] + problem_.velocity[i]);
      changed = std::max(changed, std::fabs(speed - speeds_[i]));
    }
  }
  return solved;
}

/// The arm's contacts are solved exactly and those of the heap that it touches by sweeps, in turns: each finds the momenta
/// that the other has left.
bool ReducedArm::iterate_with_heap() {
  PgsContactSolver& sweeps = islands_.solver();
  const std::size_t hinges = tree_.hinge_count();
  bool solved = true;
  double changed = infinity;
  coupled_blocks_.reset_exchange();
  for (int turn = 0; turn < max_heap_exchanges && changed > islands_.small_speed(); ++turn) {
    sweeps.sweep();
    coupled_blocks_.import_momenta(problem_, sweeps);
    solved = iterate_velocities(rounds_in_heap) && solved;
    changed = coupled_blocks_.export_speeds(problem_, hinges, sweeps);
  }
  islands_.solve();
  return solved;
}

void ReducedArm::add_side(const ContactSide& side, double sign, const std::array<Vec3, 3>& directions,
                          const Vec3& point) {
  if (side.arm != no_index) {
    for (const std::size_t hinge : chains_[side.arm]) {
      const ArmTree::PlacedBody& placed = tree_.placed()[hinge + 1];
      const JointKind kind = tree_.bodies[hinge + 1].kind;
      const Vec3 speed = point_velocity(kind, placed.axis, placed.pose.position, point) * sign;
      problem_.columns.push_back({hinge, {dot(speed, directions[0]), dot(speed, directions[1]), dot(speed, directions[2])}});
    }
  } else if (side.block != no_index) {
    const std::size_t first = tree_.hinge_count() + 6 * coupled_blocks_.slot(side.block);
    const Vec3 arm = point - to_vec(dBodyGetPosition(blocks_.body(side.block)));
    const std::array<Vec3, 3> turns{cross(arm, directions[0]), cross(arm, directions[1]), cross(arm, directions[2])};
    const auto add = [&](std::size_t k, double a, double b, double c) {
      problem_.columns.push_back({first + k, {sign * a, sign * b, sign * c}});
    };
    add(0, directions[0].x, directions[1].x, directions[2].x);
    add(1, directions[0].y, directions[1].y, directions[2].y);
    add(2, directions[0].z, directions[1].z, directions[2].z);
    add(3, turns[0].x, turns[1].x, turns[2].x);
    add(4, turns[0].y, turns[1].y, turns[2].y);
    add(5, turns[0].z, turns[1].z, turns[2].z);
  }
}

void ReducedArm::add_contact(const ContactConstraint& touch) {
  const ContactSide& first = touch.first;
  const ContactSide& second = touch.second;
  const Options& options = model_.options;
  const Vec3& point = touch.point.position;
  const auto [u, v] = tangents(touch.point.normal);
  const std::array<Vec3, 3> directions{touch.point.normal, u, v};
  VelocityProblem::Contact contact;
  contact.friction = touch.friction;
  const auto is_fixed = [](const ContactSide& side) { return side.arm == no_index && side.block == no_index; };
  const bool with_fixed = (first.arm != no_index && is_fixed(second)) || (second.arm != no_index && is_fixed(first));
  const double fastest = with_fixed ? options.max_arm_correcting_speed_m_per_s : options.max_correcting_speed_m_per_s;
  const double asked = options.contact_erp / tick_secs * std::max(0.0, touch.point.depth - options.surface_layer);
  contact.speed[0] = std::min(asked, fastest);
  // The bound is one of the speed, not of the force: an arm that presses harder than fastest / contact_cfm (50 N) would sink into
  // the wall as long as it presses, and be pushed out for seconds after it has stopped.
  if (with_fixed && asked > fastest) contact.softness = fastest / asked;
  // What the base does is known.
  const FrameMotion base = base_.motion();
  const Vec3 carried = base.linear + cross(base.angular, point - tree_.placed()[0].pose.position);
  for (std::size_t row = 0; row < 3; ++row) {
    if (first.arm != no_index) contact.speed[row] -= dot(carried, directions[row]);
    if (second.arm != no_index) contact.speed[row] += dot(carried, directions[row]);
  }
  contact.first = problem_.columns.size();
  // The solver wants columns in the order of their unknowns.
  const auto order = [&](const ContactSide& side) {
    return side.arm != no_index ? 0 : side.block == no_index ? no_index : 1 + coupled_blocks_.slot(side.block);
  };
  if (order(first) <= order(second)) {
    add_side(first, 1.0, directions, point);
    add_side(second, -1.0, directions, point);
  } else {
    add_side(second, -1.0, directions, point);
    add_side(first, 1.0, directions, point);
  }
  contact.last = problem_.columns.size();
  problem_.contacts.push_back(contact);
}

FrameMotion ReducedArm::motion(std::size_t body) const {
  return tree_.motion(body, base_.motion(), joints_.positions(), joints_.velocities());
}

void ReducedArm::restore(const State& state) {
  motor_states_ = state.motor_states;
  build();
}

}  // namespace proact::dynamics
