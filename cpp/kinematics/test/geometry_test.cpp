// The header that the cores share beside KDL: forward kinematics and Jacobian of branched arms with oblique axes, on which
// joints turn and slide.
#include "proact/geometry.hpp"
#include "proact/kinematics/arm.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <iterator>
#include <random>
#include <string>
#include <vector>

namespace kin = proact::kinematics;
using proact::Pose;
using proact::Quat;
using proact::Vec3;

namespace {

int failures = 0;

/// Rounding over a dozen joints of an arm of two metres.
constexpr double tolerance = 1e-12;

void expect(bool holds, const std::string& sentence) {
  if (holds) return;
  std::fprintf(stderr, "FAILED: %s\n", sentence.c_str());
  ++failures;
}

/// Draws with one seed.
class RandomNumbers {
 public:
  explicit RandomNumbers(unsigned int seed) : generator_(seed) {}

  double number(double low, double high) { return std::uniform_real_distribution<double>(low, high)(generator_); }
  Vec3 vector(double size) { return {number(-size, size), number(-size, size), number(-size, size)}; }
  Quat rotation() {
    const Vec3 axis = vector(1.0);
    return proact::about_axis(axis * (1.0 / proact::norm(axis)), number(-3.0, 3.0));
  }

 private:
  std::mt19937 generator_;
};

/// Seven joints, the third of which slides, and a fixed tip, on which two fingers of two joints hang; one of these slides.
kin::ArmDescription random_arm(RandomNumbers& draws) {
  kin::ArmDescription arm;
  const std::size_t parents[] = {0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 8, 11};
  for (std::size_t k = 0; k < std::size(parents); ++k) {
    kin::LinkDescription link;
    link.name = "link" + std::to_string(k);
    link.parent = parents[k];
    link.joint = "joint" + std::to_string(k);
    link.kind = k == 0 || k == 8 ? kin::JointKind::fixed : k == 3 || k == 10 ? kin::JointKind::prismatic : kin::JointKind::revolute;
    link.origin = {draws.vector(0.2), draws.rotation()};
    const Vec3 axis = draws.vector(1.0);
    const Vec3 unit = axis * (1.0 / proact::norm(axis));
    link.axis = {unit.x, unit.y, unit.z};
    link.lower = -3.0;
    link.upper = 3.0;
    if (link.kind != kin::JointKind::fixed) arm.moving.push_back(k);
    arm.links.push_back(link);
  }
  arm.tip = 8;
  return arm;
}

/// The pose of each link by the shared header.
std::vector<Pose> link_poses(const kin::ArmDescription& arm, const std::vector<double>& q) {
  std::vector<Pose> poses(arm.links.size());
  std::size_t next = 0;
  for (std::size_t k = 1; k < poses.size(); ++k) {
    const kin::LinkDescription& link = arm.links[k];
    const Pose pose = poses[link.parent] * link.origin;
    const Vec3 axis{link.axis[0], link.axis[1], link.axis[2]};
    poses[k] = proact::joint_pose(pose, link.kind, axis, link.kind == kin::JointKind::fixed ? 0.0 : q[next++]);
  }
  return poses;
}

/// Metres and rad between two poses, whichever is larger. A quaternion and its negative are one rotation.
double pose_difference(const Pose& a, const Pose& b) {
  const Pose off = proact::inverse(a) * b;
  return std::max(proact::norm(off.position), proact::norm(proact::rotation_vector(off.rotation)));
}

void links_and_jacobian_are_those_of_kdl() {
  RandomNumbers draws(7);
  double farthest = 0.0;
  for (int round = 0; round < 20; ++round) {
    const kin::ArmDescription description = random_arm(draws);
    kin::Arm arm(description);
    const std::size_t joints = arm.chain_joint_count();
    for (int pose = 0; pose < 50; ++pose) {
      std::vector<double> q(arm.moving_count());
      for (double& angle : q) angle = draws.number(-3.0, 3.0);
      std::vector<Pose> theirs(arm.link_count());
      arm.link_poses(q.data(), theirs.data());
      const std::vector<Pose> ours = link_poses(description, q);
      for (std::size_t k = 0; k < ours.size(); ++k) farthest = std::max(farthest, pose_difference(ours[k], theirs[k]));
      farthest = std::max(farthest, pose_difference(ours[description.tip], arm.forward(q.data())));

      std::vector<double> jacobian(6 * joints);
      arm.jacobian(q.data(), jacobian.data());
      for (std::size_t k = 0; k < joints; ++k) {
        // The seven joints of the chain carry the links 1 to 7.
        const kin::LinkDescription& link = description.links[k + 1];
        const Vec3 axis = proact::rotate(ours[k + 1].rotation, {link.axis[0], link.axis[1], link.axis[2]});
        const Vec3 linear = proact::point_velocity(link.kind, axis, ours[k + 1].position, ours[description.tip].position);
        const Vec3 angular = link.kind == kin::JointKind::prismatic ? Vec3{} : axis;
        const double* const column = &jacobian[6 * k];
        farthest = std::max(farthest, proact::norm(linear - Vec3{column[0], column[1], column[2]}));
        farthest = std::max(farthest, proact::norm(angular - Vec3{column[3], column[4], column[5]}));
      }
    }
  }
  expect(farthest < tolerance, "links and columns are where KDL has them; the farthest is off by " + std::to_string(farthest));
}

void poses_are_a_group() {
  RandomNumbers draws(11);
  for (int round = 0; round < 100; ++round) {
    const Pose a{draws.vector(1.0), draws.rotation()};
    const Pose b{draws.vector(1.0), draws.rotation()};
    const Vec3 point = draws.vector(1.0);
    expect(pose_difference(proact::inverse(a) * (a * b), b) < tolerance, "a pose and its inverse cancel");
    expect(proact::norm((a * b) * point - a * (b * point)) < tolerance, "poses act one after the other");
    expect(pose_difference(proact::pose_from_array(proact::pose_to_array(a)), a) < tolerance,
           "seven numbers hold a pose");
  }
}

void a_rotation_vector_leads_back_to_its_rotation() {
  RandomNumbers draws(13);
  for (int round = 0; round < 100; ++round) {
    const Vec3 axis = draws.vector(1.0);
    const Vec3 unit = axis * (1.0 / proact::norm(axis));
    for (const double angle : {1e-9, 1e-3, 1.0, 3.1}) {
      const Vec3 vector = proact::rotation_vector(proact::about_axis(unit, angle));
      expect(proact::norm(vector - unit * angle) < tolerance, "the rotation vector is axis times angle");
    }
  }
}

}  // namespace

int main() {
  links_and_jacobian_are_those_of_kdl();
  poses_are_a_group();
  a_rotation_vector_leads_back_to_its_rotation();
  if (failures == 0) std::puts("all passed");
  return failures == 0 ? 0 : 1;
}
