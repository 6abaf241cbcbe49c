// The whole arm, the box and its blocks through the C++ core, without Rust. Reads a model and commands as text from
// standard input (written by rust/dynamics/tests/side_by_side.rs) and prints one digest of the state for every tick.

#include "digest.hpp"
#include "proact/dynamics/world.hpp"

#include <cstdio>
#include <exception>
#include <iostream>
#include <stdexcept>
#include <string>
#include <vector>

using namespace proact::dynamics;
using proact::Pose;
using proact::Quat;
using proact::Vec3;

namespace {

double number() {
  std::string text;
  if (!(std::cin >> text)) throw std::runtime_error("the input ends early");
  return std::stod(text);
}
std::size_t count() { return static_cast<std::size_t>(number()); }
std::string word() {
  std::string text;
  if (!(std::cin >> text)) throw std::runtime_error("the input ends early");
  return text;
}
Vec3 vec() {
  const double x = number();
  const double y = number();
  return {x, y, number()};
}
Pose pose() {
  const Vec3 position = vec();
  const double x = number();
  const double y = number();
  const double z = number();
  return {position, {x, y, z, number()}};
}
Shape shape() {
  const auto kind = static_cast<ShapeKind>(count());
  const Vec3 size = vec();
  return {kind, {size.x, size.y, size.z}};
}

Model read_model() {
  Model model;
  model.world_from_base = pose();
  for (std::size_t links = count(); links > 0; --links) {
    Link link;
    link.name = word();
    link.mass = number();
    link.inertial = pose();
    for (double& value : link.inertia) value = number();
    for (std::size_t shapes = count(); shapes > 0; --shapes) {
      const Pose link_from_shape = pose();
      link.collisions.push_back({link_from_shape, shape()});
    }
    model.links.push_back(link);
  }
  for (std::size_t joints = count(); joints > 0; --joints) {
    Joint joint;
    joint.name = word();
    joint.kind = number() != 0.0 ? JointKind::fixed : JointKind::revolute;
    joint.parent = count();
    joint.origin = pose();
    joint.axis = vec();
    for (double* value : {&joint.lower, &joint.upper, &joint.velocity, &joint.effort, &joint.damping, &joint.friction}) {
      *value = number();
    }
    model.joints.push_back(joint);
  }
  model.arm_count = count();
  for (std::size_t moving = count(); moving > 0; --moving) {
    model.moving.push_back(count());
    model.positions.push_back(number());
  }
  for (std::size_t objects = count(); objects > 0; --objects) {
    FixedObject object;
    object.name = word();
    object.shape = shape();
    object.pose = pose();
    object.friction = number();
    model.fixed.push_back(object);
  }
  for (std::size_t blocks = count(); blocks > 0; --blocks) {
    Block block;
    block.name = word();
    block.shape = shape();
    block.mass = number();
    block.friction = number();
    block.friction_finger = number();
    block.pose = pose();
    model.blocks.push_back(block);
  }
  return model;
}

void add(Digest& digest, const Vec3& v) {
  digest.add(v.x);
  digest.add(v.y);
  digest.add(v.z);
}

void add(Digest& digest, const World& world) {
  for (const double value : world.positions()) digest.add(value);
  for (const double value : world.velocities()) digest.add(value);
  for (const double value : world.efforts()) digest.add(value);
  for (const BodyState& block : world.blocks()) {
    add(digest, block.pose.position);
    const Quat& q = block.pose.rotation;
    for (const double value : {q.x, q.y, q.z, q.w}) digest.add(value);
    add(digest, block.linear);
    add(digest, block.angular);
  }
  for (const Contact& contact : world.contacts()) {
    add(digest, contact.point);
    add(digest, contact.normal);
    digest.add(contact.force);
  }
}

}  // namespace

int main() {
  try {
    World world(read_model());
    Digest digest;
    std::vector<double> position(world.joint_count());
    std::vector<double> velocity(world.joint_count());
    const std::size_t ticks = count();
    for (std::size_t tick = 0; tick < ticks; ++tick) {
      // What is done before the tick: a block to attach to a link, "release", or "-".
      const std::string action = word();
      if (action == "attach") {
        const std::size_t block = count();
        world.attach(block, count());
      } else if (action == "release") {
        world.release();
      }
      for (double& value : position) value = number();
      for (double& value : velocity) value = number();
      world.step(position.data(), velocity.data(), pose());
      add(digest, world);
      std::printf("%016llx\n", static_cast<unsigned long long>(digest.value()));
    }
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
  }
  return 0;
}
