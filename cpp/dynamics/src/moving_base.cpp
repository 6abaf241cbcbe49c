#include "moving_base.hpp"

namespace proact::dynamics {

MovingBase::MovingBase(const Model& model) : options_(model.options), target_(model.world_from_base) {
  state_.world_from_base = model.world_from_base;
}

/// Whether a base that is told to go to `target` would have to jump.
bool MovingBase::exceeds_speed_limit(const Pose& target) const {
  const Quat turn = target.rotation * conjugate(state_.world_from_base.rotation);
  const double speed = norm(target.position - state_.world_from_base.position) / tick_secs;
  const double turn_speed = norm(rotation_vector(turn)) / tick_secs;
  return speed > options_.max_base_speed_m_per_s || turn_speed > options_.max_base_turn_rate_rad_per_s;
}

void MovingBase::begin_step(const Pose& asked) {
  const Pose normal{asked.position, normalized(asked.rotation)};
  state_.held = exceeds_speed_limit(normal);
  target_ = state_.held ? state_.world_from_base : normal;
  const Vec3 linear_before = state_.linear;
  const Vec3 angular_before = state_.angular;
  state_.linear = (target_.position - state_.world_from_base.position) * (1.0 / tick_secs);
  state_.angular =
      rotation_vector(target_.rotation * conjugate(state_.world_from_base.rotation)) * (1.0 / tick_secs);
  tick_motion_ = {state_.linear, (angular_before + state_.angular) * 0.5,
                  (state_.linear - linear_before) * (1.0 / tick_secs),
                  (state_.angular - angular_before) * (1.0 / tick_secs)};
}

}  // namespace proact::dynamics
