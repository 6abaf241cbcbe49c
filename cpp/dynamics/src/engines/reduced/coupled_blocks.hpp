// The blocks that hang together with the arm in joint angles by contacts. All other blocks are ODE's.
#pragma once

#include "block_bodies.hpp"
#include "contact_joints.hpp"
#include "large_islands.hpp"
#include "contact_constraint.hpp"
#include "engines/reduced/velocity_problem.hpp"

#include <cstddef>
#include <vector>

namespace proact::dynamics {

class CoupledBlocks {
 public:
  CoupledBlocks(const Model& model, BlockBodies& blocks, ContactJoints& contact_joints, const LargeIslands& islands);

  /// Finds the blocks that touch the arm, or each other and one of them the arm; hands all other contacts to ODE.
  void find(const std::vector<ContactConstraint>& touches);

  std::size_t count() const { return blocks_in_contact_.size(); }
  /// The contacts that act on the arm or on an engaged block.
  const std::vector<ContactConstraint>& constraints() const { return constraints_; }
  /// Place of an engaged block among them.
  std::size_t slot(std::size_t block) const { return slot_[block]; }

  /// Adds masses, momenta and present speeds to a problem of `hinges` hinges.
  void add_to(VelocityProblem& problem, std::size_t hinges);
  /// Finds out which of them are of large islands too; whether any is.
  bool find_shared();
  /// The shared ones in turns with the sweeps: start, then before and after each solution of `problem`.
  void reset_exchange();
  void import_momenta(VelocityProblem& problem, const PgsContactSolver& sweeps) const;
  /// The largest change of a speed, m/s, rad/s over a block's breadth left out.
  double export_speeds(const VelocityProblem& problem, std::size_t hinges, PgsContactSolver& sweeps);
  /// Moves the blocks by a tick at the speeds of `problem`.
  void integrate(const VelocityProblem& problem, std::size_t hinges);
  /// What hangs together with the arm is none of ODE's business in a tick.
  void disable_in_ode();
  void enable_in_ode();

 private:
  const Model& model_;
  BlockBodies& blocks_;
  ContactJoints& contact_joints_;
  const LargeIslands& islands_;
  std::vector<std::size_t> blocks_in_contact_;
  std::vector<std::size_t> slot_;  ///< by block: its place in blocks_in_contact_, or no_index
  std::vector<ContactConstraint> constraints_;
  struct SharedBlock {
    std::size_t slot;
    std::size_t body;  ///< of the sweeps
    Vec3 linear;       ///< impulse that the arm's contacts gave it, N s
    Vec3 angular;      ///< N m s
  };
  std::vector<SharedBlock> shared_;
};

}  // namespace proact::dynamics
