// How frames move. Vectors in the axes of `world`.
#pragma once

#include "proact/geometry.hpp"

namespace proact::dynamics {

/// Place and twist of a frame; linear is that of its origin.
struct FrameMotion {
  Pose pose;
  Vec3 linear;
  Vec3 angular;
};

/// How the base moves: its twist, and what its velocity gains in a second.
struct BaseMotion {
  Vec3 linear;
  Vec3 angular;
  Vec3 linear_acceleration;
  Vec3 angular_acceleration;
};

}  // namespace proact::dynamics
