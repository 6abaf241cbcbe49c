// The same motion planning problem on raw OMPL and raw FCL: no Rust, none of the project's C++ core.
//
// Reads an arm, obstacles and a query as text on standard input, prints the path, one joint vector a line, 17
// digits. What it does on its own: kinematics, the collision world (FCL's trees), the motion check (plain equal
// steps, without any clearance bound), seeds, planner and path shortening.
//
// Build: g++ -std=c++17 -O2 -ffp-contract=off raw_ompl.cpp -I/usr/include/ompl-1.5 -I/usr/include/eigen3 -lompl -lfcl -lccd

#include <fcl/broadphase/broadphase_dynamic_AABB_tree.h>
#include <fcl/geometry/shape/box.h>
#include <fcl/geometry/shape/capsule.h>
#include <fcl/geometry/shape/cylinder.h>
#include <fcl/geometry/shape/sphere.h>
#include <fcl/narrowphase/collision.h>
#include <ompl/base/ProblemDefinition.h>
#include <ompl/base/SpaceInformation.h>
#include <ompl/base/goals/GoalStates.h>
#include <ompl/base/spaces/RealVectorStateSpace.h>
#include <ompl/base/terminationconditions/IterationTerminationCondition.h>
#include <ompl/datastructures/NearestNeighborsLinear.h>
#include <ompl/geometric/PathSimplifier.h>
#include <ompl/geometric/planners/rrt/RRTConnect.h>
#include <ompl/util/Console.h>

#include <cmath>
#include <cstdint>
#include <iostream>
#include <memory>
#include <set>
#include <stdexcept>
#include <string>
#include <vector>

namespace ob = ompl::base;
namespace og = ompl::geometric;

namespace {

template <typename T>
T read() {
  T value;
  if (!(std::cin >> value)) throw std::runtime_error("the input ends too early");
  return value;
}

Eigen::Isometry3d read_pose() {
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
  for (int k = 0; k < 3; ++k) pose.translation()[k] = read<double>();
  double r[4];
  for (double& v : r) v = read<double>();
  pose.linear() = Eigen::Quaterniond(r[3], r[0], r[1], r[2]).normalized().toRotationMatrix();
  return pose;
}

std::shared_ptr<fcl::CollisionGeometryd> read_shape() {
  const auto kind = read<std::string>();
  double s[3];
  for (double& v : s) v = read<double>();
  if (kind == "box") return std::make_shared<fcl::Boxd>(s[0], s[1], s[2]);
  if (kind == "sphere") return std::make_shared<fcl::Sphered>(s[0]);
  if (kind == "cylinder") return std::make_shared<fcl::Cylinderd>(s[0], s[1]);
  if (kind == "capsule") return std::make_shared<fcl::Capsuled>(s[0], s[1]);
  throw std::runtime_error("unknown shape " + kind);
}

struct Joint {
  std::size_t parent = 0;
  std::size_t child = 0;
  bool revolute = false;
  Eigen::Isometry3d origin;
  Eigen::Vector3d axis;
  double lower = 0.0, upper = 0.0;
  /// Position in the planned vector, or -1 with a fixed angle.
  int planned = -1;
  double angle = 0.0;
};

struct LinkShape {
  std::size_t link = 0;
  Eigen::Isometry3d pose;
  std::unique_ptr<fcl::CollisionObjectd> object;
};

struct World {
  std::size_t links = 0;
  std::vector<Joint> joints;
  std::vector<LinkShape> shapes;
  std::set<std::pair<std::size_t, std::size_t>> allowed;
  std::vector<std::unique_ptr<fcl::CollisionObjectd>> obstacles;
  fcl::DynamicAABBTreeCollisionManagerd tree;
  Eigen::Isometry3d base;
  std::vector<double> lower, upper;
  /// For each link, how many planned joints move it.
  std::vector<std::size_t> depth;

  static bool first_hit(fcl::CollisionObjectd* a, fcl::CollisionObjectd* b, void* data) {
    const fcl::CollisionRequestd request;
    fcl::CollisionResultd result;
    if (fcl::collide(a, b, request, result) == 0) return false;
    *static_cast<bool*>(data) = true;
    return true;
  }

  bool is_free(const double* q) {
    std::vector<Eigen::Isometry3d> at(links, base);
    for (const Joint& joint : joints) {
      const double angle = joint.planned < 0 ? joint.angle : q[joint.planned];
      at[joint.child] = at[joint.parent] * joint.origin;
      if (joint.revolute) at[joint.child] = at[joint.child] * Eigen::AngleAxisd(angle, joint.axis);
    }
    for (LinkShape& shape : shapes) {
      shape.object->setTransform(at[shape.link] * shape.pose);
      shape.object->computeAABB();
      if (depth[shape.link] == 0) continue;  // it does not move
      bool hit = false;
      tree.collide(shape.object.get(), &hit, first_hit);
      if (hit) return false;
    }
    for (std::size_t a = 0; a < shapes.size(); ++a) {
      for (std::size_t b = a + 1; b < shapes.size(); ++b) {
        const std::size_t la = shapes[a].link, lb = shapes[b].link;
        if (depth[la] == depth[lb] || allowed.count({la, lb}) > 0) continue;
        if (!shapes[a].object->getAABB().overlap(shapes[b].object->getAABB())) continue;
        bool hit = false;
        if (first_hit(shapes[a].object.get(), shapes[b].object.get(), &hit)) return false;
      }
    }
    return true;
  }
};

void read_world(World& world) {
  world.links = read<std::size_t>();
  world.depth.assign(world.links, 0);
  world.base = read_pose();
  const auto joint_count = read<std::size_t>();
  int planned = 0;
  for (std::size_t j = 0; j < joint_count; ++j) {
    Joint joint;
    joint.parent = read<std::size_t>();
    joint.child = read<std::size_t>();
    joint.revolute = read<int>() != 0;
    joint.origin = read_pose();
    for (int k = 0; k < 3; ++k) joint.axis[k] = read<double>();
    joint.lower = read<double>();
    joint.upper = read<double>();
    joint.planned = read<int>();
    joint.angle = read<double>();
    world.depth[joint.child] = world.depth[joint.parent] + (joint.planned >= 0 ? 1 : 0);
    if (joint.planned >= 0) {
      if (joint.planned != planned++) throw std::runtime_error("planned joints out of order");
      world.lower.push_back(joint.lower);
      world.upper.push_back(joint.upper);
    }
    world.joints.push_back(joint);
  }
  for (auto n = read<std::size_t>(); n > 0; --n) {
    LinkShape shape;
    shape.link = read<std::size_t>();
    auto geometry = read_shape();
    shape.pose = read_pose();
    shape.object = std::make_unique<fcl::CollisionObjectd>(geometry);
    world.shapes.push_back(std::move(shape));
  }
  for (auto n = read<std::size_t>(); n > 0; --n) {
    const auto a = read<std::size_t>();
    const auto b = read<std::size_t>();
    world.allowed.insert({a, b});
    world.allowed.insert({b, a});
  }
  for (auto n = read<std::size_t>(); n > 0; --n) {
    auto geometry = read_shape();
    world.obstacles.push_back(std::make_unique<fcl::CollisionObjectd>(geometry, read_pose()));
    world.obstacles.back()->computeAABB();
    world.tree.registerObject(world.obstacles.back().get());
  }
  world.tree.setup();
}

std::vector<double> read_vector(std::size_t count) {
  std::vector<double> q(count);
  for (double& v : q) v = read<double>();
  return q;
}

bool motion_is_free(World& world, const double* a, const double* b, double step) {
  const std::size_t n = world.lower.size();
  double squares = 0.0;
  for (std::size_t k = 0; k < n; ++k) squares += (b[k] - a[k]) * (b[k] - a[k]);
  const auto steps = static_cast<int>(std::ceil(std::sqrt(squares) / step));
  std::vector<double> at(n);
  for (int s = 0; s <= steps; ++s) {
    const double t = steps == 0 ? 0.0 : static_cast<double>(s) / steps;
    for (std::size_t k = 0; k < n; ++k) at[k] = a[k] + t * (b[k] - a[k]);
    if (!world.is_free(at.data())) return false;
  }
  return true;
}

const double* values(const ob::State* state) { return state->as<ob::RealVectorStateSpace::StateType>()->values; }

class DiscreteMotionValidator : public ob::MotionValidator {
 public:
  DiscreteMotionValidator(const ob::SpaceInformationPtr& space, World& world, double step)
      : ob::MotionValidator(space), world_(world), step_(step) {}
  bool checkMotion(const ob::State* a, const ob::State* b) const override {
    return si_->satisfiesBounds(b) && motion_is_free(world_, values(a), values(b), step_);
  }
  bool checkMotion(const ob::State*, const ob::State*, std::pair<ob::State*, double>&) const override { return false; }

 private:
  World& world_;
  double step_;
};

// The three places where OMPL draws numbers, each with a seed made from the query's by SplitMix64.
std::uint32_t seed_number(std::uint64_t seed, int number) {
  std::uint64_t state = seed;
  std::uint64_t z = 0;
  for (int k = 0; k <= number; ++k) {
    state += 0x9e3779b97f4a7c15ULL;
    z = state;
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9ULL;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebULL;
    z = z ^ (z >> 31);
  }
  const auto cut = static_cast<std::uint32_t>(z);
  return cut == 0 ? 1 : cut;
}

struct Sampler : ob::RealVectorStateSampler {
  Sampler(const ob::StateSpace* space, std::uint32_t seed) : RealVectorStateSampler(space) { rng_.setLocalSeed(seed); }
};
struct Planner : og::RRTConnect {
  Planner(const ob::SpaceInformationPtr& space, std::uint32_t seed) : RRTConnect(space) { rng_.setLocalSeed(seed); }
};
struct Simplifier : og::PathSimplifier {
  Simplifier(const ob::SpaceInformationPtr& space, std::uint32_t seed) : PathSimplifier(space) {
    rng_.setLocalSeed(seed);
  }
};

void print(const double* q, std::size_t n) {
  for (std::size_t k = 0; k < n; ++k) std::cout << q[k] << (k + 1 < n ? ' ' : '\n');
}

int run() {
  std::cout.precision(17);
  ompl::msg::setLogLevel(ompl::msg::LOG_NONE);
  World world;
  read_world(world);
  const std::size_t n = world.lower.size();
  const auto start = read_vector(n);
  const auto goal = read_vector(n);
  const auto seed = read<std::uint64_t>();
  const auto max_iterations = read<unsigned int>();
  const auto range = read<double>();
  const auto shortcuts = read<unsigned int>();
  const auto step = read<double>();

  if (motion_is_free(world, start.data(), goal.data(), step)) {
    print(start.data(), n);
    print(goal.data(), n);
    return 0;
  }
  auto space = std::make_shared<ob::RealVectorStateSpace>(static_cast<unsigned int>(n));
  ob::RealVectorBounds bounds(static_cast<unsigned int>(n));
  bounds.low = world.lower;
  bounds.high = world.upper;
  space->setBounds(bounds);
  space->setStateSamplerAllocator(
      [&](const ob::StateSpace* s) { return std::make_shared<Sampler>(s, seed_number(seed, 0)); });
  auto information = std::make_shared<ob::SpaceInformation>(space);
  information->setStateValidityChecker(
      [&](const ob::State* state) { return information->satisfiesBounds(state) && world.is_free(values(state)); });
  information->setMotionValidator(std::make_shared<DiscreteMotionValidator>(information, world, step));
  information->setup();

  ob::ScopedState<> from(space), to(space);
  for (std::size_t k = 0; k < n; ++k) {
    from[static_cast<unsigned int>(k)] = start[k];
    to[static_cast<unsigned int>(k)] = goal[k];
  }
  auto problem = std::make_shared<ob::ProblemDefinition>(information);
  problem->addStartState(from);
  auto goals = std::make_shared<ob::GoalStates>(information);
  goals->addState(to);
  problem->setGoal(goals);

  Planner planner(information, seed_number(seed, 1));
  planner.setNearestNeighbors<ompl::NearestNeighborsLinear>();
  planner.setRange(range);
  planner.setProblemDefinition(problem);
  planner.setup();
  ob::IterationTerminationCondition limit(max_iterations);
  if (planner.solve(limit) != ob::PlannerStatus::EXACT_SOLUTION) return 2;

  og::PathGeometric path = *problem->getSolutionPath()->as<og::PathGeometric>();
  Simplifier simplifier(information, seed_number(seed, 2));
  // From each point on to the farthest that a free motion leads to.
  const auto leave_out_points = [&] {
    std::vector<ob::State*>& points = path.getStates();
    for (std::size_t from = 0; from + 2 < points.size(); ++from) {
      std::size_t to = points.size() - 1;
      while (to > from + 1 && !information->checkMotion(points[from], points[to])) --to;
      points.erase(points.begin() + static_cast<long>(from + 1), points.begin() + static_cast<long>(to));
    }
  };
  leave_out_points();
  simplifier.shortcutPath(path, shortcuts, shortcuts, 1.0, 0.05);
  leave_out_points();
  for (const ob::State* state : path.getStates()) print(values(state), n);
  return 0;
}

}  // namespace

int main() {
  try {
    return run();
  } catch (const std::exception& error) {
    std::cerr << error.what() << '\n';
    return 1;
  }
}
