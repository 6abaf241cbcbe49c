// Inverse dynamics of a KDL tree, whichever KDL there is. Plain C++17: no cxx, no ROS.
#pragma once

#include <kdl/frames.hpp>
#include <kdl/jntarray.hpp>
#include <kdl/tree.hpp>

#include <cstddef>
#include <map>
#include <string>
#include <vector>

#if __has_include(<kdl/treeidsolver_recursive_newton_euler.hpp>)
#include <kdl/treeidsolver_recursive_newton_euler.hpp>
#endif

namespace proact::kinematics {

/// Recursive Newton-Euler over a tree, for KDL 1.4 (Ubuntu 20.04), whose solver knows chains alone; called as KDL 1.5's
/// TreeIdSolver_RNE is, and equal to it within rounding. Source: Featherstone, Rigid Body Dynamics Algorithms, 5.3.
class RecursiveNewtonEuler {
 public:
  using WrenchMap = std::map<std::string, KDL::Wrench>;

  /// Keeps a reference to `tree`. Gravity in m/s^2, axes of the root.
  RecursiveNewtonEuler(const KDL::Tree& tree, const KDL::Vector& gravity);

  /// Torques of all joints, N m, in the tree's numbering, for angles, velocities and accelerations in the same. Negative
  /// if a length is wrong or an outer wrench is given, which this solver does not know. Does not allocate.
  int CartToJnt(const KDL::JntArray& q, const KDL::JntArray& qd, const KDL::JntArray& qdd, const WrenchMap& outer,
                KDL::JntArray& torques);

 private:
  struct Part {
    const KDL::Segment* segment;
    std::size_t parent;  // its own number for the root
    unsigned int joint;
    bool moves;
    KDL::Frame parent_from_part;
    KDL::Twist axis;
    KDL::Twist velocity;
    KDL::Twist acceleration;
    KDL::Wrench force;
  };

  void add(KDL::SegmentMap::const_iterator element, std::size_t parent);

  const KDL::Tree& tree_;
  KDL::Vector gravity_;
  std::vector<Part> parts_;  // parents first
};

#if __has_include(<kdl/treeidsolver_recursive_newton_euler.hpp>)
using TreeDynamics = KDL::TreeIdSolver_RNE;
using WrenchMap = KDL::WrenchMap;
#else
using TreeDynamics = RecursiveNewtonEuler;
using WrenchMap = RecursiveNewtonEuler::WrenchMap;
#endif

}  // namespace proact::kinematics
