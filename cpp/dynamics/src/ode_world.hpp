// ODE's world: its settings, its solver, and what that complains of.
#pragma once

#include "ode_runtime.hpp"
#include "proact/dynamics/model.hpp"

#include <cstdint>
#include <string>

namespace proact::dynamics {

class OdeWorld {
 public:
  struct State {
    unsigned long seed;  ///< of the iterative solver
    std::uint64_t warnings;
  };

  /// Throws std::runtime_error if ODE can make no world.
  explicit OdeWorld(const Options& options);

  dWorldID id() const { return world_.get(); }
  /// Moves all bodies that are awake by a tick. Throws std::runtime_error if memory runs out.
  void step();

  /// Counts a complaint of another solver that works on the same tick.
  void add_warning() { ++state_.warnings; }
  /// ODE's words in the latest of its own complaints.
  const std::string& last_warning() const { return last_warning_; }

  const State& state() const { return state_; }
  void restore(const State& state) { state_ = state; }

 private:
  // Destroyed last to first: the world before its threading.
  ThreadingPtr threading_;
  WorldPtr world_;
  Solver solver_;
  State state_;
  std::string last_warning_;
};

}  // namespace proact::dynamics
