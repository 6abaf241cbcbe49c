// The arm in joint positions: rigid bodies on a tree of hinges and slides. Places follow from the positions, so that joints
// cannot come apart. Vectors are in world axes unless a name says otherwise.
#pragma once

#include "frame_motion.hpp"
#include "proact/dynamics/model.hpp"

#include <cstddef>
#include <vector>

namespace proact::dynamics {

/// A symmetric matrix, such as an inertia, kg m^2.
struct SymmetricMatrix3 {
  double xx = 0.0;
  double xy = 0.0;
  double xz = 0.0;
  double yy = 0.0;
  double yz = 0.0;
  double zz = 0.0;
};

inline SymmetricMatrix3 operator+(const SymmetricMatrix3& a, const SymmetricMatrix3& b) {
  return {a.xx + b.xx, a.xy + b.xy, a.xz + b.xz, a.yy + b.yy, a.yz + b.yz, a.zz + b.zz};
}
inline Vec3 operator*(const SymmetricMatrix3& m, const Vec3& v) {
  return {m.xx * v.x + m.xy * v.y + m.xz * v.z, m.xy * v.x + m.yy * v.y + m.yz * v.z,
          m.xz * v.x + m.yz * v.y + m.zz * v.z};
}
/// The same matrix in the axes that `q` turns its own into.
SymmetricMatrix3 rotated(const Quat& q, const SymmetricMatrix3& m);
/// Inertia of `mass` at `r` about the origin.
SymmetricMatrix3 point_inertia(double mass, const Vec3& r);

/// Where a frame is after `secs` at a constant twist.
Pose integrate_pose(const Pose& pose, const Vec3& linear, const Vec3& angular, double secs);

class ArmTree {
 public:
  /// Body 0 is the base, which goes where it is told; joint k, revolute or prismatic, moves body k + 1.
  struct Body {
    std::size_t parent = 0;
    std::size_t moving = 0;  ///< index of the joint vector
    Pose parent_from_hinge;
    JointKind kind = JointKind::revolute;
    Vec3 axis;               ///< own axes

    bool slides() const { return kind == JointKind::prismatic; }
    double mass = 0.0;
    Vec3 center;                    ///< of mass, own frame
    SymmetricMatrix3 inertia;       ///< about the centre of mass, own axes
  };
  /// A body as it stands.
  struct PlacedBody {
    Pose pose;
    Vec3 axis;
    Vec3 center;               ///< of mass, from the body's origin
    SymmetricMatrix3 inertia;  ///< about the centre of mass
  };

  std::vector<Body> bodies;

  std::size_t hinge_count() const { return bodies.size() - 1; }
  const std::vector<PlacedBody>& placed() const { return placed_; }

  /// Takes over the number of bodies.
  void resize();
  /// Places all bodies; `positions` by moving joint.
  void place(const Pose& world_from_base, const std::vector<double>& positions);
  /// Place and twist of one body.
  FrameMotion motion(std::size_t body, const FrameMotion& base, const std::vector<double>& positions,
                     const std::vector<double>& velocities) const;
  /// Torques, of slides forces, one for each hinge, under which it has accelerations `acceleration` at speeds `velocity`. By Newton's
  /// and Euler's laws from the base outward and back (Featherstone, Rigid Body Dynamics Algorithms, 5.3).
  void inverse_dynamics(const BaseMotion& base, const Vec3& gravity, const double* velocity,
                        const double* acceleration, double* torque);
  /// Mass matrix, hinge_count() squared numbers (Featherstone, 6.2: composite rigid bodies).
  void mass_matrix(std::vector<double>& out);

 private:
  struct Motion {
    Vec3 angular;
    Vec3 angular_acceleration;
    Vec3 acceleration;  ///< of the origin
    Vec3 force;
    Vec3 moment;        ///< about the origin
  };
  /// A body with all that it carries, about the body's origin.
  struct Composite {
    double mass;
    Vec3 first_moment;  ///< mass times centre
    SymmetricMatrix3 second_moment;
  };

  std::vector<PlacedBody> placed_;
  std::vector<Motion> motions_;
  std::vector<Composite> composites_;
};

}  // namespace proact::dynamics
