#include "ode_body_state.hpp"

#include <algorithm>
#include <iterator>

namespace proact::dynamics {

OdeBodyState OdeBodyState::capture(dBodyID body) {
  return {body_pose(body), linear_velocity(body), angular_velocity(body), dBodyIsEnabled(body) != 0};
}

void OdeBodyState::restore(dBodyID body) const {
  set_body_pose(body, pose);
  // ODE has just normalized the quaternion again, which can change its last bit, so the bits are written over it.
  // The bodies are ODE's own, none of them constant.
  dReal* q = const_cast<dReal*>(dBodyGetQuaternion(body));
  const dQuaternion exact{pose.rotation.w, pose.rotation.x, pose.rotation.y, pose.rotation.z};
  std::copy(std::begin(exact), std::end(exact), q);
  dQtoR(exact, const_cast<dReal*>(dBodyGetRotation(body)));
  set_body_velocity(body, linear, angular);
  if (enabled) {
    dBodyEnable(body);
  } else {
    dBodyDisable(body);
  }
}

bool is_finite(dBodyID body) {
  return is_finite(to_vec(dBodyGetPosition(body))) && is_finite(to_quat(dBodyGetQuaternion(body))) &&
         is_finite(linear_velocity(body)) && is_finite(angular_velocity(body));
}

}  // namespace proact::dynamics
