// What stands behind World.
#pragma once

#include "contact_points.hpp"
#include "ode_runtime.hpp"
#include "proact/dynamics/world.hpp"

#include <array>
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
  bool base_held_ = false;
  std::string failure_;  ///< why no further step is possible

  std::size_t arm_body_count() const noexcept { return bodies_.size(); }

 private:
  /// A convex shape known to ODE.
  struct Geom {
    GeomPtr id;
    Shape shape;
    std::size_t owner;  ///< index of the link, fixed object or block
    Pose owner_from_shape;
    Pose world_from_shape;        ///< of this tick
    std::array<dReal, 6> bounds;  ///< of this tick: low and high x, y, z
  };
  /// Pose and twist of a link, world axes; linear is that of the link's origin.
  struct LinkMotion {
    Pose pose;
    Vec3 linear;
    Vec3 angular;
  };
  struct Hinge {
    dJointID joint;
    std::size_t moving;  ///< index of the joint vector
    double inertia;      ///< that its two bodies put up about the axis, kg m^2; the rest of the arm only adds to it
    dJointFeedback feedback;
  };
  struct Measured {
    std::size_t contact;  ///< index of contacts_
    dJointFeedback feedback;
  };
  /// How a contact pushes.
  struct Touch {
    dBodyID first;
    dBodyID second;
    double friction;
  };

  // arm_bodies.cpp: the arm as rigid bodies and hinges.
  void build_arm();
  void group_links();
  void place_links(const std::vector<double>& positions, std::vector<LinkMotion>& out) const;
  void set_masses();
  void make_hinges();
  void place_geoms();
  bool movable(std::size_t joint) const;
  bool rigid(std::size_t joint) const;
  bool choose_rigid_joints(const double* position, const double* velocity);

  // simulation.cpp: one tick.
  void check_command(const double* position, const double* velocity, const Pose& world_from_base);
  bool jumps(const Pose& target) const;
  int stop_of(std::size_t moving) const;
  void drive(const double* position, const double* velocity);
  void put_to_sleep();
  void advance();
  void read_state();

  // collisions.cpp: who touches whom.
  void make_geoms();
  void update(std::vector<Geom>& geoms);
  void collide();
  void collide_links_with_fixed();
  void collide_blocks_with_fixed();
  void resist_rolling(const Geom& block);
  void collide_blocks();
  void collide_blocks_with_links();
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
  std::vector<LinkMotion> motions_;      ///< by link, scratch
  std::vector<dBodyID> block_bodies_;
  std::vector<int> until_sleep_;         ///< by block: further idle ticks before it sleeps
  std::vector<bool> parted_;             ///< [block][link]: contacts act

  std::vector<Geom> link_geoms_;
  std::vector<Geom> fixed_geoms_;
  std::vector<Geom> block_geoms_;
  std::vector<Measured> measured_;
  ContactPoints found_;
};

}  // namespace proact::dynamics
