#include "engines/reduced/arm_tree.hpp"

#include <algorithm>

namespace proact::dynamics {

namespace {

/// `parent` and the hinge give the child's place.
Pose child_pose(const Pose& parent, const ArmTree::Body& body, double position) {
  return joint_pose(parent * body.parent_from_hinge, body.kind, body.axis, position);
}

}  // namespace

SymmetricMatrix3 rotated(const Quat& q, const SymmetricMatrix3& m) {
  const Vec3 x = rotate(q, {1.0, 0.0, 0.0});
  const Vec3 y = rotate(q, {0.0, 1.0, 0.0});
  const Vec3 z = cross(x, y);
  // R m R^T with the columns x, y, z of R.
  const Vec3 a = x * m.xx + y * m.xy + z * m.xz;
  const Vec3 b = x * m.xy + y * m.yy + z * m.yz;
  const Vec3 c = x * m.xz + y * m.yz + z * m.zz;
  return {a.x * x.x + b.x * y.x + c.x * z.x, a.x * x.y + b.x * y.y + c.x * z.y, a.x * x.z + b.x * y.z + c.x * z.z,
          a.y * x.y + b.y * y.y + c.y * z.y, a.y * x.z + b.y * y.z + c.y * z.z, a.z * x.z + b.z * y.z + c.z * z.z};
}

Pose integrate_pose(const Pose& pose, const Vec3& linear, const Vec3& angular, double secs) {
  const double speed = norm(angular);
  const Quat turn = speed > 0.0 ? about_axis(angular * (1.0 / speed), speed * secs) : Quat{};
  return {pose.position + linear * secs, normalized(turn * pose.rotation)};
}

SymmetricMatrix3 point_inertia(double mass, const Vec3& r) {
  return {mass * (r.y * r.y + r.z * r.z), -mass * r.x * r.y, -mass * r.x * r.z,
          mass * (r.x * r.x + r.z * r.z), -mass * r.y * r.z, mass * (r.x * r.x + r.y * r.y)};
}

void ArmTree::resize() {
  placed_.resize(bodies.size());
  motions_.resize(bodies.size());
  composites_.resize(bodies.size());
}

void ArmTree::place(const Pose& world_from_base, const std::vector<double>& positions) {
  placed_[0].pose = world_from_base;
  for (std::size_t k = 1; k < bodies.size(); ++k) {
    const Body& body = bodies[k];
    PlacedBody& placed = placed_[k];
    placed.pose = child_pose(placed_[body.parent].pose, body, positions[body.moving]);
    placed.axis = rotate(placed.pose.rotation, body.axis);
    placed.center = rotate(placed.pose.rotation, body.center);
    placed.inertia = rotated(placed.pose.rotation, body.inertia);
  }
}

FrameMotion ArmTree::motion(std::size_t body, const FrameMotion& base, const std::vector<double>& positions,
                            const std::vector<double>& velocities) const {
  if (body == 0) return base;
  const Body& own = bodies[body];
  const FrameMotion parent = motion(own.parent, base, positions, velocities);
  FrameMotion out;
  out.pose = child_pose(parent.pose, own, positions[own.moving]);
  const Vec3 moving = rotate(out.pose.rotation, own.axis) * velocities[own.moving];
  out.angular = own.slides() ? parent.angular : parent.angular + moving;
  out.linear = parent.linear + cross(parent.angular, out.pose.position - parent.pose.position);
  if (own.slides()) out.linear = out.linear + moving;
  return out;
}

void ArmTree::inverse_dynamics(const BaseMotion& base, const Vec3& gravity, const double* velocity,
                               const double* acceleration, double* torque) {
  motions_[0].angular = base.angular;
  motions_[0].angular_acceleration = base.angular_acceleration;
  // Gravity acts like a base that accelerates upward.
  motions_[0].acceleration = base.linear_acceleration - gravity;
  for (std::size_t k = 1; k < bodies.size(); ++k) {
    const Body& body = bodies[k];
    const PlacedBody& placed = placed_[k];
    const Motion& parent = motions_[body.parent];
    Motion& own = motions_[k];
    const Vec3 moving = placed.axis * velocity[k - 1];
    const Vec3 arm = placed.pose.position - placed_[body.parent].pose.position;
    own.acceleration = parent.acceleration + cross(parent.angular_acceleration, arm) +
                       cross(parent.angular, cross(parent.angular, arm));
    if (body.slides()) {
      own.angular = parent.angular;
      own.angular_acceleration = parent.angular_acceleration;
      // The second part is Coriolis' acceleration.
      own.acceleration = own.acceleration + placed.axis * acceleration[k - 1] + cross(parent.angular, moving) * 2.0;
    } else {
      own.angular = parent.angular + moving;
      own.angular_acceleration =
          parent.angular_acceleration + placed.axis * acceleration[k - 1] + cross(parent.angular, moving);
    }
    const Vec3 center = own.acceleration + cross(own.angular_acceleration, placed.center) +
                        cross(own.angular, cross(own.angular, placed.center));
    own.force = center * body.mass;
    own.moment = placed.inertia * own.angular_acceleration + cross(own.angular, placed.inertia * own.angular) +
                 cross(placed.center, own.force);
  }
  for (std::size_t k = bodies.size() - 1; k > 0; --k) {
    const Motion& own = motions_[k];
    torque[k - 1] = dot(placed_[k].axis, bodies[k].slides() ? own.force : own.moment);
    const std::size_t parent = bodies[k].parent;
    if (parent == 0) continue;
    const Vec3 arm = placed_[k].pose.position - placed_[parent].pose.position;
    motions_[parent].force = motions_[parent].force + own.force;
    motions_[parent].moment = motions_[parent].moment + own.moment + cross(arm, own.force);
  }
}

void ArmTree::mass_matrix(std::vector<double>& out) {
  const std::size_t n = hinge_count();
  for (std::size_t k = 1; k < bodies.size(); ++k) {
    const PlacedBody& placed = placed_[k];
    composites_[k] = {bodies[k].mass, placed.center * bodies[k].mass,
                      placed.inertia + point_inertia(bodies[k].mass, placed.center)};
  }
  for (std::size_t k = bodies.size() - 1; k > 0; --k) {
    const std::size_t parent = bodies[k].parent;
    if (parent == 0) continue;
    const Composite& own = composites_[k];
    Composite& sum = composites_[parent];
    const Vec3 r = placed_[k].pose.position - placed_[parent].pose.position;
    const Vec3& h = own.first_moment;
    const double both = 2.0 * dot(r, h);
    sum.second_moment = sum.second_moment + own.second_moment + point_inertia(own.mass, r) +
                        SymmetricMatrix3{both - 2.0 * r.x * h.x, -(r.x * h.y + r.y * h.x), -(r.x * h.z + r.z * h.x),
                                         both - 2.0 * r.y * h.y, -(r.y * h.z + r.z * h.y), both - 2.0 * r.z * h.z};
    sum.first_moment = sum.first_moment + h + r * own.mass;
    sum.mass += own.mass;
  }
  std::fill(out.begin(), out.begin() + static_cast<std::ptrdiff_t>(n * n), 0.0);
  for (std::size_t k = 1; k < bodies.size(); ++k) {
    // What the joint's unit acceleration takes: a force, and a moment about the joint's own place.
    const Vec3& axis = placed_[k].axis;
    const Composite& own = composites_[k];
    const bool slides = bodies[k].slides();
    const Vec3 force = slides ? axis * own.mass : cross(axis, own.first_moment);
    Vec3 moment = slides ? cross(own.first_moment, axis) : own.second_moment * axis;
    out[(k - 1) * n + k - 1] = dot(axis, slides ? force : moment);
    for (std::size_t j = k; bodies[j].parent != 0;) {
      const std::size_t parent = bodies[j].parent;
      moment = moment + cross(placed_[j].pose.position - placed_[parent].pose.position, force);
      j = parent;
      const double value = dot(placed_[j].axis, bodies[j].slides() ? force : moment);
      out[(k - 1) * n + j - 1] = value;
      out[(j - 1) * n + k - 1] = value;
    }
  }
}

}  // namespace proact::dynamics
