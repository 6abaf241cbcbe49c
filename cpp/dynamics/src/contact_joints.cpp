#include "contact_joints.hpp"

#include <algorithm>

namespace proact::dynamics {

namespace {

// What slides no faster than this, m/s, has no direction; ODE then chooses one.
constexpr double min_slide_speed = 1e-6;
// So many contacts with blocks at rest are measured.
constexpr std::size_t max_resting_contacts = 512;

void set(dReal* out, const Vec3& v) {
  out[0] = v.x;
  out[1] = v.y;
  out[2] = v.z;
}

Vec3 speed_at(dBodyID body, const Vec3& point) {
  if (body == nullptr) return {};
  dVector3 speed;
  dBodyGetPointVel(body, point.x, point.y, point.z, speed);
  return to_vec(speed);
}

}  // namespace

ContactJoints::ContactJoints(const Options& options, dWorldID world)
    : options_(options), world_(world), group_(dJointGroupCreate(0)) {
  // ODE keeps the addresses, so this never grows.
  measured_.reserve(World::contact_capacity + max_resting_contacts);
}

void ContactJoints::clear() {
  dJointGroupEmpty(group_.get());
  measured_.clear();
}

void ContactJoints::add(const ContactConstraint& touch) {
  dContact contact{};
  contact.surface.mode = dContactApprox1 | dContactSoftERP | dContactSoftCFM;
  contact.surface.mu = touch.friction;
  contact.surface.soft_erp = options_.contact_erp;
  contact.surface.soft_cfm = options_.contact_cfm;
  set(contact.geom.pos, touch.point.position);
  set(contact.geom.normal, touch.point.normal);
  contact.geom.depth = touch.point.depth;
  // ODE bounds friction along two tangents. With one of them along the slide the bound is Coulomb's; ODE's own, which
  // look the same way whatever slides, brake by up to 1.41 times as much. The engine `ode` is left as Gazebo has it.
  if (options_.engine == Engine::reduced) {
    const Vec3 slip = speed_at(touch.first.body, touch.point.position) - speed_at(touch.second.body, touch.point.position);
    const Vec3 slide = slip - touch.point.normal * dot(slip, touch.point.normal);
    const double speed = norm(slide);
    if (speed > min_slide_speed) {
      contact.surface.mode |= dContactFDir1;
      set(contact.fdir1, slide * (1.0 / speed));
    }
  }
  const dJointID joint = dJointCreateContact(world_, group_.get(), &contact);
  dJointAttach(joint, touch.first.body, touch.second.body);
  // A force on a block at rest that is not measured counts as none, and wakes it.
  if ((touch.contact_index == no_index && touch.resting_block == no_index) || measured_.size() == measured_.capacity()) {
    return;
  }
  measured_.push_back({touch, {}});
  dJointSetFeedback(joint, &measured_.back().feedback);
}

void ContactJoints::read_forces(Collisions& collisions, LargeIslands& islands) const {
  for (const MeasuredContact& measured : measured_) {
    const ContactConstraint& touch = measured.touch;
    // ODE takes the second body for the first where there is no other.
    const double sign = touch.first.body == nullptr ? -1.0 : 1.0;
    islands.record_impulse(touch, to_vec(measured.feedback.f1) * (sign * tick_secs));
    if (touch.contact_index == no_index) continue;
    collisions.set_force(touch.contact_index, std::max(0.0, dot(to_vec(measured.feedback.f1),
                                                                collisions.contacts()[touch.contact_index].normal)));
  }
}

}  // namespace proact::dynamics
