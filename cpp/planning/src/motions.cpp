#include "proact/planning/motions.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

namespace proact::planning {

namespace {

/// Most steps of the resolution in one motion. From limit to limit the testbed's arm needs some thousands; a motion of
/// so many would keep the planner busy for most of a second, and one of 1e16 could not be halved any more.
constexpr double max_motion_steps = 1e5;

/// Most states that one question may prove to be free: the farther they are apart, the less it can prove.
constexpr std::size_t max_states_at_once = 32;

/// Checks interior points of a motion.
class MotionCheck {
 public:
  MotionCheck(Scene& scene, const double* a, const double* b, const Resolution& resolution)
      : scene_(scene), start_(a), end_(b), difference_(scene.joint_count()), at_(scene.joint_count()) {
    double squares = 0.0;
    for (std::size_t k = 0; k < difference_.size(); ++k) {
      difference_[k] = b[k] - a[k];
      squares += difference_[k] * difference_[k];
    }
    const double steps =
        std::max(std::sqrt(squares) / resolution.step_rad, scene.max_travel(difference_.data()) / resolution.step_m);
    // Also refuses NaN, for which every comparison is false.
    if (!(steps <= max_motion_steps)) {
      throw std::invalid_argument("a motion needs " + std::to_string(steps) + " steps of the resolution, expected at most " +
                                  std::to_string(max_motion_steps) + ": the arm, or what it carries, is too long");
    }
    shortest_ = steps > 0.0 ? 1.0 / steps : 1.0;
  }

  /// How far the motion is free in both directions from `share` of it, at most `enough`; negative for a contact there.
  double clearance_at(double share, double enough) {
    for (std::size_t k = 0; k < at_.size(); ++k) at_[k] = share < 1.0 ? start_[k] + share * difference_[k] : end_[k];
    return scene_.clearance(at_.data(), difference_.data(), enough);
  }

  /// The middle first, because a motion that hits something mostly does so there; then the middles of what that leaves open
  /// on both sides, the longest parts first.
  bool is_free(double from, double to) {
    open_.assign(1, {from, to});
    for (std::size_t next = 0; next < open_.size(); ++next) {
      const auto [begin, end] = open_[next];
      if (end - begin <= shortest_) continue;
      const double middle = 0.5 * (begin + end);
      const double clear = clearance_at(middle, 0.5 * (end - begin));
      if (clear < 0.0) return false;
      open_.emplace_back(begin, middle - clear);
      open_.emplace_back(middle + clear, end);
    }
    return true;
  }

  /// How far from its start the motion is free, as a share of its length.
  double free_fraction() {
    // Short of the whole clearance, at whose end the motion may be about to hit something.
    constexpr double part = 0.9;
    double share = 0.0;
    for (double next = shortest_; next < 1.0;) {
      const double clear = clearance_at(next, 1.0);
      if (clear < 0.0) break;
      share = std::min(1.0, next + part * clear);
      next += std::max(clear, shortest_);
    }
    return share;
  }

 private:
  Scene& scene_;
  const double* start_;
  const double* end_;
  std::vector<double> difference_;
  std::vector<double> at_;
  std::vector<std::pair<double, double>> open_;
  double shortest_ = 1.0;
};

/// A row of states, and what one question proves of it.
class StateRow {
 public:
  StateRow(Scene& scene, const double* states) : scene_(scene), states_(states), reach_(scene.joint_count()) {}

  const double* at(std::size_t k) const { return states_ + k * reach_.size(); }

  /// The states from `first` to `last` around `middle` that are proved to be free, and whatever lies on straight motions
  /// between neighbours among them; first above last if the middle is not free.
  std::pair<std::size_t, std::size_t> proven_free_range(std::size_t first, std::size_t middle, std::size_t last) {
    std::fill(reach_.begin(), reach_.end(), 0.0);
    for (std::size_t k = first; k <= last; ++k) {
      for (std::size_t j = 0; j < reach_.size(); ++j) reach_[j] = std::max(reach_[j], joint_distance(k, middle, j));
    }
    const double clear = scene_.clearance_around(at(middle), reach_.data(), 1.0);
    if (clear < 0.0) return {1, 0};
    std::size_t left = middle;
    while (left > first && is_within(left - 1, middle, clear)) --left;
    std::size_t right = middle;
    while (right < last && is_within(right + 1, middle, clear)) ++right;
    return {left, right};
  }

 private:
  double joint_distance(std::size_t k, std::size_t middle, std::size_t joint) const {
    return std::abs(at(k)[joint] - at(middle)[joint]);
  }

  bool is_within(std::size_t k, std::size_t middle, double clear) const {
    for (std::size_t j = 0; j < reach_.size(); ++j) {
      if (joint_distance(k, middle, j) > clear * reach_[j]) return false;
    }
    return true;
  }

  Scene& scene_;
  const double* states_;
  std::vector<double> reach_;
};

/// The whole row before its parts, the longest first: what hits something is found soon.
bool part_is_free(Scene& scene, StateRow& row, std::size_t first, std::size_t last, const Resolution& resolution) {
  std::vector<std::pair<std::size_t, std::size_t>> open{{first, last}};
  for (std::size_t next = 0; next < open.size(); ++next) {
    const auto [begin, end] = open[next];
    if (begin == end) continue;
    if (end - begin == 1) {
      if (!motion_is_free(scene, row.at(begin), row.at(end), resolution)) return false;
      continue;
    }
    const auto [left, right] = row.proven_free_range(begin, begin + (end - begin) / 2, end);
    if (left > right) return false;
    open.emplace_back(begin, left);
    open.emplace_back(right, end);
  }
  return true;
}

/// States from `first` to before `end`.
bool some_are_free(StateRow& row, std::size_t first, std::size_t end) {
  if (first >= end) return true;
  const auto [left, right] = row.proven_free_range(first, first + (end - first) / 2, end - 1);
  return left <= right && some_are_free(row, first, left) && some_are_free(row, right + 1, end);
}

}  // namespace

bool motion_is_free(Scene& scene, const double* a, const double* b, const Resolution& resolution) {
  MotionCheck check(scene, a, b, resolution);
  const double begin = check.clearance_at(0.0, 1.0);
  if (begin < 0.0) return false;
  if (begin >= 1.0) return true;
  const double end = check.clearance_at(1.0, 1.0 - begin);
  return end >= 0.0 && check.is_free(begin, 1.0 - end);
}

bool motion_from_free_is_free(Scene& scene, const double* a, const double* b, const Resolution& resolution) {
  MotionCheck check(scene, a, b, resolution);
  const double end = check.clearance_at(1.0, 1.0);
  return end >= 0.0 && check.is_free(0.0, 1.0 - end);
}

double free_fraction(Scene& scene, const double* a, const double* b, const Resolution& resolution) {
  return MotionCheck(scene, a, b, resolution).free_fraction();
}

bool path_is_free(Scene& scene, const double* states, std::size_t count, const Resolution& resolution) {
  if (count == 0) return true;
  StateRow row(scene, states);
  if (count == 1) return scene.is_free(row.at(0));
  for (std::size_t first = 0; first + 1 < count; first += max_states_at_once) {
    if (!part_is_free(scene, row, first, std::min(first + max_states_at_once, count - 1), resolution)) return false;
  }
  return true;
}

bool states_are_free(Scene& scene, const double* states, std::size_t count) {
  StateRow row(scene, states);
  for (std::size_t first = 0; first < count; first += max_states_at_once) {
    if (!some_are_free(row, first, std::min(first + max_states_at_once, count))) return false;
  }
  return true;
}

}  // namespace proact::planning
