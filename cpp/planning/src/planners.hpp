// OMPL's planners by kind, and who may run beside whom. Private to the library.
#pragma once

#include "proact/planning/joint_planner.hpp"

#include <ompl/base/Planner.h>

#include <memory>
#include <mutex>
#include <shared_mutex>

namespace proact::planning {

/// Seed number `stream` of a query: SplitMix64 (Steele, Lea and Flood, OOPSLA 2014), cut to OMPL's 32 bits.
std::uint32_t derive_seed(std::uint64_t query_seed, std::uint64_t stream);

/// The right to use OMPL's generators. Planners whose generators all take the query's seeds share it; any other
/// has it alone, with the process-wide source of seeds set to `seed`. A raised flag ends the wait, without the
/// right.
class GeneratorLock {
 public:
  GeneratorLock(PlannerKind kind, std::uint32_t seed, const CancelFlag& cancel);

 private:
  std::shared_lock<std::shared_timed_mutex> shared_;
  std::unique_lock<std::shared_timed_mutex> exclusive_;
};

/// LBKPIECE1 lays its grid over the first two joints, as the original's does, in MoveIt's cells of 0.1 rad. OMPL's own
/// random projection leaves it without a way in most problems.
void set_original_projection(ompl::base::StateSpace& space);

/// A planner with OMPL's own parameters; `seed` reaches the generators of RRTConnect alone.
std::unique_ptr<ompl::base::Planner> default_planner(const ompl::base::SpaceInformationPtr& space, PlannerKind kind,
                                                     std::uint32_t seed);

/// Throws std::invalid_argument for a roadmap whose milestones have another number of joints or are not finite, or
/// whose edges name no milestone; and for a start or goals of the wrong length, outside the limits or not finite.
void require_vectors(const Scene& scene, const JointQuery& query);

/// The planner of a query, its parameters set. Throws std::invalid_argument naming a parameter that it does not
/// know, with those that it does, or a value that it refuses.
std::unique_ptr<ompl::base::Planner> make_planner(const ompl::base::SpaceInformationPtr& space, const JointQuery& query,
                                                  std::uint32_t seed);

}  // namespace proact::planning
