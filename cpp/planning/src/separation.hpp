// How far apart two convex shapes are at least. Private to the library.
#pragma once

#include "proact/planning/scene.hpp"

#include <Eigen/Geometry>

namespace proact::planning {

/// A lower bound of the distance of two shapes, metres: zero or less if they are not proved to be apart.
///
/// By the algorithm of Gilbert, Johnson and Keerthi (IEEE J. Robotics and Automation 4(2), 1988), which ends as soon as the
/// bound is above `enough`, or within a twentieth of the distance. Each bound is the width of the gap between two parallel
/// planes that both shapes keep behind, so that it holds however far the algorithm has come. Depends on nothing but the
/// arguments. Zero for a mesh.
double distance_lower_bound(const Solid& a, const Eigen::Isometry3d& a_pose, const Solid& b,
                            const Eigen::Isometry3d& b_pose, double enough);

}  // namespace proact::planning
