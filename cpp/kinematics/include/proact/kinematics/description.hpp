// What an arm is made of, as plain values.
#pragma once

#include "proact/geometry.hpp"

#include <kdl/frames.hpp>
#include <kdl/rigidbodyinertia.hpp>
#include <kdl/segment.hpp>

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

namespace proact::kinematics {

/// Mass properties.
struct Inertial {
  /// kg.
  double mass = 0.0;
  /// link_from_inertial: the origin is the centre of mass.
  Pose pose;
  /// ixx, ixy, ixz, iyy, iyz, izz about the centre of mass in the inertial frame's axes, kg m^2.
  std::array<double, 6> inertia{};
};

using proact::JointKind;

/// A link with the joint that carries it.
struct LinkDescription {
  std::string name;
  /// Index of the parent, smaller than the link's own; ignored for the first link, which is the root.
  std::size_t parent = 0;
  /// Name of the joint between parent and link.
  std::string joint;
  JointKind kind = JointKind::fixed;
  /// parent_from_link at position zero.
  Pose origin;
  /// Axis in the joint frame; its length does not matter.
  std::array<double, 3> axis{0.0, 0.0, 1.0};
  /// Smallest and largest position, rad or m.
  double lower = 0.0;
  double upper = 0.0;
  /// A mass of zero means a frame without mass.
  Inertial inertial;
};

/// An arm: links with the root first, parents before children.
struct ArmDescription {
  std::vector<LinkDescription> links;
  /// The links of all moving joints, in the order of joint vectors over the tree.
  std::vector<std::size_t> moving;
  /// First and last link of the chain.
  std::size_t base = 0;
  std::size_t tip = 0;
};

/// Conversions to and from KDL's types.
KDL::Frame to_kdl(const Pose& pose);
KDL::RigidBodyInertia to_kdl(const Inertial& inertial);
Pose from_kdl(const KDL::Frame& frame);

/// KDL's segment of a link: joint, origin and mass.
/// Throws std::invalid_argument if the axis has no direction.
KDL::Segment make_segment(const LinkDescription& link);

/// Throws std::invalid_argument, naming the offender, unless the description is usable.
void check(const ArmDescription& description);

}  // namespace proact::kinematics
