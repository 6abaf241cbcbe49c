// What stands behind World: its parts, and who of them acts when.
#pragma once

#include "arm.hpp"
#include "arm_joints.hpp"
#include "block_attachment.hpp"
#include "block_bodies.hpp"
#include "collisions.hpp"
#include "contact_joints.hpp"
#include "geoms.hpp"
#include "joint_control.hpp"
#include "large_islands.hpp"
#include "moving_base.hpp"
#include "ode_world.hpp"
#include "proact/dynamics/world.hpp"

#include <cstddef>
#include <memory>
#include <string>
#include <vector>

namespace proact::dynamics {

class World::Simulation {
 public:
  explicit Simulation(Model model);
  Simulation(const Simulation&) = delete;
  Simulation& operator=(const Simulation&) = delete;

  void step(const double* position, const double* velocity, const Pose& world_from_base);
  void attach(std::size_t block, std::size_t link);
  void release();
  void place(std::size_t block, const BodyState& state);
  std::vector<double> save() const;
  void restore(const std::vector<double>& numbers);
  Pose link_pose(std::size_t link) const;

  /// Whether no further step is possible.
  bool failed() const { return !failure_.empty(); }
  const Model& model() const { return model_; }
  const OdeWorld& ode_world() const { return ode_world_; }
  const MovingBase& base() const { return base_; }
  const ArmJoints& joints() const { return joints_; }
  const BlockAttachment& attachment() const { return attachment_; }
  const BlockBodies& blocks() const { return blocks_; }
  const Collisions& collisions() const { return collisions_; }
  const Arm& arm() const { return *arm_; }

 private:
  void check_command(const double* position, const double* velocity, const Pose& world_from_base) const;
  void refuse_failed() const;
  void check_block(std::size_t block) const;
  void advance(const double* position, const double* velocity, const Pose& world_from_base);
  void step_ode();
  void read_blocks();

  const Model model_;
  // ODE's solver depends on the order in which things are made, and shapes and joints must go before the world: made
  // first to last, destroyed last to first. The parts keep references to those before them.
  OdeWorld ode_world_;
  ContactJoints contact_joints_;
  MovingBase base_;
  ArmJoints joints_;
  JointControl control_;
  BlockAttachment attachment_;
  BlockBodies blocks_;
  Geoms geoms_;
  Collisions collisions_;
  LargeIslands islands_;
  std::unique_ptr<Arm> arm_;
  std::string failure_;  ///< why no further step is possible
};

}  // namespace proact::dynamics
