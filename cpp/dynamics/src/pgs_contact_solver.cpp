#include "pgs_contact_solver.hpp"

#include "proact/dynamics/model.hpp"

#include <algorithm>
#include <cmath>

namespace proact::dynamics {

namespace {

// A point whose bodies have changed by less than this share of what is small need not be put right again.
constexpr double skip_ratio = 0.1;

/// Adds what an impulse at `lever` of a body does to the speed there.
void add_response(SymmetricMatrix3& sum, const PgsContactSolver::Body& body, const Vec3& lever) {
  const auto column = [&](const Vec3& direction) { return cross(body.inverse_inertia * cross(lever, direction), lever); };
  const Vec3 x = column({1.0, 0.0, 0.0});
  const Vec3 y = column({0.0, 1.0, 0.0});
  const Vec3 z = column({0.0, 0.0, 1.0});
  const double m = body.inverse_mass;
  sum = sum + SymmetricMatrix3{x.x + m, x.y, x.z, y.y + m, y.z, z.z + m};
}

/// The bodies of a point; null for what stands still.
struct BodyPair {
  PgsContactSolver::Body* first;
  PgsContactSolver::Body* second;

  BodyPair(std::vector<PgsContactSolver::Body>& bodies, const PgsContactSolver::Point& point)
      : first(point.first != no_index ? &bodies[point.first] : nullptr),
        second(point.second != no_index ? &bodies[point.second] : nullptr) {}

  double changed() const {
    return (first != nullptr ? first->changed : 0.0) + (second != nullptr ? second->changed : 0.0);
  }

  /// Speed of the first against the second at a point.
  Vec3 relative_velocity(const PgsContactSolver::Point& point) const {
    Vec3 speed{};
    if (first != nullptr) speed = first->linear + cross(first->angular, point.first_lever);
    if (second != nullptr) speed = speed - second->linear - cross(second->angular, point.second_lever);
    return speed;
  }

  // Of the sweeps' time a tenth went into calling it.
  [[gnu::always_inline]] void apply_impulse(const PgsContactSolver::Point& point, const Vec3& impulse) const {
    const double size = std::fabs(impulse.x) + std::fabs(impulse.y) + std::fabs(impulse.z);
    if (first != nullptr) {
      first->linear = first->linear + impulse * first->inverse_mass;
      first->changed += size * first->inverse_mass;
      first->angular = first->angular + first->inverse_inertia * cross(point.first_lever, impulse);
    }
    if (second != nullptr) {
      second->linear = second->linear - impulse * second->inverse_mass;
      second->changed += size * second->inverse_mass;
      second->angular = second->angular - second->inverse_inertia * cross(point.second_lever, impulse);
    }
  }
};

}  // namespace

SymmetricMatrix3 inverse(const SymmetricMatrix3& m) {
  const double a = m.yy * m.zz - m.yz * m.yz;
  const double b = m.xz * m.yz - m.xy * m.zz;
  const double c = m.xy * m.yz - m.xz * m.yy;
  const double scale = 1.0 / (m.xx * a + m.xy * b + m.xz * c);
  return {a * scale, b * scale, c * scale,
          (m.xx * m.zz - m.xz * m.xz) * scale, (m.xy * m.xz - m.xx * m.yz) * scale,
          (m.xx * m.yy - m.xy * m.xy) * scale};
}

void PgsContactSolver::reserve(std::size_t most_bodies, std::size_t most_points) {
  bodies.reserve(most_bodies);
  points.reserve(most_points);
  responses_.reserve(most_points);
  previous_impulses_.reserve(most_points);
  search_direction_.reserve(most_points);
}

void PgsContactSolver::begin() {
  skip_threshold_ = 0.0;
  responses_.clear();
  const double soft = normal_softness / tick_secs;
  const double sideways_soft = friction_softness / tick_secs;
  for (Point& point : points) {
    SymmetricMatrix3 response{};
    if (point.first != no_index) add_response(response, bodies[point.first], point.first_lever);
    if (point.second != no_index) add_response(response, bodies[point.second], point.second_lever);
    const Vec3& n = point.normal;
    const double along = dot(n, response * n);
    // The two numbers of the part across the normal sum to its trace, so that neither is larger.
    const double across = response.xx + response.yy + response.zz - along;
    const double more = soft - sideways_soft;
    response = response +
               SymmetricMatrix3{sideways_soft + more * n.x * n.x, more * n.x * n.y, more * n.x * n.z,
                                sideways_soft + more * n.y * n.y, more * n.y * n.z, sideways_soft + more * n.z * n.z};
    responses_.push_back({inverse(response), along + soft, 1.0 / (along + soft), 1.0 / (across + sideways_soft)});

    // A guess is kept within the cone of this tick's normal.
    const double normal = std::max(0.0, dot(point.impulse, n));
    Vec3 across_part = point.impulse - n * dot(point.impulse, n);
    const double size = norm(across_part);
    if (size > point.friction * normal) across_part = across_part * (point.friction * normal / size);
    point.impulse = n * normal + across_part;
    BodyPair(bodies, point).apply_impulse(point, point.impulse);
  }
}

double PgsContactSolver::relax(std::size_t which) {
  Point& point = points[which];
  const BodyPair two(bodies, point);
  if (two.changed() - point.last_change <= skip_threshold_ && point.last_change >= 0.0) return 0.0;
  const Response& response = responses_[which];
  const Vec3 n = point.normal;
  const Vec3 before = point.impulse;
  const double soft = normal_softness / tick_secs;
  const double sideways_soft = friction_softness / tick_secs;

  // What the laws lack: speed and softness times impulse should be the wanted speed.
  const double pressed = dot(before, n);
  const Vec3 lack =
      n * (point.speed - (soft - sideways_soft) * pressed) - two.relative_velocity(point) - before * sideways_soft;

  // The impulse under which the point sticks, if friction can bear that.
  Vec3 wanted = before + response.inverse * lack;
  const double normal = dot(wanted, n);
  const Vec3 across = wanted - n * normal;
  if (normal <= 0.0 || dot(across, across) > point.friction * point.friction * normal * normal) {
    // Else along the normal, and then across within the bound. Where neither changes, Coulomb's law holds exactly.
    const double lacks_along = dot(lack, n);
    const double new_normal = std::max(0.0, pressed + response.along_inverse * lacks_along);
    Vec3 sideways = before - n * pressed + (lack - n * lacks_along) * response.across_inverse;
    const double bound = point.friction * new_normal;
    const double size = norm(sideways);
    if (size > bound) sideways = sideways * (bound / size);
    wanted = n * new_normal + sideways;
  }
  const Vec3 change = wanted - before;
  point.impulse = wanted;
  two.apply_impulse(point, change);
  point.last_change = two.changed();
  return std::max(std::fabs(change.x), std::max(std::fabs(change.y), std::fabs(change.z))) * response.along;
}

double PgsContactSolver::sweep() {
  for (std::size_t k = 0; k < points.size(); ++k) relax(k);
  double largest = 0.0;
  for (std::size_t k = points.size(); k-- > 0;) largest = std::max(largest, relax(k));
  return largest;
}

double PgsContactSolver::mean_speed() const {
  double sum = 0.0;
  for (const Body& body : bodies) sum += dot(body.linear, body.linear);
  return bodies.empty() ? 0.0 : std::sqrt(sum / static_cast<double>(bodies.size()));
}

/// What a pair of sweeps changes is taken for a slope, and the way for that of conjugate gradients.
bool PgsContactSolver::solve(int most, double small) {
  if (points.empty()) return true;
  skip_threshold_ = skip_ratio * small;
  previous_impulses_.resize(points.size());
  search_direction_.assign(points.size(), Vec3{});
  double last_square = 0.0;
  for (int round = 1;; ++round) {
    for (std::size_t k = 0; k < points.size(); ++k) previous_impulses_[k] = points[k].impulse;
    const double largest = sweep();
    // Ends with a sweep, so that no impulse lies outside its cone.
    if (largest <= small || round >= most) return largest <= small;
    double square = 0.0;
    for (std::size_t k = 0; k < points.size(); ++k) {
      previous_impulses_[k] = points[k].impulse - previous_impulses_[k];
      square += dot(previous_impulses_[k], previous_impulses_[k]);
    }
    const double share = last_square > 0.0 ? square / last_square : 2.0;
    last_square = square;
    if (share >= 1.0) {
      // It leads astray: begin anew along the slope.
      for (std::size_t k = 0; k < points.size(); ++k) search_direction_[k] = previous_impulses_[k];
      continue;
    }
    for (std::size_t k = 0; k < points.size(); ++k) {
      const Vec3 further = search_direction_[k] * share;
      points[k].impulse = points[k].impulse + further;
      BodyPair(bodies, points[k]).apply_impulse(points[k], further);
      search_direction_[k] = further + previous_impulses_[k];
    }
  }
}

}  // namespace proact::dynamics
