// A search as a plain program on OMPL and FCL does it: the peer that this library is measured against.
#pragma once

#include "proact/planning/joint_planner.hpp"

#include <cstdint>
#include <vector>

namespace proact::planning {

/// The original's settings: LBKPIECE1 with OMPL's own parameters, half a second an attempt and up to eight attempts,
/// states every 0.005 of the joint space's extent, simplification for what is left of an attempt's time.
struct BaselineSettings {
  /// Processor time of one attempt, seconds: on a machine with nothing else to do, that is the original's time.
  double seconds = 0.5;
  unsigned int attempts = 8;
  double fixed_validity_step = 0.005;
  PlannerKind planner = PlannerKind::lbkpiece1;
};

struct BaselinePlan {
  /// Straight joint motions from the start to a goal; empty if none was found in time.
  std::vector<std::vector<double>> path;
  /// Processor time of all attempts, seconds, and of their searches alone, without simplification.
  double cpu_secs = 0.0;
  double search_secs = 0.0;
  unsigned int attempts = 0;
};

/// Processor time of the calling thread, seconds since some moment.
double thread_cpu_secs();

/// The calling thread's clock of processor time, and what such a clock says, seconds: zero once its thread has ended.
int thread_cpu_clock();
double cpu_secs_of(int clock);

/// Searches between free arm angles in what `scene` holds now, padding included, without any of this library's own
/// collision code: two of FCL's dynamic trees, one over the arm's shapes, one over the obstacles, and OMPL's motion
/// checks. What may touch is as in the scene, but for contacts allowed one by one.
///
/// Every attempt begins anew. Not repeatable: it is bounded by time, as the original was. Throws std::invalid_argument as plan_joint does.
BaselinePlan search_baseline(const Scene& scene, const std::vector<double>& start,
                             const std::vector<std::vector<double>>& goals, const BaselineSettings& settings,
                             std::uint64_t seed);

}  // namespace proact::planning
