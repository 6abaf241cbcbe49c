// How many points each pair of shapes touches in, what tips and what falls.

#include "contact_points.hpp"
#include "ode_runtime.hpp"
#include "test_support.hpp"

#include <memory>
#include <utility>

using namespace proact;
using namespace proact::dynamics;
using namespace proact::dynamics::testing;

namespace {

constexpr double radius = 0.025;
constexpr double height = 0.05;
constexpr double overlap = 1e-4;

const Shape a_box{ShapeKind::box, {0.06, 0.06, 0.06}};
const Shape a_sphere{ShapeKind::sphere, {radius, 0.0, 0.0}};
const Shape a_cylinder{ShapeKind::cylinder, {radius, height, 0.0}};
const Shape a_capsule{ShapeKind::capsule, {0.01, 0.04, 0.0}};

const Quat upright{};
const Quat along_x{0.0, std::sqrt(0.5), 0.0, std::sqrt(0.5)};
const Quat along_y{-std::sqrt(0.5), 0.0, 0.0, std::sqrt(0.5)};

GeomPtr geom_of(const Shape& shape) {
  const auto& size = shape.size;
  switch (shape.kind) {
    case ShapeKind::box: return GeomPtr(dCreateBox(nullptr, size[0], size[1], size[2]));
    case ShapeKind::sphere: return GeomPtr(dCreateSphere(nullptr, size[0]));
    case ShapeKind::cylinder: return GeomPtr(dCreateCylinder(nullptr, size[0], size[1]));
    case ShapeKind::capsule: break;
  }
  return GeomPtr(dCreateCapsule(nullptr, size[0], size[1]));
}

/// Half of what a shape measures along z in an attitude.
double top_extent(const Shape& shape, const Quat& attitude) {
  const bool standing = std::fabs(rotate(attitude, {0, 0, 1}).z) > 0.9;
  switch (shape.kind) {
    case ShapeKind::box: return 0.5 * shape.size[2];
    case ShapeKind::sphere: return shape.size[0];
    case ShapeKind::cylinder: return standing ? 0.5 * shape.size[1] : shape.size[0];
    case ShapeKind::capsule: break;
  }
  return shape.size[0] + (standing ? 0.5 * shape.size[1] : 0.0);
}

struct Pair {
  const char* name;
  const Shape& low;
  Quat low_attitude;
  const Shape& high;
  Quat high_attitude;
  std::size_t points;
};

void every_pair_touches_in_as_many_points_as_it_needs() {
  // Enough that a face rests on a face (three or more) and a line on a face or a line (two).
  const Pair pairs[] = {
      {"box on box", a_box, upright, a_box, upright, 4},
      {"standing cylinder on box", a_box, upright, a_cylinder, upright, 6},
      {"lying cylinder on box", a_box, upright, a_cylinder, along_x, 2},
      {"standing capsule on box", a_box, upright, a_capsule, upright, 1},
      {"lying capsule on box", a_box, upright, a_capsule, along_x, 2},
      {"sphere on box", a_box, upright, a_sphere, upright, 1},
      {"cylinder on cylinder", a_cylinder, upright, a_cylinder, upright, 6},
      {"lying cylinder on standing one", a_cylinder, upright, a_cylinder, along_x, 2},
      {"parallel cylinders", a_cylinder, along_x, a_cylinder, along_x, 2},
      {"crossed cylinders", a_cylinder, along_x, a_cylinder, along_y, 1},
      {"lying capsule on standing cylinder", a_cylinder, upright, a_capsule, along_x, 2},
      {"capsule along a lying cylinder", a_cylinder, along_x, a_capsule, along_x, 2},
      {"capsule across a lying cylinder", a_cylinder, along_x, a_capsule, along_y, 1},
      {"sphere on cylinder", a_cylinder, upright, a_sphere, upright, 1},
      {"parallel capsules", a_capsule, along_x, a_capsule, along_x, 2},
      {"crossed capsules", a_capsule, along_x, a_capsule, along_y, 1},
      {"sphere on capsule", a_capsule, along_x, a_sphere, upright, 1},
      {"sphere on sphere", a_sphere, upright, a_sphere, upright, 1},
  };
  for (const Pair& pair : pairs) {
    const GeomPtr low = geom_of(pair.low);
    const GeomPtr high = geom_of(pair.high);
    const double apart = top_extent(pair.low, pair.low_attitude) + top_extent(pair.high, pair.high_attitude) - overlap;
    const Pose low_pose{{0.3, -0.2, 0.1}, pair.low_attitude};
    const Pose high_pose{{0.3, -0.2, 0.1 + apart}, pair.high_attitude};
    set_geom_pose(low.get(), low_pose);
    set_geom_pose(high.get(), high_pose);
    for (const bool swapped : {false, true}) {
      const PlacedShape first{&pair.high, high_pose, high.get()};
      const PlacedShape second{&pair.low, low_pose, low.get()};
      ContactPoints found;
      find_contacts(swapped ? second : first, swapped ? first : second, found);
      if (!swapped) std::printf("%-36s %zu\n", pair.name, found.count);
      check(found.count == pair.points, std::string(pair.name) + ": " + std::to_string(found.count) + " points, expected " +
                                            std::to_string(pair.points));
      for (std::size_t k = 0; k < found.count; ++k) {
        const ContactPoint& point = found.points[k];
        check(point.normal.z * (swapped ? -1.0 : 1.0) > 0.99, std::string(pair.name) + ": a normal points aside");
        check(std::fabs(point.depth - overlap) < 2e-5, std::string(pair.name) + ": depth " + std::to_string(point.depth));
      }
    }
  }
}

double tilt_degrees(const BodyState& block) {
  return std::acos(std::fmin(1.0, std::fabs(rotate(block.pose.rotation, {0, 0, 1}).z))) * 180.0 / pi;
}

/// A block that stands on its rim, tilted.
Block tilted(const std::string& name, double x, double degrees) {
  const double tilt = degrees * pi / 180.0;
  return cylinder(name, {{x, 0, radius * std::sin(tilt) + 0.5 * height * std::cos(tilt)}, about_axis({0, 1, 0}, tilt)});
}

void a_block_tips_back_up_to_45_degrees_and_over_beyond() {
  Model model = chain(1);
  add_table(model);
  model.blocks = {tilted("back", 0.3, 43.0), tilted("over", 0.6, 47.0)};
  World world(std::move(model));
  run(world, 5000);
  std::printf("43 degrees end at %.1f, 47 at %.1f\n", tilt_degrees(world.blocks()[0]), tilt_degrees(world.blocks()[1]));
  check(tilt_degrees(world.blocks()[0]) < 0.5, "a block tilted by 43 degrees must stand up");
  check(std::fabs(tilt_degrees(world.blocks()[1]) - 90.0) < 0.5, "a block tilted by 47 degrees must fall over");
  for (const BodyState& block : world.blocks()) check(norm(block.linear) < 1e-3, "blocks must come to rest");
}

void a_block_over_the_edge_falls_to_the_floor_and_rests_there() {
  Model model = chain(1);
  model.world_from_base.position.z = 5.0;
  model.fixed.push_back({"slab", {ShapeKind::box, {1.0, 1.0, 0.03}}, {{0.0, 0.0, 1.0}, {}}, 0.4});
  model.fixed.push_back({"floor", {ShapeKind::box, {10.0, 10.0, 0.2}}, {{0.0, 0.0, -0.1}, {}}, 0.4});
  model.blocks = {cylinder("edge", {{0.505, 0.0, 1.04}, {}}), cylinder("inside", {{0.45, 0.2, 1.04}, {}})};
  World world(std::move(model));
  double fastest = 0.0;
  for (int k = 0; k < 10000; ++k) {
    run(world, 1);
    fastest = std::fmax(fastest, norm(world.blocks()[0].linear));
  }
  const BodyState& fallen = world.blocks()[0];
  const double rest = tilt_degrees(fallen) < 45.0 ? 0.5 * height : radius;
  std::printf("fell to %.4f m at up to %.2f m/s\n", fallen.pose.position.z, fastest);
  check(std::fabs(fallen.pose.position.z - rest) < 1e-3, "the block must lie on the floor");
  check(norm(fallen.linear) < 1e-2, "the block must come to rest");
  // 1.015 m give 4.46 m/s.
  check(fastest > 4.0 && fastest < 4.6, "speed of the fall " + std::to_string(fastest));
  check(std::fabs(world.blocks()[1].pose.position.z - 1.04) < 1e-3, "its neighbour must stay on the table");
}

void what_ode_says_is_kept_and_not_printed() {
  const unsigned long before = ode_message_count();
  dMessage(3, "%s and %d", "seven", 8);
  check(ode_message_count() == before + 1, "a message must be counted");
  check(std::string(ode_last_message()) == "seven and 8", std::string("kept: ") + ode_last_message());
}

}  // namespace

int main() {
  // Starts ODE in this thread.
  const World world(chain(1));
  check(world.last_solver_warning().empty(), "nobody has complained yet");
  every_pair_touches_in_as_many_points_as_it_needs();
  a_block_tips_back_up_to_45_degrees_and_over_beyond();
  a_block_over_the_edge_falls_to_the_floor_and_rests_there();
  what_ode_says_is_kept_and_not_printed();
  return finish("pair");
}
