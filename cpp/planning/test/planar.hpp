// A planar arm among boxes, and checks that are sentences: shared by the tests.
#pragma once

#include "proact/planning/scene.hpp"

#include <cmath>
#include <cstdio>
#include <string>
#include <vector>

namespace proact::planning {

inline int failures = 0;

inline void check(bool holds, const char* sentence) {
  if (holds) return;
  ++failures;
  std::printf("does not hold: %s\n", sentence);
}

/// A planar arm in the x-y plane: three links of 0.3 m along x, each a capsule of radius 0.03 m, and one finger
/// of 0.1 m on a hand joint about z at the tip. The joint of link `slide` is drawn out along x and does not turn.
inline Arm planar_arm(std::size_t slide = 0) {
  Arm arm;
  const double half_pi_sine = std::sqrt(0.5);
  arm.links.push_back({"base", {}});
  for (const char* name : {"upper", "middle", "tip"}) {
    PlacedShape tube;
    tube.shape = {ShapeKind::capsule, {0.03, 0.24, 0.0}};
    tube.pose = {{0.15, 0.0, 0.0}, {0.0, half_pi_sine, 0.0, half_pi_sine}};
    arm.links.push_back({name, {tube}});
  }
  PlacedShape finger;
  finger.shape = {ShapeKind::box, {0.1, 0.02, 0.02}};
  finger.pose.position = {0.05, 0.0, 0.0};
  arm.links.push_back({"finger", {finger}});
  for (std::size_t k = 0; k < 4; ++k) {
    Joint joint;
    joint.parent = k;
    joint.child = k + 1;
    joint.kind = JointKind::revolute;
    if (k > 0) joint.pose.position = {0.3, 0.0, 0.0};
    if (slide == k + 1) {
      joint.kind = JointKind::prismatic;
      joint.axis = {1.0, 0.0, 0.0};
    }
    joint.lower = -2.5;
    joint.upper = 2.5;
    arm.joints.push_back(joint);
  }
  arm.arm = {0, 1, 2};
  arm.hand = {3};
  arm.tip = 3;
  arm.allowed_collisions = {{1, 2}, {2, 3}, {3, 4}};
  return arm;
}

inline Object box(const std::string& name, std::array<double, 3> size, const proact::Vec3& center) {
  Object object;
  object.name = name;
  object.placed.shape = {ShapeKind::box, size};
  object.placed.pose.position = center;
  return object;
}

/// A wall with a gap that the arm can only pass folded.
inline std::vector<Object> clutter() {
  return {box("left", {0.05, 0.5, 0.4}, {0.45, 0.45, 0.0}), box("right", {0.05, 0.5, 0.4}, {0.3, -0.5, 0.0})};
}

}  // namespace proact::planning
