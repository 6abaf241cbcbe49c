// Sampling-based planning between arm angles: OMPL's planners over a Scene, repeatable by their seed.
#pragma once

#include "proact/planning/motions.hpp"
#include "proact/planning/scene.hpp"

#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

namespace proact::planning {

/// Raised from another thread to end a plan early.
class CancelFlag {
 public:
  void raise() const noexcept { raised_.store(true, std::memory_order_relaxed); }
  void lower() const noexcept { raised_.store(false, std::memory_order_relaxed); }
  bool is_raised() const noexcept { return raised_.load(std::memory_order_relaxed); }

 private:
  mutable std::atomic<bool> raised_{false};
};

/// Planners of OMPL. RRTConnect is the default, LBKPIECE1 was the original's. Anytime shortening is RRTConnect again and
/// again until the iterations are spent: the paths are shortened and the best parts of all put together.
enum class PlannerKind : std::uint8_t { rrt_connect, bitrrt, lbkpiece1, rrt_star, prm, anytime };

/// Arm angles, and which of them a straight motion joins: grown once among things that stay where they are, and
/// begun with wherever they stand.
struct Roadmap {
  std::vector<std::vector<double>> milestones;
  std::vector<std::pair<std::size_t, std::size_t>> edges;
};

struct JointQuery {
  std::vector<double> start;
  std::vector<std::vector<double>> goals;
  std::uint64_t seed = 0;
  PlannerKind planner = PlannerKind::rrt_connect;
  /// Parameters of the planner by OMPL's names, such as "range" or "goal_bias", and their values as text.
  std::vector<std::pair<std::string, std::string>> parameters;
  /// Bound on the planner's iterations.
  unsigned int max_iterations = 20000;
  /// Longest motion added to a tree, rad (L2); for planners that have a "range".
  double range = 0.8;
  /// Bound on the time, seconds; zero for none. With it equal queries no longer give equal plans.
  double max_seconds = 0.0;
  /// Searches after the first that succeeded, by RRTConnect and BiTRRT: each for the goals to which a path could be
  /// quicker than the best so far, as long as ways are found easily. The plan is the
  /// best of all paths by how long each takes and its length.
  unsigned int more_searches = 0;
  /// Attempts to shorten the path.
  unsigned int shortcut_attempts = 20;
  Resolution resolution;
  /// What PRM begins with, if it is set. Nothing in it is taken for free: the milestones and motions that a way
  /// uses are looked at in the scene as it is now.
  std::shared_ptr<const Roadmap> roadmap;
  /// A further condition on every state, if it is set; motions are then asked about in steps of the resolution.
  std::function<bool(const double*)> accepts;
};

enum class JointPlanStatus : std::uint8_t { solved, no_plan, start_in_collision, goals_in_collision, cancelled };

struct JointPlan {
  JointPlanStatus status = JointPlanStatus::no_plan;
  /// Joint vectors from start to goal; straight motions between them. Empty unless solved.
  std::vector<std::vector<double>> path;
  /// Which goal the path ends at.
  std::size_t goal = 0;
  /// What it took: iterations of the planner, states looked at, seconds.
  std::uint64_t iterations = 0;
  std::uint64_t state_checks = 0;
  double seconds = 0.0;
  /// True if `max_seconds` ended a search.
  bool timed_out = false;
};

/// A roadmap of so many milestones that are free in the scene as it is now, by OMPL's PRM: of the query only the seed,
/// the resolution and the further condition count. Fewer milestones if the flag was raised.
///
/// Throws std::invalid_argument as plan_joint does, std::runtime_error if no more states are free.
Roadmap grow_roadmap(Scene& scene, const JointQuery& query, std::size_t milestones, const CancelFlag& cancel);

/// A free path from the start to one of the goals.
///
/// Straight motions to the goals are tried first, in order; then the planner; then the path is shortened. Equal
/// scenes and queries give equal plans, whatever runs in other threads: iterations are counted, not timed, and
/// every generator of RRTConnect has its own seed derived from the query's. The other planners draw from
/// generators out of reach: they run alone in the process, after OMPL's own source has been seeded.
///
/// Throws std::invalid_argument for wrong lengths, values that are not finite, joints outside the limits,
/// parameters that the planner does not know, and motions too long to be looked at.
JointPlan plan_joint(Scene& scene, const JointQuery& query, const CancelFlag& cancel);

/// Throws std::invalid_argument if the query's planner does not know one of its parameters, naming those that it
/// knows, or refuses a value.
void check_planner(const JointQuery& query);

}  // namespace proact::planning
