// Heaps: blocks that hang together by contacts in large numbers, solved by sweeps, and at rest one by one.
#pragma once

#include "block_bodies.hpp"
#include "carrying.hpp"
#include "contact_sweeps.hpp"
#include "geoms.hpp"
#include "touch.hpp"

#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

namespace proact::dynamics {

/// An island is a set of blocks that hang together by contacts, those at rest included. One of more blocks than
/// Options::large_island is this part's: its contacts are put right in turn (ContactSweeps) instead of all at once, whose
/// cost would grow with the cube of the blocks. Smaller ones are left to the arm's solver and to ODE. ODE's direct solver gives
/// up on some cubes that lie almost flat, and lets them fall through the table: once it has, small islands that the arm does
/// not touch are this part's, too (not with the engine ode).
///
/// A block of a large island comes to rest by itself: idle for as long as any other, it stands still as if it were part of
/// the room, and is not solved. It remembers the forces of its neighbours. It wakes when those of them that move press it
/// otherwise by more than a share of its weight, so that a hand wakes what feels it and not the whole heap; or when a link
/// of the arm comes near it.
class LargeIslands {
 public:
  LargeIslands(const Model& model, BlockBodies& blocks, const Carrying& carrying);

  /// Wakes blocks at rest that a link is near to. Expects all shapes placed.
  void wake_near(const Geoms& geoms);
  /// Takes the contacts that are this part's. Where the arm has an own solver, those of large islands with it are left
  /// to others() too, and such blocks are moved by both; else others() gets all contacts of blocks that hang together
  /// with the arm.
  void split(const std::vector<Touch>& touches);
  /// All other contacts.
  const std::vector<Touch>& others() const { return others_; }
  /// Whether a block belongs to a large island.
  bool has(std::size_t block) const { return large_[block] != 0; }

  /// ODE's solver has given up: it gets no small island any more that this part can have.
  void distrust_ode() { distrusts_ode_ = true; }

  /// Begins to solve: momenta of the tick, and the impulses of the last one as a guess.
  void begin();
  ContactSweeps& sweeps() { return sweeps_; }
  /// Place of a block in sweeps().bodies, or no_index.
  std::size_t body_of(std::size_t block) const { return body_of_[block]; }
  /// A change of speed that is small enough, m/s.
  double small_speed() const;
  /// Puts the contacts right as well as the options ask for.
  void settle();
  /// Moves its blocks by a tick and keeps them from ODE's step.
  void move();
  /// Somebody else solved a contact with a block at rest: the impulse on the first.
  void note(const Touch& touch, const Vec3& impulse);
  /// After the tick: who comes to rest, and who wakes.
  void finish();
  /// Wakes a block.
  void wake(std::size_t block);
  /// Whether a block stands still as if it were part of the room.
  bool rests(std::size_t block) const { return resting_[block] != 0; }

  /// What a neighbour did to a block when it came to rest.
  struct Press {
    std::size_t block;
    std::size_t neighbour;
    Vec3 force;   ///< N
    Vec3 torque;  ///< about the block's centre
  };
  /// A contact of the last tick, or of the time when its blocks came to rest.
  struct Remembered {
    std::uint64_t pair;
    Vec3 position;
    Vec3 impulse;  ///< on the first
    bool taken;    ///< as a guess of this tick
  };
  struct State {
    std::vector<bool> large;    ///< by block
    std::vector<bool> resting;  ///< by block
    std::vector<Press> presses;
    std::vector<Remembered> remembered;
    bool distrusts_ode = false;
  };
  State state() const;
  void restore(const State& state);

 private:
  std::size_t root(std::size_t node);
  void join(std::size_t a, std::size_t b);
  void find_islands(const std::vector<Touch>& touches);
  void find_hanging(const std::vector<Touch>& touches);
  void add_body(std::size_t block);
  void remember();
  double weight(std::size_t block) const;
  void let_rest();
  void come_to_rest(std::size_t block);
  std::uint64_t pair_of(const Touch& touch) const;
  Vec3 guess(const Touch& touch);

  const Model& model_;
  BlockBodies& blocks_;
  const Carrying& carrying_;
  ContactSweeps sweeps_;
  std::vector<Touch> touches_;  ///< in the order of sweeps_.points
  std::vector<Touch> others_;
  std::vector<char> large_;     ///< by block
  std::vector<char> resting_;   ///< by block
  std::vector<char> hanging_;   ///< by block: together with the arm
  std::vector<char> touched_;   ///< by the root of an island: the arm's solver or ODE has it, if it is small
  bool distrusts_ode_ = false;
  std::vector<std::size_t> parent_;  ///< of union-find; the last is the arm
  std::vector<std::size_t> size_;
  std::vector<char> kept_;            ///< by block: awake because a link is near
  std::vector<int> stirred_;          ///< by root: 1 where one moves, 2 where one is kept awake
  std::vector<char> left_;            ///< by block at rest: a neighbour has come off
  std::vector<std::size_t> moving_;   ///< blocks of sweeps_.bodies
  std::vector<std::size_t> body_of_;  ///< by block
  std::vector<Press> presses_;        ///< on blocks at rest, when they came to rest
  std::vector<Press> noted_;          ///< on blocks at rest, in this tick, by others
  std::vector<Remembered> remembered_;  ///< by pair
  std::vector<std::pair<std::uint64_t, std::size_t>> order_;  ///< scratch: of the points by their pairs
  std::vector<Remembered> solved_;                            ///< scratch: those of this tick
  std::vector<Remembered> kept_points_;                       ///< scratch: those between blocks at rest
  std::vector<Vec3> force_;           ///< scratch, by block
  std::vector<Vec3> torque_;
};

}  // namespace proact::dynamics
