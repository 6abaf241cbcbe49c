// The blocks as bodies of ODE, and which of them sleep.
#pragma once

#include "block_attachment.hpp"
#include "ode_body_state.hpp"
#include "proact/dynamics/world.hpp"

#include <cstddef>
#include <vector>

namespace proact::dynamics {

class BlockBodies {
 public:
  BlockBodies(const Model& model, dWorldID world);

  std::size_t count() const { return bodies_.size(); }
  dBodyID body(std::size_t block) const { return bodies_[block]; }
  /// At the end of the last tick.
  const std::vector<BodyState>& states() const { return states_; }
  bool is_asleep(std::size_t block) const { return dBodyIsEnabled(bodies_[block]) == 0; }
  bool all_asleep() const;

  /// Puts blocks to sleep that have rested long enough. What touches a sleeping block wakes it.
  void put_to_sleep(const BlockAttachment& carrying);
  void keep_awake(std::size_t block);
  /// Counts a further tick of a block; true if it has rested long enough to sleep.
  bool count_idle_tick(std::size_t block);
  void wake(std::size_t block);
  /// Brakes a round block that lies on something.
  void apply_rolling_resistance(std::size_t block) const;

  /// Takes a block's state from its body.
  void read(std::size_t block);
  /// Tells the state of a block that shares the body of a link.
  void set_state(std::size_t block, const BodyState& state) { states_[block] = state; }
  /// Puts a block's body where the block is, awake.
  void reset_body(std::size_t block);
  /// Throws std::runtime_error naming the first block that is nowhere.
  void check_finite() const;

  const std::vector<int>& ticks_until_sleep() const { return ticks_until_sleep_; }
  std::vector<OdeBodyState> ode_states() const;
  /// Restores all but the bodies, which the arm may still have to be built around: see restore_bodies().
  void restore(const std::vector<BodyState>& states, const std::vector<int>& until_sleep);
  void restore_bodies(const std::vector<OdeBodyState>& bits) const;

 private:
  const Model& model_;
  std::vector<dBodyID> bodies_;    ///< ODE's world destroys them
  std::vector<BodyState> states_;
  std::vector<int> ticks_until_sleep_;   ///< further idle ticks before it sleeps
};

}  // namespace proact::dynamics
