// The contacts that ODE is to solve in a tick, as joints between its bodies.
#pragma once

#include "collisions.hpp"
#include "contact_constraint.hpp"
#include "large_islands.hpp"

#include <cstddef>
#include <vector>

namespace proact::dynamics {

class ContactJoints {
 public:
  ContactJoints(const Options& options, dWorldID world);

  /// Forgets those of the last tick.
  void clear();
  /// Lets two things push each other in ODE's next step.
  void add(const ContactConstraint& touch);
  /// After ODE's step: tells the forces of listed contacts, and those on blocks at rest.
  void read_forces(Collisions& collisions, LargeIslands& islands) const;

 private:
  struct MeasuredContact {
    ContactConstraint touch;
    dJointFeedback feedback;
  };

  const Options& options_;
  dWorldID world_;
  JointGroupPtr group_;
  std::vector<MeasuredContact> measured_;
};

}  // namespace proact::dynamics
