#include "proact-dynamics/src/adapter.hpp"

#include "proact-dynamics/src/bridge.rs.h"

#include <algorithm>
#include <string>

namespace proact::dynamics {

namespace {

Vec3 to_vec(const double* v) { return {v[0], v[1], v[2]}; }

void write(const Pose& pose, double* out) {
  const std::array<double, 7> numbers = pose_to_array(pose);
  std::copy(numbers.begin(), numbers.end(), out);
}

void write(const Vec3& v, double* out) {
  out[0] = v.x;
  out[1] = v.y;
  out[2] = v.z;
}

Shape to_shape(ShapeKind kind, In size) { return {kind, {size[0], size[1], size[2]}}; }

}  // namespace

std::unique_ptr<Model> new_model(const DynamicsSettings& settings, In world_from_base) {
  auto model = std::make_unique<Model>();
  Options& options = model->options;
  options.gravity = to_vec(settings.gravity.data());
  options.engine = settings.engine;
  options.solver = settings.solver;
  options.iterations = static_cast<int>(settings.iterations);
  options.seed = settings.seed;
  options.position_gain = settings.position_gain;
  options.lock_idle_hand = settings.lock_idle_hand;
  options.sleep = settings.sleep;
  options.merge_attached = settings.merge_attached;
  options.max_base_speed_m_per_s = settings.max_base_speed_m_per_s;
  options.max_base_turn_rate_rad_per_s = settings.max_base_turn_rate_rad_per_s;
  options.joint_cfm = settings.joint_cfm;
  model->world_from_base = pose_from_array(world_from_base);
  return model;
}

void add_link(Model& model, rust::Str name, double mass, In inertial, In inertia) {
  Link link;
  link.name = std::string(name);
  link.mass = mass;
  link.inertial = pose_from_array(inertial);
  std::copy(inertia.begin(), inertia.end(), link.inertia.begin());
  model.links.push_back(link);
}

void add_collision(Model& model, ShapeKind kind, In size, In pose) {
  model.links.back().collisions.push_back({pose_from_array(pose), to_shape(kind, size)});
}

void add_joint(Model& model, rust::Str name, JointKind kind, std::size_t parent, In origin, In axis, In numbers) {
  model.joints.push_back({std::string(name), kind, parent, pose_from_array(origin), to_vec(axis.data()), numbers[0],
                          numbers[1], numbers[2], numbers[3], numbers[4], numbers[5], numbers[6], numbers[7]});
}

void set_moving(Model& model, rust::Slice<const std::size_t> joints, std::size_t arm_count, In positions) {
  model.moving.assign(joints.begin(), joints.end());
  model.arm_count = arm_count;
  model.positions.assign(positions.begin(), positions.end());
}

void add_fixed(Model& model, rust::Str name, ShapeKind kind, In size, In pose, double friction) {
  model.fixed.push_back({std::string(name), to_shape(kind, size), pose_from_array(pose), friction});
}

void add_block(Model& model, rust::Str name, ShapeKind kind, In size, In pose, In numbers) {
  model.blocks.push_back(
      {std::string(name), to_shape(kind, size), numbers[0], numbers[1], numbers[2], pose_from_array(pose)});
}

std::unique_ptr<World> new_world(const Model& model) { return std::make_unique<World>(model); }

void step_world(World& world, In position, In velocity, In world_from_base) {
  world.step(position.data(), velocity.data(), pose_from_array(world_from_base));
}

void read_joints(const World& world, Out position, Out velocity, Out effort, Out limit_effort) {
  std::copy(world.positions().begin(), world.positions().end(), position.begin());
  std::copy(world.velocities().begin(), world.velocities().end(), velocity.begin());
  std::copy(world.efforts().begin(), world.efforts().end(), effort.begin());
  std::copy(world.limit_effort().begin(), world.limit_effort().end(), limit_effort.begin());
}

void read_block(const World& world, std::size_t block, Out out) {
  const BodyState& state = world.blocks().at(block);
  write(state.pose, out.data());
  write(state.linear, out.data() + 7);
  write(state.angular, out.data() + 10);
}

std::size_t contact_count(const World& world) { return world.contacts().size(); }

ContactRecord read_contact(const World& world, std::size_t index) {
  const Contact& contact = world.contacts().at(index);
  ContactRecord record{contact.block, contact.link, {}, {}, contact.force};
  write(contact.point, record.point.data());
  write(contact.normal, record.normal.data());
  return record;
}

bool read_attached(const World& world, std::size_t& block, Out pose) {
  if (!world.attached()) return false;
  block = world.attached()->block;
  write(world.attached()->link_from_block, pose.data());
  return true;
}

bool base_held(const World& world) { return world.base_held(); }

rust::Vec<double> save_world(const World& world) {
  rust::Vec<double> out;
  for (const double number : world.save()) out.push_back(number);
  return out;
}

void restore_world(World& world, In numbers) { world.restore({numbers.begin(), numbers.end()}); }

void read_link(const World& world, std::size_t link, Out pose) { write(world.link_pose(link), pose.data()); }

void attach_block(World& world, std::size_t block, std::size_t link) { world.attach(block, link); }

void release_block(World& world) { world.release(); }

void place_block(World& world, std::size_t block, In state) {
  const double* n = state.data();
  world.place(block, {pose_from_array(state), {n[7], n[8], n[9]}, {n[10], n[11], n[12]}});
}

std::size_t arm_body_count(const World& world) { return world.arm_body_count(); }

std::uint64_t solver_warnings(const World& world) { return world.solver_warnings(); }

rust::String last_solver_warning(const World& world) { return rust::String::lossy(world.last_solver_warning()); }

}  // namespace proact::dynamics
