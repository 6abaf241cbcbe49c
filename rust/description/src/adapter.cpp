#include "adapter.hpp"

#include "proact-description/src/bridge.rs.h"

#include <string>
#include <vector>

namespace proact::description {

namespace {

// urdfdom hands on the bytes of the file; what is not UTF-8 must not abort the conversion.
rust::String string(const std::string& text) { return rust::String::lossy(text); }

RawPose pose(const Pose& from) {
  const auto& [p, q] = from;
  return RawPose{{p.x, p.y, p.z}, {q.x, q.y, q.z, q.w}};
}

RawShape shape(const Shape& from) {
  RawShape out;
  out.kind = from.kind;
  out.size = from.size;
  out.file = string(from.file);
  return out;
}

}  // namespace

rust::Vec<double> link_poses(rust::Str text, const rust::Vec<rust::String>& joints, rust::Slice<const double> angles,
                             const rust::Vec<rust::String>& links) {
  const std::vector<std::string> joint_names(joints.begin(), joints.end());
  const std::vector<std::string> link_names(links.begin(), links.end());
  rust::Vec<double> out;
  for (const auto& [p, q] : link_poses(std::string(text), joint_names, {angles.begin(), angles.end()}, link_names)) {
    for (const double value : {p.x, p.y, p.z, q.x, q.y, q.z, q.w}) out.push_back(value);
  }
  return out;
}

RawRobot read(rust::Str text) {
  const Robot robot = read_urdf(std::string(text));

  RawRobot out;
  out.name = string(robot.name);
  out.root = string(robot.root);
  for (const Link& link : robot.links) {
    RawLink raw{string(link.name), link.has_inertial, link.mass, pose(link.inertial_pose), link.inertia, {}, {}};
    for (const Collision& c : link.collisions) raw.collisions.push_back(RawCollision{pose(c.pose), shape(c.shape)});
    for (const Visual& v : link.visuals) raw.visuals.push_back(RawVisual{pose(v.pose), shape(v.shape), v.color});
    out.links.push_back(std::move(raw));
  }
  for (const Joint& joint : robot.joints) {
    out.joints.push_back(RawJoint{string(joint.name), joint.kind, string(joint.parent), string(joint.child),
                                  pose(joint.origin), joint.axis, joint.has_limits, joint.limits, joint.damping,
                                  joint.friction, string(joint.mimic_joint),
                                  {joint.mimic_multiplier, joint.mimic_offset}});
  }
  return out;
}

}  // namespace proact::description
