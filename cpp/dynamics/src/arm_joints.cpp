#include "arm_joints.hpp"

#include "no_index.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace proact::dynamics {

namespace {

// A joint with a smaller range does not move at all.
constexpr double immovable_range = 1e-9;

}  // namespace

bool movable(const Joint& joint) { return joint.kind != JointKind::fixed && joint.upper - joint.lower >= immovable_range; }

ArmJoints::ArmJoints(const Model& model) : model_(model), moving_of_joint_(model.joints.size(), no_index) {
  const std::size_t joints = model.moving.size();
  for (std::size_t k = 0; k < joints; ++k) moving_of_joint_[model.moving[k]] = k;
  state_.positions = model.positions;
  state_.velocities.assign(joints, 0.0);
  state_.efforts.assign(joints, 0.0);
  state_.limit_effort.assign(joints, 0.0);
  state_.last_command = model.positions;
  state_.locked.assign(joints, false);
  state_.idle_ticks.assign(joints, 0);
  for (std::size_t k = model.arm_count; k < joints && model.options.lock_idle_hand; ++k) {
    state_.locked[k] = true;
    state_.idle_ticks[k] = model.options.lock_ticks;
  }
}

void ArmJoints::restore(State state) { state_ = std::move(state); }

bool ArmJoints::rigid(std::size_t joint) const {
  return !movable(model_.joints[joint]) || state_.locked[moving_of_joint_[joint]];
}

bool ArmJoints::all_finite() const {
  return std::all_of(state_.velocities.begin(), state_.velocities.end(), [](double value) { return std::isfinite(value); });
}

bool ArmJoints::update_rigid(const double* position, const double* velocity) {
  const Options& options = model_.options;
  auto& [positions, velocities, efforts, limit_effort, last_command, held, still_ticks] = state_;
  bool changed = false;
  for (std::size_t k = model_.arm_count; k < model_.moving.size(); ++k) {
    const bool commanded = std::fabs(position[k] - last_command[k]) > 1e-9 || std::fabs(velocity[k]) > 1e-9;
    const double unit = model_.joints[model_.moving[k]].per_radian();
    const bool reached = std::fabs(position[k] - positions[k]) < options.lock_error_rad * unit &&
                         std::fabs(velocities[k]) < options.lock_speed_rad_per_s * unit;
    still_ticks[k] = commanded || !(reached || held[k]) ? 0 : still_ticks[k] + 1;
    const bool hold = options.lock_idle_hand && still_ticks[k] >= options.lock_ticks;
    if (hold != held[k]) {
      held[k] = hold;
      velocities[k] = hold ? 0.0 : velocities[k];
      changed = true;
    }
  }
  std::copy(position, position + model_.moving.size(), last_command.begin());
  return changed;
}

void ArmJoints::set_state(std::size_t moving, double position, double velocity, double effort, double limit_effort) {
  state_.positions[moving] = position;
  state_.velocities[moving] = velocity;
  state_.efforts[moving] = effort;
  state_.limit_effort[moving] = limit_effort;
}

void ArmJoints::clear_efforts() {
  for (std::size_t k = 0; k < state_.efforts.size(); ++k) clear_effort(k);
}

}  // namespace proact::dynamics
