#include "contact_joints.hpp"

#include <algorithm>

namespace proact::dynamics {

ContactJoints::ContactJoints(const Options& options, dWorldID world)
    : options_(options), world_(world), group_(dJointGroupCreate(0)) {
  // ODE keeps the addresses, so this never grows: no more contacts are listed.
  measured_.reserve(World::contact_capacity);
}

void ContactJoints::clear() {
  dJointGroupEmpty(group_.get());
  measured_.clear();
}

void ContactJoints::push(const Touch& touch) {
  dContact contact{};
  contact.surface.mode = dContactApprox1 | dContactSoftERP | dContactSoftCFM;
  contact.surface.mu = touch.friction;
  contact.surface.soft_erp = options_.contact_erp;
  contact.surface.soft_cfm = options_.contact_cfm;
  const auto set = [](dReal* out, const Vec3& v) {
    out[0] = v.x;
    out[1] = v.y;
    out[2] = v.z;
  };
  set(contact.geom.pos, touch.point.position);
  set(contact.geom.normal, touch.point.normal);
  contact.geom.depth = touch.point.depth;
  const dJointID joint = dJointCreateContact(world_, group_.get(), &contact);
  dJointAttach(joint, touch.first.body, touch.second.body);
  if (touch.listed == no_index) return;
  measured_.push_back({touch.listed, {}});
  dJointSetFeedback(joint, &measured_.back().feedback);
}

void ContactJoints::read_forces(Collisions& collisions) const {
  for (const Measured& measured : measured_) {
    const Vec3& normal = collisions.contacts()[measured.contact].normal;
    collisions.set_force(measured.contact, std::max(0.0, dot(to_vec(measured.feedback.f1), normal)));
  }
}

}  // namespace proact::dynamics
