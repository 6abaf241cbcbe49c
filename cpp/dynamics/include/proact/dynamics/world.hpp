// Arm, box and blocks in ODE. Plain C++17: no cxx, no ROS.
#pragma once

#include "proact/dynamics/model.hpp"

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace proact::dynamics {

/// Pose (of the centre of mass) and twist of a block, world axes.
struct BodyState {
  Pose pose;
  Vec3 linear;   ///< m/s
  Vec3 angular;  ///< rad/s
};

/// A block touched by a link during the last tick.
struct Contact {
  std::size_t block;
  std::size_t link;
  Vec3 point;
  Vec3 normal;   ///< from the link into the block
  double force;  ///< along the normal, N
};

struct Attachment {
  std::size_t block;
  std::size_t link;
  Pose link_from_block;
};

/// Steps in ticks of 1 ms. Deterministic: the same calls give the same bits, whatever other worlds do.
///
/// A world stays in the thread that made it. The arm's links are joined into as few bodies as their joints
/// allow: links across a fixed joint, an immovable one or a hand joint at rest share a body, and so does a
/// carried block with the link that holds it. Links do not collide with each other.
class World {
 public:
  /// Throws std::invalid_argument for a model that validate() refuses or in which things overlap.
  explicit World(Model model);
  ~World();
  World(const World&) = delete;
  World& operator=(const World&) = delete;

  std::size_t joint_count() const noexcept;
  std::size_t block_count() const noexcept;

  /// Advances by one tick: joints towards `position` with speed `velocity` (joint_count() each, rad, rad/s),
  /// base to `world_from_base`. A base that would have to jump stays where it is until it is told a place within
  /// reach: see base_held(). Throws std::invalid_argument for bad numbers, before anything moves;
  /// std::runtime_error if ODE fails, after which the world refuses every further step.
  void step(const double* position, const double* velocity, const Pose& world_from_base);

  const std::vector<double>& positions() const noexcept;   ///< rad
  const std::vector<double>& velocities() const noexcept;  ///< rad/s
  /// Torque of the position control, N m. A joint at its stop shows the stop's torque, one held rigid zero.
  const std::vector<double>& efforts() const noexcept;
  /// What stops and braking gears bear beside the motors, N m.
  const std::vector<double>& limit_effort() const noexcept;
  const Pose& world_from_base() const noexcept;
  /// Whether the base stood still in the last tick because it was told to jump.
  bool base_held() const noexcept;
  const std::vector<BodyState>& blocks() const noexcept;
  /// At most contact_capacity; further ones act but are not listed.
  const std::vector<Contact>& contacts() const noexcept;
  const std::optional<Attachment>& attached() const noexcept;

  /// Joins a block rigidly to a link, where it is. It then touches no link. Throws std::invalid_argument if
  /// there is no such block or link, or a block is attached already.
  void attach(std::size_t block, std::size_t link);
  /// Lets the attached block go with the speed that it has. It touches each link again only once they have
  /// come apart, so that fingers that overlap it do not throw it.
  void release();
  /// Puts a block somewhere, with a speed, and wakes all blocks, of heaps those that feel it: what lay on it falls. Throws std::invalid_argument, and
  /// changes nothing, if there is no such block, it is attached, a number is not finite, or it would stand more than 1 mm
  /// inside something.
  void place(std::size_t block, const BodyState& state);

  /// All that the next steps depend on. Throws std::runtime_error after a failed step.
  std::vector<double> save() const;
  /// Goes back to a saved state, of this world or of another made from the same model; every later step then gives
  /// the same bits as there. Throws std::invalid_argument, and changes nothing, if the numbers do not fit.
  void restore(const std::vector<double>& numbers);

  /// world_from_link of a link, as the bodies stand.
  Pose link_pose(std::size_t link) const;
  /// Bodies that the arm consists of at present, the base included.
  std::size_t arm_body_count() const noexcept;
  /// Complaints of ODE's solver since the start, such as a contact problem solved inexactly.
  std::uint64_t solver_warnings() const noexcept;
  /// ODE's words in the latest of them; empty if there was none, or if it was our own solver's.
  const std::string& last_solver_warning() const noexcept;

  static constexpr std::size_t contact_capacity = 64;

 private:
  class Simulation;
  std::unique_ptr<Simulation> simulation_;
};

}  // namespace proact::dynamics
