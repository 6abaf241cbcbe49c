// Tip pose, Jacobian and inverse dynamics of an arm from its URDF, by raw KDL.
//
//   kdl_reference FILE.urdf BASE TIP < states > answers
//
// The first line of the input names the joints of the tree, in the order of all vectors over it. Every
// further line is one state: angles, speeds and accelerations of these joints (three numbers each joint,
// all angles first). Gravity is 9.80665 m/s^2 along -z of the root link.
// Every answer is one line with 17 digits: tip position (3), rotation matrix (9, row after row), Jacobian
// (6 rows of one number for each joint of the chain, linear rows first), torques (one for each joint of the
// first line).
#include <kdl/chainfksolverpos_recursive.hpp>
#include <kdl/chainjnttojacsolver.hpp>
#include <kdl/tree.hpp>
#include <kdl/treeidsolver_recursive_newton_euler.hpp>
#include <urdf_model/model.h>
#include <urdf_parser/urdf_parser.h>

#include <cstdio>
#include <cstdlib>
#include <iostream>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

namespace {

KDL::Frame frame(const urdf::Pose& pose) {
  return KDL::Frame(KDL::Rotation::Quaternion(pose.rotation.x, pose.rotation.y, pose.rotation.z, pose.rotation.w),
                    KDL::Vector(pose.position.x, pose.position.y, pose.position.z));
}

/// The tensor is turned as a matrix product here, not through KDL's operator.
KDL::RigidBodyInertia inertia(const urdf::Link& link) {
  if (!link.inertial) return KDL::RigidBodyInertia::Zero();
  const urdf::Inertial& in = *link.inertial;
  const KDL::Frame link_from_inertial = frame(in.origin);
  const double own[3][3] = {{in.ixx, in.ixy, in.ixz}, {in.ixy, in.iyy, in.iyz}, {in.ixz, in.iyz, in.izz}};
  double turned[3][3] = {};
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j)
      for (int k = 0; k < 3; ++k)
        for (int l = 0; l < 3; ++l)
          turned[i][j] += link_from_inertial.M(i, k) * own[k][l] * link_from_inertial.M(j, l);
  return KDL::RigidBodyInertia(in.mass, link_from_inertial.p,
                               KDL::RotationalInertia(turned[0][0], turned[1][1], turned[2][2], turned[0][1],
                                                      turned[0][2], turned[1][2]));
}

void add_children(const urdf::Link& parent, KDL::Tree& tree) {
  for (const auto& link : parent.child_links) {
    const urdf::Joint& joint = *link->parent_joint;
    const KDL::Frame origin = frame(joint.parent_to_joint_origin_transform);
    KDL::Joint moved(joint.name, KDL::Joint::None);
    if (joint.type == urdf::Joint::REVOLUTE) {
      moved = KDL::Joint(joint.name, origin.p, origin.M * KDL::Vector(joint.axis.x, joint.axis.y, joint.axis.z),
                         KDL::Joint::RotAxis);
    } else if (joint.type != urdf::Joint::FIXED) {
      throw std::runtime_error("joint " + joint.name + " is neither revolute nor fixed");
    }
    if (!tree.addSegment(KDL::Segment(link->name, moved, origin, inertia(*link)), parent.name)) {
      throw std::runtime_error("cannot add " + link->name);
    }
    add_children(*link, tree);
  }
}

/// KDL's number of each named joint.
std::vector<unsigned int> numbers(const KDL::Tree& tree, const std::string& names) {
  std::vector<unsigned int> found;
  std::istringstream words(names);
  for (std::string name; words >> name;) {
    bool known = false;
    for (const auto& [link, element] : tree.getSegments()) {
      const KDL::Joint& joint = element.segment.getJoint();
      if (joint.getName() != name || joint.getType() == KDL::Joint::None) continue;
      found.push_back(element.q_nr);
      known = true;
    }
    if (!known) throw std::runtime_error("no joint " + name);
  }
  if (found.size() != tree.getNrOfJoints()) throw std::runtime_error("not all joints are named");
  return found;
}

void print(double value) { std::printf("%.17g ", value); }

void answer(const std::string& urdf_file, const std::string& base, const std::string& tip) {
  const urdf::ModelInterfaceSharedPtr model = urdf::parseURDFFile(urdf_file);
  if (!model) throw std::runtime_error("cannot read " + urdf_file);
  KDL::Tree tree(model->getRoot()->name);
  add_children(*model->getRoot(), tree);
  KDL::Chain chain;
  if (!tree.getChain(base, tip, chain)) throw std::runtime_error("no chain from " + base + " to " + tip);

  std::string line;
  std::getline(std::cin, line);
  const std::vector<unsigned int> number = numbers(tree, line);
  std::vector<unsigned int> chain_number;  // the tree's number of each joint of the chain
  for (const KDL::Segment& segment : chain.segments) {
    if (segment.getJoint().getType() != KDL::Joint::None) {
      chain_number.push_back(tree.getSegment(segment.getName())->second.q_nr);
    }
  }

  KDL::ChainFkSolverPos_recursive position(chain);
  KDL::ChainJntToJacSolver velocity(chain);
  KDL::TreeIdSolver_RNE dynamics(tree, KDL::Vector(0.0, 0.0, -9.80665));
  const unsigned int joints = chain.getNrOfJoints();
  KDL::JntArray q(tree.getNrOfJoints()), qd(q), qdd(q), torque(q), chain_q(joints);
  KDL::Jacobian jacobian(joints);
  while (std::getline(std::cin, line)) {
    std::istringstream values(line);
    for (KDL::JntArray* array : {&q, &qd, &qdd}) {
      for (const unsigned int k : number) {
        if (!(values >> (*array)(k))) throw std::runtime_error("too few numbers: " + line);
      }
    }
    for (unsigned int k = 0; k < joints; ++k) chain_q(k) = q(chain_number[k]);

    KDL::Frame pose;
    if (position.JntToCart(chain_q, pose) != 0 || velocity.JntToJac(chain_q, jacobian) != 0 ||
        dynamics.CartToJnt(q, qd, qdd, KDL::WrenchMap(), torque) != 0) {
      throw std::runtime_error("KDL refused: " + line);
    }
    for (int k = 0; k < 3; ++k) print(pose.p(k));
    for (int k = 0; k < 9; ++k) print(pose.M(k / 3, k % 3));
    for (unsigned int row = 0; row < 6; ++row) {
      for (unsigned int column = 0; column < joints; ++column) print(jacobian(row, column));
    }
    for (const unsigned int k : number) print(torque(k));
    std::printf("\n");
  }
}

}  // namespace

int main(int count, char** arguments) {
  if (count != 4) {
    std::fprintf(stderr, "usage: %s FILE.urdf BASE TIP < states\n", arguments[0]);
    return 2;
  }
  try {
    answer(arguments[1], arguments[2], arguments[3]);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
  }
  return 0;
}
