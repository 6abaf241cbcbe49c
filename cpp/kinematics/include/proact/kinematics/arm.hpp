// Kinematics and inverse dynamics of an arm with a hand, on KDL. Plain C++17: no cxx, no ROS.
#pragma once

#include "proact/kinematics/description.hpp"
#include "proact/kinematics/inverse_solver.hpp"
#include "proact/kinematics/tree_dynamics.hpp"

#include <kdl/chain.hpp>
#include <kdl/chainfksolverpos_recursive.hpp>
#include <kdl/chainjnttojacsolver.hpp>
#include <kdl/jacobian.hpp>
#include <kdl/jntarray.hpp>
#include <kdl/tree.hpp>

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace proact::kinematics {

/// The whole arm as a tree, and the chain from `base` to `tip` inside it.
///
/// Joint values of the chain run base to tip; joint values of the tree run in the order of
/// ArmDescription::moving. Twists and Jacobians are linear first, then angular, in base axes at the tip.
///
/// Not safe for two threads at once, not even where it looks read-only: KDL writes to mutable caches.
/// Use one Arm per thread. Values that are not finite are the caller's to refuse: KDL computes with NaN
/// and reports success.
class Arm {
 public:
  /// Throws std::invalid_argument, naming link or joint, if the description is not a tree of revolute and
  /// fixed joints with positive masses and ordered limits, or if `tip` is not below `base`.
  explicit Arm(const ArmDescription& description);
  Arm(const Arm&) = delete;  // the solvers keep references to chain and tree
  Arm& operator=(const Arm&) = delete;

  std::size_t chain_joint_count() const noexcept { return chain_.getNrOfJoints(); }
  std::size_t moving_count() const noexcept { return moving_.size(); }
  std::size_t link_count() const noexcept { return links_.size(); }

  /// base_from_tip at q[chain_joint_count()], radians. Does not allocate.
  Pose forward(const double* q);

  /// Geometric Jacobian at q, written column after column into out[6 * chain_joint_count()], linear rows
  /// first (m/rad), then angular. Does not allocate.
  void jacobian(const double* q, double* out);

  /// The six singular values of the Jacobian at q, largest first (zeros are appended when the chain has
  /// fewer than six joints), mixed units as metres and radians come.
  std::array<double, 6> singular_values(const double* q);

  /// root_from_link for every link at q[moving_count()], in the order of the description.
  void link_poses(const double* q, Pose* out);

  /// Torque of every moving joint, N m, that gives the accelerations qdd at q and qd under `gravity`
  /// (m/s^2, axes of the root link), the carried body included. All arrays have moving_count() values.
  void inverse_dynamics(const double* q, const double* qd, const double* qdd,
                        const std::array<double, 3>& gravity, double* torque);

  /// Puts `body` into the hand, fixed to the tip, or takes it away. Changes inverse dynamics only.
  void set_payload(const std::optional<Inertial>& body);

  /// Angles within the limits at which the tip is at `base_from_tip`, searched from `seed` and, should
  /// that fail, from a fixed sequence of starts around it and then all over the range.
  bool inverse(const Pose& base_from_tip, const double* seed, double* out);

  /// Distinct solutions found from `starts` starts drawn from `random_seed`, one after another in the
  /// order found.
  std::vector<double> inverse_all(const Pose& base_from_tip, std::size_t starts, std::uint64_t random_seed);

 private:
  // The tree's solver takes gravity when it is made; both belong together and are made anew for another
  // gravity or another carried body.
  struct Dynamics {
    Dynamics(const Arm& arm, const std::array<double, 3>& gravity);
    std::array<double, 3> gravity;
    KDL::Tree tree;
    TreeDynamics solver;
    std::vector<unsigned int> coordinates;  // the tree's number of each moving joint
  };

  struct Link {
    KDL::Segment segment;
    std::size_t parent;
    int moving;  // place in joint vectors over the tree, -1 for a fixed joint
  };

  void load_chain(const double* q);

  std::vector<Link> links_;
  std::vector<std::size_t> moving_;  // links of the moving joints
  std::string tip_;
  KDL::Tree tree_;
  KDL::Chain chain_;
  KDL::ChainFkSolverPos_recursive position_solver_;
  KDL::ChainJntToJacSolver jacobian_solver_;
  InverseSolver inverse_solver_;
  KDL::JntArray chain_q_;
  KDL::Jacobian chain_jacobian_;
  KDL::JntArray tree_q_;
  KDL::JntArray tree_qd_;
  KDL::JntArray tree_qdd_;
  KDL::JntArray tree_torque_;
  std::vector<KDL::Frame> frames_;
  std::optional<KDL::Segment> payload_;
  std::unique_ptr<Dynamics> dynamics_;
};

}  // namespace proact::kinematics
