// A robot description as plain values, read by urdfdom. Plain C++17: no cxx, no ROS.
#pragma once

#include "proact/geometry.hpp"

#include <array>
#include <cstdint>
#include <string>
#include <vector>

namespace proact::description {

enum class ShapeKind : std::uint8_t { box, cylinder, sphere, mesh };

struct Shape {
  ShapeKind kind{};
  /// box: side lengths; cylinder: radius, length, 0; sphere: radius, 0, 0; mesh: scale factors.
  std::array<double, 3> size{};
  /// Address of a mesh, otherwise empty.
  std::string file;
};

struct Collision {
  Pose pose;
  Shape shape;
};

struct Visual {
  Pose pose;
  Shape shape;
  /// Red, green, blue, alpha, 0 to 1; light grey when the description gives none.
  std::array<double, 4> color{};
};

struct Link {
  std::string name;
  bool has_inertial = false;
  double mass = 0.0;
  Pose inertial_pose;
  /// ixx, ixy, ixz, iyy, iyz, izz.
  std::array<double, 6> inertia{};
  std::vector<Collision> collisions;
  std::vector<Visual> visuals;
};

/// Those of URDF; `unknown` where urdfdom understood none.
enum class JointKind : std::uint8_t { fixed, revolute, continuous, prismatic, planar, floating, unknown };

struct Joint {
  std::string name;
  JointKind kind = JointKind::unknown;
  std::string parent;
  std::string child;
  Pose origin;
  std::array<double, 3> axis{};
  bool has_limits = false;
  /// lower, upper, velocity, effort.
  std::array<double, 4> limits{};
  double damping = 0.0;
  double friction = 0.0;
  /// Name of the joint that it follows; empty if it follows none.
  std::string mimic_joint;
  /// Its angle is the multiplier times the other's, and the offset more.
  double mimic_multiplier = 1.0;
  double mimic_offset = 0.0;
};

/// Links and joints in alphabetical order: urdfdom does not keep the file's order.
struct Robot {
  std::string name;
  std::string root;
  std::vector<Link> links;
  std::vector<Joint> joints;
};

/// Reads the text of a URDF file.
///
/// Throws std::runtime_error with everything that urdfdom logged when it refuses the text or leaves out a part of
/// it. Safe to call from
/// several threads: urdfdom's log handler is process-wide, so calls wait for each other.
///
/// Masses, lengths and limits are passed on as they stand; judging them is the caller's work.
Robot read_urdf(const std::string& text);

/// Where the links called `links` are, root link's frame, with the joints called `joints` at `angles`, rad, and all others
/// at zero: by urdfdom's own tree, quaternions and vectors. For comparison with other arithmetic.
///
/// Throws std::runtime_error as read_urdf, and for a name that there is not.
std::vector<Pose> link_poses(const std::string& text, const std::vector<std::string>& joints,
                             const std::vector<double>& angles, const std::vector<std::string>& links);

}  // namespace proact::description
