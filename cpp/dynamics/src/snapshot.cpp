// Saving and restoring a world, bit for bit.
//
// Bodies and hinges are built again rather than saved: building depends on nothing but the saved numbers. The
// bodies' places are saved beside the angles, because they carry the small errors of ODE's joints.

#include "simulation.hpp"

#include <algorithm>
#include <limits>
#include <stdexcept>
#include <utility>

namespace proact::dynamics {

namespace {

constexpr int most = std::numeric_limits<int>::max();
// Doubles tell whole numbers apart up to here.
constexpr std::size_t whole_numbers = std::size_t{1} << 53U;

/// Appends numbers.
class Writer {
 public:
  void add(double value) { numbers_.push_back(value); }
  void add(const Vec3& v) {
    for (const double value : {v.x, v.y, v.z}) add(value);
  }
  void add(const Pose& pose) {
    add(pose.position);
    for (const double value : {pose.rotation.x, pose.rotation.y, pose.rotation.z, pose.rotation.w}) add(value);
  }
  template <typename T>
  void add_all(const std::vector<T>& values) {
    for (const auto& value : values) add(static_cast<double>(value));
  }
  void add(dBodyID body) {
    add(body_pose(body));
    add(to_vec(dBodyGetLinearVel(body)));
    add(to_vec(dBodyGetAngularVel(body)));
    add(dBodyIsEnabled(body));
  }
  std::vector<double> take() { return std::move(numbers_); }

 private:
  std::vector<double> numbers_;
};

/// Takes numbers from the front.
class Reader {
 public:
  explicit Reader(const std::vector<double>& numbers) : numbers_(numbers) {
    for (std::size_t k = 0; k < numbers.size(); ++k) {
      if (!std::isfinite(numbers[k])) throw std::invalid_argument("snapshot: number " + std::to_string(k) + " is not finite");
    }
  }
  double number() {
    if (next_ == numbers_.size()) throw std::invalid_argument("snapshot: it ends after " + std::to_string(next_) + " numbers");
    return numbers_[next_++];
  }
  /// A whole number below `end`.
  std::size_t index(const char* what, std::size_t end) {
    const double value = number();
    if (value < 0.0 || value >= static_cast<double>(end) || value != std::floor(value)) {
      throw std::invalid_argument(std::string("snapshot: ") + what + " is " + std::to_string(value) + ", expected below " + std::to_string(end));
    }
    return static_cast<std::size_t>(value);
  }
  /// A whole number between two bounds.
  int whole(int low, int high) {
    const double value = number();
    if (value < low || value > high || value != std::floor(value)) {
      throw std::invalid_argument("snapshot: " + std::to_string(value) + ", expected a whole number from " + std::to_string(low) + " to " + std::to_string(high));
    }
    return static_cast<int>(value);
  }
  Vec3 vec() {
    const double x = number();
    const double y = number();
    return {x, y, number()};
  }
  Pose pose() {
    const Vec3 position = vec();
    const Vec3 xyz = vec();
    const Pose pose{position, {xyz.x, xyz.y, xyz.z, number()}};
    const Quat& q = pose.rotation;
    if (std::fabs(q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w - 1.0) > 1e-6) {
      throw std::invalid_argument("snapshot: a rotation is not of length 1");
    }
    return pose;
  }
  void all(std::vector<double>& out) {
    for (double& value : out) value = number();
  }
  void all(std::vector<int>& out, int low, int high) {
    for (int& value : out) value = whole(low, high);
  }
  void all(std::vector<bool>& out) {
    for (std::size_t k = 0; k < out.size(); ++k) out[k] = whole(0, 1) != 0;
  }
  BodyBits body() {
    const Pose at = pose();
    const Vec3 linear = vec();
    const Vec3 angular = vec();
    return {at, linear, angular, whole(0, 1) != 0};
  }
  void finish() const {
    if (next_ != numbers_.size()) {
      throw std::invalid_argument("snapshot: " + std::to_string(numbers_.size()) + " numbers, expected " + std::to_string(next_));
    }
  }

 private:
  const std::vector<double>& numbers_;
  std::size_t next_ = 0;
};

}  // namespace

void BodyBits::put(dBodyID body) const {
  set_body_pose(body, pose);
  // ODE has just normalized the quaternion again, which can change its last bit, so the bits are written over it.
  // The bodies are ODE's own, none of them constant.
  dReal* q = const_cast<dReal*>(dBodyGetQuaternion(body));
  const dQuaternion exact{pose.rotation.w, pose.rotation.x, pose.rotation.y, pose.rotation.z};
  std::copy(std::begin(exact), std::end(exact), q);
  dQtoR(exact, const_cast<dReal*>(dBodyGetRotation(body)));
  dBodySetLinearVel(body, linear.x, linear.y, linear.z);
  dBodySetAngularVel(body, angular.x, angular.y, angular.z);
  if (enabled) {
    dBodyEnable(body);
  } else {
    dBodyDisable(body);
  }
}

std::vector<double> World::Simulation::save() const {
  if (!failure_.empty()) throw std::runtime_error(failure_);
  Writer out;
  for (const std::size_t size : {model_.links.size(), positions_.size(), blocks_.size(), bodies_.size()}) {
    out.add(static_cast<double>(size));
  }
  out.add_all(positions_);
  out.add_all(velocities_);
  out.add_all(efforts_);
  out.add_all(last_command_);
  out.add_all(gains_command_);
  out.add_all(held_);
  out.add_all(still_ticks_);
  out.add_all(stop_);
  out.add_all(motor_states_);
  out.add_all(parted_);
  out.add_all(until_sleep_);
  out.add(built_base_);
  out.add(world_from_base_);
  out.add(base_linear_);
  out.add(base_angular_);
  out.add(base_held_ ? 1.0 : 0.0);
  out.add(static_cast<double>(model_.options.seed));
  out.add(static_cast<double>(complaints_));
  out.add(attached_ ? 1.0 : 0.0);
  if (attached_) {
    out.add(static_cast<double>(attached_->block));
    out.add(static_cast<double>(attached_->link));
    out.add(attached_->link_from_block);
  }
  for (const BodyState& block : blocks_) {
    out.add(block.pose);
    out.add(block.linear);
    out.add(block.angular);
  }
  for (const dBodyID body : bodies_) out.add(body);
  for (const dBodyID body : block_bodies_) out.add(body);
  out.add(static_cast<double>(contacts_.size()));
  for (const Contact& contact : contacts_) {
    out.add(static_cast<double>(contact.block));
    out.add(static_cast<double>(contact.link));
    out.add(contact.point);
    out.add(contact.normal);
    out.add(contact.force);
  }
  return out.take();
}

void World::Simulation::restore(const std::vector<double>& numbers) {
  if (!failure_.empty()) throw std::runtime_error(failure_);
  // All is read and checked before anything changes.
  Reader in(numbers);
  const auto same = [&](const char* what, std::size_t expected) {
    const std::size_t got = in.index(what, 1000000);
    if (got != expected) {
      throw std::invalid_argument("snapshot: " + std::to_string(got) + " " + what + ", this world has " + std::to_string(expected));
    }
  };
  same("links", model_.links.size());
  same("joints", positions_.size());
  same("blocks", blocks_.size());
  const std::size_t body_count = in.index("bodies", model_.links.size() + 1);
  std::vector<double> positions(positions_.size());
  std::vector<double> velocities(positions_.size());
  std::vector<double> efforts(positions_.size());
  std::vector<double> last_command(positions_.size());
  std::vector<double> gains_command(positions_.size());
  std::vector<bool> held(held_.size());
  std::vector<int> still_ticks(still_ticks_.size());
  std::vector<int> stop(stop_.size());
  std::vector<int> motor_states(motor_states_.size());
  std::vector<bool> parted(parted_.size());
  std::vector<int> until_sleep(until_sleep_.size());
  in.all(positions);
  in.all(velocities);
  in.all(efforts);
  in.all(last_command);
  in.all(gains_command);
  in.all(held);
  in.all(still_ticks, 0, most);
  in.all(stop, -1, 1);
  in.all(motor_states, -1, 1);
  in.all(parted);
  in.all(until_sleep, -most, most);
  const Pose built_base = in.pose();
  const Pose world_from_base = in.pose();
  const Vec3 base_linear = in.vec();
  const Vec3 base_angular = in.vec();
  const bool base_held = in.whole(0, 1) != 0;
  const auto seed = static_cast<unsigned long>(in.index("seed", whole_numbers));
  const auto complaints = static_cast<std::uint64_t>(in.index("count of complaints", whole_numbers));
  std::optional<Attachment> attached;
  if (in.whole(0, 1) != 0) {
    const std::size_t block = in.index("attached block", blocks_.size());
    const std::size_t link = in.index("attached link", model_.links.size());
    attached = Attachment{block, link, in.pose()};
  }
  std::vector<BodyState> blocks(blocks_.size());
  for (BodyState& block : blocks) {
    block.pose = in.pose();
    block.linear = in.vec();
    block.angular = in.vec();
  }
  // The arm in joint angles has no bodies of ODE.
  std::size_t hinges = reduced() ? 0 : 1;
  for (std::size_t k = 0; k < model_.joints.size() && !reduced(); ++k) {
    const bool immovable = moving_of_joint_[k] >= held.size() || !movable(k);
    if (!immovable && !held[moving_of_joint_[k]]) ++hinges;
  }
  if (hinges != body_count) {
    throw std::invalid_argument("snapshot: " + std::to_string(body_count) + " bodies, its free joints need " + std::to_string(hinges));
  }
  std::vector<BodyBits> bodies;
  for (std::size_t k = 0; k < body_count + blocks.size(); ++k) bodies.push_back(in.body());
  std::vector<Contact> contacts(in.index("contacts", contact_capacity + 1));
  for (Contact& contact : contacts) {
    contact.block = in.index("contact's block", blocks_.size());
    contact.link = in.index("contact's link", model_.links.size());
    contact.point = in.vec();
    contact.normal = in.vec();
    contact.force = in.number();
  }
  in.finish();

  positions_ = positions;
  velocities_ = velocities;
  efforts_ = efforts;
  last_command_ = last_command;
  gains_command_ = gains_command;
  held_ = held;
  still_ticks_ = still_ticks;
  stop_ = stop;
  motor_states_ = motor_states;
  parted_ = parted;
  until_sleep_ = until_sleep;
  base_linear_ = base_linear;
  base_angular_ = base_angular;
  base_held_ = base_held;
  model_.options.seed = seed;
  complaints_ = complaints;
  attached_ = attached;
  blocks_ = blocks;
  dJointGroupEmpty(contact_group_.get());
  measured_.clear();
  contacts_.assign(contacts.begin(), contacts.end());
  // Where the base was when the bodies were last built decides how their shape was rounded.
  world_from_base_ = built_base;
  build_arm();
  world_from_base_ = world_from_base;
  for (std::size_t k = 0; k < bodies_.size(); ++k) bodies[k].put(bodies_[k]);
  for (std::size_t k = 0; k < block_bodies_.size(); ++k) bodies[body_count + k].put(block_bodies_[k]);
}

}  // namespace proact::dynamics
