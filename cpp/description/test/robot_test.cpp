// Tests of the description core alone, without Rust. Returns the number of failed checks.

#include "proact/description/robot.hpp"

#include <cmath>
#include <iostream>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

namespace {

using proact::description::read_urdf;
using proact::description::Robot;
using proact::description::JointKind;
using proact::description::ShapeKind;

int failures = 0;

void check(bool holds, const std::string& what) {
  if (holds) return;
  std::cerr << "failed: " << what << '\n';
  ++failures;
}

std::string arm(const std::string& joint_body) {
  return "<robot name='arm'><link name='base'/><link name='hand'>"
         "<inertial><origin xyz='0 0 0.5'/><mass value='2'/>"
         "<inertia ixx='1' ixy='0.1' ixz='0.2' iyy='3' iyz='0.4' izz='5'/></inertial>"
         "<collision><origin rpy='1.5707963267948966 0 0'/><geometry><cylinder radius='0.1' length='0.4'/>"
         "</geometry></collision></link>"
         "<joint name='elbow' type='revolute'>" +
         joint_body + "</joint></robot>";
}

const char* const good_joint =
    "<origin xyz='1 2 3'/><parent link='base'/><child link='hand'/><axis xyz='0 0 1'/>"
    "<limit lower='-1' upper='2' velocity='3' effort='4'/><dynamics damping='0.5' friction='0.25'/>";

/// The reason for which `text` is refused, or an empty string if it is not.
std::string refusal(const std::string& text) {
  try {
    read_urdf(text);
  } catch (const std::runtime_error& error) {
    return error.what();
  }
  return {};
}

void every_field_arrives() {
  const Robot robot = read_urdf(arm(good_joint));
  check(robot.name == "arm" && robot.root == "base", "name and root");
  check(robot.links.size() == 2 && robot.joints.size() == 1, "two links, one joint");

  const auto& hand = robot.links.at(1);
  check(hand.name == "hand" && hand.has_inertial && hand.mass == 2.0, "mass");
  check(hand.inertia == std::array<double, 6>{{1.0, 0.1, 0.2, 3.0, 0.4, 5.0}}, "inertia in order");
  check(hand.inertial_pose.position.z == 0.5, "centre of mass");
  check(hand.collisions.size() == 1 && hand.collisions[0].shape.kind == ShapeKind::cylinder, "a cylinder");
  check(std::abs(hand.collisions[0].pose.rotation.x - std::sqrt(0.5)) < 1e-15, "turned by pi/2 about x");

  const auto& elbow = robot.joints.at(0);
  check(elbow.kind == JointKind::revolute && elbow.parent == "base" && elbow.child == "hand", "joint ends");
  check(elbow.limits == std::array<double, 4>{{-1.0, 2.0, 3.0, 4.0}}, "limits in order");
  check(elbow.damping == 0.5 && elbow.friction == 0.25, "dynamics");
  check(elbow.mimic_joint.empty(), "no mimic");
}

void refusals_carry_urdfdoms_reason() {
  check(!refusal("").empty(), "empty text");
  check(!refusal("<robot name='x'>").empty(), "unclosed element");
  check(refusal(arm("<parent link='base'/><child link='wrist'/><axis xyz='0 0 1'/>"
                    "<limit lower='0' upper='1' velocity='1' effort='1'/>"))
                .find("wrist") != std::string::npos,
        "a missing child link is named");
  check(refusal(arm("<parent link='base'/><child link='hand'/>")).find("elbow") != std::string::npos,
        "a revolute joint without limits is named");
  std::string cone = arm(good_joint);
  cone.replace(cone.find("<cylinder radius='0.1' length='0.4'/>"), 37, "<cone/>");
  check(!refusal(cone).empty(), "a shape that would be dropped");
}

/// The log handler is process-wide: without the lock, reasons would end up in each other's errors.
void threads_do_not_mix_their_reasons() {
  std::vector<std::thread> threads;
  std::vector<int> mixed(4, 0);
  for (std::size_t k = 0; k < mixed.size(); ++k) {
    threads.emplace_back([k, &mixed] {
      const std::string own = "missing" + std::to_string(k);
      const std::string other = "missing" + std::to_string((k + 1) % 4);
      for (int round = 0; round < 100; ++round) {
        const std::string reason = refusal(arm("<parent link='base'/><child link='" + own +
                                               "'/><limit lower='0' upper='1' velocity='1' effort='1'/>"));
        if (reason.find(own) == std::string::npos || reason.find(other) != std::string::npos) ++mixed[k];
      }
    });
  }
  for (auto& thread : threads) thread.join();
  for (const int count : mixed) check(count == 0, "reasons of several threads are kept apart");
}

}  // namespace

int main() {
  every_field_arrives();
  refusals_carry_urdfdoms_reason();
  threads_do_not_mix_their_reasons();
  if (failures == 0) std::cout << "description: all checks passed\n";
  return failures;
}
