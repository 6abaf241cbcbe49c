// The engine `ode`: the arm as rigid bodies of ODE, held together by ODE's hinges and sliders and solved by dWorldStep together with
// all blocks, as Gazebo does for the original.
//
// Frames. W is `world`, z up. B is the base, a kinematic body whose origin is that of the base link. A body is a set of links
// that rigid joints hold together; ODE has its origin in its centre of mass, its axes are those of its first link
// (LinkGroups::body_from_link). A hinge's anchor is the origin of the child link, its axis the joint's; its angle is the
// model's, because hinges are made with all free joints at zero.
//
// ODE's equations: Lagrange multipliers on velocities after D. E. Stewart and J. C. Trinkle (Int. J. Numer. Methods Eng.
// 39, 1996) and M. Anitescu and F. A. Potra (Nonlinear Dynamics 14, 1997), softened by ERP and CFM; the linear
// complementarity problem with friction by Dantzig's method after D. Baraff, Fast contact force computation for
// nonpenetrating rigid bodies (SIGGRAPH 1994); then semi-implicit Euler, of first order.
#pragma once

#include "arm.hpp"

#include <cstddef>
#include <vector>

namespace proact::dynamics {

class OdeArm final : public Arm {
 public:
  explicit OdeArm(const ArmContext& surroundings);

  void build() override { build_at(base_.pose()); }
  void drive(const double* position, const double* velocity) override;
  void place_geoms() override;
  bool resolve_contacts(Collisions& collisions) override;
  void finish() override;
  ContactSide contact_side(std::size_t link) const override {
    return {bodies_[links_.body_of(link)], no_index, no_index};
  }
  FrameMotion motion(std::size_t body) const override;
  bool moved_by_ode() const override { return true; }
  bool all_finite() const override;
  State state() const override;
  void restore(const State& state) override;

 private:
  struct Hinge {
    dJointID joint;
    std::size_t moving;  ///< index of the joint vector
    bool slides;         ///< a slider of ODE, and not a hinge
    double inertia;      ///< that its two bodies put up about the axis, kg m^2, or along it, kg; the rest of the arm only adds to it
    dJointFeedback feedback;
  };

  double position(const Hinge& hinge) const;
  static double speed(const Hinge& hinge);
  static double bearing_effort(const Hinge& hinge);

  void build_at(const Pose& world_from_base);
  void place_links(const std::vector<double>& positions);
  void place_bodies();
  void set_masses();
  void add_attached_mass(std::size_t body, dMass& total) const;
  void make_hinges();
  void set_motor(const Hinge& hinge, const Motor& motor) const;
  void attach_block();
  void attach_geoms();
  void keep_awake(const std::vector<ContactConstraint>& touches);

  const Model& model_;
  dWorldID world_;
  const MovingBase& base_;
  ArmJoints& joints_;
  JointControl& control_;
  BlockBodies& blocks_;
  const BlockAttachment& carrying_;
  Geoms& geoms_;
  ContactJoints& contact_joints_;
  LargeIslands& islands_;

  // ODE's world destroys bodies and joints.
  std::vector<dBodyID> bodies_;        ///< the first is the base
  std::vector<Hinge> hinges_;
  dJointID attachment_joint_ = nullptr;   ///< holds the carried block, if it has a body of its own
  Pose built_base_;                       ///< the base when the bodies were last built
  std::vector<FrameMotion> motions_;      ///< by link, scratch
  std::vector<bool> arm_connected_;       ///< by block, scratch: hangs together with the arm by contacts in this tick
};

}  // namespace proact::dynamics
