// What cxx sees: the core's values as shared structs.
#pragma once

#include "proact/description/robot.hpp"
#include "rust/cxx.h"

namespace proact::description {

struct RawRobot;

RawRobot read(rust::Str text);

/// Position and quaternion (x, y, z, w) of each link, one after the other.
rust::Vec<double> link_poses(rust::Str text, const rust::Vec<rust::String>& joints, rust::Slice<const double> angles,
                             const rust::Vec<rust::String>& links);

}  // namespace proact::description
