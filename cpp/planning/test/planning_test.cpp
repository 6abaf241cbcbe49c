// Tests of the collision scene and the joint planner, without Rust. Each check is a sentence; the program
// fails with the list of those that do not hold.

#include "planar.hpp"
#include "proact/planning/joint_planner.hpp"

#include <ompl/config.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <functional>
#include <limits>
#include <random>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

using namespace proact::planning;

namespace {

/// True if `call` throws std::invalid_argument whose text contains `words`.
bool refuses(const std::function<void()>& call, const std::string& words) {
  try {
    call();
  } catch (const std::exception& error) {
    return std::string(error.what()).find(words) != std::string::npos;
  }
  return false;
}

JointQuery fold_query(std::uint64_t seed) {
  JointQuery query;
  query.start = {1.9, 0.0, 0.0};
  query.goals = {{-1.9, 0.3, 0.2}, {-2.2, 0.0, 0.0}};
  query.seed = seed;
  return query;
}

void contacts_are_where_geometry_says() {
  Scene scene(planar_arm());
  const double straight[3] = {0.0, 0.0, 0.0};
  // The finger ends at x = 1.0; the box begins at 1.001.
  scene.set_obstacles({box("near", {0.1, 0.1, 0.1}, {1.051, 0.0, 0.0})});
  check(scene.is_free(straight), "a gap of 1 mm is free");
  scene.set_padding(0.002);
  check(!scene.is_free(straight), "padding of 2 mm closes a gap of 1 mm");
  const auto pairs = scene.collisions(straight);
  check(pairs.size() == 1 && pairs[0] == NamePair("finger", "near"), "the pair is named, member first");
  scene.set_padding(0.0);
  scene.set_hand({1.5707963267948966});
  scene.set_padding(0.002);
  check(scene.is_free(straight), "a finger turned away by the hand joint does not touch");
  scene.set_hand({0.0});
  scene.allow_contact("finger", "near");
  check(scene.is_free(straight), "an allowed contact does not count");
  scene.clear_allowed_contacts();
  check(!scene.is_free(straight), "a withdrawn allowance counts again");
  scene.set_padding(0.0);
  scene.set_base({{0.002, 0.0, 0.0}, {0.0, 0.0, 0.0, 1.0}});
  check(!scene.is_free(straight), "the base pose moves the arm");
}

void shapes_whose_boxes_overlap_may_be_apart() {
  Scene scene(planar_arm());
  const double diagonal[3] = {0.7853981633974483, 0.0, 0.0};
  scene.set_obstacles({box("corner", {0.1, 0.1, 0.1}, {0.4, 0.2, 0.0})});
  check(scene.is_free(diagonal), "a box beside a diagonal tube is free although their bounding boxes overlap");
  const double clear = scene.clearance(diagonal, diagonal, 1.0);
  check(clear > 0.0 && clear < 0.2, "there the clearance promises the way to the box and no more");
}

void what_is_carried_collides_and_moves_with_the_tip() {
  Scene scene(planar_arm());
  Object block;
  block.name = "block";
  block.placed.shape = {ShapeKind::cylinder, {0.025, 0.05, 0.0}};
  block.placed.pose.position = {0.4, 0.0, 0.0};
  scene.set_attached(block);
  scene.set_obstacles({box("post", {0.05, 0.05, 0.4}, {0.0, 1.04, 0.0})});
  const double ahead[3] = {0.0, 0.0, 0.0};
  const double aside[3] = {1.5707963267948966, 0.0, 0.0};
  check(scene.is_free(ahead), "the carried block is clear ahead");
  const auto pairs = scene.collisions(aside);
  check(pairs.size() == 1 && pairs[0] == NamePair("block", "post"), "turned aside it meets the post");
  const double folded[3] = {0.0, 1.5707963267948966, 2.419};
  bool hits_arm = false;
  for (const auto& pair : scene.collisions(folded)) hits_arm = hits_arm || pair == NamePair("upper", "block");
  check(hits_arm, "folded back it meets the upper arm");
  scene.set_attached(std::nullopt);
  check(scene.collisions(aside).empty(), "put down it no longer counts");
}

void the_clearance_is_never_an_overstatement(std::size_t slide) {
  Scene scene(planar_arm(slide));
  scene.set_obstacles(clutter());
  std::mt19937_64 random(7);
  std::uniform_real_distribution<double> angle(-2.5, 2.5);
  std::uniform_real_distribution<double> step(-1.0, 1.0);
  int promised = 0;
  bool honest = true;
  for (int n = 0; n < 2000; ++n) {
    double q[3], dq[3];
    for (int k = 0; k < 3; ++k) {
      q[k] = angle(random);
      dq[k] = step(random);
    }
    const double clear = scene.clearance(q, dq, 1.0);
    check((clear >= 0.0) == scene.collisions(q).empty(), "clearance and collisions agree on what touches");
    if (clear <= 0.0) continue;
    ++promised;
    for (int s = -20; s <= 20; ++s) {
      double at[3];
      for (int k = 0; k < 3; ++k) at[k] = q[k] + dq[k] * clear * 0.999 * s / 20.0;
      honest = honest && scene.is_free(at);
    }
  }
  check(honest, "nothing is hit within the promised clearance");
  check(promised > 200, "the clearance promises something often enough to matter");
}

void plans_are_free_reach_a_goal_and_depend_on_the_seed_alone() {
  Scene scene(planar_arm());
  scene.set_obstacles(clutter());
  const CancelFlag flag;
  std::vector<JointPlan> serial;
  for (std::uint64_t seed = 0; seed < 6; ++seed) {
    const JointQuery query = fold_query(seed);
    const JointPlan plan = plan_joint(scene, query, flag);
    check(plan.status == JointPlanStatus::solved, "the folded way is found");
    serial.push_back(plan);
    if (plan.path.empty()) continue;
    check(plan.path.size() > 2, "the direct way is blocked, so the search was needed");
    check(plan.path.front() == query.start && plan.path.back() == query.goals[plan.goal], "the path joins start and goal");
    bool free = true;
    for (std::size_t p = 1; p < plan.path.size(); ++p) {
      for (int s = 0; s <= 500; ++s) {
        double at[3];
        for (std::size_t k = 0; k < 3; ++k) {
          at[k] = plan.path[p - 1][k] + (plan.path[p][k] - plan.path[p - 1][k]) * s / 500.0;
        }
        free = free && scene.is_free(at);
      }
    }
    check(free, "a path is free at far finer steps than those of the planner");
  }
  check(serial[0].path != serial[1].path, "another seed gives another path");

  std::vector<std::thread> threads;
  std::vector<int> equal(4, 0);
  for (std::size_t t = 0; t < equal.size(); ++t) {
    threads.emplace_back([t, &equal, &serial] {
      Scene own(planar_arm());
      own.set_obstacles(clutter());
      const CancelFlag own_flag;
      for (std::uint64_t n = 0; n < 12; ++n) {
        const std::uint64_t seed = (n + t) % 6;
        if (plan_joint(own, fold_query(seed), own_flag).path == serial[seed].path) ++equal[t];
      }
    });
  }
  for (std::thread& thread : threads) thread.join();
  for (const int count : equal) check(count == 12, "plans in four threads equal the serial ones bit for bit");
}

void further_searches_look_only_where_a_quicker_way_may_lead() {
  std::size_t looked = 0;
  for (std::uint64_t seed = 0; seed < 6; ++seed) {
    // With joints that turn much farther than any way needs.
    Arm arm = planar_arm();
    for (Joint& joint : arm.joints) {
      joint.lower = -9.0;
      joint.upper = 9.0;
    }
    Scene scene(arm);
    scene.set_obstacles(clutter());
    std::vector<std::array<double, 3>> states;
    JointQuery query = fold_query(seed);
    query.accepts = [&](const double* q) {
      states.push_back({q[0], q[1], q[2]});
      return true;
    };
    query.more_searches = 0;
    const JointPlan once = plan_joint(scene, query, CancelFlag());
    const std::size_t first = states.size();
    states.clear();
    query.more_searches = 4;
    plan_joint(scene, query, CancelFlag());
    // No path takes longer than this: its joints' ways, and half a turn at each corner.
    double least = 0.15 * std::acos(-1.0) * static_cast<double>(once.path.size() - 2);
    for (std::size_t k = 0; k + 1 < once.path.size(); ++k) {
      double farthest = 0.0;
      for (std::size_t j = 0; j < 3; ++j) farthest = std::max(farthest, std::abs(once.path[k + 1][j] - once.path[k][j]));
      least += farthest;
    }
    bool inside = true;
    for (std::size_t n = first; n < states.size(); ++n) {
      for (std::size_t j = 0; j < 3; ++j) {
        const double q = states[n][j];
        const auto way = [&](std::size_t g) { return std::abs(q - query.start[j]) + std::abs(query.goals[g][j] - q); };
        inside = inside && std::min(way(0), way(1)) <= least + 1e-9;
      }
    }
    check(inside, "a further search looks at no state that a quicker way cannot lead through");
    looked += states.size() - first;
  }
  check(looked > 1000, "further searches looked at states");
}

void every_planner_is_repeatable_even_beside_others() {
  const std::vector<PlannerKind> kinds{PlannerKind::rrt_connect, PlannerKind::bitrrt, PlannerKind::lbkpiece1,
                                       PlannerKind::rrt_star, PlannerKind::prm,       PlannerKind::anytime};
  const auto plan_of = [](PlannerKind kind, std::uint64_t seed) {
    Scene scene(planar_arm());
    scene.set_obstacles(clutter());
    JointQuery query = fold_query(seed);
    query.planner = kind;
    query.max_iterations = 3000;
    query.resolution = {0.05, 0.02};
    return plan_joint(scene, query, CancelFlag());
  };
  std::vector<JointPlan> serial;
  for (const PlannerKind kind : kinds) {
    serial.push_back(plan_of(kind, 1));
    check(serial.back().status == JointPlanStatus::solved, "every planner finds the folded way");
    if (serial.back().path.size() < 3) continue;
    check(serial.back().path.front() == fold_query(1).start, "every planner begins at the start");
    check(plan_of(kind, 2).path != serial.back().path, "with another seed every planner goes another way");
  }
  std::vector<std::thread> threads;
  std::vector<int> equal(kinds.size(), 0);
  for (std::size_t t = 0; t < kinds.size(); ++t) {
    threads.emplace_back([&, t] {
      for (int n = 0; n < 2; ++n) equal[t] += plan_of(kinds[t], 1).path == serial[t].path ? 1 : 0;
    });
  }
  for (std::thread& thread : threads) thread.join();
  for (const int count : equal) check(count == 2, "beside other planners in threads every plan is what it was alone");
}

void a_roadmap_is_grown_once_and_begun_with_wherever_things_stand() {
  const double half_pi = 1.5707963267948966;
  Scene scene(planar_arm());
  const auto walls = clutter();
  scene.set_obstacles({walls[1]});
  JointQuery query = fold_query(1);
  query.resolution = {0.05, 0.02};
  const Roadmap roadmap = grow_roadmap(scene, query, 300, CancelFlag());
  check(roadmap.milestones.size() >= 300 && roadmap.edges.size() > 300, "a roadmap has as many milestones as was asked");
  for (const auto& [a, b] : roadmap.edges) {
    check(motion_is_free(scene, roadmap.milestones[a].data(), roadmap.milestones[b].data(), query.resolution),
          "every edge of a roadmap is a free motion");
  }
  check(grow_roadmap(scene, query, 300, CancelFlag()).milestones == roadmap.milestones, "a roadmap is repeatable");
  Scene no_room(planar_arm());
  Object rock = walls[1];
  rock.placed.shape = Shape{ShapeKind::box, {50.0, 50.0, 50.0}, {}};
  no_room.set_obstacles({rock});
  check(refuses([&] { grow_roadmap(no_room, query, 300, CancelFlag()); }, "0 of 300 milestones"),
        "a roadmap ends where no state is free");
  rock.placed.shape.size[0] = 1e154;
  check(refuses([&] { no_room.set_obstacles({rock}); }, "at most 1000"), "a box of 1e154 m is refused");
  const std::vector<double> here(scene.joint_count(), 0.0);
  std::vector<double> there(scene.joint_count(), 0.0);
  there[0] = 1e15;
  Scene open(planar_arm());
  check(refuses([&] { motion_is_free(open, here.data(), there.data(), query.resolution); }, "steps of the resolution"),
        "a motion too long to be halved is refused");
  const auto with = [&](const Roadmap& other) {
    query.planner = PlannerKind::prm;
    query.roadmap = std::make_shared<Roadmap>(other);
    plan_joint(scene, query, CancelFlag());
  };
#if OMPL_VERSION_VALUE < 1005000
  check(refuses([&] { with(roadmap); }, "needs OMPL 1.5"), "an old OMPL says that it takes no roadmap");
  return;
#endif
  // Another wall has come since.
  scene.set_obstacles(walls);
  query.planner = PlannerKind::prm;
  query.roadmap = std::make_shared<Roadmap>(roadmap);
  query.max_iterations = 3000;
  const JointPlan plan = plan_joint(scene, query, CancelFlag());
  check(plan.status == JointPlanStatus::solved, "a way is found that begins with a roadmap");
  for (std::size_t k = 0; k + 1 < plan.path.size(); ++k) {
    check(motion_is_free(scene, plan.path[k].data(), plan.path[k + 1].data(), query.resolution),
          "what has come between milestones since is kept clear of");
  }
  check(plan_joint(scene, query, CancelFlag()).path == plan.path, "a way over a roadmap is repeatable");
  check(refuses([&] { with({{{half_pi}}, {}}); }, "no vector of 3"), "a milestone of another arm is refused");
  check(refuses([&] { with({{{0.0, 0.0, 0.0}}, {{0, 1}}}); }, "names milestone 1 of 1"), "an edge to nowhere is refused");
}

void anytime_shortening_gives_ways_no_longer_than_one_search() {
  const auto length = [](const JointPlan& plan) {
    double sum = 0.0;
    for (std::size_t k = 0; k + 1 < plan.path.size(); ++k) {
      double squares = 0.0;
      for (std::size_t j = 0; j < 3; ++j) squares += std::pow(plan.path[k + 1][j] - plan.path[k][j], 2);
      sum += std::sqrt(squares);
    }
    return sum;
  };
  double once = 0.0;
  double again = 0.0;
  for (std::uint64_t seed = 1; seed <= 8; ++seed) {
    Scene scene(planar_arm());
    scene.set_obstacles(clutter());
    JointQuery query = fold_query(seed);
    once += length(plan_joint(scene, query, CancelFlag()));
    query.planner = PlannerKind::anytime;
    query.max_iterations = 3000;
    const JointPlan plan = plan_joint(scene, query, CancelFlag());
    check(plan.status == JointPlanStatus::solved && plan.iterations >= 3000, "anytime shortening spends its iterations");
    again += length(plan);
  }
  check(again < 0.98 * once, "ways by anytime shortening are shorter");
}

void parameters_go_to_the_planner_by_name() {
  JointQuery query = fold_query(1);
  query.planner = PlannerKind::lbkpiece1;
  query.parameters = {{"border_fraction", "0.5"}};
  check_planner(query);
  query.parameters = {{"goal_bias", "0.5"}};
  check(refuses([&] { check_planner(query); }, "no parameter \"goal_bias\", expected one of border_fraction"),
        "an unknown parameter is refused with those that there are");
  query.parameters = {{"border_fraction", "wide"}};
  check(refuses([&] { check_planner(query); }, "refuses \"wide\""), "a value that is no number is refused");
  Scene scene(planar_arm());
  scene.set_obstacles(clutter());
  query = fold_query(1);
  const auto usual = plan_joint(scene, query, CancelFlag());
  query.parameters = {{"range", "0.2"}};
  check(plan_joint(scene, query, CancelFlag()).path != usual.path, "a parameter makes a difference");
}

void every_status_can_be_reached() {
  Scene scene(planar_arm());
  const CancelFlag flag;
  JointQuery query = fold_query(1);
  scene.set_obstacles({box("on start", {0.1, 0.1, 0.1}, {-0.2, 0.6, 0.0})});
  query.start = {1.8925468811915388, 0.0, 0.0};  // points at the box
  check(plan_joint(scene, query, flag).status == JointPlanStatus::start_in_collision, "a start in collision is told");
  query.goals = {query.start};
  query.start = {0.0, 0.0, 0.0};
  check(plan_joint(scene, query, flag).status == JointPlanStatus::goals_in_collision, "goals in collision are told");
  // A fence through which nothing passes.
  scene.set_obstacles({box("fence up", {0.02, 2.0, 0.4}, {0.2, 1.1, 0.0}), box("fence down", {0.02, 2.0, 0.4}, {0.2, -1.1, 0.0})});
  query = fold_query(1);
  query.start = {0.0, 0.0, 0.0};
  query.goals = {{2.4, 0.0, 0.0}};
  query.max_iterations = 200;
  check(plan_joint(scene, query, flag).status == JointPlanStatus::no_plan, "a search without success ends by its iterations");
  query.max_iterations = std::numeric_limits<unsigned int>::max();
  flag.raise();
  check(plan_joint(scene, query, flag).status == JointPlanStatus::cancelled, "a flag raised before stops at once");
  flag.lower();
  std::thread canceller([&flag] { flag.raise(); });
  const JointPlan plan = plan_joint(scene, query, flag);
  canceller.join();
  check(plan.status == JointPlanStatus::cancelled && plan.path.empty(), "a flag raised meanwhile ends an endless search");
  flag.lower();
  query.goals = {query.start};
  const JointPlan still = plan_joint(scene, query, flag);
  check(still.status == JointPlanStatus::solved && still.path.size() == 2, "a goal that is the start is solved");
}

void bad_input_is_refused_by_name() {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  Arm arm = planar_arm();
  arm.links[1].shapes[0].shape.size[0] = 0.0;
  check(refuses([&] { Scene scene(arm); }, "\"upper\": extent 0"), "a shape without extent is refused");
  arm = planar_arm();
  arm.joints[1].lower = 3.0;
  check(refuses([&] { Scene scene(arm); }, "lower limit"), "limits in the wrong order are refused");
  arm = planar_arm();
  arm.joints[2].axis = {0.0, 0.0, 0.0};
  check(refuses([&] { Scene scene(arm); }, "no direction"), "an axis without direction is refused");
  arm = planar_arm();
  arm.hand.clear();
  check(refuses([&] { Scene scene(arm); }, "finger"), "a moving joint of no group is refused");
  arm = planar_arm();
  arm.arm = {0, 2, 1};
  check(refuses([&] { Scene scene(arm); }, "unbroken"), "a chain out of order is refused");
  arm = planar_arm();
  arm.tip = 9;
  check(refuses([&] { Scene scene(arm); }, "tip"), "a tip that does not exist is refused");
  check(refuses([] { Scene scene{Arm{}}; }, "at least one link"), "an empty arm is refused");

  Scene scene(planar_arm());
  scene.set_obstacles(clutter());
  check(refuses([&] { scene.set_obstacles({box("flat", {0.1, 0.0, 0.1}, {})}); }, "\"flat\": extent 1"), "a flat obstacle is refused");
  check(refuses([&] { scene.set_obstacles({box("nan", {0.1, 0.1, 0.1}, {nan, 0.0, 0.0})}); }, "\"nan\""), "an obstacle nowhere is refused");
  check(refuses([&] { scene.set_obstacles({clutter()[0], clutter()[0]}); }, "two obstacles"), "a name used twice is refused");
  check(refuses([&] { scene.allow_contact("left", "left"); }, "no link"), "an unknown link is refused");
  check(refuses([&] { scene.allow_contact("finger", "nothing"); }, "no obstacle"), "an unknown obstacle is refused");
  check(refuses([&] { scene.set_hand({}); }, "got 0 hand angles"), "a hand of the wrong length is refused");
  check(refuses([&] { scene.set_padding(nan); }, "padding"), "a padding that is not a number is refused");
  const double inside[3] = {0.7853981633974483, 0.0, 0.0};
  check(!scene.is_free(inside), "a refused change leaves the obstacles as they were");

  const CancelFlag flag;
  JointQuery query = fold_query(0);
  query.start.pop_back();
  check(refuses([&] { plan_joint(scene, query, flag); }, "the start has 2 angles"), "a short start is refused");
  query = fold_query(0);
  query.goals[0][1] = nan;
  check(refuses([&] { plan_joint(scene, query, flag); }, "a goal joint 1"), "a goal that is not a number is refused");
  query = fold_query(0);
  query.start[0] = 3.0;
  check(refuses([&] { plan_joint(scene, query, flag); }, "limit [-2.5"), "a start outside the limits is refused");
  query = fold_query(0);
  query.goals.clear();
  check(refuses([&] { plan_joint(scene, query, flag); }, "no goal"), "a query without goal is refused");
  query = fold_query(0);
  query.resolution.step_m = 0.0;
  check(refuses([&] { plan_joint(scene, query, flag); }, "resolution"), "a resolution of zero is refused");
  scene.set_obstacles({});
  check(plan_joint(scene, fold_query(0), flag).status == JointPlanStatus::solved, "an empty scene is planned in");
}

}  // namespace

int main() {
  contacts_are_where_geometry_says();
  shapes_whose_boxes_overlap_may_be_apart();
  what_is_carried_collides_and_moves_with_the_tip();
  for (std::size_t slide = 0; slide < 4; ++slide) the_clearance_is_never_an_overstatement(slide);
  plans_are_free_reach_a_goal_and_depend_on_the_seed_alone();
  further_searches_look_only_where_a_quicker_way_may_lead();
  every_planner_is_repeatable_even_beside_others();
  a_roadmap_is_grown_once_and_begun_with_wherever_things_stand();
  anytime_shortening_gives_ways_no_longer_than_one_search();
  parameters_go_to_the_planner_by_name();
  every_status_can_be_reached();
  bad_input_is_refused_by_name();
  std::printf("%d checks failed\n", failures);
  return failures == 0 ? 0 : 1;
}
