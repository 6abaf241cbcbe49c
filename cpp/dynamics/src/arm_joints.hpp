// The joints' angles and speeds, and which joints of the hand are rigid at present.
#pragma once

#include "proact/dynamics/model.hpp"

#include <cstddef>
#include <vector>

namespace proact::dynamics {

/// Whether the description lets a joint move.
bool movable(const Joint& joint);

class ArmJoints {
 public:
  /// By moving joint.
  struct State {
    std::vector<double> positions;     ///< rad
    std::vector<double> velocities;    ///< rad/s
    std::vector<double> efforts;       ///< of the motors, N m
    std::vector<double> limit_effort;  ///< by stops and braking gears, N m
    std::vector<double> last_command;
    std::vector<bool> locked;          ///< rigid at present
    std::vector<int> idle_ticks;
  };

  explicit ArmJoints(const Model& model);

  const std::vector<double>& positions() const { return state_.positions; }
  const std::vector<double>& velocities() const { return state_.velocities; }
  const std::vector<double>& efforts() const { return state_.efforts; }
  const std::vector<double>& limit_effort() const { return state_.limit_effort; }
  const std::vector<bool>& locked() const { return state_.locked; }
  const State& state() const { return state_; }
  void restore(State state);

  /// Index of the joint vector of a joint of the model, or no_index.
  std::size_t moving_index(std::size_t joint) const { return moving_of_joint_[joint]; }
  /// Whether a joint of the model cannot turn at present.
  bool rigid(std::size_t joint) const;
  bool all_finite() const;

  /// Finds which hand joints are at rest; true if that is another set than before.
  bool update_rigid(const double* position, const double* velocity);
  void set_state(std::size_t moving, double position, double velocity, double effort, double limit_effort);
  void clear_effort(std::size_t moving) { state_.efforts[moving] = state_.limit_effort[moving] = 0.0; }
  void clear_efforts();

 private:
  const Model& model_;
  std::vector<std::size_t> moving_of_joint_;
  State state_;
};

}  // namespace proact::dynamics
