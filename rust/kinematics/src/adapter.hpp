// What cxx sees: slices in and out over the plain core.
#pragma once

#include "proact/kinematics/arm.hpp"
#include "rust/cxx.h"

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>

namespace proact::kinematics {

struct RawArm;

using Seven = std::array<double, 7>;

std::unique_ptr<Arm> new_arm(const RawArm& description);
std::size_t chain_joint_count(const Arm& arm);
void forward(Arm& arm, rust::Slice<const double> q, Seven& pose);
void jacobian(Arm& arm, rust::Slice<const double> q, rust::Slice<double> out);
void singular_values(Arm& arm, rust::Slice<const double> q, std::array<double, 6>& out);
void link_poses(Arm& arm, rust::Slice<const double> q, rust::Slice<double> out);
void inverse_dynamics(Arm& arm, rust::Slice<const double> q, rust::Slice<const double> qd,
                      rust::Slice<const double> qdd, const std::array<double, 3>& gravity,
                      rust::Slice<double> torque);
void set_payload(Arm& arm, double mass, const Seven& pose, const std::array<double, 6>& inertia);
void clear_payload(Arm& arm);
bool inverse(Arm& arm, const Seven& target, rust::Slice<const double> seed, rust::Slice<double> out);
rust::Vec<double> inverse_all(Arm& arm, const Seven& target, std::size_t starts, std::uint64_t random_seed);
rust::Vec<double> time_raw_kdl(const RawArm& description, rust::Slice<const double> q, std::size_t count);

}  // namespace proact::kinematics
