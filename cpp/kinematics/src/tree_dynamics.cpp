#include "proact/kinematics/tree_dynamics.hpp"

namespace proact::kinematics {

RecursiveNewtonEuler::RecursiveNewtonEuler(const KDL::Tree& tree, const KDL::Vector& gravity)
    : tree_(tree), gravity_(gravity) {
  add(tree.getRootSegment(), 0);
}

void RecursiveNewtonEuler::add(KDL::SegmentMap::const_iterator element, std::size_t parent) {
  const std::size_t own = parts_.size();
  Part part{};
  part.segment = &GetTreeElementSegment(element->second);
  part.parent = parent;
  part.joint = GetTreeElementQNr(element->second);
  part.moves = part.segment->getJoint().getType() != KDL::Joint::None;
  parts_.push_back(part);
  for (const auto& child : GetTreeElementChildren(element->second)) add(child, own);
}

int RecursiveNewtonEuler::CartToJnt(const KDL::JntArray& q, const KDL::JntArray& qd, const KDL::JntArray& qdd,
                                    const WrenchMap& outer, KDL::JntArray& torques) {
  const unsigned int joints = tree_.getNrOfJoints();
  if (q.rows() != joints || qd.rows() != joints || qdd.rows() != joints || torques.rows() != joints) return -1;
  if (!outer.empty()) return -2;

  parts_[0].velocity = KDL::Twist::Zero();
  // A root that speeds up against gravity feels what one at rest in it feels.
  parts_[0].acceleration = KDL::Twist(-gravity_, KDL::Vector::Zero());
  parts_[0].force = KDL::Wrench::Zero();
  for (std::size_t k = 1; k < parts_.size(); ++k) {
    Part& part = parts_[k];
    const Part& parent = parts_[part.parent];
    const double angle = part.moves ? q(part.joint) : 0.0;
    part.parent_from_part = part.segment->pose(angle);
    part.axis = part.parent_from_part.M.Inverse(part.segment->twist(angle, 1.0));
    part.velocity = part.parent_from_part.Inverse(parent.velocity);
    part.acceleration = part.parent_from_part.Inverse(parent.acceleration);
    if (part.moves) {
      const KDL::Twist turning = part.axis * qd(part.joint);
      part.velocity += turning;
      part.acceleration += part.axis * qdd(part.joint) + part.velocity * turning;
    }
    const KDL::RigidBodyInertia& inertia = part.segment->getInertia();
    part.force = inertia * part.acceleration + part.velocity * (inertia * part.velocity);
  }
  for (std::size_t k = parts_.size() - 1; k > 0; --k) {
    const Part& part = parts_[k];
    if (part.moves) torques(part.joint) = dot(part.axis, part.force);
    parts_[part.parent].force += part.parent_from_part * part.force;
  }
  return 0;
}

}  // namespace proact::kinematics
