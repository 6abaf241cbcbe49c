#include "proact/description/robot.hpp"

#include <console_bridge/console.h>
#include <urdf_model/model.h>
#include <urdf_parser/urdf_parser.h>

#include <cmath>
#include <map>
#include <mutex>
#include <stdexcept>

namespace proact::description {

namespace {

/// Collects errors, which urdfdom would otherwise print to the terminal.
class LogCollector : public console_bridge::OutputHandler {
 public:
  void log(const std::string& text, console_bridge::LogLevel level, const char*, int) override {
    if (level < console_bridge::CONSOLE_BRIDGE_LOG_ERROR) return;
    if (!text_.empty()) text_ += "; ";
    text_ += text;
  }

  const std::string& text() const noexcept { return text_; }

 private:
  std::string text_;
};

/// Installs a collector for as long as it lives, also when urdfdom throws.
class LogCapture {
 public:
  LogCapture() { console_bridge::useOutputHandler(&collector_); }
  ~LogCapture() { console_bridge::restorePreviousOutputHandler(); }
  LogCapture(const LogCapture&) = delete;
  LogCapture& operator=(const LogCapture&) = delete;

  const std::string& text() const noexcept { return collector_.text(); }

 private:
  LogCollector collector_;
};

std::array<double, 3> convert(const urdf::Vector3& v) { return {{v.x, v.y, v.z}}; }

Pose convert(const urdf::Pose& pose) {
  Pose out{{pose.position.x, pose.position.y, pose.position.z}, {}};
  pose.rotation.getQuaternion(out.rotation.x, out.rotation.y, out.rotation.z, out.rotation.w);
  return out;
}

Shape convert(const urdf::Geometry& geometry) {
  Shape out;
  switch (geometry.type) {
    case urdf::Geometry::BOX:
      out.kind = ShapeKind::box;
      out.size = convert(static_cast<const urdf::Box&>(geometry).dim);
      break;
    case urdf::Geometry::CYLINDER: {
      const auto& cylinder = static_cast<const urdf::Cylinder&>(geometry);
      out.kind = ShapeKind::cylinder;
      out.size = {{cylinder.radius, cylinder.length, 0.0}};
      break;
    }
    case urdf::Geometry::SPHERE:
      out.kind = ShapeKind::sphere;
      out.size = {{static_cast<const urdf::Sphere&>(geometry).radius, 0.0, 0.0}};
      break;
    case urdf::Geometry::MESH: {
      const auto& mesh = static_cast<const urdf::Mesh&>(geometry);
      out.kind = ShapeKind::mesh;
      out.size = convert(mesh.scale);
      out.file = mesh.filename;
      break;
    }
  }
  return out;
}

JointKind kind_of(int type) {
  switch (type) {
    case urdf::Joint::FIXED: return JointKind::fixed;
    case urdf::Joint::REVOLUTE: return JointKind::revolute;
    case urdf::Joint::CONTINUOUS: return JointKind::continuous;
    case urdf::Joint::PRISMATIC: return JointKind::prismatic;
    case urdf::Joint::PLANAR: return JointKind::planar;
    case urdf::Joint::FLOATING: return JointKind::floating;
    default: return JointKind::unknown;
  }
}

Link convert(const urdf::Link& link) {
  Link out;
  out.name = link.name;
  if (link.inertial) {
    const urdf::Inertial& inertial = *link.inertial;
    out.has_inertial = true;
    out.mass = inertial.mass;
    out.inertial_pose = convert(inertial.origin);
    out.inertia = {{inertial.ixx, inertial.ixy, inertial.ixz, inertial.iyy, inertial.iyz, inertial.izz}};
  }
  for (const auto& collision : link.collision_array) {
    out.collisions.push_back({convert(collision->origin), convert(*collision->geometry)});
  }
  for (const auto& visual : link.visual_array) {
    Visual shown{convert(visual->origin), convert(*visual->geometry), {{0.8, 0.8, 0.8, 1.0}}};
    if (visual->material) {
      const urdf::Color& color = visual->material->color;
      shown.color = {{double{color.r}, double{color.g}, double{color.b}, double{color.a}}};
    }
    out.visuals.push_back(shown);
  }
  return out;
}

Joint convert(const urdf::Joint& joint) {
  Joint out;
  out.name = joint.name;
  out.kind = kind_of(joint.type);
  out.parent = joint.parent_link_name;
  out.child = joint.child_link_name;
  out.origin = convert(joint.parent_to_joint_origin_transform);
  out.axis = convert(joint.axis);
  if (joint.mimic) {
    out.mimic_joint = joint.mimic->joint_name;
    out.mimic_multiplier = joint.mimic->multiplier;
    out.mimic_offset = joint.mimic->offset;
  }
  if (joint.limits) {
    out.has_limits = true;
    out.limits = {{joint.limits->lower, joint.limits->upper, joint.limits->velocity, joint.limits->effort}};
  }
  if (joint.dynamics) {
    out.damping = joint.dynamics->damping;
    out.friction = joint.dynamics->friction;
  }
  return out;
}

urdf::ModelInterfaceSharedPtr parse(const std::string& text) {
  // console_bridge keeps one handler for the process, and no lock of its own.
  static std::mutex console_mutex;
  const std::lock_guard<std::mutex> lock(console_mutex);
  const LogCapture capture;

  urdf::ModelInterfaceSharedPtr model = urdf::parseURDF(text);
  if (!model) {
    throw std::runtime_error(capture.text().empty() ? "urdfdom refused the text without a reason" : capture.text());
  }
  // urdfdom drops a shape that it does not know, logs an error and calls the model good.
  if (!capture.text().empty()) throw std::runtime_error(capture.text());
  return model;
}

double length_of(const urdf::Vector3& axis) { return std::sqrt(axis.x * axis.x + axis.y * axis.y + axis.z * axis.z); }

/// Turned by `angle` about `axis`, which need not be a unit vector.
urdf::Rotation turn(const urdf::Vector3& axis, double angle) {
  const double length = length_of(axis);
  const double share = length > 0.0 ? std::sin(angle / 2.0) / length : 0.0;
  return {axis.x * share, axis.y * share, axis.z * share, std::cos(angle / 2.0)};
}

urdf::Pose link_pose(const urdf::Link& link, const std::map<std::string, double>& angles) {
  if (!link.parent_joint) return {};
  // Neither const nor by reference: urdfdom's sum of vectors is no const function.
  urdf::Pose parent = link_pose(*link.getParent(), angles);
  const urdf::Pose& origin = link.parent_joint->parent_to_joint_origin_transform;
  urdf::Pose out;
  out.position = parent.position + parent.rotation * origin.position;
  out.rotation = parent.rotation * origin.rotation;
  const auto position = angles.find(link.parent_joint->name);
  if (position == angles.end()) return out;
  const urdf::Vector3& axis = link.parent_joint->axis;
  if (link.parent_joint->type == urdf::Joint::PRISMATIC) {
    const double share = position->second / length_of(axis);
    out.position = out.position + out.rotation * urdf::Vector3(axis.x * share, axis.y * share, axis.z * share);
  } else if (link.parent_joint->type != urdf::Joint::FIXED) {
    out.rotation = out.rotation * turn(axis, position->second);
  }
  return out;
}

}  // namespace

std::vector<Pose> link_poses(const std::string& text, const std::vector<std::string>& joints,
                             const std::vector<double>& angles, const std::vector<std::string>& links) {
  if (joints.size() != angles.size()) throw std::runtime_error("as many angles as joints are expected");
  const urdf::ModelInterfaceSharedPtr model = parse(text);
  std::map<std::string, double> at;
  for (std::size_t k = 0; k < joints.size(); ++k) {
    if (!model->getJoint(joints[k])) throw std::runtime_error("there is no joint \"" + joints[k] + "\"");
    at[joints[k]] = angles[k];
  }
  std::vector<Pose> out;
  for (const std::string& name : links) {
    const auto link = model->getLink(name);
    if (!link) throw std::runtime_error("there is no link \"" + name + "\"");
    out.push_back(convert(link_pose(*link, at)));
  }
  return out;
}

Robot read_urdf(const std::string& text) {
  const urdf::ModelInterfaceSharedPtr model = parse(text);
  Robot out;
  out.name = model->getName();
  out.root = model->getRoot() ? model->getRoot()->name : std::string();
  for (const auto& [name, link] : model->links_) out.links.push_back(convert(*link));
  for (const auto& [name, joint] : model->joints_) out.joints.push_back(convert(*joint));
  return out;
}

}  // namespace proact::description
