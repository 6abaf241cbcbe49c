// The base of the arm, which goes where it is told unless that is too far.
#pragma once

#include "frame_motion.hpp"
#include "proact/dynamics/model.hpp"

namespace proact::dynamics {

class MovingBase {
 public:
  struct State {
    Pose world_from_base;
    Vec3 linear;   ///< m/s
    Vec3 angular;  ///< rad/s
    bool held = false;  ///< stood still in the last tick because it was told to jump
  };

  explicit MovingBase(const Model& model);

  /// Sets off to `asked`, or stays if it would have to jump there.
  void begin_step(const Pose& asked);
  /// The end of the tick.
  void end_step() { state_.world_from_base = target_; }

  const Pose& pose() const { return state_.world_from_base; }
  /// Place and twist of the base, within a tick the place from its start.
  FrameMotion motion() const { return {state_.world_from_base, state_.linear, state_.angular}; }
  /// How it moves since begin_step(), of second order: turning with the mean of the speeds before and after.
  const BaseMotion& tick_motion() const { return tick_motion_; }
  const State& state() const { return state_; }
  void restore(const State& state) { state_ = state; }

 private:
  bool exceeds_speed_limit(const Pose& target) const;

  const Options& options_;
  State state_;
  Pose target_;  ///< of this tick
  BaseMotion tick_motion_;
};

}  // namespace proact::dynamics
