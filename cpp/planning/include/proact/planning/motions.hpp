// Straight joint motions, and rows of states, looked at in a Scene.
#pragma once

#include "proact/planning/scene.hpp"

namespace proact::planning {

/// How fine a straight joint motion is looked at: no joint vector changes by more than `step_rad` (L2) and no
/// point of the arm moves farther than `step_m` between two checked states, except where the clearance of a
/// state proves that nothing can be hit.
struct Resolution {
  double step_rad = 0.02;
  double step_m = 0.005;
  /// Above zero: motions are looked at in equal steps of this share of the joint space's extent and paths are
  /// simplified to the end, both as OMPL does by itself. For comparison.
  double fixed_validity_step = 0.0;
};

/// True if the straight joint motion from a to b is free, both ends included. Throws std::invalid_argument for a motion
/// of more steps of the resolution than any arm's.
bool motion_is_free(Scene& scene, const double* a, const double* b, const Resolution& resolution);

/// The same for a motion whose start is known to be free.
bool motion_from_free_is_free(Scene& scene, const double* a, const double* b, const Resolution& resolution);

/// How far from its start, which is free, a straight motion is free, as a share of its length.
double free_fraction(Scene& scene, const double* a, const double* b, const Resolution& resolution);

/// True if the straight motions that join `count` states, one after the other, are free, the states included.
bool path_is_free(Scene& scene, const double* states, std::size_t count, const Resolution& resolution);

/// True if each of `count` states is free: the same answer as from Scene::is_free about each, by fewer questions.
bool states_are_free(Scene& scene, const double* states, std::size_t count);

}  // namespace proact::planning
