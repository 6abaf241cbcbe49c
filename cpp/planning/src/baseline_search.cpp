#include "proact/planning/baseline_search.hpp"

#include "planners.hpp"
#include "shapes.hpp"

#include <ompl/base/ProblemDefinition.h>
#include <ompl/base/SpaceInformation.h>
#include <ompl/base/StateValidityChecker.h>
#include <ompl/base/goals/GoalStates.h>
#include <ompl/base/spaces/RealVectorStateSpace.h>
#include <ompl/geometric/PathGeometric.h>
#include <ompl/geometric/PathSimplifier.h>
#include <ompl/util/Console.h>

#include <algorithm>
#include <ctime>
#include <pthread.h>
#include <memory>

namespace proact::planning {

namespace ob = ompl::base;
namespace og = ompl::geometric;

namespace {

/// One shape of the arm or of what it carries.
struct Part {
  std::size_t link = 0;
  std::size_t owner = 0;
  std::size_t body = 0;
  Pose link_from_shape;
  Solid solid;
  std::unique_ptr<fcl::CollisionObjectd> object;
};

/// The arm's shapes and the obstacles in a tree each.
class BaselineWorld {
 public:
  explicit BaselineWorld(const Scene& scene) : arm_(scene.arm()), content_(scene.content()) {
    base_ = validated_pose(content_.base, "base");
    body_of_link_.assign(arm_.links.size(), 0);
    arm_position_.assign(arm_.joints.size(), arm_.arm.size());
    for (std::size_t k = 0; k < arm_.arm.size(); ++k) arm_position_[arm_.arm[k]] = k;
    hand_angle_.assign(arm_.joints.size(), 0.0);
    for (std::size_t k = 0; k < arm_.hand.size(); ++k) hand_angle_[arm_.hand[k]] = content_.hand[k];
    for (std::size_t j = 0; j < arm_.joints.size(); ++j) {
      const Joint& joint = arm_.joints[j];
      parent_from_child_.push_back(validated_pose(joint.pose, arm_.links[joint.child].name));
      const bool opens = arm_position_[j] < arm_.arm.size();
      body_of_link_[joint.child] = opens ? arm_position_[j] + 1 : body_of_link_[joint.parent];
    }
    for (std::size_t l = 0; l < arm_.links.size(); ++l) {
      for (const PlacedShape& placed : arm_.links[l].shapes) add(l, l, placed, arm_.links[l].name);
    }
    if (content_.attached) add(arm_.tip, arm_.links.size(), content_.attached->placed, content_.attached->name);
    allowed_.assign(arm_.links.size() * arm_.links.size(), 0);
    for (const auto& [a, b] : arm_.allowed_collisions) {
      allowed_[a * arm_.links.size() + b] = allowed_[b * arm_.links.size() + a] = 1;
    }
    for (Part& part : parts_) {
      part.object->setUserData(&part);
      arm_tree_.registerObject(part.object.get());
    }
    for (const Object& obstacle : content_.obstacles) {
      const Solid solid = make_solid(obstacle.placed.shape, content_.padding, obstacle.name);
      obstacles_.push_back(
          std::make_unique<fcl::CollisionObjectd>(geometry_of(solid), to_fcl(transform_of(obstacle.placed.pose, obstacle.name))));
      obstacle_tree_.registerObject(obstacles_.back().get());
    }
    arm_tree_.setup();
    obstacle_tree_.setup();
    world_from_link_.assign(arm_.links.size(), base_);
  }

  bool is_free(const double* q) {
    for (std::size_t j = 0; j < arm_.joints.size(); ++j) {
      const Joint& joint = arm_.joints[j];
      const bool moves = arm_position_[j] < arm_.arm.size();
      const double position = moves ? q[arm_position_[j]] : hand_angle_[j];
      const Pose at_zero = world_from_link_[joint.parent] * parent_from_child_[j];
      const Vec3 axis{joint.axis[0], joint.axis[1], joint.axis[2]};
      world_from_link_[joint.child] =
          joint.kind == JointKind::fixed ? at_zero : joint_pose(at_zero, joint.kind, normalized(axis), position);
    }
    for (Part& part : parts_) {
      part.object->setTransform(to_fcl(to_transform(world_from_link_[part.link] * part.link_from_shape)));
      part.object->computeAABB();
    }
    arm_tree_.update();
    CollisionQuery question{this, false};
    arm_tree_.collide(&obstacle_tree_, &question, collides_with_obstacle);
    if (!question.in_collision) arm_tree_.collide(&question, collides_with_arm);
    return !question.in_collision;
  }

 private:
  struct CollisionQuery {
    BaselineWorld* world;
    bool in_collision;
  };

  void add(std::size_t link, std::size_t owner, const PlacedShape& placed, const std::string& name) {
    Part part;
    part.link = link;
    part.owner = owner;
    part.body = body_of_link_[link];
    part.link_from_shape = validated_pose(placed.pose, name);
    part.solid = make_solid(placed.shape, 0.0, name);
    part.object = std::make_unique<fcl::CollisionObjectd>(geometry_of(part.solid), to_fcl(to_transform(Pose{})));
    parts_.push_back(std::move(part));
  }

  static bool collide(fcl::CollisionObjectd* a, fcl::CollisionObjectd* b, CollisionQuery& question) {
    static const fcl::CollisionRequestd request(1, false);
    fcl::CollisionResultd result;
    question.in_collision = fcl::collide(a, b, request, result) > 0;
    return question.in_collision;
  }

  static bool collides_with_obstacle(fcl::CollisionObjectd* a, fcl::CollisionObjectd* b, void* data) {
    auto& question = *static_cast<CollisionQuery*>(data);
    const auto* part = static_cast<const Part*>(a->getUserData() != nullptr ? a->getUserData() : b->getUserData());
    // What stands still with the base cannot be helped by any plan.
    return part->body > 0 && collide(a, b, question);
  }

  static bool collides_with_arm(fcl::CollisionObjectd* a, fcl::CollisionObjectd* b, void* data) {
    auto& question = *static_cast<CollisionQuery*>(data);
    const auto* one = static_cast<const Part*>(a->getUserData());
    const auto* other = static_cast<const Part*>(b->getUserData());
    const BaselineWorld& world = *question.world;
    const std::size_t links = world.arm_.links.size();
    const bool may = one->owner < links && other->owner < links && world.allowed_[one->owner * links + other->owner] != 0;
    return one->body != other->body && !may && collide(a, b, question);
  }

  Arm arm_;
  SceneContent content_;
  Pose base_;
  std::vector<std::size_t> body_of_link_;
  std::vector<std::size_t> arm_position_;
  std::vector<double> hand_angle_;
  std::vector<Pose> parent_from_child_;
  std::vector<Pose> world_from_link_;
  std::vector<char> allowed_;
  std::vector<Part> parts_;
  std::vector<std::unique_ptr<fcl::CollisionObjectd>> obstacles_;
  fcl::DynamicAABBTreeCollisionManagerd arm_tree_;
  fcl::DynamicAABBTreeCollisionManagerd obstacle_tree_;
};

class BaselineValidityChecker : public ob::StateValidityChecker {
 public:
  BaselineValidityChecker(const ob::SpaceInformationPtr& space, BaselineWorld& world)
      : ob::StateValidityChecker(space), world_(world) {}

  bool isValid(const ob::State* state) const override {
    return si_->satisfiesBounds(state) && world_.is_free(state->as<ob::RealVectorStateSpace::StateType>()->values);
  }

 private:
  BaselineWorld& world_;
};

}  // namespace

int thread_cpu_clock() {
  clockid_t clock = CLOCK_THREAD_CPUTIME_ID;
  pthread_getcpuclockid(pthread_self(), &clock);
  return clock;
}

double cpu_secs_of(int clock) {
  timespec now{};
  clock_gettime(clock, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

double thread_cpu_secs() {
  return cpu_secs_of(CLOCK_THREAD_CPUTIME_ID);
}

BaselinePlan search_baseline(const Scene& scene, const std::vector<double>& start,
                             const std::vector<std::vector<double>>& goals, const BaselineSettings& settings,
                             std::uint64_t seed) {
  JointQuery query;
  query.planner = settings.planner;
  query.start = start;
  query.goals = goals;
  require_vectors(scene, query);
  ompl::msg::setLogLevel(ompl::msg::LOG_NONE);
  const CancelFlag never;
  const GeneratorLock turn(query.planner, derive_seed(seed, 3), never);
  BaselineWorld world(scene);
  const auto joints = static_cast<unsigned int>(scene.joint_count());

  auto space = std::make_shared<ob::RealVectorStateSpace>(joints);
  ob::RealVectorBounds bounds(joints);
  for (unsigned int k = 0; k < joints; ++k) {
    bounds.setLow(k, scene.lower(k));
    bounds.setHigh(k, scene.upper(k));
  }
  space->setBounds(bounds);
  set_original_projection(*space);
  auto information = std::make_shared<ob::SpaceInformation>(space);
  information->setStateValidityChecker(std::make_shared<BaselineValidityChecker>(information, world));
  information->setStateValidityCheckingResolution(settings.fixed_validity_step);
  information->setup();
  auto problem = std::make_shared<ob::ProblemDefinition>(information);
  ob::ScopedState<> state(space);
  const auto set = [&state](const std::vector<double>& q) {
    std::copy(q.begin(), q.end(), state.get()->as<ob::RealVectorStateSpace::StateType>()->values);
  };
  set(start);
  problem->addStartState(state);
  auto ends = std::make_shared<ob::GoalStates>(information);
  for (const auto& goal : goals) {
    set(goal);
    ends->addState(state);
  }
  problem->setGoal(ends);
  BaselinePlan plan;
  const double begin = thread_cpu_secs();
  while (plan.attempts < settings.attempts) {
    ++plan.attempts;
    const double attempt_begin = thread_cpu_secs();
    const ob::PlannerTerminationCondition stop(
        [&] { return thread_cpu_secs() - attempt_begin > settings.seconds; });
    problem->clearSolutionPaths();
    const std::unique_ptr<ob::Planner> planner =
        default_planner(information, query.planner, derive_seed(seed, plan.attempts));
    planner->setProblemDefinition(problem);
    planner->setup();
    const ob::PlannerStatus status = planner->solve(stop);
    plan.search_secs += thread_cpu_secs() - attempt_begin;
    if (status == ob::PlannerStatus::EXACT_SOLUTION) {
      og::PathGeometric path = *problem->getSolutionPath()->as<og::PathGeometric>();
      og::PathSimplifier simplifier(information);
      simplifier.simplify(path, stop);
      for (const ob::State* point : path.getStates()) {
        const double* values = point->as<ob::RealVectorStateSpace::StateType>()->values;
        plan.path.emplace_back(values, values + joints);
      }
      break;
    }
  }
  plan.cpu_secs = thread_cpu_secs() - begin;
  return plan;
}

}  // namespace proact::planning
