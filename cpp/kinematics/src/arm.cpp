#include "proact/kinematics/arm.hpp"

#include <Eigen/SVD>

#include <algorithm>
#include <stdexcept>
#include <string>

namespace proact::kinematics {

namespace {

void require(int kdl_status, const char* what) {
  if (kdl_status < 0) {
    throw std::runtime_error(std::string(what) + " failed, KDL status " + std::to_string(kdl_status));
  }
}

KDL::Tree make_tree(const ArmDescription& description) {
  const auto& links = description.links;
  KDL::Tree tree(links[0].name);
  for (std::size_t k = 1; k < links.size(); ++k) {
    if (!tree.addSegment(make_segment(links[k]), links[links[k].parent].name)) {
      throw std::runtime_error("KDL refused the link \"" + links[k].name + '"');
    }
  }
  return tree;
}

KDL::Chain make_chain(const KDL::Tree& tree, const ArmDescription& description) {
  KDL::Chain chain;
  const std::string& base = description.links[description.base].name;
  const std::string& tip = description.links[description.tip].name;
  if (!tree.getChain(base, tip, chain)) {
    throw std::runtime_error("KDL found no chain from \"" + base + "\" to \"" + tip + '"');
  }
  if (chain.getNrOfJoints() == 0) {
    throw std::invalid_argument("no moving joint lies between \"" + base + "\" and \"" + tip + '"');
  }
  return chain;
}

KDL::Tree with_payload(KDL::Tree tree, const std::optional<KDL::Segment>& carried, const std::string& tip) {
  if (carried && !tree.addSegment(*carried, tip)) throw std::runtime_error("KDL refused the carried body");
  return tree;
}

/// One bound per joint of the chain, base to tip.
std::vector<double> chain_limits(const ArmDescription& description, double LinkDescription::*bound) {
  std::vector<double> limits;
  for (std::size_t link = description.tip; link != description.base; link = description.links[link].parent) {
    const LinkDescription& carried = description.links[link];
    if (carried.kind != JointKind::fixed) limits.push_back(carried.*bound);
  }
  std::reverse(limits.begin(), limits.end());
  return limits;
}

const ArmDescription& checked(const ArmDescription& description) {
  check(description);
  return description;
}

unsigned int count(std::size_t size) { return static_cast<unsigned int>(size); }

}  // namespace

Arm::Arm(const ArmDescription& description)
    : moving_(checked(description).moving),
      tip_(description.links[description.tip].name),
      tree_(make_tree(description)),
      chain_(make_chain(tree_, description)),
      position_solver_(chain_),
      jacobian_solver_(chain_),
      inverse_solver_(chain_, chain_limits(description, &LinkDescription::lower),
                      chain_limits(description, &LinkDescription::upper)),
      chain_q_(chain_.getNrOfJoints()),
      chain_jacobian_(chain_.getNrOfJoints()),
      tree_q_(count(description.moving.size())),
      tree_qd_(count(description.moving.size())),
      tree_qdd_(count(description.moving.size())),
      tree_torque_(count(description.moving.size())),
      frames_(description.links.size()) {
  for (const LinkDescription& link : description.links) links_.push_back({make_segment(link), link.parent, -1});
  int place = 0;
  for (const std::size_t link : moving_) links_[link].moving = place++;
}

Arm::Dynamics::Dynamics(const Arm& arm, const std::array<double, 3>& gravity_in)
    : gravity(gravity_in),
      tree(with_payload(arm.tree_, arm.payload_, arm.tip_)),
      solver(tree, KDL::Vector(gravity[0], gravity[1], gravity[2])) {
  // KDL numbers joints anew whenever it copies a tree, so the numbers are read from the final one.
  for (const std::size_t link : arm.moving_) {
    const auto segment = tree.getSegment(arm.links_[link].segment.getName());
    coordinates.push_back(GetTreeElementQNr(segment->second));
  }
}

void Arm::load_chain(const double* q) {
  for (unsigned int k = 0; k < chain_q_.rows(); ++k) chain_q_(k) = q[k];
}

Pose Arm::forward(const double* q) {
  load_chain(q);
  KDL::Frame base_from_tip;
  require(position_solver_.JntToCart(chain_q_, base_from_tip), "forward kinematics");
  return from_kdl(base_from_tip);
}

void Arm::jacobian(const double* q, double* out) {
  load_chain(q);
  require(jacobian_solver_.JntToJac(chain_q_, chain_jacobian_), "Jacobian");
  std::copy_n(chain_jacobian_.data.data(), chain_jacobian_.data.size(), out);
}

std::array<double, 6> Arm::singular_values(const double* q) {
  load_chain(q);
  require(jacobian_solver_.JntToJac(chain_q_, chain_jacobian_), "Jacobian");
  const Eigen::MatrixXd matrix = chain_jacobian_.data;
  const Eigen::VectorXd sigma = Eigen::JacobiSVD<Eigen::MatrixXd>(matrix).singularValues();
  std::array<double, 6> out{};
  std::copy_n(sigma.data(), sigma.size(), out.begin());
  return out;
}

void Arm::link_poses(const double* q, Pose* out) {
  frames_[0] = KDL::Frame::Identity();
  out[0] = from_kdl(frames_[0]);
  for (std::size_t k = 1; k < links_.size(); ++k) {
    const Link& link = links_[k];
    const double angle = link.moving < 0 ? 0.0 : q[link.moving];
    frames_[k] = frames_[link.parent] * link.segment.pose(angle);
    out[k] = from_kdl(frames_[k]);
  }
}

void Arm::inverse_dynamics(const double* q, const double* qd, const double* qdd,
                           const std::array<double, 3>& gravity, double* torque) {
  if (!dynamics_ || dynamics_->gravity != gravity) {
    dynamics_ = std::make_unique<Dynamics>(*this, gravity);
  }
  const auto& coordinates = dynamics_->coordinates;
  for (std::size_t k = 0; k < coordinates.size(); ++k) {
    tree_q_(coordinates[k]) = q[k];
    tree_qd_(coordinates[k]) = qd[k];
    tree_qdd_(coordinates[k]) = qdd[k];
  }
  require(dynamics_->solver.CartToJnt(tree_q_, tree_qd_, tree_qdd_, WrenchMap(), tree_torque_),
          "inverse dynamics");
  for (std::size_t k = 0; k < coordinates.size(); ++k) torque[k] = tree_torque_(coordinates[k]);
}

void Arm::set_payload(const std::optional<Inertial>& body) {
  if (body && !(body->mass > 0.0)) {
    throw std::invalid_argument("the carried body has a mass of " + std::to_string(body->mass) +
                                " kg, expected more than zero");
  }
  payload_.reset();
  if (body) {
    // Sorts after every link name, so it is none of them.
    const std::string name = tree_.getSegments().rbegin()->first + "_carried";
    payload_ = KDL::Segment(name, KDL::Joint(name, KDL::Joint::None), KDL::Frame::Identity(), to_kdl(*body));
  }
  dynamics_.reset();
}

bool Arm::inverse(const Pose& base_from_tip, const double* seed, double* out) {
  return inverse_solver_.solve(to_kdl(base_from_tip), seed, out);
}

std::vector<double> Arm::inverse_all(const Pose& base_from_tip, std::size_t starts, std::uint64_t random_seed) {
  return inverse_solver_.solve_all(to_kdl(base_from_tip), starts, random_seed);
}

}  // namespace proact::kinematics
