// Tests of the questions about motions and rows of states, and of the bound on the distance of two shapes, of which FCL is
// the judge.

#include "../src/separation.hpp"
#include "../src/shapes.hpp"
#include "planar.hpp"
#include "proact/planning/motions.hpp"

#include <algorithm>
#include <array>
#include <cstdio>
#include <random>
#include <vector>

using namespace proact::planning;

namespace {

/// What FCL's distance of primitives may be off by, metres.
constexpr double fcl_tolerance = 1e-5;

class RandomScene {
 public:
  double between(double low, double high) { return std::uniform_real_distribution<double>(low, high)(random_); }

  Solid solid() {
    constexpr std::array<ShapeKind, 4> kinds{ShapeKind::box, ShapeKind::sphere, ShapeKind::cylinder, ShapeKind::capsule};
    const ShapeKind kind = kinds[static_cast<std::size_t>(between(0.0, 3.999))];
    return make_solid({kind, {between(0.01, 0.2), between(0.01, 0.2), between(0.01, 0.2)}, nullptr}, 0.0, "drawn");
  }

  Eigen::Isometry3d pose() {
    Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
    pose.translation() = Eigen::Vector3d(between(-0.3, 0.3), between(-0.3, 0.3), between(-0.3, 0.3));
    const Eigen::Vector3d axis(between(-1.0, 1.0), between(-1.0, 1.0), between(-1.0, 1.0));
    pose.linear() = Eigen::AngleAxisd(between(-3.0, 3.0), axis.normalized()).toRotationMatrix();
    return pose;
  }

  /// Arm angles within the planar arm's limits.
  std::vector<double> angles() { return {between(-2.5, 2.5), between(-2.5, 2.5), between(-2.5, 2.5)}; }

 private:
  std::mt19937_64 random_{11};
};

void shapes_are_never_farther_apart_by_the_bound_than_by_fcl() {
  RandomScene draw;
  int apart = 0;
  int met = 0;
  int near = 0;
  for (int n = 0; n < 20000; ++n) {
    const Solid a = draw.solid();
    const Solid b = draw.solid();
    const Eigen::Isometry3d a_pose = draw.pose();
    const Eigen::Isometry3d b_pose = draw.pose();
    const double bound = distance_lower_bound(a, a_pose, b, b_pose, 10.0);
    if (shapes_collide(a, a_pose, b, b_pose)) {
      ++met;
      check(bound <= fcl_tolerance, "shapes that touch are not said to be apart");
      continue;
    }
    fcl::DistanceRequestd request;
    fcl::DistanceResultd result;
    const double distance = fcl::distance(geometry_of(a).get(), to_fcl(a_pose), geometry_of(b).get(), to_fcl(b_pose), request, result);
    if (distance < 1e-3) continue;  // FCL's own distance is rough where shapes nearly touch
    ++apart;
    check(bound <= distance + fcl_tolerance, "the bound is no larger than the distance");
    near += bound >= 0.9 * distance - fcl_tolerance ? 1 : 0;
  }
  check(apart > 5000 && met > 2000, "both cases are drawn often");
  check(near > apart * 99 / 100, "the bound is nearly the distance");
}

void a_bound_that_is_enough_ends_the_look() {
  RandomScene draw;
  for (int n = 0; n < 1000; ++n) {
    const Solid a = draw.solid();
    const Solid b = draw.solid();
    const Eigen::Isometry3d a_pose = draw.pose();
    const Eigen::Isometry3d b_pose = draw.pose();
    const double whole = distance_lower_bound(a, a_pose, b, b_pose, 10.0);
    const double part = distance_lower_bound(a, a_pose, b, b_pose, 0.0);
    check(part <= whole + 1e-12 && (part > 0.0) == (whole > 0.0), "what is enough is a bound as well");
  }
}

void a_clearance_around_a_state_holds_for_any_motion(std::size_t slide) {
  Scene scene(planar_arm(slide));
  scene.set_obstacles(clutter());
  RandomScene draw;
  int promised = 0;
  for (int n = 0; n < 2000; ++n) {
    const std::vector<double> q = draw.angles();
    const std::vector<double> reach{draw.between(0.0, 1.0), draw.between(0.0, 1.0), draw.between(0.0, 1.0)};
    const double clear = scene.clearance_around(q.data(), reach.data(), 1.0);
    if (clear <= 0.0) continue;
    ++promised;
    for (int s = 0; s < 20; ++s) {
      std::vector<double> at = q;
      for (std::size_t k = 0; k < 3; ++k) at[k] += draw.between(-0.999, 0.999) * clear * reach[k];
      check(scene.is_free(at.data()), "nothing is hit by joint turns within the clearance");
    }
  }
  check(promised > 200, "the clearance promises something often enough to matter");
}

/// `count` states along a bent way through joint space.
std::vector<double> row_of(RandomScene& draw, std::size_t count) {
  const std::vector<double> a = draw.angles();
  const std::vector<double> b = draw.angles();
  const std::vector<double> c = draw.angles();
  std::vector<double> row;
  for (std::size_t n = 0; n < count; ++n) {
    const double s = static_cast<double>(n) / static_cast<double>(count - 1);
    for (std::size_t k = 0; k < 3; ++k) {
      row.push_back((1.0 - s) * (1.0 - s) * a[k] + 2.0 * s * (1.0 - s) * b[k] + s * s * c[k]);
    }
  }
  return row;
}

void a_row_of_states_is_free_if_each_of_them_is() {
  Scene scene(planar_arm());
  scene.set_obstacles(clutter());
  RandomScene draw;
  int free_rows = 0;
  for (int n = 0; n < 500; ++n) {
    const std::size_t count = 2 + static_cast<std::size_t>(n) % 90;
    const std::vector<double> row = row_of(draw, count);
    bool each = true;
    for (std::size_t k = 0; k < count; ++k) each = each && scene.is_free(row.data() + 3 * k);
    check(states_are_free(scene, row.data(), count) == each, "a row of states is judged as its states are one by one");
    free_rows += each ? 1 : 0;
  }
  check(free_rows > 20 && free_rows < 480, "rows of both kinds are drawn");
  check(states_are_free(scene, nullptr, 0), "no state touches nothing");
}

void a_path_that_is_free_has_no_contact_on_the_way() {
  Scene scene(planar_arm());
  scene.set_obstacles(clutter());
  RandomScene draw;
  const Resolution fine{0.002, 0.0005, 0.0};
  int free_paths = 0;
  for (int n = 0; n < 200; ++n) {
    const std::size_t count = 2 + static_cast<std::size_t>(n) % 40;
    const std::vector<double> row = row_of(draw, count);
    bool pairs = true;
    for (std::size_t k = 1; k < count; ++k) pairs = pairs && motion_is_free(scene, row.data() + 3 * (k - 1), row.data() + 3 * k, fine);
    const bool whole = path_is_free(scene, row.data(), count, fine);
    check(whole == pairs, "a path is free if each of its motions is");
    if (!whole) continue;
    ++free_paths;
    for (std::size_t k = 1; k < count; ++k) {
      for (int s = 0; s <= 50; ++s) {
        double at[3];
        for (std::size_t j = 0; j < 3; ++j) at[j] = row[3 * (k - 1) + j] + (row[3 * k + j] - row[3 * (k - 1) + j]) * s / 50.0;
        check(scene.is_free(at), "no state between two of a free path touches anything");
      }
    }
  }
  check(free_paths > 10 && free_paths < 190, "paths of both kinds are drawn");
}

}  // namespace

int main() {
  shapes_are_never_farther_apart_by_the_bound_than_by_fcl();
  a_bound_that_is_enough_ends_the_look();
  for (std::size_t slide = 0; slide < 4; ++slide) a_clearance_around_a_state_holds_for_any_motion(slide);
  a_row_of_states_is_free_if_each_of_them_is();
  a_path_that_is_free_has_no_contact_on_the_way();
  std::printf("%d checks failed\n", failures);
  return failures == 0 ? 0 : 1;
}
