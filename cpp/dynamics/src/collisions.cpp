// Who touches whom. Every pair is visited in the same order whatever happened before, so that the contacts and
// with them the results depend on nothing but the state.

#include "simulation.hpp"

#include <algorithm>
#include <stdexcept>

namespace proact::dynamics {

namespace {

// Things may start with this much overlap, metres; more would push them apart visibly.
constexpr double allowed_overlap = 1e-3;

GeomPtr make_geom(const Shape& shape) {
  const auto& size = shape.size;
  switch (shape.kind) {
    case ShapeKind::box: return GeomPtr(dCreateBox(nullptr, size[0], size[1], size[2]));
    case ShapeKind::sphere: return GeomPtr(dCreateSphere(nullptr, size[0]));
    case ShapeKind::cylinder: return GeomPtr(dCreateCylinder(nullptr, size[0], size[1]));
    case ShapeKind::capsule: return GeomPtr(dCreateCapsule(nullptr, size[0], size[1]));
  }
  throw std::invalid_argument("unknown kind of shape");
}

/// Radius of the sphere around a shape.
double reach_of(const Shape& shape) {
  const auto& size = shape.size;
  switch (shape.kind) {
    case ShapeKind::box: return 0.5 * norm({size[0], size[1], size[2]});
    case ShapeKind::sphere: return size[0];
    case ShapeKind::cylinder: return norm({size[0], 0.5 * size[1], 0.0});
    case ShapeKind::capsule: return size[0] + 0.5 * size[1];
  }
  throw std::invalid_argument("unknown kind of shape");
}

bool apart(const std::array<dReal, 6>& a, const std::array<dReal, 6>& b) {
  return a[0] > b[1] || b[0] > a[1] || a[2] > b[3] || b[2] > a[3] || a[4] > b[5] || b[4] > a[5];
}

}  // namespace

void World::Simulation::make_geoms() {
  for (std::size_t k = 0; k < model_.links.size(); ++k) {
    for (const Collision& collision : model_.links[k].collisions) {
      link_geoms_.push_back({make_geom(collision.shape), collision.shape, k, collision.pose, {}, {}, reach_of(collision.shape), {}});
    }
  }
  for (std::size_t k = 0; k < model_.fixed.size(); ++k) {
    const FixedObject& object = model_.fixed[k];
    fixed_geoms_.push_back({make_geom(object.shape), object.shape, k, Pose{}, object.pose, {}, reach_of(object.shape), {}});
    const dGeomID geom = fixed_geoms_.back().id.get();
    const dQuaternion q{object.pose.rotation.w, object.pose.rotation.x, object.pose.rotation.y, object.pose.rotation.z};
    dGeomSetPosition(geom, object.pose.position.x, object.pose.position.y, object.pose.position.z);
    dGeomSetQuaternion(geom, q);
  }
  for (std::size_t k = 0; k < model_.blocks.size(); ++k) {
    const Shape& shape = model_.blocks[k].shape;
    block_geoms_.push_back({make_geom(shape), shape, k, Pose{}, {}, {}, reach_of(shape), {}});
  }
  update(fixed_geoms_);
}

void World::Simulation::update(std::vector<Geom>& geoms) {
  for (Geom& geom : geoms) {
    dQuaternion q;
    dGeomGetQuaternion(geom.id.get(), q);
    geom.world_from_shape = {to_vec(dGeomGetPosition(geom.id.get())), to_quat(q)};
    dGeomGetAABB(geom.id.get(), geom.bounds.data());
  }
}

void World::Simulation::update_moving_geoms() {
  if (reduced()) {
    if (attached_) {
      const Pose link = tree_.placed()[body_of_[attached_->link]].pose * body_from_link_[attached_->link];
      const Pose pose = link * attached_->link_from_block;
      set_geom_pose(block_geoms_[attached_->block].id.get(), pose);
    }
    update(block_geoms_);
    update_link_geoms();
  } else {
    update(link_geoms_);
    update(block_geoms_);
  }
}

World::Simulation::Side World::Simulation::side_of_block(std::size_t block) const {
  if (attached_ && !carried_apart() && attached_->block == block) return side_of_link(attached_->link);
  return {block_bodies_[block], block, npos};
}

World::Simulation::Side World::Simulation::side_of_link(std::size_t link) const {
  const std::size_t body = body_of_[link];
  return reduced() ? Side{nullptr, npos, body} : Side{bodies_[body], npos, npos};
}

bool World::Simulation::resting(std::size_t block) const {
  return !(attached_ && attached_->block == block) && dBodyIsEnabled(block_bodies_[block]) == 0;
}

void World::Simulation::collide() {
  dJointGroupEmpty(contact_group_.get());
  contacts_.clear();
  measured_.clear();
  waiting_.clear();
  update_moving_geoms();
  collide_links_with_fixed();
  collide_blocks_with_fixed();
  collide_blocks();
  collide_blocks_with_links();
}

void World::Simulation::collide_links_with_fixed() {
  for (const Geom& link : link_geoms_) {
    // Neither the base nor the room can be moved by a push.
    if (body_of_[link.owner] == 0) continue;
    for (const Geom& fixed : fixed_geoms_) {
      if (apart(link.bounds, fixed.bounds)) continue;
      find_contacts({&link.shape, link.world_from_shape, link.id.get()},
                    {&fixed.shape, fixed.world_from_shape, fixed.id.get()}, found_);
      const Touch touch{side_of_link(link.owner), {}, model_.fixed[fixed.owner].friction};
      for (std::size_t k = 0; k < found_.count; ++k) touch_at(touch, found_.points[k], npos);
    }
  }
}

void World::Simulation::collide_blocks_with_fixed() {
  for (const Geom& block : block_geoms_) {
    if (resting(block.owner)) continue;
    bool touches = false;
    for (const Geom& fixed : fixed_geoms_) {
      if (apart(block.bounds, fixed.bounds)) continue;
      find_contacts({&block.shape, block.world_from_shape, block.id.get()},
                    {&fixed.shape, fixed.world_from_shape, fixed.id.get()}, found_);
      const double friction = std::min(model_.blocks[block.owner].friction, model_.fixed[fixed.owner].friction);
      const Touch touch{side_of_block(block.owner), {}, friction};
      for (std::size_t k = 0; k < found_.count; ++k) touch_at(touch, found_.points[k], npos);
      touches = touches || found_.count > 0;
    }
    if (touches) resist_rolling(block);
  }
}

void World::Simulation::resist_rolling(const Geom& block) {
  if (block.shape.kind == ShapeKind::box || (attached_ && attached_->block == block.owner)) return;
  const dBodyID body = block_bodies_[block.owner];
  const Vec3 turning = to_vec(dBodyGetAngularVel(body));
  const double speed = norm(turning);
  if (speed < 1e-9) return;
  const double mass = model_.blocks[block.owner].mass;
  const double radius = block.shape.size[0];
  // At most what stops a solid cylinder within two ticks, so that the torque never turns it back.
  const double stopping = 0.25 * mass * radius * radius * speed / tick_secs;
  const double torque =
      std::min(model_.options.rolling_resistance * mass * norm(model_.options.gravity) * radius, stopping) / speed;
  dBodyAddTorque(body, -torque * turning.x, -torque * turning.y, -torque * turning.z);
}

void World::Simulation::collide_blocks() {
  for (std::size_t i = 0; i < block_geoms_.size(); ++i) {
    for (std::size_t j = i + 1; j < block_geoms_.size(); ++j) {
      const Geom& a = block_geoms_[i];
      const Geom& b = block_geoms_[j];
      if (apart(a.bounds, b.bounds) || (resting(i) && resting(j))) continue;
      find_contacts({&a.shape, a.world_from_shape, a.id.get()}, {&b.shape, b.world_from_shape, b.id.get()}, found_);
      const double friction = std::min(model_.blocks[i].friction, model_.blocks[j].friction);
      const Touch touch{side_of_block(i), side_of_block(j), friction};
      for (std::size_t k = 0; k < found_.count; ++k) touch_at(touch, found_.points[k], npos);
    }
  }
}

void World::Simulation::collide_blocks_with_links() {
  const std::size_t links = model_.links.size();
  for (const Geom& block : block_geoms_) {
    if (attached_ && attached_->block == block.owner) continue;
    // Shapes of one link stand together, so one pass sees whether any of them still overlaps the block.
    for (std::size_t first = 0; first < link_geoms_.size();) {
      const std::size_t link = link_geoms_[first].owner;
      const bool acts = parted_[block.owner * links + link];
      bool overlaps = false;
      std::size_t next = first;
      for (; next < link_geoms_.size() && link_geoms_[next].owner == link; ++next) {
        const Geom& geom = link_geoms_[next];
        if (apart(block.bounds, geom.bounds)) continue;
        find_contacts({&block.shape, block.world_from_shape, block.id.get()},
                      {&geom.shape, geom.world_from_shape, geom.id.get()}, found_);
        overlaps = overlaps || found_.count > 0;
        if (!acts) continue;
        const Touch touch{side_of_block(block.owner), side_of_link(link), model_.blocks[block.owner].friction_finger};
        for (std::size_t k = 0; k < found_.count; ++k) {
          const ContactPoint& point = found_.points[k];
          const bool listed = contacts_.size() < contact_capacity;
          if (listed) contacts_.push_back({block.owner, link, point.position, point.normal, 0.0});
          touch_at(touch, point, listed ? contacts_.size() - 1 : npos);
        }
      }
      if (!overlaps) parted_[block.owner * links + link] = true;
      first = next;
    }
  }
}

/// `measured`: the entry of contacts_ that tells its force, or npos.
void World::Simulation::touch_at(const Touch& touch, const ContactPoint& point, std::size_t measured) {
  if (reduced()) {
    waiting_.push_back({touch, point, measured});
    return;
  }
  dJointFeedback* feedback = nullptr;
  if (measured != npos) {
    // Space is reserved for contact_capacity of them, so that the addresses stay.
    measured_.push_back({measured, {}});
    feedback = &measured_.back().feedback;
  }
  push(touch, point, feedback);
}

void World::Simulation::push(const Touch& touch, const ContactPoint& point, dJointFeedback* feedback) {
  dContact contact{};
  contact.surface.mode = dContactApprox1 | dContactSoftERP | dContactSoftCFM;
  contact.surface.mu = touch.friction;
  contact.surface.soft_erp = model_.options.contact_erp;
  contact.surface.soft_cfm = model_.options.contact_cfm;
  const auto set = [](dReal* out, const Vec3& v) {
    out[0] = v.x;
    out[1] = v.y;
    out[2] = v.z;
  };
  set(contact.geom.pos, point.position);
  set(contact.geom.normal, point.normal);
  contact.geom.depth = point.depth;
  const dJointID joint = dJointCreateContact(world_.get(), contact_group_.get(), &contact);
  dJointAttach(joint, touch.first.body, touch.second.body);
  if (feedback != nullptr) dJointSetFeedback(joint, feedback);
}

void World::Simulation::refuse_overlaps() {
  if (reduced()) tree_.place(world_from_base_, positions_);
  update_moving_geoms();
  const auto refuse = [&](const Geom& block, const Geom& other, const std::string& name) {
    if (apart(block.bounds, other.bounds)) return;
    find_contacts({&block.shape, block.world_from_shape, block.id.get()},
                  {&other.shape, other.world_from_shape, other.id.get()}, found_);
    for (std::size_t k = 0; k < found_.count; ++k) {
      if (found_.points[k].depth > allowed_overlap) {
        throw std::invalid_argument("block \"" + model_.blocks[block.owner].name + "\" starts " +
                                    std::to_string(1e3 * found_.points[k].depth) + " mm inside " + name +
                                    ", at most 1 mm is allowed");
      }
    }
  };
  for (const Geom& block : block_geoms_) {
    for (const Geom& fixed : fixed_geoms_) refuse(block, fixed, "\"" + model_.fixed[fixed.owner].name + "\"");
    for (const Geom& link : link_geoms_) refuse(block, link, "link \"" + model_.links[link.owner].name + "\"");
    for (const Geom& other : block_geoms_) {
      if (other.owner > block.owner) refuse(block, other, "block \"" + model_.blocks[other.owner].name + "\"");
    }
  }
}

}  // namespace proact::dynamics
