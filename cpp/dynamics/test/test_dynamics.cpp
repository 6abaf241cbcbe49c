// Tests of the dynamics core in plain C++.

#include "proact/dynamics/world.hpp"

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <limits>
#include <stdexcept>
#include <string>
#include <utility>

using namespace proact::dynamics;

namespace {

int failures = 0;

void check(bool good, const std::string& what) {
  if (good) return;
  std::fprintf(stderr, "FAILED: %s\n", what.c_str());
  ++failures;
}

void check_refused(const std::string& name, const std::string& expected, const std::function<void()>& action) {
  try {
    action();
    check(false, name + ": was accepted");
  } catch (const std::exception& error) {
    check(std::string(error.what()).find(expected) != std::string::npos,
          name + ": \"" + error.what() + "\" does not contain \"" + expected + "\"");
  }
}

/// Base and `count` links of 0.1 m along x, each turning about y; all but the first joint belong to the hand.
Model chain(std::size_t count) {
  Model model;
  model.world_from_base = {{0.0, 0.0, 2.0}, {}};
  model.links.push_back({"base", 0.0, {}, {}, {}});
  for (std::size_t k = 0; k < count; ++k) {
    Link link{"link" + std::to_string(k), 0.1, {{0.05, 0.0, 0.0}, {}}, {1e-5, 0, 0, 1e-4, 0, 1e-4}, {}};
    link.collisions.push_back({{{0.05, 0.0, 0.0}, {0.0, std::sqrt(0.5), 0.0, std::sqrt(0.5)}},
                               {ShapeKind::cylinder, {0.01, 0.09, 0.0}}});
    model.links.push_back(link);
    Joint joint{"joint" + std::to_string(k), false, k, {}, {0, 1, 0}, -2.0, 2.0, 2.0, 5.0, 0.01, 0.0};
    if (k > 0) joint.origin.position.x = 0.1;
    model.joints.push_back(joint);
    model.moving.push_back(k);
    model.positions.push_back(0.0);
  }
  model.arm_count = 1;
  return model;
}

Block cylinder(const std::string& name, Pose pose) {
  return {name, {ShapeKind::cylinder, {0.025, 0.05, 0.0}}, 0.1, 0.4, 0.8, pose};
}

void add_table(Model& model) {
  model.fixed.push_back({"table", {ShapeKind::box, {4.0, 4.0, 0.1}}, {{0.0, 0.0, -0.05}, {}}, 0.4});
}

void run(World& world, int ticks) {
  const std::vector<double> position = world.positions();
  const std::vector<double> velocity(position.size(), 0.0);
  for (int k = 0; k < ticks; ++k) world.step(position.data(), velocity.data(), world.world_from_base());
}

void a_held_hand_is_one_body_and_wakes_on_command() {
  World world(chain(4));
  check(world.arm_body_count() == 2, "three hand joints at rest must share a body with the arm's link");
  std::vector<double> position(4, 0.0);
  const std::vector<double> velocity(4, 0.0);
  position[2] = 0.1;
  world.step(position.data(), velocity.data(), world.world_from_base());
  check(world.arm_body_count() == 3, "one commanded hand joint must wake alone");
  for (int k = 0; k < 500; ++k) world.step(position.data(), velocity.data(), world.world_from_base());
  check(world.arm_body_count() == 2, "a hand joint that has arrived must become rigid");
  check(std::fabs(world.positions()[2] - 0.1) < 1e-3, "a rigid joint must keep its angle");
}

void a_block_falls_as_the_closed_form_says() {
  Model model = chain(1);
  model.blocks.push_back(cylinder("falling", {{1.0, 0.0, 10.0}, {}}));
  World world(std::move(model));
  run(world, 1000);
  // Semi-implicit Euler falls g h^2 n (n + 1) / 2.
  const double fallen = 9.80665 * 1e-6 * 1000.0 * 1001.0 / 2.0;
  check(std::fabs(world.blocks()[0].pose.position.z - (10.0 - fallen)) < 1e-9, "free fall");
}

void bad_models_are_refused() {
  const auto build = [](Model model) { World world(std::move(model)); };
  const double nan = std::numeric_limits<double>::quiet_NaN();
  Model model = chain(2);
  model.links[1].mass = 0.0;
  check_refused("zero mass", "mass is 0 kg", [&] { build(model); });
  model = chain(2);
  model.links[1].inertia[3] = 0.0;
  check_refused("zero inertia", "not positive definite", [&] { build(model); });
  model = chain(2);
  model.positions[0] = 3.0;
  check_refused("start outside", "starts at 3 rad", [&] { build(model); });
  model = chain(2);
  model.joints[0].effort = nan;
  check_refused("effort", "effort limit is nan", [&] { build(model); });
  model = chain(2);
  model.joints[1].parent = 2;
  check_refused("loop", "does not stand before", [&] { build(model); });
  model = chain(1);
  add_table(model);
  model.blocks.push_back(cylinder("sunk", {{1.0, 0.0, 0.0}, {}}));
  check_refused("sunk block", "inside \"table\"", [&] { build(model); });
  model = chain(1);
  model.blocks.push_back(cylinder("massless", {{1.0, 0.0, 1.0}, {}}));
  model.blocks[0].mass = -1.0;
  check_refused("block mass", "block \"massless\": mass is -1", [&] { build(model); });
}

void bad_commands_are_refused_and_harm_nothing() {
  World world(chain(1));
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const double zero = 0.0;
  const Pose base = world.world_from_base();
  check_refused("NaN command", "\"joint0\" is not finite", [&] { world.step(&nan, &zero, base); });
  Pose jumped = base;
  jumped.position.x += 0.1;
  check_refused("jump", "the base jumps: 100", [&] { world.step(&zero, &zero, jumped); });
  check_refused("unknown block", "block 0, there are 0", [&] { world.attach(0, 0); });
  world.step(&zero, &zero, base);
  check(std::fabs(world.positions()[0]) < 1e-6, "a refused command must not move the arm");
}

}  // namespace

int main() {
  a_held_hand_is_one_body_and_wakes_on_command();
  a_block_falls_as_the_closed_form_says();
  bad_models_are_refused();
  bad_commands_are_refused_and_harm_nothing();
  if (failures == 0) std::puts("all dynamics tests passed");
  return failures == 0 ? EXIT_SUCCESS : EXIT_FAILURE;
}
