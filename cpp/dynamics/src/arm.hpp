// The arm in a simulation, whichever engine moves it: engines/reduced or engines/ode.
#pragma once

#include "arm_joints.hpp"
#include "block_attachment.hpp"
#include "block_bodies.hpp"
#include "collisions.hpp"
#include "contact_constraint.hpp"
#include "contact_joints.hpp"
#include "frame_motion.hpp"
#include "geoms.hpp"
#include "joint_control.hpp"
#include "large_islands.hpp"
#include "link_groups.hpp"
#include "moving_base.hpp"
#include "ode_body_state.hpp"

#include <cstddef>
#include <memory>
#include <vector>

namespace proact::dynamics {

/// What an arm works on. All of it outlives the arm.
struct ArmContext {
  const Model& model;
  dWorldID world;
  const MovingBase& base;
  ArmJoints& joints;
  JointControl& control;
  BlockBodies& blocks;
  const BlockAttachment& carrying;
  Geoms& geoms;
  ContactJoints& contact_joints;
  LargeIslands& islands;
};

/// A tick is drive(), place_geoms(), the search for contacts, resolve_contacts(), a step of ODE and finish(). Angles
/// and speeds are the state, all else is built from them.
class Arm {
 public:
  /// What a snapshot needs besides the joints' state.
  struct State {
    Pose built_base;                   ///< the base when the bodies were last built; identity if that has no effect
    std::vector<int> motor_states;     ///< by moving joint: 0, or +-1 where the control gave its limit
    std::vector<OdeBodyState> bodies;  ///< of ODE
  };

  virtual ~Arm() = default;
  Arm(const Arm&) = delete;
  Arm& operator=(const Arm&) = delete;

  const LinkGroups& links() const { return links_; }

  /// Called at the start and whenever a hand joint becomes rigid or free, or a block is taken or let go.
  virtual void build() = 0;
  /// Takes the commands of a tick, [n_moving] each, rad and rad/s.
  virtual void drive(const double* position, const double* velocity) = 0;
  /// Brings the shapes of links and blocks to where they are for the search for contacts.
  virtual void place_geoms() = 0;
  /// Lets what touches push, large islands included. False if the speeds could be found inexactly only.
  virtual bool resolve_contacts(Collisions& collisions) = 0;
  /// After ODE's step and the arrival of the base: brings the joints' state up to date.
  virtual void finish() = 0;

  virtual ContactSide contact_side(std::size_t link) const = 0;
  /// Place and twist of one body of links().
  virtual FrameMotion motion(std::size_t body) const = 0;
  /// Whether it has bodies that ODE moves.
  virtual bool moved_by_ode() const = 0;
  /// Whether all places and speeds of such bodies are numbers.
  virtual bool all_finite() const = 0;

  virtual State state() const = 0;
  /// Builds the arm as it was. Expects all other parts restored but the bodies of blocks.
  virtual void restore(const State& state) = 0;

 protected:
  explicit Arm(std::size_t links) : links_(links) {}

  LinkGroups links_;
};

/// The arm in the engine that the model's options ask for.
std::unique_ptr<Arm> make_arm(const ArmContext& surroundings);

}  // namespace proact::dynamics
