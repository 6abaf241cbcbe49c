// What a World is built from. Plain structs: no ODE, no cxx, no ROS.
#pragma once

#include "proact/geometry.hpp"

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

namespace proact::dynamics {

/// Length of one tick, seconds.
constexpr double tick_secs = 1e-3;

enum class ShapeKind : std::uint8_t { box, sphere, cylinder, capsule };

/// A convex shape centred in its own frame, axis along z.
/// size: box, full sides x y z; sphere, radius; cylinder and capsule, radius and length (without round ends).
struct Shape {
  ShapeKind kind = ShapeKind::sphere;
  std::array<double, 3> size{};
};

struct Collision {
  Pose pose;  ///< link_from_shape
  Shape shape;
};

struct Link {
  std::string name;
  double mass = 0.0;                 ///< kg; zero: a frame without mass
  Pose inertial;                     ///< link_from_inertial, origin at the centre of mass
  std::array<double, 6> inertia{};   ///< ixx ixy ixz iyy iyz izz about it, kg m^2
  std::vector<Collision> collisions;
};

using proact::JointKind;

/// Metres of a prismatic joint that equal one radian of a revolute joint in tolerances: about the length of a finger.
constexpr double meters_per_radian = 0.1;

/// Joint k moves link k + 1; a parent stands before its children. Numbers are in rad and N m, of a prismatic joint in m and
/// N.
struct Joint {
  std::string name;
  JointKind kind = JointKind::fixed;
  std::size_t parent = 0;
  Pose origin;  ///< parent_from_child at position zero
  Vec3 axis;    ///< unit, in the child frame
  double lower = 0.0;  ///< rad; both infinite: no stops, and the angle is told within -pi to pi
  double upper = 0.0;
  double velocity = 0.0;  ///< highest speed, rad/s
  double effort = 0.0;    ///< highest effort of the position control, N m
  double damping = 0.0;   ///< N m s/rad
  double friction = 0.0;  ///< N m
  /// N m/rad. Above zero the joint is driven by these two gains alone, without feed-forward and without the effort
  /// limit; zero: by the position control.
  double proportional_gain = 0.0;
  double derivative_gain = 0.0;  ///< N m s/rad

  /// What a tolerance in radians is multiplied by to be one of this joint's position.
  double per_radian() const { return kind == JointKind::prismatic ? meters_per_radian : 1.0; }
  const char* unit() const { return kind == JointKind::prismatic ? "m" : "rad"; }
};

struct FixedObject {
  std::string name;
  Shape shape;
  Pose pose;  ///< world_from_object
  double friction = 0.0;
};

struct Block {
  std::string name;
  Shape shape;  ///< origin is the centre of mass, mass spread evenly
  double mass = 0.0;
  double friction = 0.0;         ///< against fixed objects and other blocks; of a pair the smaller counts
  double friction_finger = 0.0;  ///< against links
  Pose pose;                     ///< world_from_block at the start
};

enum class Solver : std::uint8_t {
  direct,    ///< dWorldStep: exact, depends on nothing but the state
  iterative  ///< dWorldQuickStep: approximate; its generator is process-wide, so worlds take turns
};

/// Who moves the arm and what it touches. Blocks that do not hang together with the arm are ODE's in both.
enum class Engine : std::uint8_t {
  reduced,  ///< ours, in joint angles (engines/reduced): joints cannot come apart, and cost grows little with their number
  ode       ///< a body of ODE for each link, held together by ODE's hinges, as in Gazebo (engines/ode)
};

struct Options {
  Engine engine = Engine::reduced;
  Vec3 gravity{0.0, 0.0, -9.80665};
  Solver solver = Solver::direct;
  int iterations = 50;     ///< of the iterative solver
  unsigned long seed = 1;  ///< of the iterative solver's constraint order
  /// Share of a joint's angle error that the position control takes away in one second.
  double position_gain = 200.0;
  /// The control may ask for this many times the joint's highest speed, to catch up.
  double catch_up_factor = 1.25;
  /// A gear is not turned much faster than its motor can: from this many times the joint's highest speed on it brakes a joint
  /// that contacts turn, in engine reduced, by so many times the motor's limit for each highest speed more.
  double gear_speed_factor = 1.5;
  double gear_brake = 40.0;
  /// Commands of joints that are driven by gains are followed no faster than this, rad/s.
  double gain_command_speed_rad_per_s = 0.5;
  /// Joints of the hand whose command has been constant and reached for lock_ticks become rigid, until the
  /// command changes: a body for each phalanx costs most of a tick.
  bool lock_idle_hand = true;
  int lock_ticks = 50;
  double lock_error_rad = 2e-3;        ///< rad
  double lock_speed_rad_per_s = 2e-2;  ///< rad/s
  /// Fastest motion of the base that is followed; at a faster one it stays where it is.
  double max_base_speed_m_per_s = 5.0;        ///< m/s
  double max_base_turn_rate_rad_per_s = 20.0; ///< rad/s
  /// Penetration at which a contact pushes with full force, and its spring and damper in ODE's terms.
  double contact_erp = 0.2;
  double contact_cfm = 1e-3;
  double surface_layer = 5e-5;                    ///< m, resting contacts keep this overlap
  double max_correcting_speed_m_per_s = 0.5;      ///< m/s, so that overlap is not thrown apart
  double max_arm_correcting_speed_m_per_s = 0.05; ///< the same of the arm in fixed objects, in engine reduced
  double joint_erp = 0.2;
  double joint_cfm = 1e-7;
  /// Of round blocks on fixed objects: decelerating torque over weight and radius. Assumed, as of hard plastic on
  /// wood; with none a block that falls over rolls for ever.
  double rolling_resistance = 0.01;
  /// Resting blocks fall asleep.
  bool sleep = true;
  /// Islands of more blocks than this are solved by sweeps (LargeIslands): at most so many there and back a tick, until no
  /// speed at a contact changes by more than sweep_tolerance_m_per_s or by this share of the blocks' mean speed. Fewer
  /// while the blocks' mean speed is above `motion_speed_m_per_s`: a tick of what moves corrects the one before.
  std::size_t large_island = 4;
  int sweeps = 20;
  int sweeps_in_motion = 6;
  double motion_speed_m_per_s = 0.01;
  double sweep_tolerance_m_per_s = 2e-5;
  double sweep_tolerance_ratio = 1e-3;
  /// A carried block shares the body of the link that holds it; else ODE holds it there by a fixed joint, which only
  /// Engine::ode can do.
  bool merge_attached = true;
};

struct Model {
  std::vector<Link> links;
  std::vector<Joint> joints;
  std::vector<std::size_t> moving;    ///< indices into joints: the order of every joint vector
  std::size_t arm_count = 0;          ///< the first of them are the arm, the rest the hand
  std::vector<double> positions;      ///< at the start, rad, one for each moving joint
  Pose world_from_base;
  std::vector<FixedObject> fixed;
  std::vector<Block> blocks;
  Options options;
};

/// Throws std::invalid_argument naming the first thing that ODE cannot simulate or would abort on.
void validate(const Model& model);

}  // namespace proact::dynamics
