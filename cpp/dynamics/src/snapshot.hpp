// All that the next steps of a world depend on, and its form as numbers, bit for bit.
//
// Bodies and hinges are built again rather than saved: building depends on nothing but the saved numbers.
#pragma once

#include "arm.hpp"
#include "arm_joints.hpp"
#include "body_bits.hpp"
#include "joint_control.hpp"
#include "large_islands.hpp"
#include "moving_base.hpp"
#include "ode_world.hpp"
#include "proact/dynamics/world.hpp"

#include <optional>
#include <vector>

namespace proact::dynamics {

/// The states of the parts of a simulation.
struct Snapshot {
  ArmJoints::State joints;
  JointControl::State control;
  MovingBase::State base;
  Arm::State arm;
  OdeWorld::State ode;
  std::optional<Attachment> attached;
  std::vector<BodyState> blocks;
  std::vector<int> until_sleep;  ///< by block
  std::vector<BodyBits> block_bodies;
  std::vector<bool> parted;  ///< [block][link]: contacts act
  std::vector<Contact> contacts;
  LargeIslands::State islands;
};

std::vector<double> to_numbers(const Model& model, const Snapshot& snapshot);
/// Throws std::invalid_argument if the numbers are not of a world made from `model`.
Snapshot from_numbers(const Model& model, const std::vector<double>& numbers);

}  // namespace proact::dynamics
