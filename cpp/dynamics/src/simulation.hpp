// What stands behind World.
#pragma once

#include "arm_tree.hpp"
#include "contact_points.hpp"
#include "ode_runtime.hpp"
#include "proact/dynamics/world.hpp"
#include "velocity_problem.hpp"

#include <array>
#include <limits>
#include <string>

namespace proact::dynamics {

/// All that ODE keeps of a body from one tick to the next.
struct BodyBits {
  Pose pose;
  Vec3 linear;
  Vec3 angular;
  bool enabled;

  void put(dBodyID body) const;
};

/// How long a block must be slow before it sleeps.
constexpr int sleep_ticks = 250;

class World::Simulation {
 public:
  explicit Simulation(Model model);
  Simulation(const Simulation&) = delete;
  Simulation& operator=(const Simulation&) = delete;

  void step(const double* position, const double* velocity, const Pose& world_from_base);
  void attach(std::size_t block, std::size_t link);
  void release();
  std::vector<double> save() const;
  void restore(const std::vector<double>& numbers);
  Pose link_pose(std::size_t link) const;

  Model model_;
  std::vector<double> positions_;
  std::vector<double> velocities_;
  std::vector<double> efforts_;
  Pose world_from_base_;
  std::vector<BodyState> blocks_;
  std::vector<Contact> contacts_;
  std::optional<Attachment> attached_;
  std::uint64_t complaints_ = 0;
  std::string last_complaint_;
  bool base_held_ = false;
  std::string failure_;  ///< why no further step is possible

  std::size_t arm_body_count() const noexcept { return root_of_.size(); }

 private:
  /// A convex shape known to ODE.
  struct Geom {
    GeomPtr id;
    Shape shape;
    std::size_t owner;  ///< index of the link, fixed object or block
    Pose owner_from_shape;
    Pose world_from_shape;        ///< of this tick
    std::array<dReal, 6> bounds;  ///< of this tick: low and high x, y, z
    double reach;                 ///< radius of the sphere around its centre
    Pose body_from_shape;         ///< of a link's shape on the arm in joint angles
  };
  using LinkMotion = FrameMotion;
  /// What the control asks of a joint in a tick.
  struct Motor {
    double speed;    ///< at the end of the tick, rad/s
    double limit;    ///< of its torque, N m
    double rubbing;  ///< torque lost with each unit of the speed: damping, friction, gains, N m s/rad
    double torque;   ///< of the gains at rest, N m
    double slope;    ///< what of rubbing belongs to the gains
  };
  struct Hinge {
    dJointID joint;
    std::size_t moving;  ///< index of the joint vector
    double inertia;      ///< that its two bodies put up about the axis, kg m^2; the rest of the arm only adds to it
    dJointFeedback feedback;
  };
  struct Sphere {
    Vec3 centre;
    double radius;
  };
  struct Measured {
    std::size_t contact;  ///< index of contacts_
    dJointFeedback feedback;
  };
  /// One of the two that touch: a block, a body of the arm in joint angles, or neither for what stands still.
  struct Side {
    dBodyID body = nullptr;  ///< ODE's, if it has one
    std::size_t block = npos;
    std::size_t arm = npos;
  };
  /// How a contact pushes.
  struct Touch {
    Side first;
    Side second;
    double friction;
  };
  /// A contact of this tick that waits until it is known who hangs together with the arm.
  struct Waiting {
    Touch touch;
    ContactPoint point;
    std::size_t measured;  ///< index of contacts_, or npos
  };

  static constexpr std::size_t npos = std::numeric_limits<std::size_t>::max();

  // arm_bodies.cpp: the arm as rigid bodies and hinges.
  void build_arm();
  void group_links();
  void place_links(const std::vector<double>& positions, std::vector<LinkMotion>& out) const;
  void set_masses();
  bool carried_apart() const { return attached_ && !reduced() && !model_.options.merge_carried; }
  void hold_carried_block();
  void make_hinges();
  void place_geoms();
  bool movable(std::size_t joint) const;
  bool rigid(std::size_t joint) const;
  bool choose_rigid_joints(const double* position, const double* velocity);

  // reduced_arm.cpp: the arm in joint angles.
  bool reduced() const { return model_.options.arm == ArmEquations::reduced; }
  void build_tree();
  void hang_link_geoms();
  void update_link_geoms();
  bool near_anything(const Sphere& sphere) const;
  void advance_tree(const double* position, const double* velocity, const BaseMotion& base);
  bool drive_freely(const BaseMotion& base);
  void solve_with_contacts(const BaseMotion& base);
  void engage_blocks();
  void add_contact(const Waiting& waiting, const BaseMotion& base);
  void add_side(const Side& side, double sign, const std::array<Vec3, 3>& directions, const Vec3& point);
  void move_engaged_blocks();
  FrameMotion body_motion(std::size_t body) const;

  // simulation.cpp: one tick.
  void check_command(const double* position, const double* velocity, const Pose& world_from_base);
  bool jumps(const Pose& target) const;
  int stop_of(std::size_t moving) const;
  double gains_torque(std::size_t moving, double speed) const;
  Motor motor_of(std::size_t moving, double position, double velocity);
  Motor motor_by_gains(std::size_t moving, double position);
  void drive(const double* position, const double* velocity);
  void put_to_sleep();
  void advance();
  void read_state();

  // collisions.cpp: who touches whom.
  void make_geoms();
  void update(std::vector<Geom>& geoms);
  void update_moving_geoms();
  Side side_of_block(std::size_t block) const;
  Side side_of_link(std::size_t link) const;
  void collide();
  void collide_links_with_fixed();
  void collide_blocks_with_fixed();
  void resist_rolling(const Geom& block);
  void collide_blocks();
  void collide_blocks_with_links();
  void touch_at(const Touch& touch, const ContactPoint& point, std::size_t measured);
  void push(const Touch& touch, const ContactPoint& point, dJointFeedback* feedback);
  void refuse_overlaps();
  bool resting(std::size_t block) const;

  // Destroyed last to first: shapes and joints before the world, the world before its threading.
  ThreadingPtr threading_;
  WorldPtr world_;
  JointGroupPtr contact_group_;

  std::vector<std::size_t> moving_of_joint_;  ///< index of the joint vector of joint k, or npos
  std::vector<bool> held_;                    ///< by moving joint: rigid at present
  std::vector<double> last_command_;
  std::vector<double> gains_command_;         ///< by moving joint: what joints driven by gains are asked for, rad
  std::vector<int> still_ticks_;
  std::vector<int> stop_;                     ///< by moving joint: 1 on its upper stop, -1 on its lower, else 0
  Pose built_base_;                           ///< the base when the bodies were last built
  Vec3 base_linear_;
  Vec3 base_angular_;

  std::vector<dBodyID> bodies_;          ///< of the arm; the first is the base
  std::vector<std::size_t> body_of_;     ///< by link
  std::vector<std::size_t> root_of_;     ///< by body: its first link
  std::vector<Pose> body_from_link_;     ///< by link
  std::vector<Hinge> hinges_;
  dJointID carrying_ = nullptr;          ///< holds the carried block, if it has a body of its own
  std::vector<LinkMotion> motions_;      ///< by link, scratch
  std::vector<dBodyID> block_bodies_;
  std::vector<int> until_sleep_;         ///< by block: further idle ticks before it sleeps
  std::vector<bool> parted_;             ///< [block][link]: contacts act

  std::vector<Geom> link_geoms_;
  std::vector<Geom> fixed_geoms_;
  std::vector<Geom> block_geoms_;
  std::vector<Measured> measured_;

  // The arm in joint angles.
  ArmTree tree_;
  VelocityProblem problem_;
  std::vector<int> motor_states_;        ///< by moving joint: 0, or +-1 where the control gave its limit
  std::vector<Motor> motors_;            ///< by hinge of tree_, of this tick
  std::vector<double> halfway_;          ///< joint angles in the middle of the tick
  std::vector<std::vector<std::size_t>> chains_;  ///< by body of tree_: its hinges from the base on
  std::vector<Sphere> spheres_;          ///< by body of tree_: around all its shapes, its own frame
  std::vector<Waiting> waiting_;
  std::vector<std::size_t> engaged_;     ///< blocks that hang together with the arm in this tick
  std::vector<std::size_t> slot_;        ///< by block: its place in engaged_, or npos
  std::vector<double> speeds_;           ///< scratch, by hinge
  std::vector<double> accelerations_;
  std::vector<double> torques_;
  std::vector<double> momenta_;
  ContactPoints found_;
};

}  // namespace proact::dynamics
