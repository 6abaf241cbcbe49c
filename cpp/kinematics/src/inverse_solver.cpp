#include "proact/kinematics/inverse_solver.hpp"

#include <Eigen/Cholesky>

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>
#include <utility>

namespace proact::kinematics {

namespace {

// Metres that one radian of rotation error counts for in the descent: about the length of a hand, so that
// neither part drowns the other.
constexpr double kMetersPerRadian = 0.2;
constexpr int kMaxIterations = 80;
constexpr double kFirstDamping = 1e-3;
constexpr double kMinDamping = 1e-12;
constexpr double kMaxDamping = 1e2;
// An iteration that lowers the error by less than this share has all but stalled; so many in a row end
// the search from this start.
constexpr double kStallRatio = 0.02;
constexpr int kMaxSlowIterations = 8;
// Longest step of one joint, rad: beyond it the linear picture is worthless.
constexpr double kMaxStep = 0.7;

// Starts around the seed, with growing radius, and starts all over the range.
constexpr int kStartsAround = 8;
constexpr int kStarts = 64;
// Then starts with about half of the joints at a limit: poses at the limits have basins that others miss.
constexpr int kStartsAtLimits = 2048;
constexpr std::uint64_t kStartsSeed = 0x70726f616374;  // any fixed number

/// KDL's own Norm reads lengths below 1e-6 as zero, which is too coarse to end on.
double length(const KDL::Vector& vector) { return std::sqrt(KDL::dot(vector, vector)); }

/// The rotation vector that turns `from` into `to`, in the axes in which both are given.
/// KDL's own (diff, GetRot) reads rotations below 1e-6 rad as none.
KDL::Vector rotation_between(const KDL::Rotation& from, const KDL::Rotation& to) {
  const KDL::Rotation turn = to * from.Inverse();
  const KDL::Vector sine = 0.5 * KDL::Vector(turn(2, 1) - turn(1, 2), turn(0, 2) - turn(2, 0), turn(1, 0) - turn(0, 1));
  const double cosine = 0.5 * (turn(0, 0) + turn(1, 1) + turn(2, 2) - 1.0);
  // Near half a turn the sine says nothing about the axis; KDL's way is exact enough there.
  if (cosine < 0.0) return turn.GetRot();
  const double size = length(sine);
  return size < 1e-100 ? KDL::Vector::Zero() : sine * (std::atan2(size, cosine) / size);
}

}  // namespace

InverseSolver::InverseSolver(const KDL::Chain& chain, std::vector<double> lower, std::vector<double> upper)
    : lower_(std::move(lower)),
      upper_(std::move(upper)),
      position_solver_(chain),
      jacobian_solver_(chain),
      q_(chain.getNrOfJoints()),
      trial_(chain.getNrOfJoints()),
      jacobian_(chain.getNrOfJoints()),
      free_jacobian_(6, chain.getNrOfJoints()),
      step_(chain.getNrOfJoints()),
      frozen_(chain.getNrOfJoints()) {
  if (lower_.size() != q_.rows() || upper_.size() != q_.rows()) {
    throw std::invalid_argument("got " + std::to_string(lower_.size()) + " joint limits, the chain has " +
                                std::to_string(q_.rows()) + " joints");
  }
}

bool InverseSolver::solve(const KDL::Frame& target, const double* seed, double* out) {
  random_state_ = kStartsSeed;
  for (int start = 0; start < kStarts + kStartsAtLimits; ++start) {
    for (unsigned int k = 0; k < q_.rows(); ++k) {
      const double range = upper_[k] - lower_[k];
      if (start <= kStartsAround) {
        const double radius = 0.5 * range * start / kStartsAround;
        q_(k) = std::clamp(seed[k] + radius * (2.0 * uniform() - 1.0), lower_[k], upper_[k]);
      } else {
        q_(k) = lower_[k] + range * uniform();
        const double at_limit = start < kStarts ? 1.0 : uniform();
        if (at_limit < 0.25) q_(k) = lower_[k];
        if (at_limit >= 0.25 && at_limit < 0.5) q_(k) = upper_[k];
      }
    }
    if (minimize(target)) {
      std::copy_n(q_.data.data(), q_.rows(), out);
      return true;
    }
  }
  return false;
}

std::vector<double> InverseSolver::solve_all(const KDL::Frame& target, std::size_t starts,
                                             std::uint64_t random_seed) {
  random_state_ = random_seed;
  const std::size_t joints = q_.rows();
  std::vector<double> found;
  for (std::size_t start = 0; start < starts; ++start) {
    for (unsigned int k = 0; k < joints; ++k) q_(k) = lower_[k] + (upper_[k] - lower_[k]) * uniform();
    if (!minimize(target)) continue;
    bool known = false;
    for (std::size_t other = 0; other < found.size() && !known; other += joints) {
      known = true;
      for (unsigned int k = 0; k < joints; ++k) known = known && std::abs(found[other + k] - q_(k)) < kDistinctAngle;
    }
    if (!known) found.insert(found.end(), q_.data.data(), q_.data.data() + joints);
  }
  return found;
}

/// Moves q_ to the target; false when it gets stuck.
bool InverseSolver::minimize(const KDL::Frame& target) {
  double damping = kFirstDamping;
  int slow = 0;
  evaluate_error(target, q_);
  for (int iteration = 0; iteration < kMaxIterations; ++iteration) {
    if (position_error_ < kPositionTolerance && rotation_error_ < kRotationTolerance) return true;
    const Eigen::Matrix<double, 6, 1> error = error_;
    jacobian_solver_.JntToJac(q_, jacobian_);
    jacobian_.data.bottomRows<3>() *= kMetersPerRadian;

    // Raise the damping until a step helps.
    while (true) {
      step(damping);
      evaluate_error(target, trial_);
      if (error_.squaredNorm() < error.squaredNorm()) break;
      error_ = error;
      damping *= 10.0;
      if (!(damping < kMaxDamping)) return false;
    }
    q_.data = trial_.data;
    damping = std::max(damping * 0.1, kMinDamping);
    slow = error_.norm() > (1.0 - kStallRatio) * error.norm() ? slow + 1 : 0;
    if (slow >= kMaxSlowIterations) return false;
  }
  return false;
}

void InverseSolver::evaluate_error(const KDL::Frame& target, const KDL::JntArray& q) {
  KDL::Frame reached;
  position_solver_.JntToCart(q, reached);
  const KDL::Twist left(target.p - reached.p, rotation_between(reached.M, target.M));
  position_error_ = length(left.vel);
  rotation_error_ = length(left.rot);
  for (int k = 0; k < 3; ++k) {
    error_(k) = left.vel(k);
    error_(k + 3) = kMetersPerRadian * left.rot(k);
  }
}

/// Writes into trial_ the damped least-squares step from q_ towards error_, within the limits.
void InverseSolver::step(double damping) {
  const Eigen::Index joints = q_.data.size();
  std::fill(frozen_.begin(), frozen_.end(), false);
  free_jacobian_ = jacobian_.data;
  // Each round freezes at least one more joint, so it ends.
  while (true) {
    Eigen::Matrix<double, 6, 6> normal = free_jacobian_ * free_jacobian_.transpose();
    normal.diagonal().array() += damping;
    const Eigen::Matrix<double, 6, 1> weights = normal.ldlt().solve(error_);
    step_.noalias() = free_jacobian_.transpose() * weights;
    const double longest = step_.cwiseAbs().maxCoeff();
    if (longest > kMaxStep) step_ *= kMaxStep / longest;

    bool again = false;
    for (Eigen::Index k = 0; k < joints; ++k) {
      const auto joint = static_cast<std::size_t>(k);
      const bool over = (q_.data(k) <= lower_[joint] && step_(k) < 0.0) ||
                        (q_.data(k) >= upper_[joint] && step_(k) > 0.0);
      if (over && !frozen_[joint]) {
        frozen_[joint] = again = true;
        free_jacobian_.col(k).setZero();
      }
    }
    if (!again) break;
  }
  for (Eigen::Index k = 0; k < joints; ++k) {
    const auto joint = static_cast<std::size_t>(k);
    trial_.data(k) = std::clamp(q_.data(k) + step_(k), lower_[joint], upper_[joint]);
  }
}

/// Uniform in [0, 1): SplitMix64 (Steele, Lea, Flood, OOPSLA 2014), upper 53 bits.
double InverseSolver::uniform() {
  random_state_ += 0x9e3779b97f4a7c15U;
  std::uint64_t z = random_state_;
  z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9U;
  z = (z ^ (z >> 27)) * 0x94d049bb133111ebU;
  z ^= z >> 31;
  return static_cast<double>(z >> 11) * 0x1.0p-53;
}

}  // namespace proact::kinematics
