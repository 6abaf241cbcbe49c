// Construction, commands and errors of the dynamics core.

#include "test_support.hpp"

#include <ode/ode.h>

#include <array>
#include <limits>
#include <utility>

using namespace proact;
using namespace proact::dynamics;
using namespace proact::dynamics::testing;

namespace {

const char* name_of(Engine engine) { return engine == Engine::ode ? "ode: " : "reduced: "; }

Model chain_in(Engine engine, std::size_t count) {
  Model model = chain(count);
  model.options.engine = engine;
  return model;
}

void a_held_hand_is_one_body_and_wakes_on_command(Engine engine) {
  World world(chain_in(engine, 4));
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

void a_pendulum_swings_as_the_closed_form_says() {
  Model model = chain(1);
  Joint& joint = model.joints[0];
  joint.effort = 0.0;
  joint.damping = 0.0;
  joint.lower = -std::numeric_limits<double>::infinity();
  joint.upper = std::numeric_limits<double>::infinity();
  World world(std::move(model));
  // From the horizontal to the lowest place: a quarter of the period 4 K(sin 45 degrees) / w of a pendulum that swings
  // by 90 degrees to each side; there all potential energy has become speed.
  const double w = std::sqrt(0.1 * 9.80665 * 0.05 / (1e-4 + 0.1 * 0.05 * 0.05));
  const double quarter = 1.8540746773013719 / w;
  const double lowest = 0.5 * 3.14159265358979323846;
  int ticks = 0;
  while (world.positions()[0] < lowest && ticks < 1000) {
    run(world, 1);
    ++ticks;
  }
  check(std::fabs(ticks * tick_secs - quarter) < 1.5e-3, "a quarter swing took " + std::to_string(ticks) + " ms");
  check(std::fabs(world.velocities()[0] / (w * std::sqrt(2.0)) - 1.0) < 0.01,
        "speed at the lowest place " + std::to_string(world.velocities()[0]));
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
  world.step(&zero, &zero, jumped);
  check(world.base_held() && world.world_from_base().position.x == base.position.x, "a base must not jump");
  check_refused("unknown block", "block 0, there are 0", [&] { world.attach(0, 0); });
  world.step(&zero, &zero, base);
  check(std::fabs(world.positions()[0]) < 1e-6, "a refused command must not move the arm");
}

void a_joint_stops_at_its_limit_without_a_kick(Engine engine) {
  // The load is far above the effort limit, so the joint falls onto its stop.
  Model model = chain_in(engine, 1);
  model.joints[0].effort = 0.001;
  model.joints[0].upper = 0.5;
  World world(std::move(model));
  run(world, 3000);
  check(std::fabs(world.positions()[0] - 0.5) < 2e-3, name_of(engine) + std::string("the arm must rest on its stop"));
  check(std::fabs(world.velocities()[0]) < 1e-3, name_of(engine) + std::string("the arm must be at rest on its stop"));
}

void effort_is_that_of_statics(Engine engine) {
  World world(chain_in(engine, 2));
  run(world, 500);
  // Two links of 0.1 kg with their centres at 0.05 and 0.15 m; a positive turn about y lowers the arm.
  const double expected = -9.80665 * 0.1 * (0.05 + 0.15);
  check(std::fabs(world.efforts()[0] - expected) < 1e-6, name_of(engine) + std::to_string(world.efforts()[0]) + " N m");
}

/// A limp rod that turns about y from the horizontal, with a slide on it: gravity, centrifugal and Coriolis' forces together.
/// Lagrange's equations of the two, integrated by Runge and Kutta's method in small steps, say where they are.
void a_slide_on_a_falling_rod_goes_where_lagrange_says(Engine engine) {
  Model model = chain_in(engine, 2);
  model.arm_count = 2;
  for (Joint& joint : model.joints) joint.effort = joint.damping = 0.0;
  model.joints[1].kind = JointKind::prismatic;
  model.joints[1].axis = {1.0, 0.0, 0.0};
  World world(std::move(model));

  // Centres of 0.1 kg at 0.05 m and at 0.15 m + s, each with 1e-4 kg m^2. State: angle, slide and their speeds.
  using State = std::array<double, 4>;
  const double g = 9.80665;
  const auto derivative = [g](const State& state) -> State {
    const auto [angle, slide, spin, out] = state;
    const double r = 0.15 + slide;
    const double inertia = 2e-4 + 0.1 * (0.05 * 0.05 + r * r);
    return {spin, out, (0.1 * g * std::cos(angle) * (0.05 + r) - 0.2 * r * out * spin) / inertia, r * spin * spin + g * std::sin(angle)};
  };
  const auto moved = [](const State& from, const State& rate, double secs) {
    State to = from;
    for (std::size_t k = 0; k < 4; ++k) to[k] += secs * rate[k];
    return to;
  };
  State state{};
  constexpr double step = 1e-4;
  for (int k = 0; k < 3000; ++k) {
    const State a = derivative(state);
    const State b = derivative(moved(state, a, step / 2));
    const State c = derivative(moved(state, b, step / 2));
    const State d = derivative(moved(state, c, step));
    for (std::size_t j = 0; j < 4; ++j) state[j] += step / 6 * (a[j] + 2 * b[j] + 2 * c[j] + d[j]);
  }
  run(world, 300);
  check(state[0] > 1.0 && state[1] > 0.1, "the rod falls and the slide leaves it");
  // ODE's steps are of first order.
  const double bound = engine == Engine::ode ? 0.02 : 1e-3;
  for (std::size_t k = 0; k < 2; ++k) {
    check(std::fabs(world.positions()[k] - state[k]) < bound,
          name_of(engine) + std::to_string(world.positions()[k]) + " expected " + std::to_string(state[k]));
    check(std::fabs(world.velocities()[k] - state[2 + k]) < 10.0 * bound,
          name_of(engine) + std::to_string(world.velocities()[k]) + " per s, expected " + std::to_string(state[2 + k]));
  }
}

/// Of a slide whose mass lies beside its line, on a rod that turns: what the turn does to the mass is no motion of the joint.
void the_speed_of_a_slide_is_the_change_of_its_position(Engine engine) {
  Model model = chain_in(engine, 2);
  model.arm_count = 2;
  for (Joint& joint : model.joints) joint.effort = joint.damping = 0.0;
  model.joints[1].kind = JointKind::prismatic;
  model.joints[1].axis = {1.0, 0.0, 0.0};
  model.links[2].inertial.position.z = 0.08;
  World world(std::move(model));
  run(world, 100);
  const double before = world.positions()[1];
  run(world, 1);
  const double speed = (world.positions()[1] - before) / tick_secs;
  check(std::fabs(world.velocities()[0]) > 0.5, "the rod turns");
  check(std::fabs(world.velocities()[1] - speed) < 0.01,
        name_of(engine) + std::to_string(world.velocities()[1]) + " m/s, expected " + std::to_string(speed));
}

void a_slide_bears_its_weight_and_stops_at_its_limit(Engine engine) {
  Model model = chain_in(engine, 1);
  model.joints[0].kind = JointKind::prismatic;
  model.joints[0].axis = {0.0, 0.0, -1.0};
  World world(model);
  run(world, 500);
  // A motor's positive force moves the link down.
  const double weight = 9.80665 * 0.1;
  check(std::fabs(world.efforts()[0] + weight) < 1e-6, name_of(engine) + std::to_string(world.efforts()[0]) + " N");
  check(std::fabs(world.positions()[0]) < 1e-6, name_of(engine) + std::string("the slide must not sag"));

  model.joints[0].effort = 0.0;
  model.joints[0].damping = 0.0;
  World falling(model);
  run(falling, 300);
  const double fallen = 0.5 * 9.80665 * 0.3 * 0.3;
  check(std::fabs(falling.positions()[0] - fallen) < 2e-3, name_of(engine) + std::string("fallen ") + std::to_string(falling.positions()[0]) + " m");
  check(std::fabs(falling.link_pose(1).position.z - (2.0 - falling.positions()[0])) < 1e-6, name_of(engine) + std::string("the link is where its joint says"));

  model.joints[0].upper = 0.2;
  World stopped(model);
  run(stopped, 2000);
  check(std::fabs(stopped.positions()[0] - 0.2) < 1e-3, name_of(engine) + std::string("rests at ") + std::to_string(stopped.positions()[0]) + " m");
  check(std::fabs(stopped.limit_effort()[0] + weight) < 1e-3, name_of(engine) + std::string("the stop bears ") + std::to_string(stopped.limit_effort()[0]) + " N");
}

void a_joint_that_is_driven_by_gains_sags_by_its_weight_over_the_gain(Engine engine) {
  // Stiff beside its inertia of 3.5e-4 kg m^2: a torque from the tick's start would throw it to and fro.
  Model model = chain_in(engine, 1);
  model.joints[0].proportional_gain = 2000.0;
  model.joints[0].derivative_gain = 1.0;
  World world(std::move(model));
  run(world, 2000);
  const double weight = 9.80665 * 0.1 * 0.05;
  check(std::fabs(world.positions()[0] - weight / 2000.0) < 1e-7,
        name_of(engine) + std::string("sag ") + std::to_string(1e6 * world.positions()[0]) + " microradians");
  check(std::fabs(world.efforts()[0] + weight) < 1e-5, name_of(engine) + std::to_string(world.efforts()[0]) + " N m");
}

void what_would_end_the_process_is_thrown() {
  const World world(chain(1));
  check_refused("dError", "internal error 7: seven", [] { dError(7, "%s", "seven"); });
  check_refused("dDebug", "internal error 8: eight", [] { dDebug(8, "%s", "eight"); });
}

void a_world_that_failed_inside_ode_refuses_steps_and_can_be_destroyed() {
  // ODE throws from the middle of a step, and tidying up after that used to end the process.
  Model model = chain(1);
  model.blocks.push_back(cylinder("thrown", {{1.0, 0.0, 10.0}, {0.0, std::sin(0.5), 0.0, std::cos(0.5)}}));
  model.options.gravity.z = -1e308;
  World world(std::move(model));
  check_refused("blow-up", "", [&] { run(world, 100); });
  check_refused("after it", "unusable since an earlier failure", [&] { run(world, 1); });
  check_refused("saving it", "unusable since an earlier failure", [&] { static_cast<void>(world.save()); });
}

}  // namespace

int main() {
  a_world_that_failed_inside_ode_refuses_steps_and_can_be_destroyed();
  for (const Engine engine : {Engine::reduced, Engine::ode}) {
    a_held_hand_is_one_body_and_wakes_on_command(engine);
    a_joint_stops_at_its_limit_without_a_kick(engine);
    effort_is_that_of_statics(engine);
    a_joint_that_is_driven_by_gains_sags_by_its_weight_over_the_gain(engine);
    a_slide_on_a_falling_rod_goes_where_lagrange_says(engine);
    the_speed_of_a_slide_is_the_change_of_its_position(engine);
    a_slide_bears_its_weight_and_stops_at_its_limit(engine);
  }
  a_block_falls_as_the_closed_form_says();
  a_pendulum_swings_as_the_closed_form_says();
  bad_models_are_refused();
  what_would_end_the_process_is_thrown();
  bad_commands_are_refused_and_harm_nothing();
  return finish("dynamics");
}
