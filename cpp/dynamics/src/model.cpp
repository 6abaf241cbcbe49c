#include "proact/dynamics/model.hpp"

#include <limits>
#include <sstream>
#include <stdexcept>

namespace proact::dynamics {

namespace {

// Rad or m.
constexpr double max_position = 100.0;
constexpr double infinity = std::numeric_limits<double>::infinity();

template <typename... Parts>
[[noreturn]] void refuse(const Parts&... parts) {
  std::ostringstream text;
  (text << ... << parts);
  throw std::invalid_argument(text.str());
}

void check_number(const std::string& what, double value, double smallest) {
  if (!std::isfinite(value) || value < smallest) refuse(what, " is ", value, ", expected at least ", smallest);
}

void check_pose(const std::string& what, const Pose& pose) {
  if (!is_finite(pose)) refuse(what, ": the pose has a value that is not finite");
  const Quat& q = pose.rotation;
  const double length = std::sqrt(q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w);
  if (std::fabs(length - 1.0) > 1e-6) refuse(what, ": the rotation's length is ", length, ", expected 1");
}

void check_shape(const std::string& what, const Shape& shape) {
  const std::size_t sizes = shape.kind == ShapeKind::box ? 3 : shape.kind == ShapeKind::sphere ? 1 : 2;
  for (std::size_t k = 0; k < sizes; ++k) {
    if (!std::isfinite(shape.size[k]) || shape.size[k] <= 0.0) {
      refuse(what, ": size ", k, " of the shape is ", shape.size[k], " m, expected above 0");
    }
  }
}

void check_inertia(const Link& link) {
  const auto& [ixx, ixy, ixz, iyy, iyz, izz] = link.inertia;
  for (const double value : link.inertia) {
    if (!std::isfinite(value)) refuse("link \"", link.name, "\": the inertia has a value that is not finite");
  }
  // Positive definite by Sylvester's criterion: all leading minors are above zero.
  const double minor = ixx * iyy - ixy * ixy;
  const double determinant =
      ixx * (iyy * izz - iyz * iyz) - ixy * (ixy * izz - iyz * ixz) + ixz * (ixy * iyz - iyy * ixz);
  if (ixx <= 0.0 || minor <= 0.0 || determinant <= 0.0) {
    refuse("link \"", link.name, "\": the inertia is not positive definite (diagonal ", ixx, ", ", iyy, ", ", izz,
           " kg m^2)");
  }
}

void check_links(const Model& model) {
  if (model.links.empty()) refuse("the arm has no link");
  if (model.joints.size() + 1 != model.links.size()) {
    refuse(model.joints.size(), " joints for ", model.links.size(), " links, expected one fewer than links");
  }
  for (const Link& link : model.links) {
    const std::string what = "link \"" + link.name + "\"";
    check_number(what + ": mass", link.mass, 0.0);
    if (link.mass > 0.0) {
      check_pose(what, link.inertial);
      check_inertia(link);
    }
    for (const Collision& collision : link.collisions) {
      check_pose(what + ", collision shape", collision.pose);
      check_shape(what, collision.shape);
    }
  }
}

void check_joints(const Model& model) {
  for (std::size_t k = 0; k < model.joints.size(); ++k) {
    const Joint& joint = model.joints[k];
    const std::string what = "joint \"" + joint.name + "\"";
    if (joint.parent > k) refuse(what, ": the parent link ", joint.parent, " does not stand before the child");
    check_pose(what, joint.origin);
    if (joint.kind == JointKind::fixed) continue;
    if (!is_finite(joint.axis) || std::fabs(norm(joint.axis) - 1.0) > 1e-6) refuse(what, ": the axis is not a unit vector");
    const bool continuous = joint.lower == -infinity && joint.upper == infinity;
    if (!continuous && !(std::fabs(joint.lower) <= max_position && std::fabs(joint.upper) <= max_position)) {
      refuse(what, ": limits ", joint.lower, " to ", joint.upper, " ", joint.unit(), ", expected within +-", max_position,
             ", or both infinite for none");
    }
    if (joint.lower > joint.upper) refuse(what, ": lower limit ", joint.lower, " is above the upper ", joint.upper);
    check_number(what + ": velocity limit", joint.velocity, 0.0);
    check_number(what + ": effort limit", joint.effort, 0.0);
    check_number(what + ": damping", joint.damping, 0.0);
    check_number(what + ": friction", joint.friction, 0.0);
    check_number(what + ": proportional gain", joint.proportional_gain, 0.0);
    check_number(what + ": derivative gain", joint.derivative_gain, 0.0);
    if (model.links[k + 1].mass <= 0.0) {
      refuse("link \"", model.links[k + 1].name, "\" is moved by a joint but its mass is ", model.links[k + 1].mass,
             " kg, expected above 0");
    }
  }
}

void check_moving(const Model& model) {
  std::vector<bool> seen(model.joints.size(), false);
  std::size_t free_joints = 0;
  for (const Joint& joint : model.joints) free_joints += joint.kind == JointKind::fixed ? 0U : 1U;
  for (const std::size_t joint : model.moving) {
    if (joint >= model.joints.size() || model.joints[joint].kind == JointKind::fixed || seen[joint]) {
      refuse("the list of moving joints names joint ", joint, " wrongly: unknown, fixed or named twice");
    }
    seen[joint] = true;
  }
  if (free_joints != model.moving.size()) {
    refuse(free_joints, " joints can move but ", model.moving.size(), " are in the arm and the hand");
  }
  if (model.arm_count > model.moving.size()) refuse("the arm has more joints than the model");
  if (model.positions.size() != model.moving.size()) {
    refuse(model.positions.size(), " start angles for ", model.moving.size(), " moving joints");
  }
  for (std::size_t k = 0; k < model.moving.size(); ++k) {
    const Joint& joint = model.joints[model.moving[k]];
    const double angle = model.positions[k];
    if (!(angle >= joint.lower - 1e-6 && angle <= joint.upper + 1e-6)) {
      refuse("joint \"", joint.name, "\" starts at ", angle, " ", joint.unit(), ", its limits are ", joint.lower, " to ", joint.upper);
    }
  }
}

void check_scene(const Model& model) {
  for (const FixedObject& object : model.fixed) {
    const std::string what = "scene object \"" + object.name + "\"";
    check_pose(what, object.pose);
    check_shape(what, object.shape);
    check_number(what + ": friction", object.friction, 0.0);
  }
  for (const Block& block : model.blocks) {
    const std::string what = "block \"" + block.name + "\"";
    check_pose(what, block.pose);
    check_shape(what, block.shape);
    check_number(what + ": friction", block.friction, 0.0);
    check_number(what + ": finger friction", block.friction_finger, 0.0);
    if (!std::isfinite(block.mass) || block.mass <= 0.0) refuse(what, ": mass is ", block.mass, " kg, expected above 0");
  }
}

}  // namespace

void validate(const Model& model) {
  check_links(model);
  check_joints(model);
  check_moving(model);
  check_pose("the base", model.world_from_base);
  check_scene(model);
  const Options& options = model.options;
  if (!is_finite(options.gravity)) refuse("gravity is not finite");
  if (options.iterations < 1) refuse("solver iterations: ", options.iterations, ", expected at least 1");
  check_number("position gain", options.position_gain, 0.0);
  if (options.position_gain * tick_secs > 1.0) {
    refuse("position gain ", options.position_gain, " per second overshoots, at most ", 1.0 / tick_secs);
  }
  check_number("speed of commands to gains", options.gain_command_speed_rad_per_s, 0.0);
  if (!options.merge_attached && options.engine != Engine::ode) {
    refuse("a carried block with a body of its own needs the engine ode: the engine reduced always merges it");
  }
  check_number("rolling resistance", options.rolling_resistance, 0.0);
  check_number("base speed", options.max_base_speed_m_per_s, 0.0);
  check_number("base turn speed", options.max_base_turn_rate_rad_per_s, 0.0);
  check_number("joint softness", options.joint_cfm, 0.0);
}

}  // namespace proact::dynamics
