#include "proact/kinematics/benchmark.hpp"

#include "proact/kinematics/arm.hpp"

#include <chrono>
#include <stdexcept>

namespace proact::kinematics {

std::vector<double> time_raw_kdl(const ArmDescription& description, const double* q, std::size_t count) {
  check(description);
  KDL::Tree tree(description.links[0].name);
  for (std::size_t k = 1; k < description.links.size(); ++k) {
    const LinkDescription& link = description.links[k];
    tree.addSegment(make_segment(link), description.links[link.parent].name);
  }
  KDL::Chain chain;
  if (!tree.getChain(description.links[description.base].name, description.links[description.tip].name, chain)) {
    throw std::runtime_error("KDL found no chain");
  }

  const unsigned int joints = chain.getNrOfJoints();
  KDL::ChainFkSolverPos_recursive position(chain);
  KDL::ChainJntToJacSolver velocity(chain);
  KDL::JntArray angles(joints);
  KDL::Frame frame;
  KDL::Jacobian jacobian(joints);
  std::vector<double> nanoseconds(count);
  int status = 0;
  for (int round = 0; round < 2; ++round) {
    for (std::size_t call = 0; call < count; ++call) {
      const auto begin = std::chrono::steady_clock::now();
      for (unsigned int k = 0; k < joints; ++k) angles(k) = q[call * joints + k];
      status |= position.JntToCart(angles, frame) | velocity.JntToJac(angles, jacobian);
      const auto end = std::chrono::steady_clock::now();
      nanoseconds[call] = std::chrono::duration<double, std::nano>(end - begin).count();
    }
  }
  if (status != 0) throw std::runtime_error("KDL status " + std::to_string(status));
  return nanoseconds;
}

}  // namespace proact::kinematics
