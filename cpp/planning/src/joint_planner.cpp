#include "proact/planning/joint_planner.hpp"

#include "planners.hpp"

#include <ompl/base/MotionValidator.h>
#include <ompl/base/PlannerData.h>
#include <ompl/base/PlannerTerminationCondition.h>
#include <ompl/base/ProblemDefinition.h>
#include <ompl/base/SpaceInformation.h>
#include <ompl/base/StateValidityChecker.h>
#include <ompl/base/goals/GoalStates.h>
#include <ompl/base/spaces/RealVectorStateSpace.h>
#include <ompl/geometric/PathGeometric.h>
#include <ompl/geometric/PathHybridization.h>
#include <ompl/geometric/PathSimplifier.h>
#include <ompl/geometric/planners/prm/PRM.h>
#include <ompl/util/Console.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>
#include <memory>
#include <stdexcept>
#include <string>

namespace proact::planning {

namespace ob = ompl::base;
namespace og = ompl::geometric;

namespace {

/// OMPL gives every generator a seed from one process-wide source; these put the query's in its place.
class SeededSampler : public ob::RealVectorStateSampler {
 public:
  SeededSampler(const ob::StateSpace* space, std::uint32_t seed) : ob::RealVectorStateSampler(space) {
    rng_.setLocalSeed(seed);
  }
};

class SeededSimplifier : public og::PathSimplifier {
 public:
  SeededSimplifier(const ob::SpaceInformationPtr& space, std::uint32_t seed) : og::PathSimplifier(space) {
    rng_.setLocalSeed(seed);
  }
};

/// Most looks for a free state in vain, of up to 20 random states each, after which a roadmap is given up.
constexpr unsigned int max_failed_samples = 2000;

const double* values(const ob::State* state) { return state->as<ob::RealVectorStateSpace::StateType>()->values; }

/// True if the query's further condition, if there is one, holds along a straight joint motion.
bool accepts_motion(const JointQuery& query, const double* a, const double* b) {
  if (!query.accepts) return true;
  const std::size_t joints = query.start.size();
  double squares = 0.0;
  for (std::size_t k = 0; k < joints; ++k) squares += (b[k] - a[k]) * (b[k] - a[k]);
  const double steps = std::ceil(std::sqrt(squares) / query.resolution.step_rad);
  std::vector<double> q(joints);
  for (double step = 0.0; step <= steps; step += 1.0) {
    const double share = steps > 0.0 ? step / steps : 0.0;
    for (std::size_t k = 0; k < joints; ++k) q[k] = a[k] + share * (b[k] - a[k]);
    if (!query.accepts(q.data())) return false;
  }
  return true;
}

class SceneValidity : public ob::StateValidityChecker {
 public:
  SceneValidity(const ob::SpaceInformationPtr& space, Scene& scene, const JointQuery& query, const CancelFlag& cancel)
      : ob::StateValidityChecker(space), scene_(scene), query_(query), cancel_(cancel) {}

  // A cancelled query calls everything invalid, so that even path shortening comes to its end at once.
  bool isValid(const ob::State* state) const override {
    return !cancel_.is_raised() && si_->satisfiesBounds(state) && scene_.is_free(values(state)) &&
           (!query_.accepts || query_.accepts(values(state)));
  }

 private:
  Scene& scene_;
  const JointQuery& query_;
  const CancelFlag& cancel_;
};

class SceneMotions : public ob::MotionValidator {
 public:
  SceneMotions(const ob::SpaceInformationPtr& space, Scene& scene, const JointQuery& query, const CancelFlag& cancel)
      : ob::MotionValidator(space), scene_(scene), query_(query), cancel_(cancel), resolution_(query.resolution) {}

  bool checkMotion(const ob::State* a, const ob::State* b) const override {
    return !cancel_.is_raised() && si_->satisfiesBounds(b) &&
           motion_from_free_is_free(scene_, values(a), values(b), resolution_) &&
           accepts_motion(query_, values(a), values(b));
  }

  bool checkMotion(const ob::State* a, const ob::State* b, std::pair<ob::State*, double>& last) const override {
    if (checkMotion(a, b)) return true;
    // How far a user's condition holds is not known.
    last.second = query_.accepts ? 0.0 : free_fraction(scene_, values(a), values(b), resolution_);
    if (last.first != nullptr) si_->getStateSpace()->interpolate(a, b, last.second, last.first);
    return false;
  }

 private:
  Scene& scene_;
  const JointQuery& query_;
  const CancelFlag& cancel_;
  Resolution resolution_;
};

void copy_into(const std::vector<double>& q, ob::State* state) {
  std::copy(q.begin(), q.end(), state->as<ob::RealVectorStateSpace::StateType>()->values);
}

std::shared_ptr<ob::RealVectorStateSpace> joint_space(const ob::RealVectorBounds& bounds, std::uint32_t seed) {
  auto space = std::make_shared<ob::RealVectorStateSpace>(static_cast<unsigned int>(bounds.low.size()));
  space->setBounds(bounds);
  set_original_projection(*space);
  space->setStateSamplerAllocator(
      [seed](const ob::StateSpace* s) { return std::make_shared<SeededSampler>(s, seed); });
  return space;
}

using Clock = std::chrono::steady_clock;

double seconds_since(Clock::time_point begin) { return std::chrono::duration<double>(Clock::now() - begin).count(); }

/// What one search gave: an empty path for none.
struct SearchResult {
  std::vector<std::vector<double>> path;
  double cost = 0.0;
  std::uint64_t iterations = 0;
  bool timed_out = false;
};

/// The farthest way of any joint, radians.
double max_joint_distance(const std::vector<double>& from, const std::vector<double>& to) {
  double farthest = 0.0;
  for (std::size_t j = 0; j < from.size(); ++j) farthest = std::max(farthest, std::abs(to[j] - from[j]));
  return farthest;
}

/// How long a path takes at equal limits for all joints, in radians of the joint that is behind: the farthest way of
/// any joint on each motion, and what slowing down for a corner costs.
double duration_cost(const std::vector<std::vector<double>>& path) {
  // At 0.5 rad/s and 1 rad/s^2 a joint comes from rest to full speed, or to rest, on a quarter of a radian that others go
  // meanwhile. Where both motions at a corner have room for that, it costs little.
  constexpr double room = 0.23;
  constexpr double turn = 0.03;
  constexpr double no_room = 0.5;
  double cost = 0.0;
  for (std::size_t k = 0; k + 1 < path.size(); ++k) {
    const double way = max_joint_distance(path[k], path[k + 1]);
    cost += way;
    if (k == 0) continue;
    const double before = max_joint_distance(path[k - 1], path[k]);
    if (before == 0.0 || way == 0.0) continue;
    double change = 0.0;  // of the speed of the joint that changes it most, as a share of full speed
    for (std::size_t j = 0; j < path[k].size(); ++j) {
      change = std::max(change, std::abs((path[k][j] - path[k - 1][j]) / before - (path[k + 1][j] - path[k][j]) / way));
    }
    cost += turn * change + no_room * std::max(0.0, room * change - std::min(before, way));
  }
  return cost;
}

/// Length of a path, radians (L2).
double length_of(const std::vector<std::vector<double>>& path) {
  double length = 0.0;
  for (std::size_t k = 0; k + 1 < path.size(); ++k) {
    double squares = 0.0;
    for (std::size_t j = 0; j < path[k].size(); ++j) squares += std::pow(path[k + 1][j] - path[k][j], 2);
    length += std::sqrt(squares);
  }
  return length;
}

std::vector<std::vector<double>> points_of(const og::PathGeometric& path) {
  const auto joints = path.getSpaceInformation()->getStateDimension();
  std::vector<std::vector<double>> points;
  for (std::size_t k = 0; k < path.getStateCount(); ++k) {
    const double* q = values(path.getState(static_cast<unsigned int>(k)));
    points.emplace_back(q, q + joints);
  }
  return points;
}

/// A further search is worth it where a path could be quicker by this share.
constexpr double retry_ratio = 0.95;

/// A path this many times slower than the best so far is not shortened any more.
constexpr double discard_ratio = 1.5;

/// A shortcut may span the whole path, and begins at a point of it that is within this share of its length, so that fewer
/// points come to lie close together.
constexpr double shortcut_span = 1.0;
constexpr double snap_fraction = 0.05;

/// Iterations, over all searches of a query, up to which a further one is begun.
constexpr std::uint64_t easy_iterations = 200;

/// The limits of the joints.
ob::RealVectorBounds limits_of(const Scene& scene) {
  const auto joints = static_cast<unsigned int>(scene.joint_count());
  ob::RealVectorBounds bounds(joints);
  for (unsigned int k = 0; k < joints; ++k) {
    bounds.setLow(k, scene.lower(k));
    bounds.setHigh(k, scene.upper(k));
  }
  return bounds;
}

/// The part of the joint space through which a path to one of `goals` may lead that is quicker than `least`: no joint
/// can go farther than that in all.
ob::RealVectorBounds bounds_of(const Scene& scene, const JointQuery& query, const std::vector<std::size_t>& goals,
                               double least) {
  ob::RealVectorBounds bounds = limits_of(scene);
  for (unsigned int k = 0; k < bounds.low.size(); ++k) {
    double low = query.start[k];
    double high = query.start[k];
    for (const std::size_t g : goals) {
      const double from = std::min(query.start[k], query.goals[g][k]);
      const double to = std::max(query.start[k], query.goals[g][k]);
      const double beyond = std::max(0.0, 0.5 * (least - (to - from)));  // every goal is inside
      low = std::min(low, from - beyond);
      high = std::max(high, to + beyond);
    }
    bounds.setLow(k, std::max(bounds.low[k], low));
    bounds.setHigh(k, std::min(bounds.high[k], high));
  }
  return bounds;
}

/// The joint space within `bounds` with the scene's verdicts on states and motions; its samplers take `seed`.
ob::SpaceInformationPtr make_space_information(const ob::RealVectorBounds& bounds, Scene& scene, const JointQuery& query,
                                               std::uint32_t seed, const CancelFlag& cancel) {
  auto information = std::make_shared<ob::SpaceInformation>(joint_space(bounds, seed));
  information->setStateValidityChecker(std::make_shared<SceneValidity>(information, scene, query, cancel));
  if (query.resolution.fixed_validity_step > 0.0) {
    information->setStateValidityCheckingResolution(query.resolution.fixed_validity_step);
  } else {
    information->setMotionValidator(std::make_shared<SceneMotions>(information, scene, query, cancel));
  }
  information->setup();
  return information;
}

void require_resolution(const Resolution& resolution) {
  if (!(resolution.step_rad > 0.0) || !(resolution.step_m > 0.0)) {
    throw std::invalid_argument("resolution must be above zero");
  }
  if (!(resolution.fixed_validity_step >= 0.0 && resolution.fixed_validity_step < 1.0)) {
    throw std::invalid_argument("equal steps must be a share below 1");
  }
}

/// From each point of a path on to the farthest that a free motion leads to.
void skip_vertices(og::PathGeometric& path) {
  const auto& information = path.getSpaceInformation();
  std::vector<ob::State*>& points = path.getStates();
  for (std::size_t from = 0; from + 2 < points.size(); ++from) {
    std::size_t to = points.size() - 1;
    while (to > from + 1 && !information->checkMotion(points[from], points[to])) --to;
    for (std::size_t k = from + 1; k < to; ++k) information->freeState(points[k]);
    const auto at = [&](std::size_t k) { return points.begin() + static_cast<std::ptrdiff_t>(k); };
    points.erase(at(from + 1), at(to));
  }
}

/// Search number `number` of a query, from its start to those goals that are free; `least` is the cost of the best path yet.
SearchResult search_once(Scene& scene, const JointQuery& query, const std::vector<std::size_t>& free_goals,
                         std::uint64_t number, double least, Clock::time_point begin, const CancelFlag& cancel) {
  constexpr std::uint64_t streams = 4;
  const auto stream = [&](std::uint64_t which) { return derive_seed(query.seed, which + number * streams); };
  const double equal_steps = query.resolution.fixed_validity_step;
  // Equal steps are shares of the bounds.
  const auto bounds = equal_steps > 0.0 ? limits_of(scene) : bounds_of(scene, query, free_goals, least);
  const auto information = make_space_information(bounds, scene, query, stream(0), cancel);
  auto problem = std::make_shared<ob::ProblemDefinition>(information);
  ob::ScopedState<> state(information);
  copy_into(query.start, state.get());
  problem->addStartState(state);
  auto goals = std::make_shared<ob::GoalStates>(information);
  for (const std::size_t g : free_goals) {
    copy_into(query.goals[g], state.get());
    goals->addState(state);
  }
  problem->setGoal(goals);

  SearchResult found;
  const std::unique_ptr<ob::Planner> planner = make_planner(information, query, stream(1));
  planner->setProblemDefinition(problem);
  planner->setup();
  const ob::PlannerTerminationCondition stop([&] {
    ++found.iterations;
    found.timed_out = query.max_seconds > 0.0 && seconds_since(begin) > query.max_seconds;
    return cancel.is_raised() || found.timed_out || found.iterations > query.max_iterations;
  });
  const ob::PlannerStatus status = planner->solve(stop);
  if (cancel.is_raised() || status != ob::PlannerStatus::EXACT_SOLUTION) return found;

  og::PathGeometric path = *problem->getSolutionPath()->as<og::PathGeometric>();
  SeededSimplifier simplifier(information, stream(2));
  if (equal_steps > 0.0) {
    simplifier.simplifyMax(path);
  } else {
    skip_vertices(path);
    if (duration_cost(points_of(path)) < discard_ratio * least) {
      simplifier.shortcutPath(path, query.shortcut_attempts, query.shortcut_attempts, shortcut_span, snap_fraction);
      skip_vertices(path);
    }
  }
  if (cancel.is_raised()) return found;
  found.path = points_of(path);
  found.cost = duration_cost(found.path);
  return found;
}

/// Paths of which the best parts are joined, the least costly ones: as many as OMPL's own planner takes. The time and the
/// memory that it takes to join them grow with the square of their number.
constexpr std::size_t max_hybrid_paths = 24;

/// Adds a path to those that will be joined, which are sorted by their cost.
void keep_best(std::vector<SearchResult>& paths, const SearchResult& found) {
  const auto after = std::upper_bound(paths.begin(), paths.end(), found.cost,
                                      [](double cost, const SearchResult& other) { return cost < other.cost; });
  paths.insert(after, found);
  if (paths.size() > max_hybrid_paths) paths.pop_back();
}

/// One path from the best parts of several that begin at one state, joined where a free motion leads from one to another.
SearchResult hybridize_paths(Scene& scene, const JointQuery& query, const std::vector<SearchResult>& paths,
                             const CancelFlag& cancel) {
  const auto information = make_space_information(limits_of(scene), scene, query, derive_seed(query.seed, 0), cancel);
  og::PathHybridization hybrid(information);
  ob::ScopedState<> state(information);
  for (const SearchResult& other : paths) {
    const auto& points = other.path;
    // Ends that are different goals cannot be mixed.
    if (points.back() != paths.front().path.back()) continue;
    auto path = std::make_shared<og::PathGeometric>(information);
    for (const auto& point : points) {
      copy_into(point, state.get());
      path->append(state.get());
    }
    hybrid.recordPath(path, false);
  }
  SearchResult found;
  hybrid.computeHybridPath();
  const ob::PathPtr& mixed = hybrid.getHybridPath();
  if (!mixed || cancel.is_raised()) return found;
  og::PathGeometric path = *mixed->as<og::PathGeometric>();
  SeededSimplifier(information, derive_seed(query.seed, 2))
      .reduceVertices(path, query.shortcut_attempts, query.shortcut_attempts);
  found.path = points_of(path);
  found.cost = duration_cost(found.path);
  return found;
}

}  // namespace

Roadmap grow_roadmap(Scene& scene, const JointQuery& query, std::size_t milestones, const CancelFlag& cancel) {
  require_resolution(query.resolution);
  ompl::msg::setLogLevel(ompl::msg::LOG_NONE);
  const GeneratorLock turn(PlannerKind::prm, derive_seed(query.seed, 3), cancel);
  const auto information = make_space_information(limits_of(scene), scene, query, derive_seed(query.seed, 0), cancel);
  og::PRM planner(information);
  // Growing needs no start and no goal, but a definition that could hold them.
  planner.setProblemDefinition(std::make_shared<ob::ProblemDefinition>(information));
  planner.setup();
  unsigned int looks = 0;
  std::size_t before = 0;
  planner.growRoadmap(ob::PlannerTerminationCondition([&] {
    const std::size_t count = planner.milestoneCount();
    looks = count > before ? 0 : looks + 1;
    before = count;
    return cancel.is_raised() || count >= milestones || looks > max_failed_samples;
  }));
  if (looks > max_failed_samples && before < milestones) {
    throw std::runtime_error("the roadmap has " + std::to_string(before) + " of " + std::to_string(milestones) +
                             " milestones, and of the last " + std::to_string(max_failed_samples) +
                             " looks for a free state none found one: the arm has no room among its obstacles");
  }
  ob::PlannerData data(information);
  planner.getPlannerData(data);
  Roadmap roadmap;
  for (unsigned int v = 0; v < data.numVertices(); ++v) {
    const double* q = values(data.getVertex(v).getState());
    roadmap.milestones.emplace_back(q, q + scene.joint_count());
    std::vector<unsigned int> neighbors;
    data.getEdges(v, neighbors);
    for (const unsigned int n : neighbors) {
      if (v < n) roadmap.edges.emplace_back(v, n);
    }
  }
  return roadmap;
}

JointPlan plan_joint(Scene& scene, const JointQuery& query, const CancelFlag& cancel) {
  require_vectors(scene, query);
  require_resolution(query.resolution);
  if (!(query.range > 0.0)) throw std::invalid_argument("range must be above zero");
  const double equal_steps = query.resolution.fixed_validity_step;
  if (!(query.max_seconds >= 0.0)) throw std::invalid_argument("the bound on the time must not be below zero");
  const auto begin = Clock::now();
  const std::size_t checks_before = scene.state_checks();
  JointPlan plan;
  const auto ended = [&](JointPlanStatus status) {
    plan.status = status;
    plan.state_checks = scene.state_checks() - checks_before;
    plan.seconds = seconds_since(begin);
    return plan;
  };
  if (cancel.is_raised()) return ended(JointPlanStatus::cancelled);
  const auto valid = [&](const std::vector<double>& q) {
    return scene.is_free(q.data()) && (!query.accepts || query.accepts(q.data()));
  };
  if (!valid(query.start)) return ended(JointPlanStatus::start_in_collision);

  // Straight motions first: in the open they are both the quickest to find and the shortest.
  std::vector<std::size_t> free_goals;
  for (std::size_t g = 0; g < query.goals.size(); ++g) {
    if (cancel.is_raised()) return ended(JointPlanStatus::cancelled);
    if (!valid(query.goals[g])) continue;
    free_goals.push_back(g);
    if (equal_steps == 0.0 &&
        motion_is_free(scene, query.start.data(), query.goals[g].data(), query.resolution) &&
        accepts_motion(query, query.start.data(), query.goals[g].data())) {
      plan.path = {query.start, query.goals[g]};
      plan.goal = g;
      return ended(JointPlanStatus::solved);
    }
  }
  if (free_goals.empty()) return ended(JointPlanStatus::goals_in_collision);

  // OMPL reports progress on the console, which belongs to the program.
  ompl::msg::setLogLevel(ompl::msg::LOG_NONE);
  const GeneratorLock turn(query.planner, derive_seed(query.seed, 3), cancel);
  if (cancel.is_raised()) return ended(JointPlanStatus::cancelled);
  const bool anytime = query.planner == PlannerKind::anytime;
  double best = std::numeric_limits<double>::infinity();
  double least = best;
  std::vector<SearchResult> paths;
  // Only trees that end with their first path begin again, and only where that path came easily.
  const bool again = query.planner == PlannerKind::rrt_connect || query.planner == PlannerKind::bitrrt;
  const unsigned int searches = again ? 1 + query.more_searches : 1;
  for (unsigned int search = 0; anytime || search < searches; ++search) {
    if (search > 0 && !anytime) {
      if (plan.iterations > easy_iterations) break;
      // No path to a goal is quicker than the straight motion; what could not be quicker than the best is left out.
      const auto hopeless = [&](std::size_t g) {
        return max_joint_distance(query.start, query.goals[g]) > retry_ratio * least;
      };
      free_goals.erase(std::remove_if(free_goals.begin(), free_goals.end(), hopeless), free_goals.end());
      if (free_goals.empty()) break;
    }
    const SearchResult found = search_once(scene, query, free_goals, search, least, begin, cancel);
    plan.iterations += found.iterations;
    plan.timed_out = plan.timed_out || found.timed_out;
    if (cancel.is_raised()) return ended(JointPlanStatus::cancelled);
    if (found.path.empty()) break;
    if (anytime) keep_best(paths, found);
    const double cost = found.cost + length_of(found.path);
    if (cost < best) {
      best = cost;
      least = found.cost;
      plan.path = found.path;
    }
    if (anytime && (plan.iterations >= query.max_iterations || plan.timed_out)) break;
  }
  if (paths.size() > 1) {
    const SearchResult mixed = hybridize_paths(scene, query, paths, cancel);
    if (cancel.is_raised()) return ended(JointPlanStatus::cancelled);
    if (!mixed.path.empty() && mixed.cost < least) plan.path = mixed.path;
  }
  if (plan.path.empty()) return ended(JointPlanStatus::no_plan);
  // The goal that was reached: its state was copied through the planner unchanged.
  const auto reached = std::find(query.goals.begin(), query.goals.end(), plan.path.back());
  plan.goal = static_cast<std::size_t>(reached - query.goals.begin());
  return ended(JointPlanStatus::solved);
}

}  // namespace proact::planning
