// All that ODE keeps of a body from one tick to the next.
#pragma once

#include "ode_runtime.hpp"

namespace proact::dynamics {

struct OdeBodyState {
  Pose pose;
  Vec3 linear;
  Vec3 angular;
  bool enabled;

  static OdeBodyState capture(dBodyID body);
  /// Puts a body where it was, bit for bit.
  void restore(dBodyID body) const;
};

inline Vec3 linear_velocity(dBodyID body) { return to_vec(dBodyGetLinearVel(body)); }
inline Vec3 angular_velocity(dBodyID body) { return to_vec(dBodyGetAngularVel(body)); }
inline void set_body_velocity(dBodyID body, const Vec3& linear, const Vec3& angular) {
  dBodySetLinearVel(body, linear.x, linear.y, linear.z);
  dBodySetAngularVel(body, angular.x, angular.y, angular.z);
}
/// Whether place and twist of a body are numbers.
bool is_finite(dBodyID body);

}  // namespace proact::dynamics
