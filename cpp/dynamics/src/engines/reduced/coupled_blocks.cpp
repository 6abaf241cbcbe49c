#include "engines/reduced/coupled_blocks.hpp"

#include <algorithm>
#include <iterator>

namespace proact::dynamics {

CoupledBlocks::CoupledBlocks(const Model& model, BlockBodies& blocks, ContactJoints& contact_joints,
                             const LargeIslands& islands)
    : model_(model),
      blocks_(blocks),
      contact_joints_(contact_joints),
      islands_(islands),
      slot_(blocks.count(), no_index) {
  blocks_in_contact_.reserve(blocks.count());
  constraints_.reserve(World::contact_capacity);
}

void CoupledBlocks::find(const std::vector<ContactConstraint>& touches) {
  for (const std::size_t block : blocks_in_contact_) slot_[block] = no_index;
  blocks_in_contact_.clear();
  const auto engage = [&](const ContactSide& side) {
    if (side.block == no_index || slot_[side.block] != no_index) return false;
    slot_[side.block] = blocks_in_contact_.size();
    blocks_in_contact_.push_back(side.block);
    blocks_.keep_awake(side.block);
    return true;
  };
  const auto moves = [&](const ContactSide& side) {
    return side.arm != no_index || (side.block != no_index && slot_[side.block] != no_index);
  };
  for (bool grown = true; grown;) {
    grown = false;
    for (const ContactConstraint& touch : touches) {
      if (moves(touch.first) || moves(touch.second)) grown = engage(touch.first) || grown;
      if (moves(touch.first) || moves(touch.second)) grown = engage(touch.second) || grown;
    }
  }
  constraints_.clear();
  for (const ContactConstraint& touch : touches) {
    if (moves(touch.first) || moves(touch.second)) {
      constraints_.push_back(touch);
    } else {
      contact_joints_.add(touch);
    }
  }
}

void CoupledBlocks::add_to(VelocityProblem& problem, std::size_t hinges) {
  problem.blocks.clear();
  for (std::size_t slot = 0; slot < blocks_in_contact_.size(); ++slot) {
    const dBodyID body = blocks_.body(blocks_in_contact_[slot]);
    dMass mass;
    dBodyGetMass(body, &mass);
    const SymmetricMatrix3 own{mass.I[0], mass.I[1], mass.I[2], mass.I[5], mass.I[6], mass.I[10]};
    const SymmetricMatrix3 inertia = rotated(to_quat(dBodyGetQuaternion(body)), own);
    const Vec3 linear = linear_velocity(body);
    const Vec3 angular = angular_velocity(body);
    const Vec3 spin = inertia * angular;
    const Vec3 torque = to_vec(dBodyGetTorque(body)) - cross(angular, spin);
    dBodySetTorque(body, 0, 0, 0);
    problem.blocks.push_back({mass.mass, inertia, (linear + model_.options.gravity * tick_secs) * mass.mass,
                              spin + torque * tick_secs});
    const double twist[6] = {linear.x, linear.y, linear.z, angular.x, angular.y, angular.z};
    std::copy(std::begin(twist), std::end(twist), problem.velocity.begin() + static_cast<std::ptrdiff_t>(hinges + 6 * slot));
  }
}

bool CoupledBlocks::find_shared() {
  shared_.clear();
  for (std::size_t slot = 0; slot < blocks_in_contact_.size(); ++slot) {
    const std::size_t body = islands_.body_of(blocks_in_contact_[slot]);
    if (body != no_index) shared_.push_back({slot, body, {}, {}});
  }
  return !shared_.empty();
}

void CoupledBlocks::reset_exchange() {
  for (SharedBlock& shared : shared_) shared.linear = shared.angular = {};
}

void CoupledBlocks::import_momenta(VelocityProblem& problem, const PgsContactSolver& sweeps) const {
  for (const SharedBlock& shared : shared_) {
    VelocityProblem::BlockPart& part = problem.blocks[shared.slot];
    const PgsContactSolver::Body& body = sweeps.bodies[shared.body];
    part.linear_momentum = body.linear * part.mass - shared.linear;
    part.angular_momentum = part.inertia * body.angular - shared.angular;
  }
}

double CoupledBlocks::export_speeds(const VelocityProblem& problem, std::size_t hinges, PgsContactSolver& sweeps) {
  constexpr double reach = 0.1;  // m, of a block
  double largest = 0.0;
  for (SharedBlock& shared : shared_) {
    const double* const twist = &problem.velocity[hinges + 6 * shared.slot];
    const VelocityProblem::BlockPart& part = problem.blocks[shared.slot];
    PgsContactSolver::Body& body = sweeps.bodies[shared.body];
    const Vec3 linear{twist[0], twist[1], twist[2]};
    const Vec3 angular{twist[3], twist[4], twist[5]};
    const double change = norm(linear - body.linear);
    largest = std::max(largest, change);
    body.changed += change + norm(angular - body.angular) * reach;
    shared.linear = linear * part.mass - part.linear_momentum;
    shared.angular = part.inertia * angular - part.angular_momentum;
    body.linear = linear;
    body.angular = angular;
  }
  return largest;
}

/// Those of large islands are moved there.
void CoupledBlocks::integrate(const VelocityProblem& problem, std::size_t hinges) {
  for (std::size_t slot = 0; slot < blocks_in_contact_.size(); ++slot) {
    if (islands_.body_of(blocks_in_contact_[slot]) != no_index) continue;
    const dBodyID body = blocks_.body(blocks_in_contact_[slot]);
    const double* const twist = &problem.velocity[hinges + 6 * slot];
    const Vec3 linear{twist[0], twist[1], twist[2]};
    const Vec3 angular{twist[3], twist[4], twist[5]};
    set_body_pose(body, integrate_pose(body_pose(body), linear, angular, tick_secs));
    set_body_velocity(body, linear, angular);
  }
}

void CoupledBlocks::disable_in_ode() {
  for (const std::size_t block : blocks_in_contact_) dBodyDisable(blocks_.body(block));
}

void CoupledBlocks::enable_in_ode() {
  for (const std::size_t block : blocks_in_contact_) dBodyEnable(blocks_.body(block));
}

}  // namespace proact::dynamics
