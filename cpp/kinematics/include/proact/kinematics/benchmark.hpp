// The peer of `proact bench kinematics`: KDL alone, timed in its own loop.
#pragma once

#include "proact/kinematics/description.hpp"

#include <cstddef>
#include <vector>

namespace proact::kinematics {

/// Forward kinematics and Jacobian of the chain on KDL's solvers, once for each of the `count`
/// configurations in q[count][joints] after one round that warms up. Returns nanoseconds per call, in order.
/// Reads the steady clock; everything else here does not.
std::vector<double> time_raw_kdl(const ArmDescription& description, const double* q, std::size_t count);

}  // namespace proact::kinematics
