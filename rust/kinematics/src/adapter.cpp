#include "proact-kinematics/src/adapter.hpp"

#include "proact-kinematics/src/bridge.rs.h"
#include "proact/kinematics/benchmark.hpp"

#include <algorithm>
#include <string>

// Lengths and finiteness are checked on the Rust side, where the error can name the numbers.
namespace proact::kinematics {

namespace {

ArmDescription from_raw(const RawArm& raw) {
  ArmDescription arm;
  for (const RawLink& link : raw.links) {
    LinkDescription description;
    description.name = std::string(link.name);
    description.parent = link.parent;
    description.joint = std::string(link.joint);
    description.kind = link.kind;
    description.origin = pose_from_array(link.origin);
    description.axis = link.axis;
    description.lower = link.lower;
    description.upper = link.upper;
    description.inertial = {link.mass, pose_from_array(link.inertial_pose), link.inertia};
    arm.links.push_back(description);
  }
  arm.moving.assign(raw.moving.begin(), raw.moving.end());
  arm.base = raw.base;
  arm.tip = raw.tip;
  return arm;
}

rust::Vec<double> to_raw(const std::vector<double>& values) {
  rust::Vec<double> out;
  out.reserve(values.size());
  for (const double value : values) out.push_back(value);
  return out;
}

}  // namespace

std::unique_ptr<Arm> new_arm(const RawArm& description) { return std::make_unique<Arm>(from_raw(description)); }

std::size_t chain_joint_count(const Arm& arm) { return arm.chain_joint_count(); }

void forward(Arm& arm, rust::Slice<const double> q, Seven& pose) { pose = pose_to_array(arm.forward(q.data())); }

void jacobian(Arm& arm, rust::Slice<const double> q, rust::Slice<double> out) {
  arm.jacobian(q.data(), out.data());
}

void singular_values(Arm& arm, rust::Slice<const double> q, std::array<double, 6>& out) {
  out = arm.singular_values(q.data());
}

void link_poses(Arm& arm, rust::Slice<const double> q, rust::Slice<double> out) {
  std::vector<Pose> poses(arm.link_count());
  arm.link_poses(q.data(), poses.data());
  double* next = out.data();
  for (const Pose& pose : poses) {
    const Seven numbers = pose_to_array(pose);
    next = std::copy(numbers.begin(), numbers.end(), next);
  }
}

void inverse_dynamics(Arm& arm, rust::Slice<const double> q, rust::Slice<const double> qd,
                      rust::Slice<const double> qdd, const std::array<double, 3>& gravity,
                      rust::Slice<double> torque) {
  arm.inverse_dynamics(q.data(), qd.data(), qdd.data(), gravity, torque.data());
}

void set_payload(Arm& arm, double mass, const Seven& pose, const std::array<double, 6>& inertia) {
  arm.set_payload(Inertial{mass, pose_from_array(pose), inertia});
}

void clear_payload(Arm& arm) { arm.set_payload(std::nullopt); }

bool inverse(Arm& arm, const Seven& target, rust::Slice<const double> seed, rust::Slice<double> out) {
  return arm.inverse(pose_from_array(target), seed.data(), out.data());
}

rust::Vec<double> inverse_all(Arm& arm, const Seven& target, std::size_t starts, std::uint64_t random_seed) {
  return to_raw(arm.inverse_all(pose_from_array(target), starts, random_seed));
}

rust::Vec<double> time_raw_kdl(const RawArm& description, rust::Slice<const double> q, std::size_t count) {
  return to_raw(time_raw_kdl(from_raw(description), q.data(), count));
}

}  // namespace proact::kinematics
