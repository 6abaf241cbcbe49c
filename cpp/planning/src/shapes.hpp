// Shapes as FCL takes them, and the boxes and balls around them. Private to the library.
#pragma once

#include "proact/planning/scene.hpp"

#include <string>

namespace proact::planning {

/// A pose as FCL's shapes are placed by it.
Eigen::Isometry3d to_transform(const Pose& pose);

/// `pose` with a quaternion of length one. Throws std::invalid_argument naming `name` for a position that is not finite or
/// a quaternion whose length is not near one.
Pose validated_pose(const Pose& pose, const std::string& name);

/// The transform of a pose that may be refused, as by `validated_pose`.
inline Eigen::Isometry3d transform_of(const Pose& pose, const std::string& name) {
  return to_transform(validated_pose(pose, name));
}

/// Throws std::invalid_argument naming `name` if the shape has no extent, or is a mesh that makes no sense.
void require_extent(const Shape& shape, const std::string& name);

/// `shape` grown by `padding` on all sides. Negative padding shrinks it, but for a mesh, which
/// keeps its size.
Solid make_solid(const Shape& shape, double padding, const std::string& name);

/// The shape as FCL takes it, made when it is first asked for: a new padding remakes shapes of which few come that near.
const std::shared_ptr<fcl::CollisionGeometryd>& geometry_of(const Solid& solid);

/// Axis-aligned box around a shape.
Box bounds(const Solid& solid, const Eigen::Isometry3d& world_from_shape);

/// Farthest point of a shape from its own origin, metres.
double bounding_radius(const Solid& solid);

/// Distance, metres; zero where the two overlap. Asked for so often that it is worth having in place.
inline double distance(const Box& a, const Box& b) {
  return (a.low - b.high).cwiseMax(b.low - a.high).cwiseMax(Eigen::Vector3d::Zero()).norm();
}

/// True if the two shapes touch, by FCL.
bool shapes_collide(const Solid& a, const Eigen::Isometry3d& a_pose, const Solid& b, const Eigen::Isometry3d& b_pose);

}  // namespace proact::planning
