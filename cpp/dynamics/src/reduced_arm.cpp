// The arm in joint angles, and the blocks that hang together with it by contacts. All other blocks are ODE's.
//
// A tick of the arm is half a tick of drift, the change of the speeds, and the other half: second order, so that an arm
// without damping keeps its energy. What it touches is found halfway.

#include "simulation.hpp"

#include <algorithm>
#include <stdexcept>

namespace proact::dynamics {

namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();
// Bounds of a shape that is far from everything.
constexpr std::array<dReal, 6> nowhere{infinity, -infinity, infinity, -infinity, infinity, -infinity};

// The speeds in the middle of a tick have settled when none changes by more than this, rad/s.
constexpr double settled_speed = 1e-6;
constexpr int most_rounds = 10;
// A joint is braked beyond this speed, rad/s, two hundred times the fastest that a hand is asked for: limp fingers without
// stops would whip round by half a radian in a tick, which no tick of 1 ms can follow.
constexpr double fastest_turn = 400.0;

Pose moved(const Pose& pose, const Vec3& linear, const Vec3& angular, double secs) {
  const double speed = norm(angular);
  const Quat turn = speed > 0.0 ? about_axis(angular * (1.0 / speed), speed * secs) : Quat{};
  return {pose.position + linear * secs, normalized(turn * pose.rotation)};
}

/// Two directions across a unit vector.
std::array<Vec3, 2> across(const Vec3& normal) {
  const dVector3 n{normal.x, normal.y, normal.z};
  dVector3 first;
  dVector3 second;
  dPlaneSpace(n, first, second);
  return {to_vec(first), to_vec(second)};
}

/// Takes the angle of a joint without stops into -pi to pi.
double wrapped(const Joint& joint, double angle) {
  constexpr double pi = 3.14159265358979323846;
  if (joint.upper != infinity) return angle;
  return angle > pi ? angle - 2.0 * pi : (angle < -pi ? angle + 2.0 * pi : angle);
}

}  // namespace

/// Joins links across rigid joints to the bodies of tree_. Depends on no place in the world, so that it gives the same
/// bits whenever it is called.
void World::Simulation::build_tree() {
  group_links();
  tree_.bodies.assign(root_of_.size(), {});
  tree_.resize();
  body_from_link_[0] = Pose{};
  for (std::size_t k = 0; k < model_.joints.size(); ++k) {
    const Joint& joint = model_.joints[k];
    const std::size_t moving = moving_of_joint_[k];
    const Pose from_parent = body_from_link_[joint.parent] * joint.origin;
    if (rigid(k)) {
      Pose& pose = body_from_link_[k + 1];
      pose = from_parent;
      if (moving != npos) pose.rotation = normalized(pose.rotation * about_axis(joint.axis, positions_[moving]));
    } else {
      ArmTree::Body& body = tree_.bodies[body_of_[k + 1]];
      body.parent = body_of_[joint.parent];
      body.moving = moving;
      body.parent_from_hinge = from_parent;
      body.axis = joint.axis;
      body_from_link_[k + 1] = Pose{};
    }
  }

  const auto add_mass = [&](std::size_t body, double mass, const Vec3& centre, const Symmetric& about_centre) {
    // About the body's origin for now.
    ArmTree::Body& sum = tree_.bodies[body];
    sum.mass += mass;
    sum.centre = sum.centre + centre * mass;
    sum.inertia = sum.inertia + about_centre + point_inertia(mass, centre);
  };
  for (std::size_t k = 0; k < model_.links.size(); ++k) {
    const Link& link = model_.links[k];
    if (link.mass <= 0.0) continue;
    const Pose pose = body_from_link_[k] * link.inertial;
    const auto& [ixx, ixy, ixz, iyy, iyz, izz] = link.inertia;
    add_mass(body_of_[k], link.mass, pose.position, rotated(pose.rotation, {ixx, ixy, ixz, iyy, iyz, izz}));
  }
  if (attached_) {
    dMass mass;
    dBodyGetMass(block_bodies_[attached_->block], &mass);
    const Pose pose = body_from_link_[attached_->link] * attached_->link_from_block;
    const Symmetric own{mass.I[0], mass.I[1], mass.I[2], mass.I[5], mass.I[6], mass.I[10]};
    add_mass(body_of_[attached_->link], mass.mass, pose.position, rotated(pose.rotation, own));
  }
  for (ArmTree::Body& body : tree_.bodies) {
    if (body.mass <= 0.0) continue;
    body.centre = body.centre * (1.0 / body.mass);
    body.inertia = body.inertia + point_inertia(-body.mass, body.centre);
  }

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
  for (std::size_t k = 0; k < held_.size(); ++k) {
    if (!held_[k]) continue;
    motor_states_[k] = 0;
    efforts_[k] = 0.0;
  }
  hang_link_geoms();
}

/// Shapes of the arm are moved by hand; those of a block by its body of ODE, unless it is carried.
void World::Simulation::hang_link_geoms() {
  spheres_.assign(tree_.bodies.size(), {{}, -1.0});
  for (Geom& geom : link_geoms_) {
    geom.body_from_shape = body_from_link_[geom.owner] * geom.owner_from_shape;
    Sphere& sphere = spheres_[body_of_[geom.owner]];
    if (sphere.radius < 0.0) sphere = {geom.body_from_shape.position, 0.0};
    sphere.radius = std::max(sphere.radius, norm(geom.body_from_shape.position - sphere.centre) + geom.reach);
  }
  for (const Geom& geom : block_geoms_) {
    const bool carried = attached_ && attached_->block == geom.owner;
    dGeomSetBody(geom.id.get(), carried ? nullptr : block_bodies_[geom.owner]);
  }
}

bool World::Simulation::near_anything(const Sphere& sphere) const {
  const auto near = [&](const Geom& geom) {
    const auto& b = geom.bounds;
    const auto& [c, r] = sphere;
    return c.x + r >= b[0] && c.x - r <= b[1] && c.y + r >= b[2] && c.y - r <= b[3] && c.z + r >= b[4] && c.z - r <= b[5];
  };
  return std::any_of(fixed_geoms_.begin(), fixed_geoms_.end(), near) ||
         std::any_of(block_geoms_.begin(), block_geoms_.end(), near);
}

/// Brings the shapes of links up to date that are near anything they could touch. Expects the blocks' bounds.
void World::Simulation::update_link_geoms() {
  std::size_t last = npos;
  bool near = false;
  for (Geom& geom : link_geoms_) {
    const std::size_t body = body_of_[geom.owner];
    const Pose& pose = tree_.placed()[body].pose;
    if (body != last) near = near_anything({pose * spheres_[body].centre, spheres_[body].radius});
    last = body;
    geom.bounds = nowhere;
    if (!near || !near_anything({pose * geom.body_from_shape.position, geom.reach})) continue;
    geom.world_from_shape = pose * geom.body_from_shape;
    set_geom_pose(geom.id.get(), geom.world_from_shape);
    dGeomGetAABB(geom.id.get(), geom.bounds.data());
  }
}

void World::Simulation::advance_tree(const double* position, const double* velocity, const BaseMotion& base) {
  const std::size_t hinges = tree_.hinge_count();
  halfway_ = positions_;
  for (std::size_t i = 0; i < hinges; ++i) {
    const std::size_t k = tree_.bodies[i + 1].moving;
    const bool by_gains = model_.joints[model_.moving[k]].proportional_gain > 0.0;
    motors_[i] = by_gains ? motor_by_gains(k, position[k]) : motor_of(k, position[k], velocity[k]);
    halfway_[k] += 0.5 * tick_secs * velocities_[k];
  }
  tree_.place(moved(world_from_base_, base_linear_, base_angular_, 0.5 * tick_secs), halfway_);
  collide();
  engage_blocks();
  if (!waiting_.empty() || !drive_freely(base)) solve_with_contacts(base);
  for (std::size_t i = 0; i < hinges; ++i) {
    const std::size_t k = tree_.bodies[i + 1].moving;
    velocities_[k] = problem_.velocity[i];
    positions_[k] = wrapped(model_.joints[model_.moving[k]], halfway_[k] + 0.5 * tick_secs * velocities_[k]);
    efforts_[k] = problem_.hinges[i].impulse / tick_secs + motors_[i].torque - motors_[i].slope * velocities_[k];
    motor_states_[k] = problem_.hinges[i].state;
  }
  move_engaged_blocks();
  // What hangs together with the arm is none of ODE's business in this tick.
  for (const std::size_t block : engaged_) dBodyDisable(block_bodies_[block]);
  advance();
  for (const std::size_t block : engaged_) dBodyEnable(block_bodies_[block]);
}

/// The tick of an arm that touches nothing and whose motors can do what they are asked: the speeds are known and the
/// torques follow. False, and nothing has changed, if it is not one.
bool World::Simulation::drive_freely(const BaseMotion& base) {
  const std::size_t hinges = tree_.hinge_count();
  problem_.velocity.resize(hinges);
  for (std::size_t i = 0; i < hinges; ++i) {
    const std::size_t k = tree_.bodies[i + 1].moving;
    if (motor_states_[k] != 0 || motors_[i].limit <= 0.0) return false;
    problem_.velocity[i] = motors_[i].speed;
    speeds_[i] = 0.5 * (velocities_[k] + motors_[i].speed);
    accelerations_[i] = (motors_[i].speed - velocities_[k]) / tick_secs;
  }
  tree_.inverse_dynamics(base, model_.options.gravity, speeds_.data(), accelerations_.data(), torques_.data());
  for (std::size_t i = 0; i < hinges; ++i) {
    torques_[i] += motors_[i].rubbing * motors_[i].speed;
    if (std::fabs(torques_[i]) > motors_[i].limit) return false;
  }
  for (std::size_t i = 0; i < hinges; ++i) {
    problem_.hinges[i].state = 0;
    problem_.hinges[i].impulse = torques_[i] * tick_secs;
  }
  return true;
}

void World::Simulation::solve_with_contacts(const BaseMotion& base) {
  const std::size_t hinges = tree_.hinge_count();
  tree_.mass_matrix(problem_.mass);
  problem_.velocity.assign(hinges + 6 * engaged_.size(), 0.0);
  for (std::size_t i = 0; i < hinges; ++i) {
    const std::size_t k = tree_.bodies[i + 1].moving;
    // A motor that did what it was asked will most likely do so again.
    problem_.velocity[i] = motor_states_[k] == 0 ? motors_[i].speed : velocities_[k];
    momenta_[i] = 0.0;
    for (std::size_t j = 0; j < hinges; ++j) {
      momenta_[i] += problem_.mass[i * hinges + j] * velocities_[tree_.bodies[j + 1].moving];
    }
  }
  for (std::size_t i = 0; i < hinges; ++i) {
    double& own = problem_.mass[i * hinges + i];
    own *= std::max(1.0, std::fabs(velocities_[tree_.bodies[i + 1].moving]) / fastest_turn);
    own += tick_secs * motors_[i].rubbing;
    VelocityProblem::Hinge& hinge = problem_.hinges[i];
    hinge.speed = motors_[i].speed;
    hinge.limit = motors_[i].limit * tick_secs;
  }
  problem_.blocks.clear();
  for (std::size_t slot = 0; slot < engaged_.size(); ++slot) {
    const dBodyID body = block_bodies_[engaged_[slot]];
    dMass mass;
    dBodyGetMass(body, &mass);
    const Symmetric own{mass.I[0], mass.I[1], mass.I[2], mass.I[5], mass.I[6], mass.I[10]};
    const Symmetric inertia = rotated(to_quat(dBodyGetQuaternion(body)), own);
    const Vec3 linear = to_vec(dBodyGetLinearVel(body));
    const Vec3 angular = to_vec(dBodyGetAngularVel(body));
    const Vec3 spin = inertia * angular;
    const Vec3 torque = to_vec(dBodyGetTorque(body)) - cross(angular, spin);
    dBodySetTorque(body, 0, 0, 0);
    problem_.blocks.push_back({mass.mass, inertia, (linear + model_.options.gravity * tick_secs) * mass.mass,
                               spin + torque * tick_secs});
    const double twist[6] = {linear.x, linear.y, linear.z, angular.x, angular.y, angular.z};
    std::copy(std::begin(twist), std::end(twist), problem_.velocity.begin() + static_cast<std::ptrdiff_t>(hinges + 6 * slot));
  }
  problem_.normal_softness = model_.options.contact_cfm;
  problem_.contacts.clear();
  problem_.columns.clear();
  for (const Waiting& waiting : waiting_) add_contact(waiting, base);

  // Centrifugal torques belong to the speeds in the middle of the tick, which are repeated until they settle.
  problem_.renew();
  bool solved = true;
  double changed = infinity;
  for (int round = 0; round < most_rounds && changed > settled_speed; ++round) {
    for (std::size_t i = 0; i < hinges; ++i) {
      speeds_[i] = 0.5 * (velocities_[tree_.bodies[i + 1].moving] + problem_.velocity[i]);
      accelerations_[i] = 0.0;
    }
    tree_.inverse_dynamics(base, model_.options.gravity, speeds_.data(), accelerations_.data(), torques_.data());
    for (std::size_t i = 0; i < hinges; ++i) {
      problem_.hinges[i].momentum = momenta_[i] + tick_secs * (motors_[i].torque - torques_[i]);
    }
    solved = problem_.solve() && solved;
    changed = 0.0;
    for (std::size_t i = 0; i < hinges; ++i) {
      const double speed = 0.5 * (velocities_[tree_.bodies[i + 1].moving] + problem_.velocity[i]);
      changed = std::max(changed, std::fabs(speed - speeds_[i]));
    }
  }
  if (!solved) ++complaints_;
  for (std::size_t k = 0; k < waiting_.size(); ++k) {
    if (waiting_[k].measured == npos) continue;
    contacts_[waiting_[k].measured].force = problem_.contacts[k].impulse[0] / tick_secs;
  }
}

/// Finds the blocks that touch the arm, or each other and one of them the arm; hands all other contacts to ODE.
void World::Simulation::engage_blocks() {
  for (const std::size_t block : engaged_) slot_[block] = npos;
  engaged_.clear();
  const auto engage = [&](const Side& side) {
    if (side.block == npos || slot_[side.block] != npos) return false;
    slot_[side.block] = engaged_.size();
    engaged_.push_back(side.block);
    until_sleep_[side.block] = sleep_ticks;
    return true;
  };
  const auto moves = [&](const Side& side) { return side.arm != npos || (side.block != npos && slot_[side.block] != npos); };
  for (bool grown = true; grown;) {
    grown = false;
    for (const Waiting& waiting : waiting_) {
      const auto& [first, second, friction] = waiting.touch;
      if (moves(first) || moves(second)) grown = engage(first) || grown;
      if (moves(first) || moves(second)) grown = engage(second) || grown;
    }
  }
  const auto free = [&](const Waiting& waiting) {
    if (moves(waiting.touch.first) || moves(waiting.touch.second)) return false;
    push(waiting.touch, waiting.point, nullptr);
    return true;
  };
  waiting_.erase(std::remove_if(waiting_.begin(), waiting_.end(), free), waiting_.end());
}

void World::Simulation::add_side(const Side& side, double sign, const std::array<Vec3, 3>& directions, const Vec3& point) {
  if (side.arm != npos) {
    for (const std::size_t hinge : chains_[side.arm]) {
      const ArmTree::Placed& placed = tree_.placed()[hinge + 1];
      const Vec3 speed = cross(placed.axis, point - placed.pose.position) * sign;
      problem_.columns.push_back({hinge, {dot(speed, directions[0]), dot(speed, directions[1]), dot(speed, directions[2])}});
    }
  } else if (side.block != npos) {
    const std::size_t first = tree_.hinge_count() + 6 * slot_[side.block];
    const Vec3 lever = point - to_vec(dBodyGetPosition(block_bodies_[side.block]));
    const std::array<Vec3, 3> turns{cross(lever, directions[0]), cross(lever, directions[1]), cross(lever, directions[2])};
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

void World::Simulation::add_contact(const Waiting& waiting, const BaseMotion& base) {
  const auto& [first, second, friction] = waiting.touch;
  const Options& options = model_.options;
  const Vec3& point = waiting.point.position;
  const auto [u, v] = across(waiting.point.normal);
  const std::array<Vec3, 3> directions{waiting.point.normal, u, v};
  VelocityProblem::Contact contact;
  contact.friction = friction;
  contact.speed[0] = std::min(options.contact_erp / tick_secs * std::max(0.0, waiting.point.depth - options.surface_layer),
                              options.correcting_speed);
  // What the base does is known.
  const Vec3 carried = base.linear + cross(base_angular_, point - tree_.placed()[0].pose.position);
  for (std::size_t row = 0; row < 3; ++row) {
    if (first.arm != npos) contact.speed[row] -= dot(carried, directions[row]);
    if (second.arm != npos) contact.speed[row] += dot(carried, directions[row]);
  }
  contact.first = problem_.columns.size();
  // The solver wants columns in the order of their unknowns.
  const auto order = [&](const Side& side) { return side.arm != npos ? 0 : side.block == npos ? npos : 1 + slot_[side.block]; };
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

void World::Simulation::move_engaged_blocks() {
  for (std::size_t slot = 0; slot < engaged_.size(); ++slot) {
    const dBodyID body = block_bodies_[engaged_[slot]];
    const double* const twist = &problem_.velocity[tree_.hinge_count() + 6 * slot];
    const Vec3 linear{twist[0], twist[1], twist[2]};
    const Vec3 angular{twist[3], twist[4], twist[5]};
    const Pose pose = moved(body_pose(body), linear, angular, tick_secs);
    set_body_pose(body, pose);
    dBodySetLinearVel(body, linear.x, linear.y, linear.z);
    dBodySetAngularVel(body, angular.x, angular.y, angular.z);
  }
}

}  // namespace proact::dynamics
