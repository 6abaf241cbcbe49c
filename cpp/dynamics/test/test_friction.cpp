// Coulomb's friction: against the slip, by friction times the normal force in every direction alike.

#include "engines/reduced/velocity_problem.hpp"
#include "test_support.hpp"

#include <ode/ode.h>

#include <random>

using namespace proact;
using namespace proact::dynamics;
using namespace proact::dynamics::testing;

namespace {


/// A block that slides over the table alone is ODE's; the way is v^2 / 2 mu g.
void a_block_slides_as_far_in_every_direction() {
  const double speed = 0.8;
  const double expected = speed * speed / (2.0 * 0.4 * 9.80665);
  for (int direction = 0; direction < 12; ++direction) {
    const double angle = direction * pi / 12.0;
    Model model = chain(1);
    add_table(model);
    model.blocks.push_back(cylinder("sliding", {{0.3, 0.0, 0.02495}, {}}));
    World world(std::move(model));
    world.place(0, {{{0.3, 0.0, 0.02495}, {}}, {speed * std::cos(angle), speed * std::sin(angle), 0.0}, {}});
    run(world, 500);
    const Vec3 way = world.blocks()[0].pose.position - Vec3{0.3, 0.0, 0.02495};
    const double ahead = way.x * std::cos(angle) + way.y * std::sin(angle);
    const double aside = way.y * std::cos(angle) - way.x * std::sin(angle);
    const std::string name = std::to_string(15 * direction) + " degrees: ";
    std::printf("%s%.2f mm ahead, %.2f mm aside, by hand %.2f\n", name.c_str(), 1e3 * ahead, 1e3 * aside, 1e3 * expected);
    // A block that stands on six points pitches a little as it stops.
    check(std::fabs(ahead - expected) < 0.02 * expected, name + std::to_string(1e3 * ahead) + " mm");
    check(std::fabs(aside) < 0.01 * expected, name + std::to_string(1e3 * aside) + " mm aside");
  }
}

/// A block of 0.1 kg between `count` points at random, with a hinge that drives some of them.
VelocityProblem problem_at_random(std::mt19937& random, std::size_t count) {
  std::uniform_real_distribution<double> number(-1.0, 1.0);
  VelocityProblem problem;
  problem.mass = {2e-3};
  VelocityProblem::Hinge hinge;
  hinge.momentum = 1e-3 * number(random);
  hinge.speed = number(random);
  hinge.limit = 1e-3 * std::fabs(number(random));
  problem.hinges.push_back(hinge);
  VelocityProblem::BlockPart block;
  block.mass = 0.1;
  block.inertia = {4e-5, 0, 0, 4e-5, 0, 3e-5};
  block.linear_momentum = Vec3{number(random), number(random), number(random)} * 0.02;
  block.angular_momentum = Vec3{number(random), number(random), number(random)} * 4e-4;
  problem.blocks.push_back(block);
  for (std::size_t k = 0; k < count; ++k) {
    const Vec3 arm = Vec3{number(random), number(random), number(random)} * 0.025;
    Vec3 normal{number(random), number(random), number(random)};
    normal = normal * (1.0 / norm(normal));
    dVector3 u;
    dVector3 v;
    const dVector3 n{normal.x, normal.y, normal.z};
    dPlaneSpace(n, u, v);
    const Vec3 directions[3] = {normal, {u[0], u[1], u[2]}, {v[0], v[1], v[2]}};
    VelocityProblem::Contact contact;
    contact.friction = 0.8 * std::fabs(number(random));
    contact.speed[0] = 0.05 * std::fabs(number(random));
    contact.first = problem.columns.size();
    if (k % 2 == 0) problem.columns.push_back({0, {0.05 * number(random), 0.05 * number(random), 0.05 * number(random)}});
    for (std::size_t axis = 0; axis < 6; ++axis) {
      VelocityProblem::Column column{1 + axis, {}};
      for (std::size_t row = 0; row < 3; ++row) {
        const Vec3& along = directions[row];
        const Vec3 turn = cross(arm, along);
        const double values[6] = {along.x, along.y, along.z, turn.x, turn.y, turn.z};
        column.value[row] = values[axis];
      }
      problem.columns.push_back(column);
    }
    contact.last = problem.columns.size();
    problem.contacts.push_back(contact);
  }
  problem.velocity.assign(7, 0.0);
  problem.velocity[0] = hinge.speed;
  for (std::size_t k = 0; k < 3; ++k) problem.velocity[1 + k] = 0.2 * number(random);
  return problem;
}

/// Momentum is kept, and every contact obeys its law.
void what_is_found_obeys_coulomb_and_newton() {
  std::mt19937 random(7);
  int solved = 0;
  int slipping = 0;
  int sticking = 0;
  int to_rounding = 0;
  constexpr int problems = 5000;
  for (int round = 0; round < problems; ++round) {
    VelocityProblem problem = problem_at_random(random, 1 + static_cast<std::size_t>(round % 6));
    if (!problem.solve()) continue;
    ++solved;
    std::vector<double> missing(7, 0.0);
    missing[0] = problem.mass[0] * problem.velocity[0] - problem.hinges[0].momentum - problem.hinges[0].impulse;
    const VelocityProblem::BlockPart& block = problem.blocks[0];
    const double* const v = &problem.velocity[1];
    const Vec3 linear = Vec3{v[0], v[1], v[2]} * block.mass - block.linear_momentum;
    const Vec3 angular = block.inertia * Vec3{v[3], v[4], v[5]} - block.angular_momentum;
    const double lacks[6] = {linear.x, linear.y, linear.z, angular.x, angular.y, angular.z};
    for (std::size_t k = 0; k < 6; ++k) missing[1 + k] = lacks[k];
    double largest = 0.0;
    for (const VelocityProblem::Contact& contact : problem.contacts) largest = std::fmax(largest, contact.friction * contact.impulse[0]);
    for (const VelocityProblem::Contact& contact : problem.contacts) {
      std::array<double, 3> gap = contact.speed;
      for (std::size_t c = contact.first; c < contact.last; ++c) {
        const VelocityProblem::Column& column = problem.columns[c];
        for (std::size_t row = 0; row < 3; ++row) {
          gap[row] -= column.value[row] * problem.velocity[column.index];
          missing[column.index] -= column.value[row] * contact.impulse[row];
        }
      }
      const double normal = contact.impulse[0];
      const double force = std::hypot(contact.impulse[1], contact.impulse[2]);
      const double slip = std::hypot(gap[1], gap[2]);
      const double bound = contact.friction * normal;
      check(std::fabs(normal - std::max(0.0, tick_secs / problem.normal_softness * gap[0])) < 1e-9, "a contact pushes by its softness");
      // The bounds settle to 1e-4 of the largest.
      check(force <= bound + 1.01e-4 * largest, "friction is at most its bound: " + std::to_string(force) + " of " + std::to_string(bound));
      if (slip > 1e-3 && bound > 0.1 * largest) {
        ++slipping;
        if (std::fabs(force - bound) < 1e-9 * bound) ++to_rounding;
        check(std::fabs(force - bound) < 2e-3 * bound, "what slips is braked by the bound");
        check(contact.impulse[1] * gap[1] + contact.impulse[2] * gap[2] > (1.0 - 1e-6) * force * slip, "against the slip");
      } else if (bound > 0.0) {
        ++sticking;
      }
    }
    for (const double lack : missing) check(std::fabs(lack) < 1e-7, "momentum is kept: " + std::to_string(lack));
  }
  std::printf("%d of %d problems solved, %d contacts slip (%d to rounding), %d stick\n", solved, problems, slipping, to_rounding, sticking);
  // Repeated bounds alone settle to 1e-4: so near they are only if they follow the normal forces in Newton's method.
  check(to_rounding > slipping * 9 / 10, std::to_string(to_rounding) + " of " + std::to_string(slipping) + " are found to rounding");
  check(slipping > 1000 && sticking > 500, "both cases occur");
  check(solved > problems * 99 / 100, std::to_string(problems - solved) + " problems are unsolved");
}

}  // namespace

int main() {
  dInitODE2(0);
  a_block_slides_as_far_in_every_direction();
  what_is_found_obeys_coulomb_and_newton();
  return finish("friction");
}
