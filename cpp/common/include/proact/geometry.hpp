// Vectors, quaternions and poses, and what an arm's joints do to them: shared by the C++ cores. Header only; plain C++17:
// no library, no cxx, no ROS.
//
// Metres and radians. A pose is `target_from_source`; twists and Jacobians are linear first, then angular. The crate
// `arm` is the same in Rust; KDL is the judge of both (cpp/kinematics/test, rust/kinematics/tests).
#pragma once

#include <array>
#include <cmath>
#include <cstdint>

namespace proact {

constexpr double pi = 3.14159265358979323846;

/// Three numbers: metres, m/s, rad/s or N, as the user says.
struct Vec3 {
  double x = 0.0;
  double y = 0.0;
  double z = 0.0;
};

inline Vec3 operator+(const Vec3& a, const Vec3& b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
inline Vec3 operator-(const Vec3& a, const Vec3& b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
inline Vec3 operator*(const Vec3& a, double s) { return {a.x * s, a.y * s, a.z * s}; }
inline double dot(const Vec3& a, const Vec3& b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
inline Vec3 cross(const Vec3& a, const Vec3& b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
inline double norm(const Vec3& a) { return std::sqrt(dot(a, a)); }
inline Vec3 normalized(const Vec3& a) { return a * (1.0 / norm(a)); }

/// A unit quaternion, scalar last.
struct Quat {
  double x = 0.0;
  double y = 0.0;
  double z = 0.0;
  double w = 1.0;
};

inline Quat operator*(const Quat& a, const Quat& b) {
  return {a.w * b.x + a.x * b.w + a.y * b.z - a.z * b.y, a.w * b.y - a.x * b.z + a.y * b.w + a.z * b.x,
          a.w * b.z + a.x * b.y - a.y * b.x + a.z * b.w, a.w * b.w - a.x * b.x - a.y * b.y - a.z * b.z};
}
inline Quat conjugate(const Quat& q) { return {-q.x, -q.y, -q.z, q.w}; }
inline Vec3 rotate(const Quat& q, const Vec3& v) {
  const Vec3 u{q.x, q.y, q.z};
  const Vec3 t = cross(u, v) * 2.0;
  return v + t * q.w + cross(u, t);
}
inline Quat normalized(const Quat& q) {
  const double length = std::sqrt(q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w);
  return {q.x / length, q.y / length, q.z / length, q.w / length};
}
/// Rotation by `angle` radians about the unit vector `axis`.
inline Quat about_axis(const Vec3& axis, double angle) {
  const double s = std::sin(0.5 * angle);
  return {axis.x * s, axis.y * s, axis.z * s, std::cos(0.5 * angle)};
}
/// Rotation vector (axis times angle, angle at most pi) of a unit quaternion.
inline Vec3 rotation_vector(const Quat& q) {
  const Vec3 u{q.x, q.y, q.z};
  const double s = norm(u);
  // Near zero the ratio angle / sin(angle / 2) is two; dividing by s would lose it.
  if (s < 1e-12) return u * (q.w < 0.0 ? -2.0 : 2.0);
  const double angle = 2.0 * std::atan2(q.w < 0.0 ? -s : s, std::fabs(q.w));
  return u * (angle / s);
}

/// A rigid transform `target_from_source`.
struct Pose {
  Vec3 position;
  Quat rotation;
};

/// `a_from_c` of `a_from_b` and `b_from_c`.
inline Pose operator*(const Pose& a, const Pose& b) {
  return {a.position + rotate(a.rotation, b.position), normalized(a.rotation * b.rotation)};
}
inline Vec3 operator*(const Pose& a, const Vec3& p) { return a.position + rotate(a.rotation, p); }
inline Pose inverse(const Pose& a) {
  const Quat back = conjugate(a.rotation);
  return {rotate(back, a.position) * -1.0, back};
}

/// How a joint moves the link that it carries: not at all, about its axis, rad, or along it, m.
enum class JointKind : std::uint8_t { fixed, revolute, prismatic };

/// A link that stands at `pose` while its joint is at zero, with the joint at `position`: turned about, or moved along, the
/// unit vector `axis` of its own frame. Forward kinematics is this of `world_from_parent * parent_from_child`, joint by joint.
inline Pose joint_pose(const Pose& pose, JointKind kind, const Vec3& axis, double position) {
  switch (kind) {
    case JointKind::revolute:
      return {pose.position, normalized(pose.rotation * about_axis(axis, position))};
    case JointKind::prismatic:
      return {pose.position + rotate(pose.rotation, axis) * position, pose.rotation};
    case JointKind::fixed:
      break;
  }
  return pose;
}
/// Velocity of the point `point` per unit of speed of a moving joint at `origin` with the unit vector `axis`, all in one
/// frame: the linear rows of its column of the geometric Jacobian. The angular ones are the axis, or zero if it slides.
inline Vec3 point_velocity(JointKind kind, const Vec3& axis, const Vec3& origin, const Vec3& point) {
  return kind == JointKind::prismatic ? axis : cross(axis, point - origin);
}

/// A pose as it crosses to Rust: position, then quaternion x, y, z, w.
template <typename Numbers>
Pose pose_from_array(const Numbers& n) {
  return {{n[0], n[1], n[2]}, {n[3], n[4], n[5], n[6]}};
}
inline std::array<double, 7> pose_to_array(const Pose& pose) {
  const auto& [p, q] = pose;
  return {p.x, p.y, p.z, q.x, q.y, q.z, q.w};
}

inline bool is_finite(const Vec3& v) { return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z); }
inline bool is_finite(const Quat& q) {
  return std::isfinite(q.x) && std::isfinite(q.y) && std::isfinite(q.z) && std::isfinite(q.w);
}
inline bool is_finite(const Pose& p) { return is_finite(p.position) && is_finite(p.rotation); }

}  // namespace proact
