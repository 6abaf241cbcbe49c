#include "engines/reduced/velocity_problem.hpp"

#include "proact/dynamics/model.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace proact::dynamics {

namespace {

// Three to six steps are usual.
constexpr int most_steps = 60;
constexpr int most_widths = 30;
// From this round on the width of friction goes half the way, lest it swings to and fro.
constexpr int cautious_widths = 12;
// Friction has settled when no width changes by more than this share of the largest.
constexpr double settled_share = 1e-4;
// A step that changes no speed by more than this (rad/s, m/s) is none.
constexpr double still = 1e-12;

/// Of two rows of numbers. Four sums at once, because each addition waits for the one before it.
double product(const double* a, const double* b, std::size_t count) {
  double sums[4] = {0.0, 0.0, 0.0, 0.0};
  std::size_t k = 0;
  for (; k + 4 <= count; k += 4) {
    for (std::size_t lane = 0; lane < 4; ++lane) sums[lane] += a[k + lane] * b[k + lane];
  }
  for (; k < count; ++k) sums[0] += a[k] * b[k];
  return (sums[0] + sums[1]) + (sums[2] + sums[3]);
}

int side_of(double value, double limit) { return value > limit ? 1 : (value < -limit ? -1 : 0); }

/// Impulse of a gear that brakes beyond a speed.
double braked(const VelocityProblem::Hinge& hinge, double speed) {
  return hinge.brake * (std::clamp(speed, -hinge.fastest, hinge.fastest) - speed);
}

/// Impulse of a contact along a row, when the gap is so wide.
double impulse_of(const VelocityProblem::Contact& contact, std::size_t row, double wanted) {
  return row == 0 ? std::max(0.0, wanted) : std::clamp(wanted, -contact.bound, contact.bound);
}

}  // namespace

double VelocityProblem::stiffness(std::size_t row) const {
  return tick_secs / (row == 0 ? normal_softness : friction_softness);
}

void VelocityProblem::find_gaps() {
  for (Contact& contact : contacts) {
    contact.gap = contact.speed;
    for (std::size_t c = contact.first; c < contact.last; ++c) {
      const double v = velocity[columns[c].index];
      for (std::size_t row = 0; row < 3; ++row) contact.gap[row] -= columns[c].value[row] * v;
    }
  }
}

/// Finds who is at a limit, and the impulses; true if it is the same as before. Expects the gaps.
bool VelocityProblem::judge() {
  bool same = true;
  for (std::size_t k = 0; k < hinges.size(); ++k) {
    Hinge& hinge = hinges[k];
    const double wanted = tick_secs / motor_softness * (hinge.speed - velocity[k]);
    const int state = side_of(wanted, hinge.limit);
    const int braking = side_of(velocity[k], hinge.fastest);
    same = same && state == hinge.state && braking == hinge.braking;
    hinge.state = state;
    hinge.braking = braking;
    hinge.impulse = std::clamp(wanted, -hinge.limit, hinge.limit);
    hinge.braked = braked(hinge, velocity[k]);
  }
  for (Contact& contact : contacts) {
    for (std::size_t row = 0; row < 3; ++row) {
      const double wanted = stiffness(row) * contact.gap[row];
      const int state = row == 0 ? (wanted > 0.0 ? 0 : -1) : side_of(wanted, contact.bound);
      same = same && state == contact.state[row];
      contact.state[row] = state;
      contact.impulse[row] = impulse_of(contact, row, wanted);
    }
  }
  return same;
}

/// Slope of the convex function: what momentum lacks. Expects the impulses.
void VelocityProblem::find_slope() {
  const std::size_t hinge_count = hinges.size();
  slope_.resize(velocity.size());
  for (std::size_t k = 0; k < hinge_count; ++k) {
    slope_[k] = product(&mass[k * hinge_count], velocity.data(), hinge_count) - hinges[k].momentum - hinges[k].impulse - hinges[k].braked;
  }
  for (std::size_t b = 0; b < blocks.size(); ++b) {
    const double* const v = &velocity[hinge_count + 6 * b];
    const Vec3 linear = Vec3{v[0], v[1], v[2]} * blocks[b].mass - blocks[b].linear_momentum;
    const Vec3 angular = blocks[b].inertia * Vec3{v[3], v[4], v[5]} - blocks[b].angular_momentum;
    const double numbers[6] = {linear.x, linear.y, linear.z, angular.x, angular.y, angular.z};
    std::copy(std::begin(numbers), std::end(numbers), slope_.begin() + static_cast<std::ptrdiff_t>(hinge_count + 6 * b));
  }
  for (const Contact& contact : contacts) {
    for (std::size_t c = contact.first; c < contact.last; ++c) {
      const Column& column = columns[c];
      for (std::size_t row = 0; row < 3; ++row) slope_[column.index] -= column.value[row] * contact.impulse[row];
    }
  }
}

/// Cholesky's factors of the mass matrix with the springs of motors and contacts that are not at a limit.
void VelocityProblem::factor() {
  const std::size_t n = velocity.size();
  const std::size_t hinge_count = hinges.size();
  factors_.assign(n * n, 0.0);
  for (std::size_t i = 0; i < hinge_count; ++i) {
    std::copy_n(&mass[i * hinge_count], i + 1, &factors_[i * n]);
    if (hinges[i].state == 0) factors_[i * n + i] += tick_secs / motor_softness;
    if (hinges[i].braking != 0) factors_[i * n + i] += hinges[i].brake;
  }
  for (std::size_t b = 0; b < blocks.size(); ++b) {
    const std::size_t at = hinge_count + 6 * b;
    const auto set = [&](std::size_t i, std::size_t j, double value) { factors_[(at + i) * n + at + j] = value; };
    const Symmetric& inertia = blocks[b].inertia;
    for (std::size_t k = 0; k < 3; ++k) set(k, k, blocks[b].mass);
    set(3, 3, inertia.xx);
    set(4, 3, inertia.xy);
    set(4, 4, inertia.yy);
    set(5, 3, inertia.xz);
    set(5, 4, inertia.yz);
    set(5, 5, inertia.zz);
  }
  for (const Contact& contact : contacts) {
    for (std::size_t row = 0; row < 3; ++row) {
      if (contact.state[row] != 0) continue;
      for (std::size_t a = contact.first; a < contact.last; ++a) {
        const double scaled = stiffness(row) * columns[a].value[row];
        double* const into = &factors_[columns[a].index * n];
        for (std::size_t b = contact.first; b <= a; ++b) into[columns[b].index] += scaled * columns[b].value[row];
      }
    }
  }
  for (std::size_t i = 0; i < n; ++i) {
    double* const row = &factors_[i * n];
    for (std::size_t j = 0; j <= i; ++j) {
      const double* const other = &factors_[j * n];
      const double sum = row[j] - product(row, other, j);
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
  factored_ = true;
}

/// Newton's step, and what it does to the gaps.
void VelocityProblem::find_step() {
  const std::size_t n = velocity.size();
  step_.resize(n);
  for (std::size_t i = 0; i < n; ++i) {
    const double* const row = &factors_[i * n];
    step_[i] = (-slope_[i] - product(row, step_.data(), i)) * row[i];
  }
  for (std::size_t i = n; i-- > 0;) {
    const double* const row = &factors_[i * n];
    step_[i] *= row[i];
    for (std::size_t k = 0; k < i; ++k) step_[k] -= row[k] * step_[i];
  }
  for (Contact& contact : contacts) {
    contact.change = {};
    for (std::size_t c = contact.first; c < contact.last; ++c) {
      for (std::size_t row = 0; row < 3; ++row) contact.change[row] -= columns[c].value[row] * step_[columns[c].index];
    }
  }
}

/// Slope of the convex function along the step, after so much of it. Expects slope_start_ and slope_growth_.
double VelocityProblem::slope_along(double way) const {
  double slope = slope_start_ + way * slope_growth_;
  for (std::size_t k = 0; k < hinges.size(); ++k) {
    const double wanted = tick_secs / motor_softness * (hinges[k].speed - velocity[k] - way * step_[k]);
    const double impulse = std::clamp(wanted, -hinges[k].limit, hinges[k].limit) + braked(hinges[k], velocity[k] + way * step_[k]);
    slope -= step_[k] * impulse;
  }
  for (const Contact& contact : contacts) {
    for (std::size_t row = 0; row < 3; ++row) {
      const double wanted = stiffness(row) * (contact.gap[row] + way * contact.change[row]);
      slope += contact.change[row] * impulse_of(contact, row, wanted);
    }
  }
  return slope;
}

/// Where along the step the slope is zero, exactly: it is a line between the places where somebody comes to or off a
/// limit. The stretch in which a motor is at no limit can be as short as 1e-8 of the step.
double VelocityProblem::find_way() {
  kinks_.clear();
  const auto add = [&](double gap, double change, double at) {
    const double way = (at - gap) / change;
    if (way > 0.0 && way < 1.0) kinks_.push_back(way);
  };
  for (std::size_t k = 0; k < hinges.size(); ++k) {
    if (step_[k] == 0.0) continue;
    if (hinges[k].brake > 0.0) {
      add(velocity[k], step_[k], hinges[k].fastest);
      add(velocity[k], step_[k], -hinges[k].fastest);
    }
    if (hinges[k].limit <= 0.0) continue;
    const double gap = hinges[k].speed - velocity[k];
    const double bend = hinges[k].limit * motor_softness / tick_secs;
    add(gap, -step_[k], bend);
    add(gap, -step_[k], -bend);
  }
  for (const Contact& contact : contacts) {
    if (contact.change[0] != 0.0) add(contact.gap[0], contact.change[0], 0.0);
    for (std::size_t row = 1; row < 3; ++row) {
      if (contact.change[row] == 0.0 || contact.bound <= 0.0) continue;
      add(contact.gap[row], contact.change[row], contact.bound / stiffness(row));
      add(contact.gap[row], contact.change[row], -contact.bound / stiffness(row));
    }
  }
  std::sort(kinks_.begin(), kinks_.end());
  // The first bend beyond the zero, by halving the list.
  kinks_.push_back(1.0);
  const auto beyond = std::partition_point(kinks_.begin(), kinks_.end() - 1, [&](double way) { return slope_along(way) < 0.0; });
  const double high = *beyond;
  const double low = beyond == kinks_.begin() ? 0.0 : *(beyond - 1);
  const double at_low = slope_along(low);
  const double at_high = slope_along(high);
  if (at_high <= 0.0 || at_low >= 0.0) return high;
  return low - at_low * (high - low) / (at_high - at_low);
}

/// The minimum for the present widths of friction; false if it was not reached.
bool VelocityProblem::settle_velocity() {
  const std::size_t n = velocity.size();
  const std::size_t hinge_count = hinges.size();
  find_gaps();
  if (!judge()) factored_ = false;
  for (int round = 0; round < most_steps; ++round) {
    find_slope();
    if (!factored_) factor();
    find_step();
    const bool tiny = std::all_of(step_.begin(), step_.end(), [](double change) { return std::fabs(change) <= still; });

    // The whole step first: if nobody comes to or off a limit, it leads to the minimum.
    for (std::size_t k = 0; k < n; ++k) velocity[k] += step_[k];
    find_gaps();
    if (judge() || tiny) return true;
    factored_ = false;

    // Back to its start: the slope there without motors and contacts, which are known at any place along it.
    for (std::size_t k = 0; k < n; ++k) velocity[k] -= step_[k];
    for (Contact& contact : contacts) {
      for (std::size_t row = 0; row < 3; ++row) contact.gap[row] -= contact.change[row];
    }
    slope_start_ = 0.0;
    slope_growth_ = 0.0;
    for (std::size_t k = 0; k < hinge_count; ++k) {
      const double* const row = &mass[k * hinge_count];
      slope_start_ += step_[k] * (product(row, velocity.data(), hinge_count) - hinges[k].momentum);
      slope_growth_ += step_[k] * product(row, step_.data(), hinge_count);
    }
    for (std::size_t b = 0; b < blocks.size(); ++b) {
      const double* const v = &velocity[hinge_count + 6 * b];
      const double* const d = &step_[hinge_count + 6 * b];
      const Vec3 linear{d[0], d[1], d[2]};
      const Vec3 angular{d[3], d[4], d[5]};
      slope_start_ += dot(linear, Vec3{v[0], v[1], v[2]} * blocks[b].mass - blocks[b].linear_momentum) +
                      dot(angular, blocks[b].inertia * Vec3{v[3], v[4], v[5]} - blocks[b].angular_momentum);
      slope_growth_ += blocks[b].mass * dot(linear, linear) + dot(angular, blocks[b].inertia * angular);
    }
    const double way = find_way();
    for (std::size_t k = 0; k < n; ++k) velocity[k] += way * step_[k];
    find_gaps();
    judge();
  }
  return false;
}

bool VelocityProblem::solve() {
  find_gaps();
  if (!factored_) {
    for (Contact& contact : contacts) contact.bound = contact.friction * impulse_of(contact, 0, stiffness(0) * contact.gap[0]);
  }
  for (int round = 0; round < most_widths; ++round) {
    if (!settle_velocity()) return false;
    double largest = 0.0;
    double changed = 0.0;
    for (Contact& contact : contacts) {
      const double width = contact.friction * contact.impulse[0];
      largest = std::max(largest, width);
      changed = std::max(changed, std::fabs(width - contact.bound));
      contact.bound = round < cautious_widths ? width : 0.5 * (width + contact.bound);
    }
    if (changed <= settled_share * largest) return true;
  }
  return false;
}

}  // namespace proact::dynamics
