// The engine `reduced`: the arm in joint angles, solved together with the blocks that hang together with it by contacts.
//
// Frames. W is `world`, z up, and vectors are in its axes unless a name says otherwise. B is the base, which goes where it
// is told. A body is a set of links that rigid joints hold together; its frame is that of its first link, whose hinge
// turns it against its parent. A contact has its normal n, from the second side into the first, and two tangents across.
//
// Equations of a tick of length h. Unknown are the speeds v at its end, of the hinges and of the engaged blocks (linear,
// then angular); M is the mass matrix, C what inverse dynamics gives for zero accelerations, J the contacts' Jacobian:
//
//   q_half = q + h/2 v_start,   M (v - v_start) = h (motors - damping - C) + J^T impulses,   q_end = q_half + h/2 v.
//
// Where the parts come from:
// - half a tick of drift, velocities with contacts at the middle, the other half: the time stepping of J. J. Moreau,
//   Unilateral contact and dry friction in finite freedom dynamics (CISM 302, 1988);
// - impulses and velocities instead of forces and accelerations: D. E. Stewart and J. C. Trinkle (Int. J. Numer. Methods
//   Eng. 39, 1996), M. Anitescu and F. A. Potra (Nonlinear Dynamics 14, 1997);
// - inverse dynamics by Newton and Euler: J. Y. S. Luh, M. W. Walker and R. P. C. Paul (J. Dyn. Sys. Meas. Control 102,
//   1980), as R. Featherstone, Rigid Body Dynamics Algorithms (2008), 5.3 (arm_tree);
// - mass matrix of composite rigid bodies: M. W. Walker and D. E. Orin (J. Dyn. Sys. Meas. Control 104, 1982), as
//   Featherstone 6.2 (arm_tree);
// - contacts and motors: see velocity_problem.
#pragma once

#include "arm.hpp"
#include "engines/reduced/arm_tree.hpp"
#include "engines/reduced/coupled_blocks.hpp"
#include "engines/reduced/link_broad_phase.hpp"
#include "engines/reduced/velocity_problem.hpp"

#include <array>
#include <cstddef>
#include <vector>

namespace proact::dynamics {

/// A tick of the arm is half a tick of drift, the change of the speeds, and the other half: second order, so that an arm
/// without damping keeps its energy. What it touches is found halfway.
class ReducedArm final : public Arm {
 public:
  explicit ReducedArm(const ArmContext& surroundings);

  void build() override;
  void drive(const double* position, const double* velocity) override;
  void place_geoms() override;
  bool resolve_contacts(Collisions& collisions) override;
  void finish() override;
  ContactSide contact_side(std::size_t link) const override { return {nullptr, no_index, links_.body_of(link)}; }
  FrameMotion motion(std::size_t body) const override;
  bool moved_by_ode() const override { return false; }
  bool all_finite() const override { return true; }
  State state() const override { return {Pose{}, motor_states_, {}}; }
  void restore(const State& state) override;

 private:
  void join_links();
  void sum_masses();
  void add_mass(std::size_t body, double mass, const Vec3& center, const SymmetricMatrix3& about_center);
  void resize_scratch();
  void attach_block_shapes();
  bool step_without_contacts();
  bool solve_with_contacts(Collisions& collisions, bool shared);
  void set_up_hinges();
  bool iterate_velocities(int rounds);
  bool iterate_with_heap();
  void add_contact(const ContactConstraint& touch);
  void add_side(const ContactSide& side, double sign, const std::array<Vec3, 3>& directions, const Vec3& point);
  std::size_t moving(std::size_t hinge) const { return tree_.bodies[hinge + 1].moving; }

  const Model& model_;
  const MovingBase& base_;
  ArmJoints& joints_;
  JointControl& control_;
  const BlockBodies& blocks_;
  const BlockAttachment& carrying_;
  Geoms& geoms_;
  LargeIslands& islands_;

  ArmTree tree_;
  VelocityProblem problem_;
  LinkBroadPhase broad_phase_;
  CoupledBlocks coupled_blocks_;
  std::vector<int> motor_states_;                 ///< by moving joint: 0, or +-1 where the control gave its limit
  std::vector<Motor> motors_;                     ///< by hinge of tree_, of this tick
  std::vector<double> midpoint_positions_;        ///< joint angles in the middle of the tick
  std::vector<std::vector<std::size_t>> chains_;  ///< by body of tree_: its hinges from the base on
  std::vector<double> speeds_;           ///< scratch, by hinge
  std::vector<double> accelerations_;
  std::vector<double> torques_;
  std::vector<double> momenta_;
};

}  // namespace proact::dynamics
