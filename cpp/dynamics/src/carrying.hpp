// The block that the hand carries, if it carries one.
#pragma once

#include "proact/dynamics/world.hpp"

#include <cstddef>
#include <optional>

namespace proact::dynamics {

class Carrying {
 public:
  explicit Carrying(const Options& options)
      : joined_by_ode_(options.engine == Engine::ode && !options.merge_carried) {}

  const std::optional<Attachment>& attached() const { return attached_; }
  bool carries(std::size_t block) const { return attached_ && attached_->block == block; }
  /// Whether the carried block has a body of its own, which ODE joins to that of the link.
  bool apart() const { return attached_ && joined_by_ode_; }
  /// Whether the carried block is part of the body of the link that holds it.
  bool merged() const { return attached_ && !joined_by_ode_; }
  bool merges(std::size_t block) const { return carries(block) && !joined_by_ode_; }

  void take(const Attachment& attachment) { attached_ = attachment; }
  void let_go() { attached_.reset(); }
  void restore(const std::optional<Attachment>& attached) { attached_ = attached; }

 private:
  bool joined_by_ode_;
  std::optional<Attachment> attached_;
};

}  // namespace proact::dynamics
