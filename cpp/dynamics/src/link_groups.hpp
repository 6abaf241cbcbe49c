// Which links share a body, because the joints between them are rigid.
#pragma once

#include "arm_joints.hpp"

#include <cstddef>
#include <vector>

namespace proact::dynamics {

class LinkGroups {
 public:
  explicit LinkGroups(std::size_t links) : body_of_(links, 0), body_from_link_(links) {}

  /// Joins links across rigid joints. Where they are in their bodies is up to the caller.
  void join(const Model& model, const ArmJoints& joints);

  std::size_t link_count() const { return body_of_.size(); }
  std::size_t body_count() const { return root_of_.size(); }
  /// Body of a link; body 0 is the base.
  std::size_t body_of(std::size_t link) const { return body_of_[link]; }
  /// First link of a body.
  std::size_t root_of(std::size_t body) const { return root_of_[body]; }
  const Pose& body_from_link(std::size_t link) const { return body_from_link_[link]; }
  Pose& body_from_link(std::size_t link) { return body_from_link_[link]; }

 private:
  std::vector<std::size_t> body_of_;
  std::vector<std::size_t> root_of_;
  std::vector<Pose> body_from_link_;
};

}  // namespace proact::dynamics
