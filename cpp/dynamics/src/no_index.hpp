#pragma once

#include <cstddef>
#include <limits>

namespace proact::dynamics {

/// Stands for "none" where an index is expected.
constexpr std::size_t no_index = std::numeric_limits<std::size_t>::max();

}  // namespace proact::dynamics
