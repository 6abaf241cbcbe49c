// The block that the hand carries, if it carries one.
#pragma once

#include "proact/dynamics/world.hpp"

#include <cstddef>
#include <optional>

namespace proact::dynamics {

class BlockAttachment {
 public:
  explicit BlockAttachment(const Options& options)
      : uses_ode_joint_(options.engine == Engine::ode && !options.merge_attached) {}

  const std::optional<Attachment>& attached() const { return attached_; }
  bool is_attached(std::size_t block) const { return attached_ && attached_->block == block; }
  /// Whether the carried block has a body of its own, which ODE joins to that of the link.
  bool is_separate() const { return attached_ && uses_ode_joint_; }
  /// Whether the carried block is part of the body of the link that holds it.
  bool is_merged() const { return attached_ && !uses_ode_joint_; }
  bool is_merged_block(std::size_t block) const { return is_attached(block) && !uses_ode_joint_; }

  void attach(const Attachment& attachment) { attached_ = attachment; }
  void detach() { attached_.reset(); }
  void restore(const std::optional<Attachment>& attached) { attached_ = attached; }

 private:
  bool uses_ode_joint_;
  std::optional<Attachment> attached_;
};

}  // namespace proact::dynamics
