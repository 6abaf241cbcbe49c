// The arm as rigid bodies of ODE, held together by ODE's hinges.
#pragma once

#include "arm.hpp"

#include <cstddef>
#include <vector>

namespace proact::dynamics {

class ArmBodies final : public Arm {
 public:
  explicit ArmBodies(const ArmSurroundings& surroundings);

  void build() override { build_at(base_.pose()); }
  void drive(const double* position, const double* velocity) override;
  void place_geoms() override;
  bool push(Collisions& collisions) override;
  void finish() override;
  Side side_of_link(std::size_t link) const override { return {bodies_[links_.body_of(link)], no_index, no_index}; }
  FrameMotion motion(std::size_t body) const override;
  bool moved_by_ode() const override { return true; }
  bool all_finite() const override;
  State state() const override;
  void restore(const State& state) override;

 private:
  struct Hinge {
    dJointID joint;
    std::size_t moving;  ///< index of the joint vector
    double inertia;      ///< that its two bodies put up about the axis, kg m^2; the rest of the arm only adds to it
    dJointFeedback feedback;
  };

  void build_at(const Pose& world_from_base);
  void place_links(const std::vector<double>& positions);
  void place_bodies();
  void set_masses();
  void add_carried_mass(std::size_t body, dMass& total) const;
  void make_hinges();
  void hold_carried_block();
  void hang_geoms();

  const Model& model_;
  dWorldID world_;
  const MovingBase& base_;
  ArmJoints& joints_;
  JointControl& control_;
  const BlockBodies& blocks_;
  const Carrying& carrying_;
  Geoms& geoms_;
  ContactJoints& contact_joints_;

  // ODE's world destroys bodies and joints.
  std::vector<dBodyID> bodies_;        ///< the first is the base
  std::vector<Hinge> hinges_;
  dJointID holding_ = nullptr;         ///< holds the carried block, if it has a body of its own
  Pose built_base_;                    ///< the base when the bodies were last built
  std::vector<FrameMotion> motions_;   ///< by link, scratch
};

}  // namespace proact::dynamics
