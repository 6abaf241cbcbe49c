// Heaps: blocks that hang together by contacts in large numbers, solved by sweeps, and at rest one by one.
#pragma once

#include "block_attachment.hpp"
#include "block_bodies.hpp"
#include "contact_constraint.hpp"
#include "geoms.hpp"
#include "pgs_contact_solver.hpp"

#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

namespace proact::dynamics {

/// An island is a set of blocks that hang together by contacts, those at rest included. One of more blocks than
/// Options::large_island is this part's: its contacts are put right in turn (PgsContactSolver) instead of all at once,
/// whose cost would grow with the cube of the blocks. Smaller ones are left to the arm's solver and to ODE. ODE's direct solver gives
/// up on some cubes that lie almost flat, and lets them fall through the table: once it has, small islands that the arm does
/// not touch are this part's, too (not with the engine ode).
///
/// A block of a large island comes to rest by itself: idle for as long as any other, it stands still as if it were part of
/// the room, and is not solved. It remembers the forces of its neighbours. It wakes when those of them that move press it
/// otherwise by more than a share of its weight, so that a hand wakes what feels it and not the whole heap; or when a link
/// of the arm comes near it.
class LargeIslands {
 public:
  LargeIslands(const Model& model, BlockBodies& blocks, const BlockAttachment& carrying);

  /// Wakes blocks at rest that a link is near to. Expects all shapes placed.
  void wake_near(const Geoms& geoms);
  /// Takes the contacts that are this part's. Where the arm has an own solver, those of large islands with it are left
  /// to remaining_constraints() too, and such blocks are moved by both; else remaining_constraints() gets all contacts of
  /// blocks that hang together with the arm.
  void assign_contacts(const std::vector<ContactConstraint>& touches);
  /// All other contacts.
  const std::vector<ContactConstraint>& remaining_constraints() const { return remaining_constraints_; }
  /// Whether a block belongs to a large island.
  bool has(std::size_t block) const { return large_[block] != 0; }

  /// ODE's solver has given up: it gets no small island any more that this part can have.
  void stop_using_ode() { ode_unreliable_ = true; }

  /// Begins to solve: momenta of the tick, and the impulses of the last one as a guess.
  void begin_solve();
  PgsContactSolver& solver() { return solver_; }
  /// Place of a block in solver().bodies, or no_index.
  std::size_t body_of(std::size_t block) const { return body_of_[block]; }
  /// A change of speed that is small enough, m/s.
  double small_speed() const;
  /// Puts the contacts right as well as the options ask for.
  void solve();
  /// Moves its blocks by a tick and keeps them from ODE's step.
  void integrate();
  /// Somebody else solved a contact with a block at rest: the impulse on the first.
  void record_impulse(const ContactConstraint& touch, const Vec3& impulse);
  /// After the tick: who comes to rest, and who wakes.
  void end_step();
  /// Wakes a block.
  void wake(std::size_t block);
  /// Whether a block stands still as if it were part of the room.
  bool is_resting(std::size_t block) const { return resting_[block] != 0; }

  /// What a neighbour did to a block when it came to rest.
  struct RestingForce {
    std::size_t block;
    std::size_t neighbor;
    Vec3 force;   ///< N
    Vec3 torque;  ///< about the block's centre
  };
  /// A contact of the last tick, or of the time when its blocks came to rest.
  struct CachedContact {
    std::uint64_t pair;
    Vec3 position;
    Vec3 impulse;  ///< on the first
    bool used;     ///< as a guess of this tick
  };
  struct State {
    std::vector<bool> large;    ///< by block
    std::vector<bool> resting;  ///< by block
    std::vector<RestingForce> resting_forces;
    std::vector<CachedContact> cached_contacts;
    bool ode_unreliable = false;
  };
  State state() const;
  void restore(const State& state);

 private:
  std::size_t root(std::size_t node);
  void join(std::size_t a, std::size_t b);
  void find_islands(const std::vector<ContactConstraint>& touches);
  void find_arm_connected(const std::vector<ContactConstraint>& touches);
  void add_body(std::size_t block);
  void cache_impulses();
  double weight(std::size_t block) const;
  void update_resting();
  void put_to_rest(std::size_t block);
  std::uint64_t pair_of(const ContactConstraint& touch) const;
  Vec3 warm_start_impulse(const ContactConstraint& touch);

  const Model& model_;
  BlockBodies& blocks_;
  const BlockAttachment& carrying_;
  PgsContactSolver solver_;
  std::vector<ContactConstraint> constraints_;  ///< in the order of solver_.points
  std::vector<ContactConstraint> remaining_constraints_;
  std::vector<char> large_;              ///< by block
  std::vector<char> resting_;            ///< by block
  std::vector<char> arm_connected_;      ///< by block: together with the arm
  std::vector<char> has_other_solver_;   ///< by the root of an island: the arm's solver or ODE has it, if it is small
  bool ode_unreliable_ = false;
  std::vector<std::size_t> parent_;  ///< of union-find; the last is the arm
  std::vector<std::size_t> size_;
  std::vector<char> kept_awake_;               ///< by block: awake because a link is near
  std::vector<int> island_activity_;           ///< by root: 1 where one moves, 2 where one is kept awake
  std::vector<char> lost_neighbor_;            ///< by block at rest: a neighbour has come off
  std::vector<std::size_t> moving_;            ///< blocks of solver_.bodies
  std::vector<std::size_t> body_of_;           ///< by block
  std::vector<RestingForce> resting_forces_;   ///< on blocks at rest, when they came to rest
  std::vector<RestingForce> recorded_forces_;  ///< on blocks at rest, in this tick, by others
  std::vector<CachedContact> cached_contacts_;  ///< by pair
  std::vector<std::pair<std::uint64_t, std::size_t>> order_;  ///< scratch: of the points by their pairs
  std::vector<CachedContact> solved_;                         ///< scratch: those of this tick
  std::vector<CachedContact> resting_contacts_;               ///< scratch: those between blocks at rest
  std::vector<Vec3> force_;           ///< scratch, by block
  std::vector<Vec3> torque_;
};

}  // namespace proact::dynamics
