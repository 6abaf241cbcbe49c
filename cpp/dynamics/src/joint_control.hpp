// What the control asks of each joint in a tick, and the joints' stops.
#pragma once

#include "arm_joints.hpp"

#include <cstddef>
#include <vector>

namespace proact::dynamics {

struct Motor {
  double speed;         ///< at the end of the tick, rad/s
  double limit;         ///< of its torque, N m
  double damping;       ///< torque lost with each unit of the speed: damping, friction, gains, N m s/rad
  double torque;        ///< of the gains at rest, N m
  double gain_damping;  ///< what of rubbing belongs to the gains
  double max_speed;     ///< beyond this speed the gear brakes, rad/s
  double brake_gain;    ///< torque of the gear for each unit of the speed beyond, N m s/rad
};

class JointControl {
 public:
  /// By moving joint.
  struct State {
    std::vector<double> gains_command;  ///< what joints driven by gains are asked for, rad
    std::vector<int> stop;              ///< 1 on its upper stop, -1 on its lower, else 0
  };

  JointControl(const Model& model, const ArmJoints& joints);

  /// What of a torque of joint `moving` its stop bears, since its motor cannot, N m.
  double limit_effort(std::size_t moving, double torque) const;
  /// Of a tick in which joint `moving` is asked for `position` with speed `velocity`.
  Motor motor(std::size_t moving, double position, double velocity);

  const State& state() const { return state_; }
  void restore(State state);

 private:
  const Joint& joint(std::size_t moving) const { return model_.joints[model_.moving[moving]]; }
  int active_stop(std::size_t moving) const;
  double gains_torque(std::size_t moving, double speed) const;
  Motor position_motor(std::size_t moving, double position, double velocity);
  Motor gain_motor(std::size_t moving, double position);

  const Model& model_;
  const ArmJoints& joints_;
  State state_;
};

}  // namespace proact::dynamics
