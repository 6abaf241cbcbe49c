// Heaps: the sweeps beside the exact solver, and 150 cubes that are dropped, rest, are woken and saved.
#include "engines/reduced/velocity_problem.hpp"
#include "pgs_contact_solver.hpp"
#include "test_support.hpp"

#include <algorithm>
#include <random>

using namespace proact;
using namespace proact::dynamics;
using namespace proact::dynamics::testing;

namespace {

class RandomNumbers {
 public:
  explicit RandomNumbers(unsigned seed) : generator_(seed) {}
  double between(double low, double high) { return low + (high - low) * (static_cast<double>(generator_()) / 4294967296.0); }
  Vec3 vec(double size) {
    const double x = between(-size, size);
    const double y = between(-size, size);
    return {x, y, between(-size, size)};
  }
  Vec3 direction() {
    for (;;) {
      const Vec3 v = vec(1.0);
      if (norm(v) > 0.1 && norm(v) < 1.0) return normalized(v);
    }
  }

 private:
  std::mt19937 generator_;
};

/// One problem for both solvers: blocks in a row, each with points at the one before or at the room.
void make_problem(RandomNumbers& numbers, VelocityProblem& exact, PgsContactSolver& sweeps) {
  const std::size_t blocks = 2 + static_cast<std::size_t>(numbers.between(0.0, 4.0));
  for (std::size_t b = 0; b < blocks; ++b) {
    const double mass = numbers.between(0.005, 0.1);
    const double inertia = mass * 0.025 * 0.025 / 6.0;
    const SymmetricMatrix3 own{inertia, 0.0, 0.0, inertia, 0.0, inertia};
    const Vec3 linear = numbers.vec(0.2);
    const Vec3 angular = numbers.vec(2.0);
    exact.blocks.push_back({mass, own, linear * mass, own * angular});
    sweeps.bodies.push_back({linear, angular, 1.0 / mass, inverse(own), 0.0});
    for (const double v : {linear.x, linear.y, linear.z, angular.x, angular.y, angular.z}) exact.velocity.push_back(v);
    for (int k = 0; k < 3; ++k) {
      PgsContactSolver::Point point;
      point.first = b;
      point.first_lever = numbers.vec(0.0125);
      if (b > 0 && k > 0) {
        point.second = b - 1;
        point.second_lever = numbers.vec(0.0125);
      }
      point.normal = numbers.direction();
      point.speed = numbers.between(0.0, 0.01);
      point.friction = numbers.between(0.1, 0.8);
      sweeps.points.push_back(point);

      VelocityProblem::Contact contact;
      contact.speed[0] = point.speed;
      contact.friction = point.friction;
      const Vec3 u = normalized(cross(point.normal, std::fabs(point.normal.x) < 0.5 ? Vec3{1, 0, 0} : Vec3{0, 1, 0}));
      const Vec3 directions[3] = {point.normal, u, cross(point.normal, u)};
      contact.first = exact.columns.size();
      const auto add = [&](std::size_t body, const Vec3& lever, double sign) {
        for (std::size_t k2 = 0; k2 < 6; ++k2) {
          VelocityProblem::Column column{6 * body + k2, {}};
          for (std::size_t row = 0; row < 3; ++row) {
            const Vec3 turn = cross(lever, directions[row]);
            const double six[6] = {directions[row].x, directions[row].y, directions[row].z, turn.x, turn.y, turn.z};
            column.value[row] = sign * six[k2];
          }
          exact.columns.push_back(column);
        }
      };
      if (point.second != no_index) add(point.second, point.second_lever, -1.0);
      add(b, point.first_lever, 1.0);
      contact.last = exact.columns.size();
      exact.contacts.push_back(contact);
    }
  }
}

double max_difference(const VelocityProblem& exact, const PgsContactSolver& sweeps) {
  double largest = 0.0;
  for (std::size_t b = 0; b < sweeps.bodies.size(); ++b) {
    const double* const v = &exact.velocity[6 * b];
    largest = std::max(largest, norm(sweeps.bodies[b].linear - Vec3{v[0], v[1], v[2]}));
  }
  return largest;
}

/// Where both can, they must find the same speeds; and what twenty sweeps leave from a cold start is told.
void sweeps_find_what_the_exact_solver_finds() {
  RandomNumbers numbers(1);
  int solved = 0;
  int same = 0;
  std::vector<double> left;
  for (int k = 0; k < 1000; ++k) {
    VelocityProblem exact;
    PgsContactSolver sweeps;
    make_problem(numbers, exact, sweeps);
    PgsContactSolver few = sweeps;
    exact.invalidate_factors();
    if (!exact.solve()) continue;
    ++solved;
    sweeps.begin();
    sweeps.solve(5000, 1e-12);
    same += max_difference(exact, sweeps) < 1e-4 ? 1 : 0;
    few.begin();
    few.solve(20, 2e-5);
    left.push_back(max_difference(exact, few));
  }
  std::sort(left.begin(), left.end());
  std::printf("%d problems, the same speeds within 0.1 mm/s in %d; after 20 sweeps apart by %.2e m/s (median), %.2e (95 %%)\n", solved,
              same, left[left.size() / 2], left[left.size() * 95 / 100]);
  check(solved > 900, "the exact solver finds most");
  // With friction there can be more than one solution.
  check(same >= solved * 95 / 100, "sweeps find the same speeds");
  check(left[left.size() / 2] < 2e-3, "twenty sweeps come near");
}

/// One side of the box of the box-and-blocks test, its sides made high, and cubes in the air above.
Model heap(int count, unsigned seed) {
  Model model = chain(1);
  model.world_from_base.position.z = 3.0;
  const auto fix = [&](const char* name, const std::array<double, 3>& size, const Vec3& at) {
    model.fixed.push_back({name, {ShapeKind::box, size}, {at, {}}, 0.4});
  };
  fix("table", {0.4, 0.8, 0.03}, {0.0, 0.0, 1.0});
  fix("partition", {0.234, 0.01, 0.7}, {0.0, 0.0, 1.365});
  fix("right", {0.254, 0.01, 0.7}, {0.0, -0.2635, 1.365});
  fix("far", {0.01, 0.517, 0.7}, {0.122, 0.0, 1.365});
  fix("near", {0.01, 0.517, 0.7}, {-0.122, 0.0, 1.365});
  RandomNumbers numbers(seed);
  for (int k = 0; k < count; ++k) {
    const int in_layer = k % 25;
    const Vec3 at{-0.117 + 0.234 * (in_layer / 5 + 0.5) / 5.0, -0.2585 + 0.2535 * (in_layer % 5 + 0.5) / 5.0,
                  1.037 + 0.045 * (k / 25)};
    const Vec3 axis = numbers.direction();
    model.blocks.push_back({"cube" + std::to_string(k), {ShapeKind::box, {0.025, 0.025, 0.025}}, 0.01, 0.4, 0.8,
                            {at, about_axis(axis, numbers.between(0.0, 3.0))}});
  }
  return model;
}

int moving_block_count(const World& world) {
  const auto& blocks = world.blocks();
  return static_cast<int>(std::count_if(blocks.begin(), blocks.end(), [](const BodyState& b) { return norm(b.linear) + norm(b.angular) > 0.0; }));
}

double max_penetration(const World& world, const Model& model) {
  // Corners of a cube below the table: a cube's own faces are not looked at.
  double depth = 0.0;
  for (const BodyState& block : world.blocks()) {
    for (int corner = 0; corner < 8; ++corner) {
      const Vec3 half{corner & 1 ? 0.0125 : -0.0125, corner & 2 ? 0.0125 : -0.0125, corner & 4 ? 0.0125 : -0.0125};
      depth = std::max(depth, 1.015 - (block.pose * half).z);
    }
  }
  static_cast<void>(model);
  return depth;
}

void a_heap_comes_to_rest_and_does_not_creep() {
  const Model model = heap(150, 1);
  World world(model);
  run(world, 5000);
  std::printf("after 5 s %d move, deepest in the table %.4f mm\n", moving_block_count(world),
              1e3 * max_penetration(world, model));
  check(moving_block_count(world) == 0, "all rest after five seconds");
  check(max_penetration(world, model) < 1e-4, "none is deeper in the table than 0.1 mm");
  check(world.solver_warnings() == 0, "no complaint");
  const std::vector<BodyState> before = world.blocks();
  run(world, 300000);
  double crept = 0.0;
  for (std::size_t k = 0; k < before.size(); ++k) {
    crept = std::max(crept, norm(world.blocks()[k].pose.position - before[k].pose.position));
  }
  check(crept == 0.0, "at rest nothing moves in five minutes");
}

void a_heap_kept_awake_does_not_creep() {
  Model model = heap(150, 1);
  World settling(model);
  run(settling, 5000);
  for (std::size_t k = 0; k < model.blocks.size(); ++k) model.blocks[k].pose = settling.blocks()[k].pose;
  model.options.sleep = false;
  World world(model);
  run(world, 1000);
  const std::vector<BodyState> before = world.blocks();
  run(world, 10000);
  double crept = 0.0;
  for (std::size_t k = 0; k < before.size(); ++k) {
    crept = std::max(crept, norm(world.blocks()[k].pose.position - before[k].pose.position));
  }
  std::printf("awake for ten seconds it creeps by %.4f mm at most\n", 1e3 * crept);
  check(crept < 2e-3, "awake it creeps by less than 2 mm in ten seconds");
}

void what_falls_on_a_heap_wakes_a_part_of_it() {
  Model model = heap(150, 2);
  Block last = model.blocks.back();
  last.pose.position = {0.3, 0.35, 1.1};
  model.fixed.push_back({"shelf", {ShapeKind::box, {0.1, 0.1, 0.1}}, {{0.3, 0.35, 1.03}, {}}, 0.4});
  model.blocks.push_back(last);
  World world(model);
  run(world, 5000);
  check(moving_block_count(world) == 0, "all rest");
  const std::vector<double> saved = world.save();
  World other(model);
  other.restore(saved);
  int most = 0;
  BodyState above = world.blocks().back();
  double top = 0.0;
  for (const BodyState& block : world.blocks()) top = std::max(top, block.pose.position.z);
  above.pose = {{0.0, -0.13, top + 0.1}, {}};
  for (World* const each : {&world, &other}) each->place(150, above);
  Digest a;
  Digest b;
  for (int k = 0; k < 4000; ++k) {
    run(world, 1);
    run(other, 1);
    if (k == 100) other.restore(world.save());
    most = std::max(most, moving_block_count(world));
    a.add(world);
    b.add(other);
  }
  check(a.value() == b.value(), "a heap goes on bit for bit where it was saved");
  check(moving_block_count(world) == 0, "it rests again");
  check(most > 1 && most < 150, "a part of the heap wakes");
  std::printf("a cube that falls on a heap of 150: up to %d move\n", most);
}

/// Cubes that came to rest almost flat, in a world that begins with them so: ODE's direct solver gives up on some.
void few_cubes_lie_still_in_a_world_that_begins_with_them(int count, unsigned seeds) {
  for (unsigned seed = 1; seed <= seeds; ++seed) {
    Model model = heap(count, seed);
    World settling(model);
    run(settling, 5000);
    for (std::size_t k = 0; k < model.blocks.size(); ++k) model.blocks[k].pose = settling.blocks()[k].pose;
    World world(model);
    run(world, 2000);
    double lowest = 2.0;
    for (const BodyState& block : world.blocks()) lowest = std::min(lowest, block.pose.position.z);
    check(lowest > 1.027, "none falls through the table");
    check(moving_block_count(world) == 0, "all rest");
    check(world.solver_warnings() < 100, "it gives up in a tick, and gets none of them again");
  }
}

void the_same_seed_gives_the_same_bits() {
  std::uint64_t values[3];
  for (int round = 0; round < 3; ++round) {
    World world(heap(60, round == 2 ? 8 : 7));
    Digest digest;
    for (int k = 0; k < 1000; ++k) {
      run(world, 1);
      digest.add(world);
    }
    values[round] = digest.value();
  }
  check(values[0] == values[1], "the same heap falls the same way");
  check(values[0] != values[2], "another one does not");
}

}  // namespace

int main() {
  sweeps_find_what_the_exact_solver_finds();
  the_same_seed_gives_the_same_bits();
  a_heap_comes_to_rest_and_does_not_creep();
  a_heap_kept_awake_does_not_creep();
  few_cubes_lie_still_in_a_world_that_begins_with_them(40, 4);
  few_cubes_lie_still_in_a_world_that_begins_with_them(4, 20);
  what_falls_on_a_heap_wakes_a_part_of_it();
  return finish("heap");
}
