#include "joint_control.hpp"

#include "ode_runtime.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace proact::dynamics {

namespace {

// Below this speed Coulomb friction fades to zero, so that a joint at rest is not pushed to and fro, rad/s.
constexpr double friction_fade = 0.01;
// A joint is at its stop from this far beyond its limit, rad: a command to the limit itself ends a little
// beside it.
constexpr double stop_tolerance = 1e-4;

}  // namespace

JointControl::JointControl(const Model& model, const ArmJoints& joints)
    : model_(model), joints_(joints), state_{model.positions, std::vector<int>(model.moving.size(), 0)} {}

void JointControl::restore(State state) { state_ = std::move(state); }

Motor JointControl::motor(std::size_t moving, double position, double velocity) {
  const bool gains = joint(moving).proportional_gain > 0.0;
  return gains ? gain_motor(moving, position) : position_motor(moving, position, velocity);
}

/// Whether a joint is on a stop: once beyond its limit, and until the control alone can hold it.
int JointControl::active_stop(std::size_t moving) const {
  const Joint& own = joint(moving);
  if (const int stop = state_.stop[moving]; stop != 0) {
    const double control = own.proportional_gain > 0.0 ? -stop * gains_torque(moving, 0.0) : own.effort;
    return -stop * (joints_.efforts()[moving] + joints_.limit_effort()[moving]) > control ? stop : 0;
  }
  const double position = joints_.positions()[moving];
  const double beyond = stop_tolerance * own.per_radian();
  if (position > own.upper + beyond) return 1;
  return position < own.lower - beyond ? -1 : 0;
}

double JointControl::limit_effort(std::size_t moving, double torque) const {
  if (state_.stop[moving] == 0) return 0.0;
  const Joint& own = joint(moving);
  const double motor = own.proportional_gain > 0.0 ? std::fabs(gains_torque(moving, 0.0)) : own.effort;
  return torque - std::clamp(torque, -motor, motor);
}

/// Position control as a speed constraint with bounded torque: at the end of the tick the joint has the speed
/// that closes the gap, unless that takes more than the effort limit. Gravity therefore leaves no sag.
///
/// A stop is the same constraint at the limit without a bound. ODE's own stops are not used: a motor that drives
/// away from one acts with its full torque for a tick, which throws light fingers.
Motor JointControl::position_motor(std::size_t moving, double position, double velocity) {
  const Options& options = model_.options;
  const Joint& own = joint(moving);
  const int stop = active_stop(moving);
  state_.stop[moving] = stop;
  const bool stopped = stop != 0;
  const double command = stopped ? (stop > 0 ? own.upper : own.lower) : position;
  const double ahead = stopped ? 0.0 : velocity;
  const double target = std::clamp(command, own.lower, own.upper);
  // The command is for the end of the tick: what its own speed covers is no error.
  const double error = target - joints_.positions()[moving] - ahead * tick_secs;
  const double fastest = options.catch_up_factor * own.velocity;
  const double rubbing = own.damping + own.friction / std::max(std::fabs(joints_.velocities()[moving]), friction_fade * own.per_radian());
  return {std::clamp(ahead + options.position_gain * error, -fastest, fastest), stopped ? dInfinity : own.effort, rubbing,
          0.0, 0.0, options.gear_speed_factor * own.velocity,
          own.velocity > 0.0 ? options.gear_brake * own.effort / own.velocity : 0.0};
}

/// Torque of a joint's gains at its present angle while its command moves at `speed` and the joint does not.
double JointControl::gains_torque(std::size_t moving, double speed) const {
  const Joint& own = joint(moving);
  const double command = std::clamp(state_.gains_command[moving], own.lower, own.upper);
  return own.proportional_gain * (command - joints_.positions()[moving]) + own.derivative_gain * speed;
}

/// Proportional and derivative gain on the difference to a command of bounded speed, as it is at the end of the tick:
/// taken from its start, such gains would shake light fingers. Nothing bears gravity, so that the arm sags.
Motor JointControl::gain_motor(std::size_t moving, double position) {
  const Joint& own = joint(moving);
  double& command = state_.gains_command[moving];
  const double farthest = model_.options.gain_command_speed_rad_per_s * own.per_radian() * tick_secs;
  const double way = std::clamp(position - command, -farthest, farthest);
  command += way;
  Motor motor = position_motor(moving, command, 0.0);
  if (state_.stop[moving] != 0) return motor;
  motor.limit = 0.0;
  motor.brake_gain = 0.0;
  motor.torque = gains_torque(moving, way / tick_secs);
  motor.gain_damping = own.derivative_gain + own.proportional_gain * tick_secs;
  motor.damping += motor.gain_damping;
  return motor;
}

}  // namespace proact::dynamics
