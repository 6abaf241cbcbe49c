// The arm as rigid bodies and hinges. Called at the start and whenever a hand joint becomes rigid or free, or a
// block is taken or let go: angles and speeds are the state, bodies are rebuilt from them.

#include "simulation.hpp"

#include <algorithm>

namespace proact::dynamics {

namespace {

// A joint with a smaller range does not move at all.
constexpr double immovable_range = 1e-9;

dMass link_mass(const Link& link, const Pose& frame_from_link) {
  const auto& [ixx, ixy, ixz, iyy, iyz, izz] = link.inertia;
  dMass mass;
  dMassSetParameters(&mass, link.mass, 0, 0, 0, ixx, iyy, izz, ixy, ixz, iyz);
  const Pose frame_from_inertial = frame_from_link * link.inertial;
  const Quat& q = frame_from_inertial.rotation;
  const dQuaternion rotation{q.w, q.x, q.y, q.z};
  dMatrix3 matrix;
  dQtoR(rotation, matrix);
  dMassRotate(&mass, matrix);
  dMassTranslate(&mass, frame_from_inertial.position.x, frame_from_inertial.position.y, frame_from_inertial.position.z);
  return mass;
}

/// Angular acceleration of a free body about `axis` by a torque of 1 N m about it, 1/(kg m^2).
double turning_ease(dBodyID body, const Vec3& axis) {
  dMass mass;
  dBodyGetMass(body, &mass);
  dMatrix3 inverse_inertia;
  dInvertPDMatrix(mass.I, inverse_inertia, 3);
  const Vec3 own = rotate(conjugate(to_quat(dBodyGetQuaternion(body))), axis);
  const dVector3 turn{own.x, own.y, own.z};
  dVector3 response;
  dMultiply0(response, inverse_inertia, turn, 3, 3, 1);
  return dot(own, to_vec(response));
}

}  // namespace

bool World::Simulation::movable(std::size_t joint) const {
  const Joint& description = model_.joints[joint];
  return !description.fixed && description.upper - description.lower >= immovable_range;
}

bool World::Simulation::rigid(std::size_t joint) const {
  return !movable(joint) || held_[moving_of_joint_[joint]];
}

/// Poses and twists of all links at `positions` and the present speeds and base.
void World::Simulation::place_links(const std::vector<double>& positions, std::vector<LinkMotion>& out) const {
  out[0] = {world_from_base_, base_linear_, base_angular_};
  for (std::size_t k = 0; k < model_.joints.size(); ++k) {
    const Joint& joint = model_.joints[k];
    const LinkMotion& parent = out[joint.parent];
    LinkMotion& child = out[k + 1];
    child.pose = parent.pose * joint.origin;
    child.angular = parent.angular;
    if (const std::size_t moving = moving_of_joint_[k]; moving != npos) {
      child.pose.rotation = normalized(child.pose.rotation * about_axis(joint.axis, positions[moving]));
      child.angular = child.angular + rotate(child.pose.rotation, joint.axis) * velocities_[moving];
    }
    child.linear = parent.linear + cross(parent.angular, child.pose.position - parent.pose.position);
  }
}

/// Joins links across rigid joints; sets body_of_ and root_of_.
void World::Simulation::group_links() {
  root_of_.assign(1, 0);
  body_of_[0] = 0;
  for (std::size_t k = 0; k < model_.joints.size(); ++k) {
    if (rigid(k)) {
      body_of_[k + 1] = body_of_[model_.joints[k].parent];
    } else {
      body_of_[k + 1] = root_of_.size();
      root_of_.push_back(k + 1);
    }
  }
}

/// Gives each body the mass of its links and of a carried block, and finds body_from_link_. ODE's bodies have
/// their origin in the centre of mass; their axes are those of the first link. Expects motions_.
void World::Simulation::set_masses() {
  for (std::size_t body = 0; body < root_of_.size(); ++body) {
    const Pose root_from_world = inverse(motions_[root_of_[body]].pose);
    dMass total;
    dMassSetZero(&total);
    for (std::size_t link = 0; link < model_.links.size(); ++link) {
      if (body_of_[link] != body) continue;
      body_from_link_[link] = root_from_world * motions_[link].pose;
      if (model_.links[link].mass <= 0.0) continue;
      const dMass mass = link_mass(model_.links[link], body_from_link_[link]);
      dMassAdd(&total, &mass);
    }
    if (body == 0) {
      // The base goes where it is told, whatever it weighs; its origin is that of the base link.
      dBodySetKinematic(bodies_[body]);
      continue;
    }
    if (attached_ && !carried_apart() && body_of_[attached_->link] == body) {
      dMass mass;
      dBodyGetMass(block_bodies_[attached_->block], &mass);
      const Pose place = body_from_link_[attached_->link] * attached_->link_from_block;
      const dQuaternion q{place.rotation.w, place.rotation.x, place.rotation.y, place.rotation.z};
      dMatrix3 matrix;
      dQtoR(q, matrix);
      dMassRotate(&mass, matrix);
      dMassTranslate(&mass, place.position.x, place.position.y, place.position.z);
      dMassAdd(&total, &mass);
    }
    const Vec3 centre = to_vec(total.c);
    dMassTranslate(&total, -centre.x, -centre.y, -centre.z);
    // Rounding leaves a remainder, and ODE asks for exactly zero.
    std::fill(std::begin(total.c), std::end(total.c), 0.0);
    dBodySetMass(bodies_[body], &total);
    for (std::size_t link = 0; link < model_.links.size(); ++link) {
      if (body_of_[link] == body) body_from_link_[link].position = body_from_link_[link].position - centre;
    }
  }
}

/// Expects the bodies placed with all free joints at angle zero, so that ODE's angles are the model's.
void World::Simulation::make_hinges() {
  hinges_.clear();
  for (std::size_t k = 0; k < model_.joints.size(); ++k) {
    if (rigid(k)) continue;
    const Joint& joint = model_.joints[k];
    const dJointID hinge = dJointCreateHinge(world_.get(), nullptr);
    dJointAttach(hinge, bodies_[body_of_[k + 1]], bodies_[body_of_[joint.parent]]);
    const Pose& pose = motions_[k + 1].pose;
    const Vec3 axis = rotate(pose.rotation, joint.axis);
    dJointSetHingeAnchor(hinge, pose.position.x, pose.position.y, pose.position.z);
    dJointSetHingeAxis(hinge, axis.x, axis.y, axis.z);
    double yielding = turning_ease(bodies_[body_of_[k + 1]], axis);
    if (const std::size_t parent = body_of_[joint.parent]; parent != 0) yielding += turning_ease(bodies_[parent], axis);
    hinges_.push_back({hinge, moving_of_joint_[k], 1.0 / yielding, {}});
  }
  // ODE keeps the addresses, so they are given once the vector has stopped growing.
  for (Hinge& hinge : hinges_) dJointSetFeedback(hinge.joint, &hinge.feedback);
}

/// Hangs the arm's and the blocks' shapes on their bodies.
void World::Simulation::place_geoms() {
  const auto hang = [](const Geom& geom, dBodyID body, const Pose& body_from_shape) {
    const Quat& q = body_from_shape.rotation;
    const dQuaternion rotation{q.w, q.x, q.y, q.z};
    // ODE loses the memory of an offset when the body changes under it.
    dGeomClearOffset(geom.id.get());
    dGeomSetBody(geom.id.get(), body);
    dGeomSetOffsetPosition(geom.id.get(), body_from_shape.position.x, body_from_shape.position.y,
                           body_from_shape.position.z);
    dGeomSetOffsetQuaternion(geom.id.get(), rotation);
  };
  for (const Geom& geom : link_geoms_) {
    hang(geom, bodies_[body_of_[geom.owner]], body_from_link_[geom.owner] * geom.owner_from_shape);
  }
  for (const Geom& geom : block_geoms_) {
    if (attached_ && !carried_apart() && attached_->block == geom.owner) {
      hang(geom, bodies_[body_of_[attached_->link]], body_from_link_[attached_->link] * attached_->link_from_block);
    } else {
      hang(geom, block_bodies_[geom.owner], Pose{});
    }
  }
}

/// Gives a carried block that has a body of its own a fixed joint. ODE takes the present places for those to keep, so the
/// block is put for a moment where it belongs.
void World::Simulation::hold_carried_block() {
  if (!carried_apart()) return;
  const dBodyID block = block_bodies_[attached_->block];
  const std::size_t body = body_of_[attached_->link];
  const Pose present = body_pose(block);
  set_body_pose(block, body_pose(bodies_[body]) * body_from_link_[attached_->link] * attached_->link_from_block);
  carrying_ = dJointCreateFixed(world_.get(), nullptr);
  dJointAttach(carrying_, block, bodies_[body]);
  dJointSetFixed(carrying_);
  set_body_pose(block, present);
}

void World::Simulation::build_arm() {
  if (reduced()) {
    build_tree();
    return;
  }
  built_base_ = world_from_base_;
  const std::vector<dBodyID> old_bodies = bodies_;
  for (const Hinge& hinge : hinges_) dJointDestroy(hinge.joint);
  hinges_.clear();
  if (carrying_ != nullptr) dJointDestroy(carrying_);
  carrying_ = nullptr;

  group_links();
  bodies_.clear();
  for (std::size_t body = 0; body < root_of_.size(); ++body) {
    bodies_.push_back(dBodyCreate(world_.get()));
    dBodySetAutoDisableFlag(bodies_.back(), 0);
  }

  // Shape of each body: rigid joints at their angles, free ones at zero.
  std::vector<double> zeros(positions_.size(), 0.0);
  for (std::size_t k = 0; k < model_.joints.size(); ++k) {
    if (moving_of_joint_[k] != npos && rigid(k)) zeros[moving_of_joint_[k]] = positions_[moving_of_joint_[k]];
  }
  place_links(zeros, motions_);
  set_masses();
  const auto place_bodies = [&] {
    for (std::size_t body = 0; body < bodies_.size(); ++body) {
      const std::size_t root = root_of_[body];
      set_body_pose(bodies_[body], motions_[root].pose * inverse(body_from_link_[root]));
    }
  };
  place_bodies();
  make_hinges();

  // Now to where the arm is, with the speeds that it has.
  place_links(positions_, motions_);
  place_bodies();
  for (std::size_t body = 0; body < bodies_.size(); ++body) {
    const LinkMotion& root = motions_[root_of_[body]];
    const Vec3 centre = to_vec(dBodyGetPosition(bodies_[body]));
    const Vec3 linear = root.linear + cross(root.angular, centre - root.pose.position);
    dBodySetLinearVel(bodies_[body], linear.x, linear.y, linear.z);
    dBodySetAngularVel(bodies_[body], root.angular.x, root.angular.y, root.angular.z);
  }
  // Infinitesimal rotation would leave the base behind its command by the square of the turn.
  dBodySetFiniteRotationMode(bodies_[0], 1);

  hold_carried_block();
  place_geoms();
  for (const dBodyID body : old_bodies) dBodyDestroy(body);
}

/// Finds which hand joints are at rest; true if that is another set than before.
bool World::Simulation::choose_rigid_joints(const double* position, const double* velocity) {
  bool changed = false;
  for (std::size_t k = model_.arm_count; k < model_.moving.size(); ++k) {
    const bool commanded = std::fabs(position[k] - last_command_[k]) > 1e-9 || std::fabs(velocity[k]) > 1e-9;
    const bool reached = std::fabs(position[k] - positions_[k]) < model_.options.hold_error &&
                         std::fabs(velocities_[k]) < model_.options.hold_speed;
    still_ticks_[k] = commanded || !(reached || held_[k]) ? 0 : still_ticks_[k] + 1;
    const bool hold = model_.options.hold_still_hand && still_ticks_[k] >= model_.options.hold_ticks;
    if (hold != held_[k]) {
      held_[k] = hold;
      velocities_[k] = hold ? 0.0 : velocities_[k];
      changed = true;
    }
  }
  std::copy(position, position + model_.moving.size(), last_command_.begin());
  return changed;
}

}  // namespace proact::dynamics
