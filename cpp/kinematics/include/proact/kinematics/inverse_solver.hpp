// Inverse kinematics within joint limits.
#pragma once

#include <kdl/chain.hpp>
#include <kdl/chainfksolverpos_recursive.hpp>
#include <kdl/chainjnttojacsolver.hpp>
#include <kdl/frames.hpp>
#include <kdl/jacobian.hpp>
#include <kdl/jntarray.hpp>

#include <Eigen/Core>

#include <cstddef>
#include <cstdint>
#include <vector>

namespace proact::kinematics {

/// Damped least squares (Levenberg-Marquardt) on KDL's forward kinematics and Jacobian.
///
/// A joint that a step would push over its limit is taken out of that step, and the others are solved
/// again, so that a search slides along limits instead of stopping there. KDL's own LMA solver knows no
/// limits, and its Newton-Raphson with limits clamps only.
/// Deterministic: starts after the first come from a fixed generator.
/// Known weakness: a local method; a failure after all starts does not prove that the target is out of reach.
class InverseSolver {
 public:
  /// Tolerances of a solution: metres, and radians of the rotation left over.
  static constexpr double kPositionTolerance = 1e-8;
  static constexpr double kRotationTolerance = 1e-8;
  /// Solutions closer than this in every joint, rad, count as one.
  static constexpr double kDistinctAngle = 0.1;

  /// `chain` must outlive the solver. Limits in radians, one per joint.
  InverseSolver(const KDL::Chain& chain, std::vector<double> lower, std::vector<double> upper);

  /// From `seed`, then from starts around it, then from anywhere. Writes to `out` only on success.
  bool solve(const KDL::Frame& target, const double* seed, double* out);

  /// Distinct solutions from `starts` starts spread over the range.
  std::vector<double> solve_all(const KDL::Frame& target, std::size_t starts, std::uint64_t random_seed);

 private:
  bool minimize(const KDL::Frame& target);
  void evaluate_error(const KDL::Frame& target, const KDL::JntArray& q);
  void step(double damping);
  double uniform();

  std::vector<double> lower_;
  std::vector<double> upper_;
  KDL::ChainFkSolverPos_recursive position_solver_;
  KDL::ChainJntToJacSolver jacobian_solver_;
  std::uint64_t random_state_ = 0;
  KDL::JntArray q_;
  KDL::JntArray trial_;
  KDL::Jacobian jacobian_;
  Eigen::Matrix<double, 6, Eigen::Dynamic> free_jacobian_;
  Eigen::VectorXd step_;
  std::vector<bool> frozen_;
  // The error of the last configuration measured: weighted for the descent, plain for the tolerances.
  Eigen::Matrix<double, 6, 1> error_;
  double position_error_ = 0.0;
  double rotation_error_ = 0.0;
};

}  // namespace proact::kinematics
