#include "engines/ode/ode_arm.hpp"

#include <algorithm>
#include <iterator>

namespace proact::dynamics {

namespace {

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
double inverse_inertia_about(dBodyID body, const Vec3& axis) {
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

/// Of a free body, 1/kg.
double inverse_mass(dBodyID body) {
  dMass mass;
  dBodyGetMass(body, &mass);
  return 1.0 / mass.mass;
}

}  // namespace

OdeArm::OdeArm(const ArmContext& surroundings)
    : Arm(surroundings.model.links.size()),
      model_(surroundings.model),
      world_(surroundings.world),
      base_(surroundings.base),
      joints_(surroundings.joints),
      control_(surroundings.control),
      blocks_(surroundings.blocks),
      carrying_(surroundings.carrying),
      geoms_(surroundings.geoms),
      contact_joints_(surroundings.contact_joints),
      islands_(surroundings.islands),
      motions_(surroundings.model.links.size()),
      arm_connected_(surroundings.blocks.count(), false) {}

/// Finds poses and twists of all links at `positions` and the present speeds. Expects that of the base.
void OdeArm::place_links(const std::vector<double>& positions) {
  for (std::size_t k = 0; k < model_.joints.size(); ++k) {
    const Joint& joint = model_.joints[k];
    const FrameMotion& parent = motions_[joint.parent];
    FrameMotion& child = motions_[k + 1];
    child.pose = parent.pose * joint.origin;
    child.angular = parent.angular;
    const std::size_t moving = joints_.moving_index(k);
    Vec3 own;
    if (moving != no_index) {
      child.pose = joint_pose(child.pose, joint.kind, joint.axis, positions[moving]);
      own = rotate(child.pose.rotation, joint.axis) * joints_.velocities()[moving];
    }
    child.linear = parent.linear + cross(parent.angular, child.pose.position - parent.pose.position);
    if (joint.kind == JointKind::prismatic) {
      child.linear = child.linear + own;
    } else if (moving != no_index) {
      child.angular = child.angular + own;
    }
  }
}

void OdeArm::place_bodies() {
  for (std::size_t body = 0; body < bodies_.size(); ++body) {
    const std::size_t root = links_.root_of(body);
    set_body_pose(bodies_[body], motions_[root].pose * inverse(links_.body_from_link(root)));
  }
}

/// Gives each body the mass of its links and of a carried block, and finds body_from_link(). ODE's bodies have
/// their origin in the centre of mass; their axes are those of the first link. Expects motions_.
void OdeArm::set_masses() {
  for (std::size_t body = 0; body < links_.body_count(); ++body) {
    const Pose root_from_world = inverse(motions_[links_.root_of(body)].pose);
    dMass total;
    dMassSetZero(&total);
    for (std::size_t link = 0; link < model_.links.size(); ++link) {
      if (links_.body_of(link) != body) continue;
      links_.body_from_link(link) = root_from_world * motions_[link].pose;
      if (model_.links[link].mass <= 0.0) continue;
      const dMass mass = link_mass(model_.links[link], links_.body_from_link(link));
      dMassAdd(&total, &mass);
    }
    if (body == 0) {
      // The base goes where it is told, whatever it weighs; its origin is that of the base link.
      dBodySetKinematic(bodies_[body]);
      continue;
    }
    add_attached_mass(body, total);
    const Vec3 center = to_vec(total.c);
    dMassTranslate(&total, -center.x, -center.y, -center.z);
    // Rounding leaves a remainder, and ODE asks for exactly zero.
    std::fill(std::begin(total.c), std::end(total.c), 0.0);
    dBodySetMass(bodies_[body], &total);
    for (std::size_t link = 0; link < model_.links.size(); ++link) {
      if (links_.body_of(link) != body) continue;
      Pose& body_from_link = links_.body_from_link(link);
      body_from_link.position = body_from_link.position - center;
    }
  }
}

/// Adds the carried block to the mass of a body that it is part of.
void OdeArm::add_attached_mass(std::size_t body, dMass& total) const {
  if (!carrying_.is_merged()) return;
  const Attachment& attachment = *carrying_.attached();
  if (links_.body_of(attachment.link) != body) return;
  dMass mass;
  dBodyGetMass(blocks_.body(attachment.block), &mass);
  const Pose place = links_.body_from_link(attachment.link) * attachment.link_from_block;
  const dQuaternion q{place.rotation.w, place.rotation.x, place.rotation.y, place.rotation.z};
  dMatrix3 matrix;
  dQtoR(q, matrix);
  dMassRotate(&mass, matrix);
  dMassTranslate(&mass, place.position.x, place.position.y, place.position.z);
  dMassAdd(&total, &mass);
}

/// Expects the bodies placed with all free joints at angle zero, so that ODE's angles are the model's.
void OdeArm::make_hinges() {
  hinges_.clear();
  for (std::size_t k = 0; k < model_.joints.size(); ++k) {
    if (joints_.rigid(k)) continue;
    const Joint& joint = model_.joints[k];
    const dBodyID child = bodies_[links_.body_of(k + 1)];
    const std::size_t parent = links_.body_of(joint.parent);
    const bool slides = joint.kind == JointKind::prismatic;
    const dJointID hinge = slides ? dJointCreateSlider(world_, nullptr) : dJointCreateHinge(world_, nullptr);
    dJointAttach(hinge, child, bodies_[parent]);
    const Pose& pose = motions_[k + 1].pose;
    const Vec3 axis = rotate(pose.rotation, joint.axis);
    if (slides) {
      dJointSetSliderAxis(hinge, axis.x, axis.y, axis.z);
    } else {
      dJointSetHingeAnchor(hinge, pose.position.x, pose.position.y, pose.position.z);
      dJointSetHingeAxis(hinge, axis.x, axis.y, axis.z);
    }
    const auto inverse_inertia = [&](dBodyID body) {
      return slides ? inverse_mass(body) : inverse_inertia_about(body, axis);
    };
    double yielding = inverse_inertia(child);
    if (parent != 0) yielding += inverse_inertia(bodies_[parent]);
    hinges_.push_back({hinge, joints_.moving_index(k), slides, 1.0 / yielding, {}});
  }
  // ODE keeps the addresses, so they are given once the vector has stopped growing.
  for (Hinge& hinge : hinges_) dJointSetFeedback(hinge.joint, &hinge.feedback);
}

/// Hangs the arm's and the blocks' shapes on their bodies.
void OdeArm::attach_geoms() {
  for (const Geom& geom : geoms_.links) {
    geom.attach(bodies_[links_.body_of(geom.owner)], links_.body_from_link(geom.owner) * geom.owner_from_shape);
  }
  for (const Geom& geom : geoms_.blocks) {
    if (carrying_.is_merged_block(geom.owner)) {
      const Attachment& attachment = *carrying_.attached();
      geom.attach(bodies_[links_.body_of(attachment.link)],
                  links_.body_from_link(attachment.link) * attachment.link_from_block);
    } else {
      geom.attach(blocks_.body(geom.owner), Pose{});
    }
  }
}

/// Gives a carried block that has a body of its own a fixed joint. ODE takes the present places for those to keep, so the
/// block is put for a moment where it belongs.
void OdeArm::attach_block() {
  if (!carrying_.is_separate()) return;
  const Attachment& attachment = *carrying_.attached();
  const dBodyID block = blocks_.body(attachment.block);
  const dBodyID body = bodies_[links_.body_of(attachment.link)];
  const Pose present = body_pose(block);
  set_body_pose(block, body_pose(body) * links_.body_from_link(attachment.link) * attachment.link_from_block);
  attachment_joint_ = dJointCreateFixed(world_, nullptr);
  dJointAttach(attachment_joint_, block, body);
  dJointSetFixed(attachment_joint_);
  set_body_pose(block, present);
}

void OdeArm::build_at(const Pose& world_from_base) {
  built_base_ = world_from_base;
  const std::vector<dBodyID> old_bodies = bodies_;
  for (const Hinge& hinge : hinges_) dJointDestroy(hinge.joint);
  hinges_.clear();
  if (attachment_joint_ != nullptr) dJointDestroy(attachment_joint_);
  attachment_joint_ = nullptr;

  links_.join(model_, joints_);
  bodies_.clear();
  for (std::size_t body = 0; body < links_.body_count(); ++body) {
    bodies_.push_back(dBodyCreate(world_));
    dBodySetAutoDisableFlag(bodies_.back(), 0);
  }

  // Shape of each body: rigid joints at their angles, free ones at zero.
  const std::vector<double>& positions = joints_.positions();
  std::vector<double> zeros(positions.size(), 0.0);
  for (std::size_t k = 0; k < model_.joints.size(); ++k) {
    const std::size_t moving = joints_.moving_index(k);
    if (moving != no_index && joints_.rigid(k)) zeros[moving] = positions[moving];
  }
  motions_[0] = base_.motion();
  motions_[0].pose = world_from_base;
  place_links(zeros);
  set_masses();
  place_bodies();
  make_hinges();

  // Now to where the arm is, with the speeds that it has.
  place_links(positions);
  place_bodies();
  for (std::size_t body = 0; body < bodies_.size(); ++body) {
    const FrameMotion& root = motions_[links_.root_of(body)];
    const Vec3 center = to_vec(dBodyGetPosition(bodies_[body]));
    set_body_velocity(bodies_[body], root.linear + cross(root.angular, center - root.pose.position), root.angular);
  }
  // Infinitesimal rotation would leave the base behind its command by the square of the turn.
  dBodySetFiniteRotationMode(bodies_[0], 1);

  attach_block();
  attach_geoms();
  for (const dBodyID body : old_bodies) dBodyDestroy(body);
}

/// A motor at its speed yields by the world's softness; one that is driven by gains by their inverse, which makes ODE
/// solve for their torque at the end of the tick: torque - slope * speed.
void OdeArm::set_motor(const Hinge& hinge, const Motor& motor) const {
  const bool gains = motor.gain_damping > 0.0;
  const auto set = [&](int parameter, double value) {
    hinge.slides ? dJointSetSliderParam(hinge.joint, parameter, value) : dJointSetHingeParam(hinge.joint, parameter, value);
  };
  set(dParamVel, gains ? motor.torque / motor.gain_damping : motor.speed);
  set(dParamFMax, gains ? dInfinity : motor.limit);
  set(dParamCFM, gains ? 1.0 / motor.gain_damping : model_.options.joint_cfm);
}

/// Damping and friction act as they do at the end of the tick (implicit Euler, of each joint by itself): taken from
/// its start, they would shake light fingers that no control holds ever faster.
void OdeArm::drive(const double* position, const double* velocity) {
  const FrameMotion base = base_.motion();
  set_body_velocity(bodies_[0], base.linear, base.angular);
  for (const Hinge& hinge : hinges_) {
    const std::size_t k = hinge.moving;
    const Motor motor = control_.motor(k, position[k], velocity[k]);
    set_motor(hinge, motor);
    const double rubbing = motor.damping - motor.gain_damping;
    const double torque = -rubbing * joints_.velocities()[k] / (1.0 + tick_secs * rubbing / hinge.inertia);
    hinge.slides ? dJointAddSliderForce(hinge.joint, torque) : dJointAddHingeTorque(hinge.joint, torque);
  }
}

void OdeArm::place_geoms() {
  Geoms::update(geoms_.links);
  Geoms::update(geoms_.blocks);
}

/// Blocks that hang together with the arm by contacts stay awake: ODE wakes them, but one that the arm pushes slowly
/// would be put to sleep again in each tick, and lose its speed there.
void OdeArm::keep_awake(const std::vector<ContactConstraint>& touches) {
  std::fill(arm_connected_.begin(), arm_connected_.end(), false);
  const auto moves = [&](const ContactSide& side) {
    return side.block == no_index ? side.body != nullptr : static_cast<bool>(arm_connected_[side.block]);
  };
  const auto hang = [&](const ContactSide& side) {
    if (side.block == no_index || arm_connected_[side.block]) return false;
    arm_connected_[side.block] = true;
    blocks_.keep_awake(side.block);
    return true;
  };
  for (bool grown = true; grown;) {
    grown = false;
    for (const ContactConstraint& touch : touches) {
      if (moves(touch.first)) grown = hang(touch.second) || grown;
      if (moves(touch.second)) grown = hang(touch.first) || grown;
    }
  }
}

bool OdeArm::resolve_contacts(Collisions&) {
  keep_awake(islands_.remaining_constraints());
  for (const ContactConstraint& touch : islands_.remaining_constraints()) contact_joints_.add(touch);
  islands_.begin_solve();
  islands_.solve();
  return true;
}

/// ODE gives angles from -pi to pi. A joint with limits keeps the full turns that it had before the tick.
double OdeArm::position(const Hinge& hinge) const {
  if (hinge.slides) return dJointGetSliderPosition(hinge.joint);
  const double angle = dJointGetHingeAngle(hinge.joint);
  const Joint& joint = model_.joints[model_.moving[hinge.moving]];
  if (std::isinf(joint.lower) || std::isinf(joint.upper)) return angle;
  const double turns = std::round((joints_.positions()[hinge.moving] - angle) / (2.0 * pi));
  return turns == 0.0 ? angle : angle + 2.0 * pi * turns;
}

/// The speed of a joint. ODE's own rate of a slider leaves out how the turning parent carries the child's centre of mass along.
double OdeArm::speed(const Hinge& hinge) {
  if (!hinge.slides) return dJointGetHingeAngleRate(hinge.joint);
  dVector3 axis_at;
  dJointGetSliderAxis(hinge.joint, axis_at);
  const dBodyID child = dJointGetBody(hinge.joint, 0);
  const dBodyID parent = dJointGetBody(hinge.joint, 1);
  const Vec3 lever = to_vec(dBodyGetPosition(child)) - to_vec(dBodyGetPosition(parent));
  const Vec3 carried = linear_velocity(parent) + cross(angular_velocity(parent), lever);
  return dot(to_vec(axis_at), linear_velocity(child) - carried);
}

/// The torque on the child about the axis, or the force along it.
double OdeArm::bearing_effort(const Hinge& hinge) {
  dVector3 axis_at;
  if (hinge.slides) {
    dJointGetSliderAxis(hinge.joint, axis_at);
    return dot(to_vec(axis_at), to_vec(hinge.feedback.f1));
  }
  // The bearing's force is taken out by its lever.
  dVector3 anchor_at;
  dJointGetHingeAnchor(hinge.joint, anchor_at);
  dJointGetHingeAxis(hinge.joint, axis_at);
  const Vec3 lever = to_vec(anchor_at) - to_vec(dBodyGetPosition(dJointGetBody(hinge.joint, 0)));
  return dot(to_vec(axis_at), to_vec(hinge.feedback.t1) - cross(lever, to_vec(hinge.feedback.f1)));
}

void OdeArm::finish() {
  // Takes away the rounding of ODE's own integration, so that it cannot add up.
  set_body_pose(bodies_[0], base_.pose());
  joints_.clear_efforts();
  for (const Hinge& hinge : hinges_) {
    const double effort = bearing_effort(hinge);
    const double limit_effort = control_.limit_effort(hinge.moving, effort);
    joints_.set_state(hinge.moving, position(hinge), speed(hinge), effort - limit_effort, limit_effort);
  }
}

FrameMotion OdeArm::motion(std::size_t body) const {
  const dBodyID id = bodies_[body];
  return {body_pose(id), linear_velocity(id), angular_velocity(id)};
}

bool OdeArm::all_finite() const {
  return std::all_of(bodies_.begin(), bodies_.end(), [](dBodyID body) { return is_finite(body); });
}

Arm::State OdeArm::state() const {
  State state{built_base_, std::vector<int>(model_.moving.size(), 0), {}};
  for (const dBodyID body : bodies_) state.bodies.push_back(OdeBodyState::capture(body));
  return state;
}

void OdeArm::restore(const State& state) {
  // Where the base was when the bodies were last built decides how their shape was rounded. Their places are saved
  // beside the angles, because they carry the small errors of ODE's joints.
  build_at(state.built_base);
  for (std::size_t k = 0; k < bodies_.size(); ++k) state.bodies[k].restore(bodies_[k]);
}

}  // namespace proact::dynamics
