// Blocks on the table, against each other and between fingers; carrying; determinism.

#include "test_support.hpp"

#include <atomic>
#include <memory>
#include <thread>
#include <utility>

using namespace proact;
using namespace proact::dynamics;
using namespace proact::dynamics::testing;

namespace {

constexpr double radius = 0.025;
constexpr double height = 0.05;
const Quat lying{std::sqrt(0.5), 0.0, 0.0, std::sqrt(0.5)};  // axis along y

/// An arm far from everything, a table at z = 0, and `blocks`; nothing sleeps.
Model table_with(std::vector<Block> blocks) {
  Model model = chain(1);
  add_table(model);
  model.blocks = std::move(blocks);
  model.options.sleep = false;
  return model;
}

double tilt_degrees(const BodyState& block) {
  return std::acos(std::fmin(1.0, std::fabs(rotate(block.pose.rotation, {0, 0, 1}).z))) * 180.0 / 3.141592653589793;
}

void check_no_creep(const std::string& name, World& world) {
  run(world, 3000);
  const std::vector<BodyState> before = world.blocks();
  run(world, 300000);
  for (std::size_t k = 0; k < before.size(); ++k) {
    const double moved = norm(world.blocks()[k].pose.position - before[k].pose.position);
    std::printf("%s: block %zu moved %.2e m in 5 min, tilt %.2f degrees\n", name.c_str(), k, moved, tilt_degrees(world.blocks()[k]));
    check(moved < 1e-3, name + ": block " + std::to_string(k) + " crept " + std::to_string(moved) + " m");
    check(std::fabs(tilt_degrees(world.blocks()[k]) - tilt_degrees(before[k])) < 0.5, name + ": turned");
  }
  check(world.solver_warnings() == 0, name + ": the solver complained");
}

void resting_blocks_do_not_creep() {
  // Standing, lying, a pair that touches, and a stack.
  World world(table_with({cylinder("standing", {{0.3, 0, 0.025}, {}}), cylinder("lying", {{0.5, 0, 0.025}, lying}),
                          cylinder("left", {{0.7, 0.0251, 0.025}, {}}), cylinder("right", {{0.7, -0.0251, 0.025}, {}}),
                          cylinder("low", {{0.9, 0, 0.025}, {}}), cylinder("high", {{0.905, 0.005, 0.0752}, {}})}));
  check_no_creep("resting", world);
  check(std::fabs(world.blocks()[5].pose.position.z - 0.075) < 1e-3, "the stack must stand");
}

void a_leaning_block_does_not_creep() {
  // Tilted by 60 degrees (below 45 it would fall back onto its face), its upper rim against a wall; with friction
  // 0.4 it would slide down, as it should.
  const double tilt = 60.0 * 3.141592653589793 / 180.0;
  const double lowest = radius * std::sin(tilt) + 0.5 * height * std::cos(tilt);
  const double reach = radius * std::cos(tilt) + 0.5 * height * std::sin(tilt);
  Model model = table_with({cylinder("leaning", {{0.5 - reach, 0, lowest}, about_axis({0, 1, 0}, tilt)})});
  model.fixed.push_back({"wall", {ShapeKind::box, {0.01, 0.4, 0.1}}, {{0.505, 0, 0.05}, {}}, 2.0});
  model.fixed[0].friction = 2.0;
  model.blocks[0].friction = 2.0;
  World world(std::move(model));
  check_no_creep("leaning", world);
  check(std::fabs(tilt_degrees(world.blocks()[0]) - 60.0) < 1.0, "the block must still lean");
}

void a_cylinder_on_its_side_rolls_and_a_standing_one_slides() {
  World world(table_with({cylinder("rolling", {{0.3, 0, 0.0249}, lying}), cylinder("sliding", {{0.3, 0.5, 0.0249}, {}})}));
  // Both are pushed by the arm's base through an attachment: carried at 0.2 m/s, then let go.
  std::vector<double> position(1, 0.0);
  const std::vector<double> velocity(1, 0.0);
  for (std::size_t block = 0; block < 2; ++block) {
    world.attach(block, 0);
    Pose base = world.world_from_base();
    for (int k = 0; k < 10; ++k) {
      base.position.x += 2e-4;
      world.step(position.data(), velocity.data(), base);
    }
    world.release();
    const double start = world.blocks()[block].pose.position.x;
    run(world, 1000);
    const double way = world.blocks()[block].pose.position.x - start;
    // Sliding: v^2 / 2 mu g. A solid cylinder that starts without spin keeps two thirds of its speed, after
    // sliding for v / 3 mu g; from then on rolling resistance c slows it by 2/3 c g.
    const double slide = 0.2 * 0.2 / (2.0 * 0.4 * 9.80665);
    const double spin_up = 0.2 / (3.0 * 0.4 * 9.80665);
    const double roll = 0.2 * spin_up - 0.5 * 0.4 * 9.80665 * spin_up * spin_up + (1.0 - spin_up) * 0.2 * 2.0 / 3.0 -
                        0.5 * (2.0 / 3.0) * 0.01 * 9.80665 * (1.0 - spin_up) * (1.0 - spin_up);
    const double expected = block == 0 ? roll : slide;
    std::printf("%s way %.4f m, closed form %.4f m\n", block == 0 ? "rolling" : "sliding", way, expected);
    check(std::fabs(way - expected) < 0.03 * expected, "way " + std::to_string(way) + ", expected " + std::to_string(expected));
  }
}

/// Angle of the fingers below at which their bars touch the block.
constexpr double touching = 0.28;

/// Two fingers of 0.1 m hanging from the base at y = +-0.06, turning about x, with a bar at the tip that lies
/// along `along` when the fingers touch the block.
Model gripper(const Quat& along) {
  Model model;
  model.world_from_base = {{0.0, 0.0, 0.126}, {}};
  model.links.push_back({"palm", 0.0, {}, {}, {}});
  for (const double side : {1.0, -1.0}) {
    Link finger{side > 0 ? "left" : "right", 0.05, {{0, 0, -0.05}, {}}, {1e-4, 0, 0, 1e-4, 0, 1e-5}, {}};
    finger.collisions.push_back({{{0, 0, -0.1}, about_axis({1, 0, 0}, side * touching) * along}, {ShapeKind::cylinder, {0.0075, 0.03, 0.0}}});
    model.joints.push_back({finger.name, JointKind::revolute, 0, {{0, side * 0.06, 0}, {}}, {-side, 0, 0}, -0.5, 1.0, 2.0, side > 0 ? 2.0 : 0.4, 0.001, 0.0});
    model.links.push_back(finger);
    model.moving.push_back(model.moving.size());
    model.positions.push_back(0.0);
  }
  model.arm_count = 0;
  add_table(model);
  model.blocks.push_back(cylinder("pinched", {{0, 0, 0.025}, {}}));
  return model;
}

void a_pinched_block_is_lifted_by_friction(const std::string& name, const Quat& along) {
  World world(gripper(along));
  std::vector<double> position(2, 0.0);
  std::vector<double> velocity(2, 0.0);
  // The left finger stops where it touches, the right one presses: two fingers that press with the same bounded
  // torque would leave the block free to wander.
  const double target[2] = {touching, 0.5};
  Pose base = world.world_from_base();
  for (int k = 0; k < 6000; ++k) {
    for (std::size_t j = 0; j < 2; ++j) {
      velocity[j] = position[j] < target[j] ? 1.0 : 0.0;
      position[j] += velocity[j] * tick_secs;
    }
    if (k >= 1000 && k < 2000) base.position.z += 1e-4;
    world.step(position.data(), velocity.data(), base);
  }
  const BodyState& block = world.blocks()[0];
  std::printf("pinched by %s: rose %.4f m, aside %.4f m, tilt %.2f degrees, %zu contacts\n", name.c_str(),
              block.pose.position.z - 0.025, std::hypot(block.pose.position.x, block.pose.position.y),
              tilt_degrees(block), world.contacts().size());
  check(std::fabs(block.pose.position.z - 0.125) < 2e-3, name + ": the block must come along by 0.1 m");
  check(std::hypot(block.pose.position.x, block.pose.position.y) < 5e-3, name + ": the block must stay between the fingers");
  check(norm(block.linear) < 1e-3, name + ": the block must be at rest");
  check(world.contacts().size() >= 2, name + ": both fingers must touch");
  for (const Contact& contact : world.contacts()) {
    const double side = contact.link == 1 ? -1.0 : 1.0;
    check(contact.normal.y * side > 0.9, name + ": normals must point from the link into the block");
  }
}

void an_attached_block_follows_the_base_without_a_kick() {
  Model model = chain(2);
  model.world_from_base = {{0, 0, 0.3}, {}};
  model.blocks.push_back(cylinder("carried", {{0.2, 0.0, 0.2}, {}}));
  model.options.gravity = {0, 0, 0};
  World world(std::move(model));
  const std::vector<double> position(2, 0.0);
  const std::vector<double> velocity(2, 0.0);
  world.attach(0, 2);
  check_refused("second attachment", "attached already", [&] { world.attach(0, 1); });
  const Pose start = world.blocks()[0].pose;
  run(world, 10);
  check(norm(world.blocks()[0].pose.position - start.position) < 1e-9, "attaching must not move the block");
  Pose base = world.world_from_base();
  double worst = 0.0;
  for (int k = 1; k <= 2000; ++k) {
    base.position.x = 0.1 * (1.0 - std::cos(0.003 * k));
    base.rotation = about_axis({0, 0, 1}, 0.3 * (1.0 - std::cos(0.003 * k)));
    world.step(position.data(), velocity.data(), base);
    const Vec3 wanted = base * (start.position - Vec3{0, 0, 0.3});
    worst = std::fmax(worst, norm(world.blocks()[0].pose.position - wanted));
  }
  std::printf("a carried block strays at most %.1e m from the base\n", worst);
  check(worst < 1e-4, "the carried block strays by " + std::to_string(worst));
  const Vec3 before = world.blocks()[0].linear;
  world.release();
  world.step(position.data(), velocity.data(), base);
  check(norm(world.blocks()[0].linear - before) < 1e-6, "a released block must keep its speed");
  check(!world.attached(), "nothing may be attached after release");
  world.release();
}

void a_sleeping_block_wakes_when_pushed(Engine engine) {
  const auto world_with = [&](bool sleep) {
    Model model = gripper({});
    model.options.engine = engine;
    model.options.sleep = sleep;
    // Nothing but the table bears it.
    model.blocks[0].friction_finger = 0.0;
    model.blocks[0].pose.position = {0.0, 0.0, 0.025};
    return World(std::move(model));
  };
  World world = world_with(true);
  World awake = world_with(false);
  const std::vector<double> velocity(2, 0.0);
  std::vector<double> position(2, 0.0);
  run(world, 1000);
  run(awake, 1000);
  check(norm(world.blocks()[0].linear) == 0.0, "a resting block must fall asleep");
  // One finger alone pushes it away. The table bears it from the first tick on, as it does one that never slept.
  int touched = 0;
  double apart = 0.0;
  for (int k = 0; k < 1000; ++k) {
    position[0] = std::fmin(0.6, position[0] + 1e-3);
    world.step(position.data(), velocity.data(), world.world_from_base());
    awake.step(position.data(), velocity.data(), awake.world_from_base());
    const Vec3 speed = world.blocks()[0].linear;
    if (norm(speed) > 0.0 && touched++ < 3) apart = std::fmax(apart, norm(speed - awake.blocks()[0].linear));
  }
  std::printf("%s: pushed in its sleep a block moves by %.2e m/s otherwise\n", engine == Engine::ode ? "ode" : "reduced", apart);
  check(apart < 2e-3, "a block that is touched in its sleep must move as one that is awake");
  check(world.blocks()[0].pose.position.y < -5e-3, "a pushed block must wake and move");
}

std::uint64_t tumble(Solver solver, int ticks) {
  Model model = gripper({});
  model.options.solver = solver;
  model.options.iterations = 20;
  model.blocks.push_back(cylinder("dropped", {{0.005, 0.003, 0.3}, {0.1, 0.2, 0.0, std::sqrt(0.95)}}));
  World world(std::move(model));
  Digest digest;
  std::vector<double> position(2, 0.0);
  const std::vector<double> velocity(2, 0.0);
  for (int k = 0; k < ticks; ++k) {
    position[0] = 0.3 * std::sin(0.005 * k);
    position[1] = 0.3 * std::sin(0.004 * k);
    world.step(position.data(), velocity.data(), world.world_from_base());
    digest.add(world);
  }
  return digest.value();
}

void the_same_commands_give_the_same_bits_beside_another_world() {
  for (const Solver solver : {Solver::direct, Solver::iterative}) {
    const std::string name = solver == Solver::direct ? "direct" : "iterative";
    const std::uint64_t alone = tumble(solver, 1500);
    check(tumble(solver, 1500) == alone, name + ": a second run differs");
    std::atomic<bool> stop{false};
    std::thread neighbor([&] {
      while (!stop) tumble(solver, 50);
    });
    for (int repeat = 0; repeat < 3; ++repeat) check(tumble(solver, 1500) == alone, name + ": a run beside another differs");
    stop = true;
    neighbor.join();
    check(tumble(solver, 1499) != alone, name + ": the digest does not see the last tick");
  }
}

}  // namespace

int main() {
  resting_blocks_do_not_creep();
  a_leaning_block_does_not_creep();
  a_cylinder_on_its_side_rolls_and_a_standing_one_slides();
  a_pinched_block_is_lifted_by_friction("bars across", {0.0, std::sqrt(0.5), 0.0, std::sqrt(0.5)});
  a_pinched_block_is_lifted_by_friction("bars along", {});
  an_attached_block_follows_the_base_without_a_kick();
  for (const Engine engine : {Engine::reduced, Engine::ode}) a_sleeping_block_wakes_when_pushed(engine);
  the_same_commands_give_the_same_bits_beside_another_world();
  return finish("contact");
}
