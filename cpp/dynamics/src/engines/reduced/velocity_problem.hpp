// The velocities at the end of a tick of the arm and of the blocks that hang together with it by contacts.
#pragma once

#include "engines/reduced/arm_tree.hpp"

#include <array>
#include <cstddef>
#include <limits>
#include <vector>

namespace proact::dynamics {

/// Unknown are the speeds of the hinges and the twists of the blocks (linear, then angular). Wanted are those at which
///
///   mass * v = momentum + motors + contacts,
///
/// each motor and each contact pushing by what its speed lacks over its softness, within its limits: the laws of ODE's
/// constraints (manual, "Soft constraints and constraint force mixing"). Friction is Coulomb's: against the slip, and in
/// any direction within friction times the normal force of the same tick. (ODE has friction along two tangents, each
/// within that bound, so that what slides aslant of both is braked by up to 1.41 times as much.)
///
/// For given bounds of friction these speeds are the minimum of a smooth convex function, found by Newton's method with
/// a search along each step. From there Newton's method on all laws at once leads on in a few steps, the bounds following
/// the normal forces; where it does not, the bounds are repeated until they settle. The result depends on nothing but the
/// numbers given.
///
/// Coulomb's friction as a fixed point of problems with given friction, each solved by a semi-smooth Newton method:
/// K. Kunisch and G. Stadler (ESAIM: M2AN 39, 2005). Soft contacts as a convex function of the speeds: E. Todorov,
/// Convex and analytically-invertible dynamics with contacts and constraints (ICRA 2014). Theirs are of continua, and of
/// cones that let what slides lift off; ours of rigid bodies whose normal forces know nothing of the slip. Newton's method
/// on Coulomb's law itself: P. Alart and A. Curnier (Computer Methods in Applied Mechanics and Engineering 92, 1991).
class VelocityProblem {
 public:
  static constexpr double infinity = std::numeric_limits<double>::infinity();
  static constexpr int max_bound_rounds = 60;
  struct Hinge {
    double momentum = 0.0;  ///< of the start and of all known torques, kg m^2/s
    double speed = 0.0;     ///< wanted, rad/s
    double limit = 0.0;     ///< of the motor's impulse, N m s
    double max_speed = infinity;  ///< beyond this speed the gear brakes, rad/s
    double brake_gain = 0.0;      ///< how much, N m s^2/rad
    int saturation = 0;           ///< found: 0, or +-1 where the motor gives its limit
    int braking = 0;              ///< found: 0, or +-1 where the gear brakes a joint that turns that way
    double impulse = 0.0;         ///< of the motor, found
    double brake_impulse = 0.0;   ///< impulse of the gear, found
  };
  struct BlockPart {
    double mass = 0.0;
    SymmetricMatrix3 inertia;
    Vec3 linear_momentum;
    Vec3 angular_momentum;
  };
  struct Contact {
    std::size_t first = 0;  ///< of its columns
    std::size_t last = 0;
    std::array<double, 3> speed{};  ///< wanted along the normal and the two tangents, m/s
    double friction = 0.0;
    double friction_bound = 0.0;                    ///< of friction, N s
    double saved_friction_bound = 0.0;              ///< to which a try that fails goes back
    double softness = 1.0;                          ///< along the normal, as a share of normal_softness
    std::array<double, 3> velocity_error{};         ///< speed that lacks
    std::array<double, 3> velocity_error_change{};  ///< of the gap in a step
    bool touching = false;                          ///< found: it pushes
    bool slipping = false;                          ///< found: its friction is at the bound
    std::array<double, 3> impulse{};                ///< found
  };
  struct Column {
    std::size_t index;
    std::array<double, 3> value;  ///< speed along normal and tangents by a unit of the unknown
  };

  std::vector<double> mass;  ///< hinge by hinge, square, damping included
  std::vector<Hinge> hinges;
  std::vector<BlockPart> blocks;
  std::vector<Contact> contacts;
  std::vector<Column> columns;    ///< of each contact in the order of their unknowns
  std::vector<double> velocity;   ///< in: a guess; out: the result
  double motor_softness = 1e-7;   ///< rad/s that a motor lags for each N m
  double normal_softness = 1e-3;  ///< m/s by which a contact gives way for each N
  double friction_softness = 1e-6;  ///< the same sideways
  /// Repetitions of the bounds of friction; to stop at fewer than all is no failure.
  int max_bound_iterations = max_bound_rounds;

  /// False if the laws could not all be met in a bounded number of steps; velocity is then the last try. Throws
  /// std::runtime_error if the masses are no masses.
  bool solve();
  /// Forgets the factors of an earlier solve: to be called when more than the momenta has changed.
  void invalidate_factors() { factors_for_ = FactorKind::nothing; }

 private:
  enum class FactorKind { nothing, fixed_bounds, following_bounds };

  bool minimize_velocity();
  bool solve_coupled_newton();
  bool bounds_converged() const;
  void update_bounds();
  bool update_active_set();
  bool has_sliding() const;
  void compute_velocity_errors();
  void compute_gradient();
  void assemble_mass_matrix();
  void factorize();
  bool factorize_coupled();
  void add_coupled_contact(const Contact& contact);
  void add_spring(const Contact& contact, double strength, const std::array<double, 3>& along);
  void forward_substitute();
  void compute_newton_step();
  double compute_coupled_step();
  void take_step(double way);
  void compute_line_gradient();
  double line_gradient(double way) const;
  double line_search();
  double stiffness(const Contact& contact, std::size_t row) const;
  std::array<double, 3> unclamped_impulse(const Contact& contact, double way) const;

  std::vector<double> factors_;         ///< lower triangle, square
  std::vector<double> spring_columns_;  ///< columns of a contact along a spring
  std::vector<double> upper_;           ///< the other triangle, transposed, where it is not the same
  std::vector<double> saved_velocity_;  ///< speeds to which a try that fails goes back
  std::vector<double> gradient_;        ///< of the convex function
  std::vector<double> step_;
  std::vector<double> kinks_;    ///< along the step
  FactorKind factors_for_ = FactorKind::nothing;
  bool factors_exact_ = false;  ///< the factors hold as long as nobody comes to or off a limit
  double line_gradient_start_ = 0.0;  ///< along the step, without motors and contacts
  double line_curvature_ = 0.0;
};

}  // namespace proact::dynamics
