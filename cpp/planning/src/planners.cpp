#include "planners.hpp"

#include <ompl/base/PlannerData.h>
#include <ompl/base/SpaceInformation.h>
#include <ompl/base/spaces/RealVectorStateProjections.h>
#include <ompl/base/spaces/RealVectorStateSpace.h>
#include <ompl/config.h>
#include <ompl/datastructures/NearestNeighborsLinear.h>
#include <ompl/geometric/planners/kpiece/LBKPIECE1.h>
#include <ompl/geometric/planners/prm/LazyPRM.h>
#include <ompl/geometric/planners/prm/PRM.h>
#include <ompl/geometric/planners/rrt/BiTRRT.h>
#include <ompl/geometric/planners/rrt/RRTConnect.h>
#include <ompl/geometric/planners/rrt/RRTstar.h>
#include <ompl/util/Console.h>
#include <ompl/util/RandomNumbers.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <stdexcept>
#include <string>
#include <vector>

namespace proact::planning {

namespace ob = ompl::base;
namespace og = ompl::geometric;

namespace {

/// How long a wait for the generators goes on before the flag is looked at again.
constexpr std::chrono::milliseconds poll_interval{1};

/// Milestones that are added to a roadmap before a way is looked for again.
constexpr unsigned int milestone_batch = 50;

std::shared_timed_mutex& generators() {
  static std::shared_timed_mutex mutex;
  return mutex;
}

class SeededRrtConnect : public og::RRTConnect {
 public:
  SeededRrtConnect(const ob::SpaceInformationPtr& space, std::uint32_t seed) : og::RRTConnect(space) {
    rng_.setLocalSeed(seed);
    // An exact search without pivots: the default structure draws them from a generator out of reach.
    setNearestNeighbors<ompl::NearestNeighborsLinear>();
  }
};

/// OMPL's PRM looks for a way in a second thread while the roadmap grows, so that its result depends on the
/// machine's mood; here growing and looking take turns.
class SerialPrm : public og::PRM {
 public:
  explicit SerialPrm(const ob::SpaceInformationPtr& space) : og::PRM(space) {}

  ob::PlannerStatus solve(const ob::PlannerTerminationCondition& stop) override {
    checkValidity();
    while (const ob::State* start = pis_.nextStart()) startM_.push_back(addMilestone(si_->cloneState(start)));
    while (const ob::State* goal = pis_.nextGoal()) goalM_.push_back(addMilestone(si_->cloneState(goal)));
    if (startM_.empty()) return ob::PlannerStatus::INVALID_START;
    if (goalM_.empty()) return ob::PlannerStatus::INVALID_GOAL;
    bestCost_ = opt_->infiniteCost();
    ob::PathPtr way;
    while (!maybeConstructSolution(startM_, goalM_, way)) {
      if (stop) return ob::PlannerStatus::TIMEOUT;
      unsigned int asked = 0;
      growRoadmap(ob::PlannerTerminationCondition([&] { return ++asked > milestone_batch || stop; }));
    }
    pdef_->addSolutionPath(way, false, 0.0, getName());
    return ob::PlannerStatus::EXACT_SOLUTION;
  }
};

#if OMPL_VERSION_VALUE >= 1005000
/// OMPL 1.5's LazyPRM frees the states of its graph in `clear`, and its destructor does not call it.
class FreeingLazyPrm : public og::LazyPRM {
 public:
  explicit FreeingLazyPrm(const ob::PlannerData& data) : og::LazyPRM(data) {}
  ~FreeingLazyPrm() override { og::LazyPRM::clear(); }
  FreeingLazyPrm(const FreeingLazyPrm&) = delete;
  FreeingLazyPrm& operator=(const FreeingLazyPrm&) = delete;
};

/// A planner that begins with a roadmap and looks at no more of it than a way needs.
std::unique_ptr<ob::Planner> roadmap_planner(const ob::SpaceInformationPtr& space, const Roadmap& roadmap) {
  std::vector<ob::ScopedState<ob::RealVectorStateSpace>> states;
  states.reserve(roadmap.milestones.size());
  ob::PlannerData data(space);
  for (const auto& milestone : roadmap.milestones) {
    states.emplace_back(space);
    std::copy(milestone.begin(), milestone.end(), states.back()->values);
    data.addVertex(ob::PlannerDataVertex(states.back().get()));
  }
  for (const auto& [a, b] : roadmap.edges) {
    const ob::Cost length(space->distance(states[a].get(), states[b].get()));
    data.addEdge(static_cast<unsigned int>(a), static_cast<unsigned int>(b), ob::PlannerDataEdge(), length);
  }
  // The planner clones the states.
  return std::make_unique<FreeingLazyPrm>(data);
}
#else
std::unique_ptr<ob::Planner> roadmap_planner(const ob::SpaceInformationPtr&, const Roadmap&) {
  throw std::invalid_argument("a stored roadmap needs OMPL 1.5, this is " OMPL_VERSION);
}
#endif

void require_roadmap(const Scene& scene, const Roadmap& roadmap) {
  for (const auto& milestone : roadmap.milestones) {
    const bool finite = std::all_of(milestone.begin(), milestone.end(), [](double q) { return std::isfinite(q); });
    if (milestone.size() != scene.joint_count() || !finite) {
      throw std::invalid_argument("a milestone of the roadmap is no vector of " + std::to_string(scene.joint_count()) +
                                  " finite angles");
    }
  }
  for (const auto& [a, b] : roadmap.edges) {
    if (std::max(a, b) >= roadmap.milestones.size()) {
      throw std::invalid_argument("an edge of the roadmap names milestone " + std::to_string(std::max(a, b)) + " of " +
                                  std::to_string(roadmap.milestones.size()));
    }
  }
}

void require_vector(const Scene& scene, const std::vector<double>& q, const std::string& what) {
  if (q.size() != scene.joint_count()) {
    throw std::invalid_argument(what + " has " + std::to_string(q.size()) + " angles, the arm has " +
                                std::to_string(scene.joint_count()) + " joints");
  }
  for (std::size_t k = 0; k < q.size(); ++k) {
    if (!(q[k] >= scene.lower(k) && q[k] <= scene.upper(k))) {
      throw std::invalid_argument(what + " joint " + std::to_string(k) + " = " + std::to_string(q[k]) +
                                  " rad, limit [" + std::to_string(scene.lower(k)) + ", " +
                                  std::to_string(scene.upper(k)) + "]");
    }
  }
}

}  // namespace

void require_vectors(const Scene& scene, const JointQuery& query) {
  require_vector(scene, query.start, "the start");
  if (query.goals.empty()) throw std::invalid_argument("no goal was given");
  for (const auto& goal : query.goals) require_vector(scene, goal, "a goal");
  if (query.roadmap) require_roadmap(scene, *query.roadmap);
}

std::uint32_t derive_seed(std::uint64_t query_seed, std::uint64_t stream) {
  std::uint64_t z = query_seed + (stream + 1) * 0x9e3779b97f4a7c15ULL;
  z = (z ^ (z >> 30U)) * 0xbf58476d1ce4e5b9ULL;
  z = (z ^ (z >> 27U)) * 0x94d049bb133111ebULL;
  z ^= z >> 31U;
  // OMPL treats seed 0 as "choose one yourself".
  return std::max<std::uint32_t>(static_cast<std::uint32_t>(z), 1U);
}

GeneratorLock::GeneratorLock(PlannerKind kind, std::uint32_t seed, const CancelFlag& cancel)
    : shared_(generators(), std::defer_lock), exclusive_(generators(), std::defer_lock) {
  if (kind == PlannerKind::rrt_connect || kind == PlannerKind::anytime) {
    while (!cancel.is_raised() && !shared_.try_lock_for(poll_interval)) {
    }
    return;
  }
  while (!cancel.is_raised() && !exclusive_.try_lock_for(poll_interval)) {
  }
  if (exclusive_) ompl::RNG::setSeed(seed);
}

void set_original_projection(ob::StateSpace& space) {
  std::vector<unsigned int> first{0};
  if (space.getDimension() > 1) first.push_back(1);
  const std::vector<double> cells(first.size(), 0.1);
  space.registerDefaultProjection(std::make_shared<ob::RealVectorOrthogonalProjectionEvaluator>(&space, cells, first));
}

std::unique_ptr<ob::Planner> default_planner(const ob::SpaceInformationPtr& space, PlannerKind kind,
                                             std::uint32_t seed) {
  switch (kind) {
    case PlannerKind::rrt_connect:
    case PlannerKind::anytime: return std::make_unique<SeededRrtConnect>(space, seed);
    case PlannerKind::bitrrt: return std::make_unique<og::BiTRRT>(space);
    case PlannerKind::lbkpiece1: return std::make_unique<og::LBKPIECE1>(space);
    case PlannerKind::rrt_star: return std::make_unique<og::RRTstar>(space);
    case PlannerKind::prm: return std::make_unique<SerialPrm>(space);
  }
  throw std::invalid_argument("unknown kind of planner");
}

std::unique_ptr<ob::Planner> make_planner(const ob::SpaceInformationPtr& space, const JointQuery& query,
                                          std::uint32_t seed) {
  const bool over = query.planner == PlannerKind::prm && query.roadmap && !query.roadmap->milestones.empty();
  std::unique_ptr<ob::Planner> planner =
      over ? roadmap_planner(space, *query.roadmap) : default_planner(space, query.planner, seed);
  ob::ParamSet& known = planner->params();
  // A roadmap's milestones are as far apart as they are: OMPL's own bound on new edges allows for that.
  if (!over && known.hasParam("range")) known.setParam("range", std::to_string(query.range));
  for (const auto& [name, value] : query.parameters) {
    if (!known.hasParam(name)) {
      std::vector<std::string> names;
      known.getParamNames(names);
      std::string list;
      for (const std::string& other : names) list += (list.empty() ? "" : ", ") + other;
      throw std::invalid_argument(planner->getName() + " has no parameter \"" + name + "\", expected one of " + list);
    }
    bool taken = false;
    try {
      taken = known.setParam(name, value);
    } catch (const std::exception&) {
      // OMPL throws where the text is no number and returns false where the number will not do.
    }
    if (!taken) {
      throw std::invalid_argument(planner->getName() + " refuses \"" + value + "\" for its parameter \"" + name + "\"");
    }
  }
  return planner;
}

void check_planner(const JointQuery& query) {
  // Even a planner that never runs draws a seed for its generators.
  const GeneratorLock turn(PlannerKind::rrt_connect, 1, CancelFlag());
  ompl::msg::setLogLevel(ompl::msg::LOG_NONE);
  const auto space = std::make_shared<ob::RealVectorStateSpace>(2);
  space->setBounds(0.0, 1.0);
  const auto information = std::make_shared<ob::SpaceInformation>(space);
  information->setStateValidityChecker([](const ob::State*) { return true; });
  information->setup();
  make_planner(information, query, 1);
}

}  // namespace proact::planning
