#include "engines/reduced/near_links.hpp"

#include "no_index.hpp"

#include <algorithm>
#include <array>
#include <limits>

namespace proact::dynamics {

namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();
// Bounds of a shape that is far from everything.
constexpr std::array<dReal, 6> nowhere{infinity, -infinity, infinity, -infinity, infinity, -infinity};

}  // namespace

void NearLinks::hang(const LinkGroups& links) {
  spheres_.assign(links.body_count(), {{}, -1.0});
  body_from_shape_.resize(geoms_.links.size());
  for (std::size_t k = 0; k < geoms_.links.size(); ++k) {
    const Geom& geom = geoms_.links[k];
    Pose& body_from_shape = body_from_shape_[k];
    body_from_shape = links.body_from_link(geom.owner) * geom.owner_from_shape;
    Sphere& sphere = spheres_[links.body_of(geom.owner)];
    if (sphere.radius < 0.0) sphere = {body_from_shape.position, 0.0};
    sphere.radius = std::max(sphere.radius, norm(body_from_shape.position - sphere.centre) + geom.reach);
  }
}

bool NearLinks::near_anything(const Sphere& sphere) const {
  const auto near = [&](const Geom& geom) {
    const auto& b = geom.bounds;
    const auto& [c, r] = sphere;
    return c.x + r >= b[0] && c.x - r <= b[1] && c.y + r >= b[2] && c.y - r <= b[3] && c.z + r >= b[4] && c.z - r <= b[5];
  };
  return std::any_of(geoms_.fixed.begin(), geoms_.fixed.end(), near) ||
         std::any_of(geoms_.blocks.begin(), geoms_.blocks.end(), near);
}

void NearLinks::update(const LinkGroups& links, const ArmTree& tree) {
  std::size_t last = no_index;
  bool near = false;
  const Pose* next = body_from_shape_.data();
  for (Geom& geom : geoms_.links) {
    const Pose& body_from_shape = *next++;
    const std::size_t body = links.body_of(geom.owner);
    const Pose& pose = tree.placed()[body].pose;
    if (body != last) near = near_anything({pose * spheres_[body].centre, spheres_[body].radius});
    last = body;
    geom.bounds = nowhere;
    if (!near || !near_anything({pose * body_from_shape.position, geom.reach})) continue;
    geom.world_from_shape = pose * body_from_shape;
    set_geom_pose(geom.id.get(), geom.world_from_shape);
    dGeomGetAABB(geom.id.get(), geom.bounds.data());
  }
}

}  // namespace proact::dynamics
