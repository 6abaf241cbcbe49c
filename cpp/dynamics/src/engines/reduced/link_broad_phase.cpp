#include "engines/reduced/link_broad_phase.hpp"

#include "no_index.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace proact::dynamics {

namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();
// Bounds of a shape that is far from everything.
constexpr std::array<dReal, 6> empty_bounds{infinity, -infinity, infinity, -infinity, infinity, -infinity};
// What a shape of a body is near is looked for among what the body is near with this much more, metres: rounding must
// not lose anything.
constexpr double bounds_margin = 1e-6;

/// Whether a sphere reaches into bounds. Without branches, which nobody could foretell.
bool sphere_overlaps_bounds(const Vec3& c, double r, const std::array<dReal, 6>& b) {
  return (c.x + r >= b[0]) & (c.x - r <= b[1]) & (c.y + r >= b[2]) & (c.y - r <= b[3]) & (c.z + r >= b[4]) & (c.z - r <= b[5]);
}

}  // namespace

void LinkBroadPhase::attach_shapes(const LinkGroups& links) {
  spheres_.assign(links.body_count(), {{}, -1.0});
  body_from_shape_.resize(geoms_.links.size());
  far_bounds_.assign(geoms_.links.size(), {});
  runs_.clear();
  runs_.reserve(geoms_.links.size());
  for (std::size_t k = 0; k < geoms_.links.size(); ++k) {
    const Geom& geom = geoms_.links[k];
    const std::size_t body = links.body_of(geom.owner);
    Pose& body_from_shape = body_from_shape_[k];
    body_from_shape = links.body_from_link(geom.owner) * geom.owner_from_shape;
    Sphere& sphere = spheres_[body];
    if (sphere.radius < 0.0) sphere = {body_from_shape.position, 0.0};
    sphere.radius = std::max(sphere.radius, norm(body_from_shape.position - sphere.center) + geom.bounding_radius);
    if (runs_.empty() || runs_.back().body != body) runs_.push_back({body, k, k, false, {}});
    runs_.back().last = k + 1;
  }
  obstacles_.resize(geoms_.fixed.size() + geoms_.blocks.size());
  near_obstacles_.reserve(obstacles_.size());
  for (std::size_t k = 0; k < geoms_.fixed.size(); ++k) obstacles_[k] = geoms_.fixed[k].bounds;
}

/// Takes over the blocks' bounds.
void LinkBroadPhase::update_block_bounds() {
  std::array<dReal, 6>* known = obstacles_.data() + geoms_.fixed.size();
  double farthest = 0.0;
  for (const Geom& block : geoms_.blocks) {
    for (std::size_t k = 0; k < 6; ++k) farthest = std::max(farthest, std::abs(block.bounds[k] - (*known)[k]));
    *known++ = block.bounds;
  }
  block_travel_m_ += farthest;
}

/// For what is near nothing.
LinkBroadPhase::FarBound LinkBroadPhase::far_bound(const Sphere& sphere) const {
  const auto& [c, r] = sphere;
  double least = infinity;
  for (const std::array<dReal, 6>& b : obstacles_) {
    const double x = std::max(b[0] - c.x, c.x - b[1]);
    const double y = std::max(b[2] - c.y, c.y - b[3]);
    const double z = std::max(b[4] - c.z, c.z - b[5]);
    least = std::min(least, std::max({x, y, z}) - r);
  }
  return {c, block_travel_m_ + least - bounds_margin};
}

bool LinkBroadPhase::stays_far(const FarBound& far, const Vec3& center) const {
  const Vec3 way = center - far.center;
  const double left = far.travel - block_travel_m_;
  return (std::abs(way.x) < left) & (std::abs(way.y) < left) & (std::abs(way.z) < left);
}

/// Finds what a body is close to; whether it is near anything.
bool LinkBroadPhase::find_near_obstacles(const Sphere& sphere) {
  near_obstacles_.clear();
  bool near = false;
  for (const std::array<dReal, 6>& bounds : obstacles_) {
    if (!sphere_overlaps_bounds(sphere.center, sphere.radius + bounds_margin, bounds)) continue;
    near_obstacles_.push_back(bounds);
    near = near || sphere_overlaps_bounds(sphere.center, sphere.radius, bounds);
  }
  return near;
}

/// Brings the shapes of a body at `pose` up to date that are near anything in `near_obstacles_`; whether none is.
bool LinkBroadPhase::update_shapes(const ShapeRun& run, const Pose& pose) {
  bool none = true;
  for (std::size_t k = run.first; k < run.last; ++k) {
    Geom& geom = geoms_.links[k];
    const Vec3 center = pose * body_from_shape_[k].position;
    if (stays_far(far_bounds_[k], center)) {
      geom.bounds = empty_bounds;
      continue;
    }
    const auto near = [&](const std::array<dReal, 6>& bounds) {
      return sphere_overlaps_bounds(center, geom.bounding_radius, bounds);
    };
    if (std::none_of(near_obstacles_.begin(), near_obstacles_.end(), near)) {
      geom.bounds = empty_bounds;
      far_bounds_[k] = far_bound({center, geom.bounding_radius});
      continue;
    }
    geom.world_from_shape = pose * body_from_shape_[k];
    set_geom_pose(geom.id.get(), geom.world_from_shape);
    dGeomGetAABB(geom.id.get(), geom.bounds.data());
    geoms_.near_links.push_back(k);
    none = false;
  }
  return none;
}

void LinkBroadPhase::update(const ArmTree& tree) {
  update_block_bounds();
  geoms_.near_links.clear();
  for (ShapeRun& run : runs_) {
    const Pose& pose = tree.placed()[run.body].pose;
    const Sphere sphere{pose * spheres_[run.body].center, spheres_[run.body].radius};
    if (stays_far(run.far_bound, sphere.center)) continue;
    if (find_near_obstacles(sphere)) {
      run.is_far = update_shapes(run, pose);
      continue;
    }
    if (!run.is_far) {
      for (std::size_t k = run.first; k < run.last; ++k) geoms_.links[k].bounds = empty_bounds;
      run.is_far = true;
    }
    run.far_bound = far_bound(sphere);
  }
}

}  // namespace proact::dynamics
