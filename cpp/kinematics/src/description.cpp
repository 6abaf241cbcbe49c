#include "proact/kinematics/description.hpp"

#include <cmath>
#include <set>
#include <stdexcept>

namespace proact::kinematics {

namespace {

// Below this length an axis is taken to be a mistake rather than a direction.
constexpr double kMinAxisNorm = 1e-9;

void require(bool holds, const std::string& otherwise) {
  if (!holds) throw std::invalid_argument(otherwise);
}

std::string quoted(const std::string& name) { return '"' + name + '"'; }

void check_joint(const LinkDescription& link) {
  const double length = std::hypot(link.axis[0], link.axis[1], link.axis[2]);
  require(length >= kMinAxisNorm, "joint " + quoted(link.joint) + ": the axis has no direction");
  // Written so that NaN fails.
  require(link.lower <= link.upper, "joint " + quoted(link.joint) + ": lower limit " + std::to_string(link.lower) +
                                        " is above upper limit " + std::to_string(link.upper));
}

}  // namespace

KDL::Frame to_kdl(const Pose& pose) {
  const auto& [p, q] = pose;
  return KDL::Frame(KDL::Rotation::Quaternion(q.x, q.y, q.z, q.w), KDL::Vector(p.x, p.y, p.z));
}

Pose from_kdl(const KDL::Frame& frame) {
  Pose pose{{frame.p.x(), frame.p.y(), frame.p.z()}, {}};
  frame.M.GetQuaternion(pose.rotation.x, pose.rotation.y, pose.rotation.z, pose.rotation.w);
  return pose;
}

KDL::RigidBodyInertia to_kdl(const Inertial& inertial) {
  const KDL::Frame link_from_inertial = to_kdl(inertial.pose);
  const auto& [ixx, ixy, ixz, iyy, iyz, izz] = inertial.inertia;
  // KDL turns whole bodies only; one without mass at the origin leaves the pure rotation of the tensor.
  const KDL::RigidBodyInertia turned =
      link_from_inertial.M *
      KDL::RigidBodyInertia(0.0, KDL::Vector::Zero(), KDL::RotationalInertia(ixx, iyy, izz, ixy, ixz, iyz));
  return KDL::RigidBodyInertia(inertial.mass, link_from_inertial.p, turned.getRotationalInertia());
}

KDL::Segment make_segment(const LinkDescription& link) {
  const KDL::Frame parent_from_link = to_kdl(link.origin);
  KDL::Joint joint(link.joint, KDL::Joint::None);
  if (link.kind != JointKind::fixed) {
    // KDL moves a joint in the parent frame, so origin and axis are expressed there.
    const KDL::Vector axis(link.axis[0], link.axis[1], link.axis[2]);
    const auto type = link.kind == JointKind::prismatic ? KDL::Joint::TransAxis : KDL::Joint::RotAxis;
    joint = KDL::Joint(link.joint, parent_from_link.p, parent_from_link.M * axis, type);
  }
  const bool massive = link.inertial.mass > 0.0;
  return KDL::Segment(link.name, joint, parent_from_link,
                      massive ? to_kdl(link.inertial) : KDL::RigidBodyInertia::Zero());
}

void check(const ArmDescription& description) {
  const auto& links = description.links;
  require(!links.empty(), "the arm has no links");
  std::set<std::string> names;
  bool any_moves = false;
  for (std::size_t k = 0; k < links.size(); ++k) {
    require(names.insert(links[k].name).second, "two links are called " + quoted(links[k].name));
    require(links[k].inertial.mass >= 0.0, "link " + quoted(links[k].name) + ": mass " +
                                               std::to_string(links[k].inertial.mass) + " kg is negative");
    if (k == 0) continue;
    require(links[k].parent < k, "link " + quoted(links[k].name) + " stands before its parent");
    if (links[k].kind != JointKind::fixed) {
      check_joint(links[k]);
      any_moves = true;
    }
  }

  std::set<std::size_t> moving;
  for (const std::size_t link : description.moving) {
    require(link > 0 && link < links.size() && links[link].kind != JointKind::fixed,
            "moving joint list: entry " + std::to_string(link) + " is no moving joint");
    require(moving.insert(link).second, "joint " + quoted(links[link].joint) + " is listed twice as moving");
  }
  for (std::size_t k = 1; k < links.size(); ++k) {
    require(links[k].kind == JointKind::fixed || moving.count(k) == 1,
            "joint " + quoted(links[k].joint) + " moves but belongs to no group");
  }
  require(any_moves, "the arm has no moving joint");

  require(description.base < links.size() && description.tip < links.size(), "base or tip is no link");
  std::size_t link = description.tip;
  while (link != description.base && link != 0) link = links[link].parent;
  require(link == description.base && description.tip != description.base,
          "the tip " + quoted(links[description.tip].name) + " is not below the base " +
              quoted(links[description.base].name));
}

}  // namespace proact::kinematics
