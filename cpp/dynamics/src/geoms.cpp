#include "geoms.hpp"

#include <numeric>
#include <stdexcept>

namespace proact::dynamics {

namespace {

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
double bounding_radius_of(const Shape& shape) {
  const auto& size = shape.size;
  switch (shape.kind) {
    case ShapeKind::box: return 0.5 * norm({size[0], size[1], size[2]});
    case ShapeKind::sphere: return size[0];
    case ShapeKind::cylinder: return norm({size[0], 0.5 * size[1], 0.0});
    case ShapeKind::capsule: return size[0] + 0.5 * size[1];
  }
  throw std::invalid_argument("unknown kind of shape");
}

}  // namespace

void Geom::attach(dBodyID body, const Pose& body_from_shape) const {
  const Quat& q = body_from_shape.rotation;
  const dQuaternion rotation{q.w, q.x, q.y, q.z};
  // ODE loses the memory of an offset when the body changes under it.
  dGeomClearOffset(id.get());
  dGeomSetBody(id.get(), body);
  dGeomSetOffsetPosition(id.get(), body_from_shape.position.x, body_from_shape.position.y, body_from_shape.position.z);
  dGeomSetOffsetQuaternion(id.get(), rotation);
}

Geoms::Geoms(const Model& model) {
  for (std::size_t k = 0; k < model.links.size(); ++k) {
    for (const Collision& collision : model.links[k].collisions) {
      links.push_back({make_geom(collision.shape), collision.shape, k, collision.pose, {}, {},
                       bounding_radius_of(collision.shape)});
    }
  }
  near_links.resize(links.size());
  std::iota(near_links.begin(), near_links.end(), std::size_t{0});
  for (std::size_t k = 0; k < model.fixed.size(); ++k) {
    const FixedObject& object = model.fixed[k];
    fixed.push_back(
        {make_geom(object.shape), object.shape, k, Pose{}, object.pose, {}, bounding_radius_of(object.shape)});
    set_geom_pose(fixed.back().id.get(), object.pose);
  }
  for (std::size_t k = 0; k < model.blocks.size(); ++k) {
    const Shape& shape = model.blocks[k].shape;
    blocks.push_back({make_geom(shape), shape, k, Pose{}, {}, {}, bounding_radius_of(shape)});
  }
  update(fixed);
}

void Geoms::update(std::vector<Geom>& geoms) {
  for (Geom& geom : geoms) {
    dQuaternion q;
    dGeomGetQuaternion(geom.id.get(), q);
    geom.world_from_shape = {to_vec(dGeomGetPosition(geom.id.get())), to_quat(q)};
    dGeomGetAABB(geom.id.get(), geom.bounds.data());
  }
}

}  // namespace proact::dynamics
