#include "separation.hpp"

#include <algorithm>
#include <array>
#include <cmath>

namespace proact::planning {

namespace {

using Vector = Eigen::Vector3d;

/// Most steps of the algorithm: shapes that are apart take five on average.
constexpr int max_gjk_steps = 24;
/// The bound is near enough to the distance when it lacks less than this share of it, or this many metres.
constexpr double relative_tolerance = 0.05;
constexpr double absolute_tolerance_m = 1e-6;

/// A shape without its rounding: spheres are points, capsules segments.
class Core {
 public:
  Core(const Solid& solid, const Eigen::Isometry3d& pose) : shape_(solid.shape), pose_(pose) {
    if (shape_.kind == ShapeKind::sphere || shape_.kind == ShapeKind::capsule) rounding_ = shape_.size[0];
  }

  double rounding() const { return rounding_; }
  Vector center() const { return pose_.translation(); }

  /// The point that is farthest along `d`, which need not be a unit vector.
  Vector farthest(const Vector& d) const {
    Vector point = pose_.translation();
    const auto& r = pose_.linear();
    switch (shape_.kind) {
      case ShapeKind::box:
        for (int k = 0; k < 3; ++k) {
          const auto side = r.col(k);
          point += std::copysign(0.5 * shape_.size[static_cast<std::size_t>(k)], d.dot(side)) * side;
        }
        break;
      case ShapeKind::cylinder: {
        const Vector axis = r.col(2);
        const double along = d.dot(axis);
        const Vector across = d - along * axis;
        const double length = across.norm();
        point += std::copysign(0.5 * shape_.size[1], along) * axis;
        if (length > 1e-12) point += (shape_.size[0] / length) * across;
        break;
      }
      case ShapeKind::capsule: {
        const Vector axis = r.col(2);
        point += std::copysign(0.5 * shape_.size[1], d.dot(axis)) * axis;
        break;
      }
      case ShapeKind::sphere:
      case ShapeKind::mesh: break;
    }
    return point;
  }

 private:
  const Shape& shape_;
  const Eigen::Isometry3d& pose_;
  double rounding_ = 0.0;
};

/// Up to four points whose hull approaches the origin.
class Simplex {
 public:
  void add(const Vector& point) { points_[count_++] = point; }

  /// The point of the hull that is nearest to the origin; points that it does not depend on are dropped.
  Vector nearest() {
    switch (count_) {
      case 1: return points_[0];
      case 2: return of_segment();
      case 3: return of_triangle();
      default: return of_tetrahedron();
    }
  }

 private:
  Vector keep(std::initializer_list<Vector> points, const Vector& nearest) {
    count_ = 0;
    for (const Vector& point : points) points_[count_++] = point;
    return nearest;
  }

  Vector of_segment() {
    const Vector a = points_[0];
    const Vector b = points_[1];
    const Vector ab = b - a;
    const double t = -a.dot(ab);
    const double squares = ab.squaredNorm();
    if (t <= 0.0) return keep({a}, a);
    if (t >= squares) return keep({b}, b);
    return a + (t / squares) * ab;
  }

  /// By the regions of the triangle's corners, edges and face (Ericson, Real-Time Collision Detection, 2005, 5.1.5).
  Vector of_triangle() {
    const Vector a = points_[0];
    const Vector b = points_[1];
    const Vector c = points_[2];
    const Vector ab = b - a;
    const Vector ac = c - a;
    const double d1 = -ab.dot(a);
    const double d2 = -ac.dot(a);
    if (d1 <= 0.0 && d2 <= 0.0) return keep({a}, a);
    const double d3 = -ab.dot(b);
    const double d4 = -ac.dot(b);
    if (d3 >= 0.0 && d4 <= d3) return keep({b}, b);
    const double vc = d1 * d4 - d3 * d2;
    if (vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0) return keep({a, b}, a + (d1 / (d1 - d3)) * ab);
    const double d5 = -ab.dot(c);
    const double d6 = -ac.dot(c);
    if (d6 >= 0.0 && d5 <= d6) return keep({c}, c);
    const double vb = d5 * d2 - d1 * d6;
    if (vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0) return keep({a, c}, a + (d2 / (d2 - d6)) * ac);
    const double va = d3 * d6 - d5 * d4;
    if (va <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0) {
      return keep({b, c}, b + ((d4 - d3) / ((d4 - d3) + (d5 - d6))) * (c - b));
    }
    const double whole = va + vb + vc;
    return a + (vb / whole) * ab + (vc / whole) * ac;
  }

  Vector of_tetrahedron() {
    const std::array<Vector, 4> all = points_;
    constexpr std::array<std::array<std::size_t, 4>, 4> faces{{{0, 1, 2, 3}, {0, 1, 3, 2}, {0, 2, 3, 1}, {1, 2, 3, 0}}};
    Simplex best;
    Vector nearest = Vector::Zero();
    double least = 0.0;
    bool outside = false;
    for (const auto& [i, j, k, opposite] : faces) {
      const Vector normal = (all[j] - all[i]).cross(all[k] - all[i]);
      const double origin_side = -all[i].dot(normal);
      const double inner_side = (all[opposite] - all[i]).dot(normal);
      if (origin_side * inner_side > 0.0) continue;
      Simplex face;
      face.keep({all[i], all[j], all[k]}, nearest);
      const Vector point = face.of_triangle();
      const double squares = point.squaredNorm();
      if (!outside || squares < least) {
        outside = true;
        best = face;
        nearest = point;
        least = squares;
      }
    }
    if (outside) *this = best;
    return nearest;
  }

  std::array<Vector, 4> points_;
  std::size_t count_ = 0;
};

}  // namespace

double distance_lower_bound(const Solid& a, const Eigen::Isometry3d& a_pose, const Solid& b,
                            const Eigen::Isometry3d& b_pose, double enough) {
  if (a.shape.kind == ShapeKind::mesh || b.shape.kind == ShapeKind::mesh) return 0.0;
  const Core one(a, a_pose);
  const Core other(b, b_pose);
  const double rounding = one.rounding() + other.rounding();
  Simplex simplex;
  Vector to_one = one.center() - other.center();
  double bound = 0.0;
  for (int step = 0; step < max_gjk_steps; ++step) {
    const double length = to_one.norm();
    // The cores are no farther apart than this.
    if (length <= rounding + absolute_tolerance_m) break;
    const Vector point = one.farthest(-to_one) - other.farthest(to_one);
    bound = std::max(bound, to_one.dot(point) / length);
    if (bound - rounding > enough || length - bound <= relative_tolerance * (length - rounding) + absolute_tolerance_m) {
      break;
    }
    simplex.add(point);
    to_one = simplex.nearest();
  }
  return bound - rounding;
}

}  // namespace proact::planning
