#include "link_groups.hpp"

namespace proact::dynamics {

void LinkGroups::join(const Model& model, const ArmJoints& joints) {
  root_of_.assign(1, 0);
  body_of_[0] = 0;
  for (std::size_t k = 0; k < model.joints.size(); ++k) {
    if (joints.rigid(k)) {
      body_of_[k + 1] = body_of_[model.joints[k].parent];
    } else {
      body_of_[k + 1] = root_of_.size();
      root_of_.push_back(k + 1);
    }
  }
}

}  // namespace proact::dynamics
