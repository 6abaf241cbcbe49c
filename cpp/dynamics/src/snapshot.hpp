// All that the next steps of a world depend on, and its form as numbers, bit for bit.
//
// Bodies and hinges are built again rather than saved: building depends on nothing but the saved numbers.
#pragma once

#include "arm.hpp"
#include "arm_joints.hpp"
#include "joint_control.hpp"
#include "large_islands.hpp"
#include "moving_base.hpp"
#include "ode_body_state.hpp"
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
  std::vector<int> ticks_until_sleep;  ///< by block
  std::vector<OdeBodyState> block_bodies;
  std::vector<bool> separated;  ///< [block][link]: contacts act
  std::vector<Contact> contacts;
  LargeIslands::State islands;
};

std::vector<double> serialize(const Model& model, const Snapshot& snapshot);
/// Throws std::invalid_argument if the numbers are not of a world made from `model`.
Snapshot deserialize(const Model& model, const std::vector<double>& numbers);

}  // namespace proact::dynamics
