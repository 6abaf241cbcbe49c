#include "engines/reduced/velocity_problem.hpp"

#include "engines/reduced/vector_ops.hpp"
#include "proact/dynamics/model.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace proact::dynamics {

namespace {

// Three to six steps are usual.
constexpr int max_newton_steps = 60;
// From this round on the bound of friction goes half the way, lest it swings to and fro.
constexpr int undamped_bound_rounds = 12;
// Friction has settled when no bound changes by more than this share of the largest.
constexpr double bound_tolerance = 1e-4;
// A step that changes no speed by more than this (rad/s, m/s) is none.
constexpr double step_tolerance = 1e-12;
// The same while something slips, whose direction turns a little with each step.
constexpr double sliding_step_tolerance = 1e-10;
// The factors of a step that left no more than this share of the slope along it serve the next one as well.
constexpr double factor_reuse_ratio = 0.1;
// Along a step the slope is zero when no more than this share of it is left.
constexpr double line_search_tolerance = 1e-3;
constexpr int max_line_search_steps = 20;
// Steps whose bounds follow: five are usual, and one that is longer than the one before ends the try.
constexpr int max_coupled_steps = 12;

int saturation_side(double value, double limit) { return value > limit ? 1 : (value < -limit ? -1 : 0); }

/// Impulse of a gear that brakes beyond a speed.
double brake_impulse(const VelocityProblem::Hinge& hinge, double speed) {
  return hinge.brake_gain * (std::clamp(speed, -hinge.max_speed, hinge.max_speed) - speed);
}

/// Impulse of a contact whose gap is so wide: along its normal, and against the slip within the bound of friction.
std::array<double, 3> impulse_of(const VelocityProblem::Contact& contact, const std::array<double, 3>& wanted) {
  const double sideways = std::sqrt(wanted[1] * wanted[1] + wanted[2] * wanted[2]);
  const double share = sideways > contact.friction_bound ? contact.friction_bound / sideways : 1.0;
  return {std::max(0.0, wanted[0]), share * wanted[1], share * wanted[2]};
}

}  // namespace

std::array<double, 3> VelocityProblem::unclamped_impulse(const Contact& contact, double way) const {
  std::array<double, 3> impulse{};
  for (std::size_t row = 0; row < 3; ++row) {
    impulse[row] = stiffness(contact, row) * (contact.velocity_error[row] + way * contact.velocity_error_change[row]);
  }
  return impulse;
}

double VelocityProblem::stiffness(const Contact& contact, std::size_t row) const {
  return tick_secs / (row == 0 ? normal_softness * contact.softness : friction_softness);
}

void VelocityProblem::compute_velocity_errors() {
  for (Contact& contact : contacts) {
    contact.velocity_error = contact.speed;
    for (std::size_t c = contact.first; c < contact.last; ++c) {
      const double v = velocity[columns[c].index];
      for (std::size_t row = 0; row < 3; ++row) contact.velocity_error[row] -= columns[c].value[row] * v;
    }
  }
}

/// Finds who is at a limit, and the impulses; true if it is the same as before. Expects the gaps.
bool VelocityProblem::update_active_set() {
  bool same = true;
  for (std::size_t k = 0; k < hinges.size(); ++k) {
    Hinge& hinge = hinges[k];
    const double wanted = tick_secs / motor_softness * (hinge.speed - velocity[k]);
    const int state = saturation_side(wanted, hinge.limit);
    const int braking = saturation_side(velocity[k], hinge.max_speed);
    same = same && state == hinge.saturation && braking == hinge.braking;
    hinge.saturation = state;
    hinge.braking = braking;
    hinge.impulse = std::clamp(wanted, -hinge.limit, hinge.limit);
    hinge.brake_impulse = brake_impulse(hinge, velocity[k]);
  }
  for (Contact& contact : contacts) {
    const std::array<double, 3> impulse = unclamped_impulse(contact, 0.0);
    const bool touching = impulse[0] > 0.0;
    const bool slipping =
        impulse[1] * impulse[1] + impulse[2] * impulse[2] > contact.friction_bound * contact.friction_bound;
    same = same && touching == contact.touching && slipping == contact.slipping;
    contact.touching = touching;
    contact.slipping = slipping;
    contact.impulse = impulse_of(contact, impulse);
  }
  return same;
}

/// Whether friction at its bound pushes anything: its direction follows the speeds, so that no step is exact.
bool VelocityProblem::has_sliding() const {
  return std::any_of(contacts.begin(), contacts.end(),
                     [](const Contact& contact) { return contact.slipping && contact.friction_bound > 0.0; });
}

/// Slope of the convex function: what momentum lacks. Expects the impulses.
void VelocityProblem::compute_gradient() {
  const std::size_t hinge_count = hinges.size();
  gradient_.resize(velocity.size());
  for (std::size_t k = 0; k < hinge_count; ++k) {
    gradient_[k] = dot_product(&mass[k * hinge_count], velocity.data(), hinge_count) - hinges[k].momentum -
                   hinges[k].impulse - hinges[k].brake_impulse;
  }
  for (std::size_t b = 0; b < blocks.size(); ++b) {
    const double* const v = &velocity[hinge_count + 6 * b];
    const Vec3 linear = Vec3{v[0], v[1], v[2]} * blocks[b].mass - blocks[b].linear_momentum;
    const Vec3 angular = blocks[b].inertia * Vec3{v[3], v[4], v[5]} - blocks[b].angular_momentum;
    const double numbers[6] = {linear.x, linear.y, linear.z, angular.x, angular.y, angular.z};
    std::copy(std::begin(numbers), std::end(numbers),
              gradient_.begin() + static_cast<std::ptrdiff_t>(hinge_count + 6 * b));
  }
  for (const Contact& contact : contacts) {
    for (std::size_t c = contact.first; c < contact.last; ++c) {
      const Column& column = columns[c];
      for (std::size_t row = 0; row < 3; ++row) gradient_[column.index] -= column.value[row] * contact.impulse[row];
    }
  }
}

/// Adds to factors_ a spring between the two sides of a contact.
void VelocityProblem::add_spring(const Contact& contact, double strength, const std::array<double, 3>& along) {
  spring_columns_.clear();
  for (std::size_t c = contact.first; c < contact.last; ++c) {
    const std::array<double, 3>& value = columns[c].value;
    spring_columns_.push_back(along[0] * value[0] + along[1] * value[1] + along[2] * value[2]);
  }
  const Column* const own = columns.data() + contact.first;
  for (std::size_t a = 0; a < spring_columns_.size(); ++a) {
    const double scaled = strength * spring_columns_[a];
    double* const into = &factors_[own[a].index * velocity.size()];
    for (std::size_t b = 0; b <= a; ++b) into[own[b].index] += scaled * spring_columns_[b];
  }
}

/// Puts the mass matrix with the springs of motors that are not at a limit into factors_.
void VelocityProblem::assemble_mass_matrix() {
  const std::size_t n = velocity.size();
  const std::size_t hinge_count = hinges.size();
  factors_.assign(n * n, 0.0);
  for (std::size_t i = 0; i < hinge_count; ++i) {
    std::copy_n(&mass[i * hinge_count], i + 1, &factors_[i * n]);
    if (hinges[i].saturation == 0) factors_[i * n + i] += tick_secs / motor_softness;
    if (hinges[i].braking != 0) factors_[i * n + i] += hinges[i].brake_gain;
  }
  for (std::size_t b = 0; b < blocks.size(); ++b) {
    const std::size_t at = hinge_count + 6 * b;
    const auto set = [&](std::size_t i, std::size_t j, double value) { factors_[(at + i) * n + at + j] = value; };
    const SymmetricMatrix3& inertia = blocks[b].inertia;
    for (std::size_t k = 0; k < 3; ++k) set(k, k, blocks[b].mass);
    set(3, 3, inertia.xx);
    set(4, 3, inertia.xy);
    set(4, 4, inertia.yy);
    set(5, 3, inertia.xz);
    set(5, 4, inertia.yz);
    set(5, 5, inertia.zz);
  }
}

/// Cholesky's factors of the masses with the springs of motors and contacts that are not at a limit. Friction at its
/// bound resists a change of its direction only.
void VelocityProblem::factorize() {
  assemble_mass_matrix();
  for (const Contact& contact : contacts) {
    if (contact.touching) add_spring(contact, stiffness(contact, 0), {1.0, 0.0, 0.0});
    if (!contact.slipping) {
      add_spring(contact, stiffness(contact, 1), {0.0, 1.0, 0.0});
      add_spring(contact, stiffness(contact, 2), {0.0, 0.0, 1.0});
    } else if (contact.friction_bound > 0.0) {
      const double slip = std::sqrt(contact.velocity_error[1] * contact.velocity_error[1] +
                                    contact.velocity_error[2] * contact.velocity_error[2]);
      add_spring(contact, contact.friction_bound / slip,
                 {0.0, -contact.velocity_error[2] / slip, contact.velocity_error[1] / slip});
    }
  }
  const std::size_t n = velocity.size();
  for (std::size_t i = 0; i < n; ++i) {
    double* const row = &factors_[i * n];
    for (std::size_t j = 0; j <= i; ++j) {
      const double* const other = &factors_[j * n];
      const double sum = row[j] - dot_product(row, other, j);
      if (j < i) {
        row[j] = sum * other[j];
      } else if (sum > 0.0) {
        // The diagonal keeps the inverse, so that nothing divides.
        row[j] = 1.0 / std::sqrt(sum);
      } else {
        throw std::runtime_error("the mass matrix is not positive definite");
      }
    }
  }
  factors_for_ = FactorKind::fixed_bounds;
  factors_exact_ = !has_sliding();
}

/// Adds to factors_ and upper_ what a contact resists while its bound of friction follows its normal force: what slips is
/// braked more the harder it is pressed, but not pressed harder the more it slips, so that this is not symmetric.
void VelocityProblem::add_coupled_contact(const Contact& contact) {
  if (!contact.touching) return;
  const std::size_t n = velocity.size();
  double resisted[3][3] = {{stiffness(contact, 0), 0.0, 0.0}, {0.0, stiffness(contact, 1), 0.0}, {0.0, 0.0, stiffness(contact, 2)}};
  if (contact.slipping) {
    const double slip = std::sqrt(contact.velocity_error[1] * contact.velocity_error[1] +
                                  contact.velocity_error[2] * contact.velocity_error[2]);
    const double along[2] = {contact.velocity_error[1] / slip, contact.velocity_error[2] / slip};
    const double strength = contact.friction_bound / slip;
    resisted[1][1] = strength * along[1] * along[1];
    resisted[1][2] = resisted[2][1] = -strength * along[0] * along[1];
    resisted[2][2] = strength * along[0] * along[0];
    resisted[1][0] = contact.friction * stiffness(contact, 0) * along[0];
    resisted[2][0] = contact.friction * stiffness(contact, 0) * along[1];
  }
  for (std::size_t b = contact.first; b < contact.last; ++b) {
    double by_unit[3];
    for (std::size_t row = 0; row < 3; ++row) by_unit[row] = dot_product(resisted[row], columns[b].value.data(), 3);
    for (std::size_t a = contact.first; a < contact.last; ++a) {
      const std::size_t i = columns[a].index;
      const std::size_t j = columns[b].index;
      double& into = j <= i ? factors_[i * n + j] : upper_[j * n + i];
      into += dot_product(columns[a].value.data(), by_unit, 3);
    }
  }
}

/// Crout's factors, in factors_ and the transpose upper_, of the masses and what resists while the bounds follow. False if
/// they need an exchange of rows, which only happens far from what is wanted.
bool VelocityProblem::factorize_coupled() {
  assemble_mass_matrix();
  upper_ = factors_;
  for (const Contact& contact : contacts) add_coupled_contact(contact);
  const std::size_t n = velocity.size();
  for (std::size_t i = 0; i < n; ++i) {
    double* const lower = &factors_[i * n];
    double* const upper = &upper_[i * n];
    for (std::size_t j = 0; j < i; ++j) {
      lower[j] -= dot_product(lower, &upper_[j * n], j);
      upper[j] = (upper[j] - dot_product(upper, &factors_[j * n], j)) * factors_[j * n + j];
    }
    const double pivot = lower[i] - dot_product(lower, upper, i);
    if (!(pivot > 0.0)) return false;
    lower[i] = 1.0 / pivot;
  }
  factors_for_ = FactorKind::following_bounds;
  return true;
}

/// The first half of a step: the lower factors undone.
void VelocityProblem::forward_substitute() {
  const std::size_t n = velocity.size();
  step_.resize(n);
  for (std::size_t i = 0; i < n; ++i) {
    const double* const row = &factors_[i * n];
    step_[i] = (-gradient_[i] - dot_product(row, step_.data(), i)) * row[i];
  }
}

/// Newton's step while the bounds follow; gives its largest change of a speed.
double VelocityProblem::compute_coupled_step() {
  forward_substitute();
  const std::size_t n = velocity.size();
  double largest = 0.0;
  for (std::size_t i = n; i-- > 0;) {
    const double* const row = &upper_[i * n];
    subtract_scaled(step_.data(), row, step_[i], i);
    largest = std::max(largest, std::fabs(step_[i]));
  }
  return largest;
}

/// Newton's step, and what it does to the gaps.
void VelocityProblem::compute_newton_step() {
  forward_substitute();
  const std::size_t n = velocity.size();
  for (std::size_t i = n; i-- > 0;) {
    const double* const row = &factors_[i * n];
    step_[i] *= row[i];
    subtract_scaled(step_.data(), row, step_[i], i);
  }
  for (Contact& contact : contacts) {
    contact.velocity_error_change = {};
    for (std::size_t c = contact.first; c < contact.last; ++c) {
      for (std::size_t row = 0; row < 3; ++row) {
        contact.velocity_error_change[row] -= columns[c].value[row] * step_[columns[c].index];
      }
    }
  }
}

/// Goes so much of the step.
void VelocityProblem::take_step(double way) {
  for (std::size_t k = 0; k < velocity.size(); ++k) velocity[k] += way * step_[k];
}

/// The slope along the step without motors and contacts, which are known at any place along it.
void VelocityProblem::compute_line_gradient() {
  const std::size_t hinge_count = hinges.size();
  line_gradient_start_ = 0.0;
  line_curvature_ = 0.0;
  for (std::size_t k = 0; k < hinge_count; ++k) {
    const double* const row = &mass[k * hinge_count];
    line_gradient_start_ += step_[k] * (dot_product(row, velocity.data(), hinge_count) - hinges[k].momentum);
    line_curvature_ += step_[k] * dot_product(row, step_.data(), hinge_count);
  }
  for (std::size_t b = 0; b < blocks.size(); ++b) {
    const double* const v = &velocity[hinge_count + 6 * b];
    const double* const d = &step_[hinge_count + 6 * b];
    const Vec3 linear{d[0], d[1], d[2]};
    const Vec3 angular{d[3], d[4], d[5]};
    line_gradient_start_ += dot(linear, Vec3{v[0], v[1], v[2]} * blocks[b].mass - blocks[b].linear_momentum) +
                    dot(angular, blocks[b].inertia * Vec3{v[3], v[4], v[5]} - blocks[b].angular_momentum);
    line_curvature_ += blocks[b].mass * dot(linear, linear) + dot(angular, blocks[b].inertia * angular);
  }
}

/// Slope of the convex function along the step, after so much of it. Expects compute_line_gradient().
double VelocityProblem::line_gradient(double way) const {
  double slope = line_gradient_start_ + way * line_curvature_;
  for (std::size_t k = 0; k < hinges.size(); ++k) {
    const double wanted = tick_secs / motor_softness * (hinges[k].speed - velocity[k] - way * step_[k]);
    const double impulse =
        std::clamp(wanted, -hinges[k].limit, hinges[k].limit) + brake_impulse(hinges[k], velocity[k] + way * step_[k]);
    slope -= step_[k] * impulse;
  }
  for (const Contact& contact : contacts) {
    const std::array<double, 3> impulse = impulse_of(contact, unclamped_impulse(contact, way));
    for (std::size_t row = 0; row < 3; ++row) slope += contact.velocity_error_change[row] * impulse[row];
  }
  return slope;
}

/// Where along the step the slope is zero. Between the places where somebody comes to or off a limit it is a line, or,
/// while something slips, a smooth curve. The stretch in which a motor is at no limit can be as short as 1e-8 of the step.
double VelocityProblem::line_search() {
  kinks_.clear();
  const auto add = [&](double way) {
    if (way > 0.0 && way < 1.0) kinks_.push_back(way);
  };
  for (std::size_t k = 0; k < hinges.size(); ++k) {
    if (step_[k] == 0.0) continue;
    if (hinges[k].brake_gain > 0.0) {
      add((hinges[k].max_speed - velocity[k]) / step_[k]);
      add((-hinges[k].max_speed - velocity[k]) / step_[k]);
    }
    if (hinges[k].limit <= 0.0) continue;
    const double gap = hinges[k].speed - velocity[k];
    const double bend = hinges[k].limit * motor_softness / tick_secs;
    add((gap - bend) / step_[k]);
    add((gap + bend) / step_[k]);
  }
  for (const Contact& contact : contacts) {
    const std::array<double, 3>& gap = contact.velocity_error;
    const std::array<double, 3>& change = contact.velocity_error_change;
    if (change[0] != 0.0) add(-gap[0] / change[0]);
    // Where the slip passes the width within which the contact sticks.
    const double square = change[1] * change[1] + change[2] * change[2];
    if (square == 0.0 || contact.friction_bound <= 0.0) continue;
    const double width = contact.friction_bound / stiffness(contact, 1);
    const double half = (gap[1] * change[1] + gap[2] * change[2]) / square;
    const double rest = half * half - (gap[1] * gap[1] + gap[2] * gap[2] - width * width) / square;
    if (rest <= 0.0) continue;
    add(-half - std::sqrt(rest));
    add(-half + std::sqrt(rest));
  }
  std::sort(kinks_.begin(), kinks_.end());
  // The first bend beyond the zero, by halving the list.
  kinks_.push_back(1.0);
  double low = 0.0;
  double at_low = line_gradient(low);
  double at_high = infinity;
  const double small = line_search_tolerance * std::fabs(at_low);
  const auto beyond = std::partition_point(kinks_.begin(), kinks_.end() - 1, [&](double way) {
    const double slope = line_gradient(way);
    if (!(slope < 0.0)) {
      at_high = slope;
      return false;
    }
    low = way;
    at_low = slope;
    return true;
  });
  double high = *beyond;
  if (at_high == infinity) at_high = line_gradient(high);
  if (at_high <= 0.0 || at_low >= 0.0) return high;
  // False position; an end that stays counts half (the Illinois rule), so that both ends come nearer. A line needs one.
  double way = low;
  for (int place = 0; place < max_line_search_steps; ++place) {
    const int before = way > low ? 1 : (place > 0 ? -1 : 0);
    way = low - at_low * (high - low) / (at_high - at_low);
    const double slope = line_gradient(way);
    if (std::fabs(slope) <= small) break;
    if (slope < 0.0) {
      if (before == -1) at_high *= 0.5;
      low = way;
      at_low = slope;
    } else {
      if (before == 1) at_low *= 0.5;
      high = way;
      at_high = slope;
    }
  }
  return way;
}

/// The minimum for the present bounds of friction; false if it was not reached.
bool VelocityProblem::minimize_velocity() {
  compute_velocity_errors();
  if (!update_active_set()) factors_for_ = FactorKind::nothing;
  compute_gradient();
  const auto slope_at_end = [&] { return dot_product(gradient_.data(), step_.data(), step_.size()); };
  for (int round = 0; round < max_newton_steps; ++round) {
    if (factors_for_ != FactorKind::fixed_bounds) factorize();
    compute_newton_step();
    const double small = has_sliding() ? sliding_step_tolerance : step_tolerance;
    const bool tiny = std::all_of(step_.begin(), step_.end(), [small](double change) { return std::fabs(change) <= small; });
    const double slope = std::fabs(slope_at_end());

    // The whole step first: if nobody comes to or off a limit and nothing slips, it leads to the minimum.
    take_step(1.0);
    compute_velocity_errors();
    const bool same = update_active_set();
    if (tiny || (same && factors_exact_ && !has_sliding())) return true;
    if (has_sliding()) {
      compute_gradient();
      const double left = slope_at_end();
      const bool leads_on = same && std::fabs(left) <= factor_reuse_ratio * slope;
      if (!leads_on) factors_for_ = FactorKind::nothing;
      if (left <= 0.0 || leads_on) continue;
    }
    factors_for_ = FactorKind::nothing;

    // Back, and to the lowest place along the step.
    take_step(-1.0);
    compute_velocity_errors();
    compute_line_gradient();
    take_step(line_search());
    compute_velocity_errors();
    update_active_set();
    compute_gradient();
  }
  return false;
}

/// Gives every contact the bound of friction that belongs to its normal force.
void VelocityProblem::update_bounds() {
  compute_velocity_errors();
  for (Contact& contact : contacts) {
    contact.friction_bound = contact.friction * std::max(0.0, stiffness(contact, 0) * contact.velocity_error[0]);
  }
}

/// Newton's method on all laws at once, the bounds following the normal forces: few steps from nearby, and no function
/// that would lead there from afar. False, and speeds and bounds are as before, if the steps do not become shorter.
bool VelocityProblem::solve_coupled_newton() {
  saved_velocity_ = velocity;
  for (Contact& contact : contacts) contact.saved_friction_bound = contact.friction_bound;
  double last = infinity;
  for (int round = 0; round < max_coupled_steps; ++round) {
    update_bounds();
    const bool same = update_active_set();
    compute_gradient();
    if ((!same || factors_for_ != FactorKind::following_bounds) && !factorize_coupled()) break;
    const double largest = compute_coupled_step();
    if (!(largest < last)) break;
    take_step(1.0);
    if (same && largest <= sliding_step_tolerance) {
      update_bounds();
      update_active_set();
      return true;
    }
    if (largest > factor_reuse_ratio * last) factors_for_ = FactorKind::nothing;
    last = largest;
  }
  velocity = saved_velocity_;
  for (Contact& contact : contacts) contact.friction_bound = contact.saved_friction_bound;
  compute_velocity_errors();
  update_active_set();
  factors_for_ = FactorKind::nothing;
  return false;
}

/// Whether the bounds of what slips belong to the normal forces.
bool VelocityProblem::bounds_converged() const {
  double largest = 0.0;
  double changed = 0.0;
  for (const Contact& contact : contacts) {
    const double bound = contact.friction * contact.impulse[0];
    largest = std::max(largest, bound);
    const double sideways = stiffness(contact, 1) * std::hypot(contact.velocity_error[1], contact.velocity_error[2]);
    if (sideways > std::min(bound, contact.friction_bound)) {
      changed = std::max(changed, std::fabs(bound - contact.friction_bound));
    }
  }
  return changed <= bound_tolerance * largest;
}

bool VelocityProblem::solve() {
  if (factors_for_ == FactorKind::following_bounds && solve_coupled_newton()) return true;
  if (factors_for_ == FactorKind::nothing) update_bounds();
  for (int round = 0; round < max_bound_iterations; ++round) {
    if (!minimize_velocity()) return false;
    if (bounds_converged() || solve_coupled_newton()) return true;
    for (Contact& contact : contacts) {
      const double bound = contact.friction * contact.impulse[0];
      contact.friction_bound = round < undamped_bound_rounds ? bound : 0.5 * (bound + contact.friction_bound);
    }
  }
  return max_bound_iterations < max_bound_rounds;
}

}  // namespace proact::dynamics
