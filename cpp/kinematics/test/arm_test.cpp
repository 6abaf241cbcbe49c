// Tests of the core without Rust: a spatial arm of seven joints with a two-finger hand.
#include "proact/kinematics/arm.hpp"
#include "proact/kinematics/benchmark.hpp"

#include <cmath>
#include <cstdio>
#include <exception>
#include <functional>
#include <string>

namespace kin = proact::kinematics;

namespace {

int failures = 0;

void expect(bool holds, const std::string& sentence) {
  if (holds) return;
  std::fprintf(stderr, "FAILED: %s\n", sentence.c_str());
  ++failures;
}

void expect_error(const std::function<void()>& action, const std::string& text) {
  try {
    action();
    expect(false, "no error; expected: " + text);
  } catch (const std::exception& error) {
    expect(error.what() == text, std::string("got the error: ") + error.what() + "; expected: " + text);
  }
}

kin::LinkDescription link(const std::string& name, std::size_t parent, double length,
                          const std::array<double, 3>& axis) {
  kin::LinkDescription description;
  description.name = name;
  description.parent = parent;
  description.joint = name + "_joint";
  description.kind = kin::JointKind::revolute;
  description.origin.position = {0.0, 0.0, -length};
  description.axis = axis;
  description.lower = -2.0;
  description.upper = 2.0;
  description.inertial.mass = 0.2;
  description.inertial.pose.position = {0.0, 0.01, -0.05};
  description.inertial.inertia = {2e-4, 0.0, 0.0, 2e-4, 0.0, 1e-4};
  return description;
}

kin::ArmDescription spatial_arm() {
  const std::array<double, 3> x{1, 0, 0}, y{0, 1, 0}, z{0, 0, 1};
  kin::ArmDescription arm;
  arm.links.emplace_back();
  arm.links[0].name = "base";
  arm.links.push_back(link("shoulder_y", 0, 0.0, y));
  arm.links.push_back(link("shoulder_x", 1, 0.0, x));
  arm.links.push_back(link("humerus", 2, 0.1, z));
  arm.links.push_back(link("elbow", 3, 0.2, y));
  arm.links.push_back(link("forearm", 4, 0.1, z));
  arm.links.push_back(link("wrist_y", 5, 0.15, y));
  arm.links.push_back(link("wrist_x", 6, 0.02, x));
  // The fingers stand before their place in the joint vector, as siblings, so that KDL's own numbering
  // differs from the order of `moving`.
  arm.links.push_back(link("thumb", 7, 0.05, x));
  arm.links.push_back(link("index", 7, 0.06, x));
  arm.moving = {1, 2, 3, 4, 5, 6, 7, 9, 8};
  arm.tip = 7;
  return arm;
}

void forward_kinematics_adds_the_lengths_of_a_hanging_arm() {
  kin::Arm arm(spatial_arm());
  const std::vector<double> q(7, 0.0);
  const proact::Pose tip = arm.forward(q.data());
  expect(std::abs(tip.position.z + 0.57) < 1e-15, "the tip hangs 0.57 m below the base");
  std::vector<proact::Pose> poses(arm.link_count());
  const std::vector<double> all(9, 0.0);
  arm.link_poses(all.data(), poses.data());
  expect(std::abs(poses[9].position.z + 0.63) < 1e-15, "the index finger is 0.06 m further");
}

void a_bent_index_finger_moves_the_index_and_not_the_thumb() {
  kin::Arm arm(spatial_arm());
  std::vector<double> q(9, 0.0);
  std::vector<proact::Pose> poses(arm.link_count());
  q[7] = 1.0;  // the seventh value after the arm is the index, although the thumb's link stands first
  arm.link_poses(q.data(), poses.data());
  expect(std::abs(poses[9].rotation.x - std::sin(0.5)) < 1e-15, "the index has turned by 1 rad");
  expect(poses[8].rotation.x == 0.0, "the thumb has not");
}

void inverse_kinematics_reaches_what_forward_kinematics_made() {
  kin::Arm arm(spatial_arm());
  const std::vector<double> made{0.5, -0.4, 0.3, -1.2, 0.6, 0.2, -0.5};
  const std::vector<double> seed(7, 0.0);
  const proact::Pose target = arm.forward(made.data());
  std::vector<double> q(7);
  expect(arm.inverse(target, seed.data(), q.data()), "a reachable target is reached");
  const proact::Pose reached = arm.forward(q.data());
  expect(proact::norm(reached.position - target.position) < 2e-8, "the position is met");
  proact::Pose far = target;
  far.position.x = 2.0;
  expect(!arm.inverse(far, seed.data(), q.data()), "a target 2 m away is not reached");
  expect(arm.inverse_all(target, 40, 1).size() >= 2 * 7, "several solutions are found");
  expect(arm.inverse_all(target, 40, 1) == arm.inverse_all(target, 40, 1), "the same seed gives the same answer");
}

void a_carried_body_adds_its_weight_at_its_lever() {
  kin::Arm arm(spatial_arm());
  std::vector<double> q(9, 0.0), zero(9, 0.0), without(9), with(9), again(9);
  q[0] = -1.5707963267948966;  // straight out
  const std::array<double, 3> gravity{0.0, 0.0, -9.80665};
  arm.inverse_dynamics(q.data(), zero.data(), zero.data(), gravity, without.data());
  kin::Inertial body;
  body.mass = 0.1;
  body.pose.position = {0.0, 0.0, -0.03};
  arm.set_payload(body);
  arm.inverse_dynamics(q.data(), zero.data(), zero.data(), gravity, with.data());
  const double expected = 0.1 * 9.80665 * 0.60;
  expect(std::abs(std::abs(with[0] - without[0]) - expected) < 1e-12, "shoulder torque rises by m g r");
  expect(with[7] == without[7] && with[8] == without[8], "fingers do not bear what the palm carries");
  arm.set_payload(std::nullopt);
  arm.inverse_dynamics(q.data(), zero.data(), zero.data(), gravity, again.data());
  expect(again == without, "letting go restores the torque bit for bit");
}

#if __has_include(<kdl/treeidsolver_recursive_newton_euler.hpp>)
void the_solver_for_an_old_kdl_equals_that_of_this_one() {
  KDL::Tree tree("root");
  const auto body = [](double mass) {
    return KDL::RigidBodyInertia(mass, KDL::Vector(0.01, -0.02, -0.1), KDL::RotationalInertia(2e-3, 3e-3, 1e-3, 1e-4));
  };
  const auto segment = [&](const std::string& name, const KDL::Vector& axis, double mass) {
    const KDL::Vector origin(0.02, 0.01, -0.2);
    return KDL::Segment(name, KDL::Joint(name, origin, axis, KDL::Joint::RotAxis),
                        KDL::Frame(KDL::Rotation::RPY(0.3, -0.2, 0.1), origin), body(mass));
  };
  tree.addSegment(segment("upper", KDL::Vector(0, 1, 0), 1.2), "root");
  tree.addSegment(KDL::Segment("sleeve", KDL::Joint("sleeve", KDL::Joint::None), KDL::Frame::Identity(), body(0.3)),
                  "upper");
  tree.addSegment(segment("lower", KDL::Vector(1, 0, 0), 0.8), "sleeve");
  tree.addSegment(segment("thumb", KDL::Vector(0, 0.6, 0.8), 0.05), "lower");
  tree.addSegment(segment("index", KDL::Vector(0, 0, 1), 0.04), "lower");
  const unsigned int joints = tree.getNrOfJoints();
  const KDL::Vector gravity(0.4, -0.3, -9.8);
  KDL::TreeIdSolver_RNE theirs(tree, gravity);
  kin::RecursiveNewtonEuler ours(tree, gravity);
  KDL::JntArray q(joints), qd(joints), qdd(joints), expected(joints), got(joints);
  for (int trial = 0; trial < 20; ++trial) {
    for (unsigned int k = 0; k < joints; ++k) {
      q(k) = std::sin(1.7 * trial + k);
      qd(k) = 2.0 * std::cos(0.9 * trial + 2.0 * k);
      qdd(k) = 5.0 * std::sin(2.3 * trial - k);
    }
    expect(theirs.CartToJnt(q, qd, qdd, {}, expected) >= 0, "KDL's solver answers");
    expect(ours.CartToJnt(q, qd, qdd, {}, got) >= 0, "ours answers");
    for (unsigned int k = 0; k < joints; ++k) {
      expect(std::abs(got(k) - expected(k)) < 1e-13, "the torques are the same");
    }
  }
  KDL::JntArray wrong(joints + 1);
  expect(ours.CartToJnt(wrong, qd, qdd, {}, got) < 0, "a wrong length is refused");
  expect(ours.CartToJnt(q, qd, qdd, {{"lower", KDL::Wrench::Zero()}}, got) < 0, "an outer wrench is refused");
}
#endif

void wrong_descriptions_are_refused_by_name() {
  auto with = [](const std::function<void(kin::ArmDescription&)>& change) {
    return [change] {
      kin::ArmDescription arm = spatial_arm();
      change(arm);
      kin::Arm built(arm);
    };
  };
  expect_error(with([](auto& a) { a.links.clear(); }), "the arm has no links");
  expect_error(with([](auto& a) { a.links[4].axis = {0, 0, 0}; }),
               "joint \"elbow_joint\": the axis has no direction");
  expect_error(with([](auto& a) { a.links[4].name = "humerus"; }), "two links are called \"humerus\"");
  expect_error(with([](auto& a) { a.links[4].parent = 6; }), "link \"elbow\" stands before its parent");
  expect_error(with([](auto& a) { a.moving.pop_back(); }),
               "joint \"thumb_joint\" moves but belongs to no group");
  expect_error(with([](auto& a) { a.moving[8] = 9; }), "joint \"index_joint\" is listed twice as moving");
  expect_error(with([](auto& a) { a.base = 8; }), "the tip \"wrist_x\" is not below the base \"thumb\"");
  expect_error(with([](auto& a) { a.links[4].inertial.mass = -1.0; }),
               "link \"elbow\": mass -1.000000 kg is negative");
  expect_error(with([](auto& a) { a.links[4].lower = 3.0; }),
               "joint \"elbow_joint\": lower limit 3.000000 is above upper limit 2.000000");
  expect_error(
      [] {
        kin::Arm arm(spatial_arm());
        arm.set_payload(kin::Inertial{});
      },
      "the carried body has a mass of 0.000000 kg, expected more than zero");
}

void the_benchmark_times_every_call() {
  const std::vector<double> q(3 * 7, 0.1);
  expect(kin::time_raw_kdl(spatial_arm(), q.data(), 3).size() == 3, "three calls give three times");
}

}  // namespace

int main() {
  forward_kinematics_adds_the_lengths_of_a_hanging_arm();
  a_bent_index_finger_moves_the_index_and_not_the_thumb();
  inverse_kinematics_reaches_what_forward_kinematics_made();
  a_carried_body_adds_its_weight_at_its_lever();
#if __has_include(<kdl/treeidsolver_recursive_newton_euler.hpp>)
  the_solver_for_an_old_kdl_equals_that_of_this_one();
#endif
  wrong_descriptions_are_refused_by_name();
  the_benchmark_times_every_call();
  if (failures == 0) std::puts("all passed");
  return failures == 0 ? 0 : 1;
}
