// The part of FCL that the planner uses, under the names of FCL 0.6 and later; FCL 0.5 (Ubuntu 20.04) has others.
#pragma once

#include <Eigen/Geometry>

#if __has_include(<fcl/narrowphase/collision.h>)

#include <fcl/broadphase/broadphase_dynamic_AABB_tree.h>
#include <fcl/geometry/bvh/BVH_model.h>
#include <fcl/geometry/collision_geometry.h>
#include <fcl/geometry/shape/box.h>
#include <fcl/geometry/shape/capsule.h>
#include <fcl/geometry/shape/cylinder.h>
#include <fcl/geometry/shape/sphere.h>
#include <fcl/narrowphase/collision.h>
#include <fcl/narrowphase/collision_object.h>
#include <fcl/narrowphase/distance.h>

namespace proact::planning {

inline const Eigen::Isometry3d& to_fcl(const Eigen::Isometry3d& pose) { return pose; }
inline const Eigen::Vector3d& to_fcl(const Eigen::Vector3d& point) { return point; }

}  // namespace proact::planning

#else

#include <fcl/BVH/BVH_model.h>
#include <fcl/broadphase/broadphase_dynamic_AABB_tree.h>
#include <fcl/collision.h>
#include <fcl/collision_object.h>
#include <fcl/distance.h>
#include <fcl/shape/geometric_shapes.h>

namespace fcl {

using Boxd = Box;
using Capsuled = Capsule;
using CollisionGeometryd = CollisionGeometry;
using CollisionObjectd = CollisionObject;
using CollisionRequestd = CollisionRequest;
using CollisionResultd = CollisionResult;
using Cylinderd = Cylinder;
using DistanceRequestd = DistanceRequest;
using DistanceResultd = DistanceResult;
using DynamicAABBTreeCollisionManagerd = DynamicAABBTreeCollisionManager;
using OBBRSSd = OBBRSS;
using Sphered = Sphere;
using Vector3d = Vec3f;

}  // namespace fcl

namespace proact::planning {

inline fcl::Vec3f to_fcl(const Eigen::Vector3d& point) { return {point[0], point[1], point[2]}; }
inline fcl::Transform3f to_fcl(const Eigen::Isometry3d& pose) {
  const auto r = pose.linear();
  return {fcl::Matrix3f(r(0, 0), r(0, 1), r(0, 2), r(1, 0), r(1, 1), r(1, 2), r(2, 0), r(2, 1), r(2, 2)),
          to_fcl(Eigen::Vector3d(pose.translation()))};
}

}  // namespace proact::planning

#endif
