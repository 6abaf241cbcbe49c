// What cxx sees: the core's values as shared structs.
#pragma once

#include "proact/description/robot.hpp"
#include "rust/cxx.h"

namespace proact::description {

struct RawRobot;

RawRobot read(rust::Str text);

}  // namespace proact::description
