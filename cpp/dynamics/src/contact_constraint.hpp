// A point at which two things push each other in this tick.
#pragma once

#include "contact_points.hpp"
#include "no_index.hpp"
#include "ode_runtime.hpp"

#include <cstddef>

namespace proact::dynamics {

/// One of the two that touch: a block, a body of the arm in joint angles, or neither for what stands still.
struct ContactSide {
  dBodyID body = nullptr;  ///< ODE's, if it has one
  std::size_t block = no_index;
  std::size_t arm = no_index;
};

struct ContactConstraint {
  ContactSide first;
  ContactSide second;
  double friction;
  ContactPoint point;
  std::size_t contact_index;  ///< index in the list of contacts, which wants its force, or no_index
  std::size_t resting_block = no_index;  ///< the block at rest in a heap that one of the sides is, as part of the room
};

}  // namespace proact::dynamics
