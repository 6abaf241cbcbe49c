// The velocities at the end of a tick of many blocks that touch each other, contact by contact.
#pragma once

#include "engines/reduced/arm_tree.hpp"
#include "no_index.hpp"

#include <cstddef>
#include <vector>

namespace proact::dynamics {

/// Wanted are the speeds and impulses that VelocityProblem finds: the same soft normal forces, and Coulomb's friction. That
/// one factors a matrix of all speeds, whose cost grows with the cube of the blocks; this one visits the contacts in turn
/// and puts each right for the present speeds of its two blocks, so that a sweep costs as much as there are contacts. What
/// is left after some sweeps is an error, which the impulses of the tick before keep small when the sweeps begin with them.
///
/// Projected Gauss-Seidel on the velocities with a block of three for each contact: J. J. Moreau, Unilateral contact and dry
/// friction in finite freedom dynamics (CISM 302, 1988); M. Jean, The non-smooth contact dynamics method (Comput. Methods
/// Appl. Mech. Eng. 177, 1999); impulses of the last tick as the first guess: E. Catto, Iterative dynamics with temporal
/// coherence (GDC 2005). Sweeps go to and fro in the order given, so that the result depends on nothing but the numbers.
class PgsContactSolver {
 public:
  struct Body {
    Vec3 linear;   ///< m/s; in: without contacts; then: as it stands
    Vec3 angular;  ///< rad/s
    double inverse_mass = 0.0;
    SymmetricMatrix3 inverse_inertia;
    double changed = 0.0;  ///< sum of the changes of its speed so far, m/s
  };
  struct Point {
    std::size_t first = no_index;  ///< body, or no_index for what stands still
    std::size_t second = no_index;
    Vec3 first_lever;              ///< from the body's centre of mass
    Vec3 second_lever;
    Vec3 normal;                   ///< from the second into the first
    double speed = 0.0;            ///< wanted along the normal, m/s
    double friction = 0.0;
    Vec3 impulse;                         ///< on the first, N s; in: a guess
    double last_change = -1.0;            ///< what its bodies had changed when it was last put right
  };

  std::vector<Body> bodies;
  std::vector<Point> points;
  double normal_softness = 1e-3;    ///< m/s by which a contact gives way for each N
  double friction_softness = 1e-6;  ///< the same sideways

  /// Takes the memory for so many, so that no tick with fewer asks for any.
  void reserve(std::size_t most_bodies, std::size_t most_points);
  /// Begins a tick: lets the guessed impulses act.
  void begin();
  /// One sweep there and one back; the largest change of a speed at a contact in the second, m/s.
  double sweep();
  /// Sweeps until no speed at a contact changes by more than `small`, m/s, at most so often. True if it was reached.
  bool solve(int most, double small);
  /// Root of the mean square of the bodies' speeds, m/s.
  double mean_speed() const;

 private:
  /// What a point's impulse does to the speed there.
  struct Response {
    SymmetricMatrix3 inverse;      ///< of that and of the softness
    double along;                  ///< of an impulse along the normal, softness included
    double along_inverse;
    double across_inverse;  ///< of the most that one across does
  };

  double relax(std::size_t point);

  std::vector<Response> responses_;
  double skip_threshold_ = 0.0;  ///< a point whose bodies have changed by no more since it was put right is left out, m/s
  std::vector<Vec3> previous_impulses_;  ///< impulses before a sweep, then what it changed
  std::vector<Vec3> search_direction_;   ///< of conjugate gradients
};

/// The inverse of a symmetric matrix.
SymmetricMatrix3 inverse(const SymmetricMatrix3& m);

}  // namespace proact::dynamics
