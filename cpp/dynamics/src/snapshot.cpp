#include "snapshot.hpp"

#include <cmath>
#include <cstdint>
#include <limits>
#include <stdexcept>
#include <string>
#include <utility>

namespace proact::dynamics {

namespace {

constexpr int max_int = std::numeric_limits<int>::max();
// Doubles tell whole numbers apart up to here.
constexpr std::size_t max_exact_integer = std::size_t{1} << 53U;

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
  void add(const OdeBodyState& body) {
    add(body.pose);
    add(body.linear);
    add(body.angular);
    add(body.enabled ? 1.0 : 0.0);
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
  std::vector<double> numbers(std::size_t count) {
    std::vector<double> out(count);
    for (double& value : out) value = number();
    return out;
  }
  std::vector<int> wholes(std::size_t count, int low, int high) {
    std::vector<int> out(count);
    for (int& value : out) value = whole(low, high);
    return out;
  }
  std::vector<bool> flags(std::size_t count) {
    std::vector<bool> out(count);
    for (std::size_t k = 0; k < count; ++k) out[k] = flag();
    return out;
  }
  bool flag() { return whole(0, 1) != 0; }
  OdeBodyState body() {
    const Pose at = pose();
    const Vec3 linear = vec();
    const Vec3 angular = vec();
    return {at, linear, angular, flag()};
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

/// Bodies of ODE that the arm consists of while the joints `held` are rigid.
std::size_t arm_body_count(const Model& model, const std::vector<bool>& held) {
  // The arm in joint angles has none.
  if (model.options.engine == Engine::reduced) return 0;
  std::size_t bodies = 1;
  for (std::size_t k = 0; k < held.size(); ++k) {
    if (movable(model.joints[model.moving[k]]) && !held[k]) ++bodies;
  }
  return bodies;
}

void add_islands(Writer& out, const LargeIslands::State& islands) {
  out.add_all(islands.large);
  out.add_all(islands.resting);
  out.add(static_cast<double>(islands.resting_forces.size()));
  for (const LargeIslands::RestingForce& press : islands.resting_forces) {
    out.add(static_cast<double>(press.block));
    out.add(static_cast<double>(press.neighbor));
    out.add(press.force);
    out.add(press.torque);
  }
  out.add(islands.ode_unreliable ? 1.0 : 0.0);
  out.add(static_cast<double>(islands.cached_contacts.size()));
  for (const LargeIslands::CachedContact& point : islands.cached_contacts) {
    out.add(static_cast<double>(point.pair));
    out.add(point.position);
    out.add(point.impulse);
  }
}

LargeIslands::State read_islands(Reader& in, std::size_t blocks) {
  // Contacts of a pair of blocks, of all pairs: more than there can be.
  const std::size_t numbers = blocks + 1;
  const std::size_t points = ContactPoints::capacity * numbers * numbers + 1;
  LargeIslands::State out;
  out.large = in.flags(blocks);
  out.resting = in.flags(blocks);
  out.resting_forces.resize(in.index("forces on blocks at rest", numbers * numbers));
  for (LargeIslands::RestingForce& press : out.resting_forces) {
    press.block = in.index("block at rest", blocks);
    press.neighbor = in.index("neighbour", blocks);
    press.force = in.vec();
    press.torque = in.vec();
  }
  out.ode_unreliable = in.whole(0, 1) != 0;
  out.cached_contacts.resize(in.index("contacts remembered", points));
  for (LargeIslands::CachedContact& point : out.cached_contacts) {
    point.pair = in.index("pair", numbers * numbers);
    point.position = in.vec();
    point.impulse = in.vec();
    point.used = false;
  }
  return out;
}

}  // namespace

std::vector<double> serialize(const Model& model, const Snapshot& snapshot) {
  Writer out;
  const ArmJoints::State& joints = snapshot.joints;
  for (const std::size_t size :
       {model.links.size(), joints.positions.size(), snapshot.blocks.size(), snapshot.arm.bodies.size()}) {
    out.add(static_cast<double>(size));
  }
  out.add_all(joints.positions);
  out.add_all(joints.velocities);
  out.add_all(joints.efforts);
  out.add_all(joints.limit_effort);
  out.add_all(joints.last_command);
  out.add_all(snapshot.control.gains_command);
  out.add_all(joints.locked);
  out.add_all(joints.idle_ticks);
  out.add_all(snapshot.control.stop);
  out.add_all(snapshot.arm.motor_states);
  out.add_all(snapshot.separated);
  out.add_all(snapshot.ticks_until_sleep);
  out.add(snapshot.arm.built_base);
  out.add(snapshot.base.world_from_base);
  out.add(snapshot.base.linear);
  out.add(snapshot.base.angular);
  out.add(snapshot.base.held ? 1.0 : 0.0);
  out.add(static_cast<double>(snapshot.ode.seed));
  out.add(static_cast<double>(snapshot.ode.warnings));
  out.add(snapshot.attached ? 1.0 : 0.0);
  if (snapshot.attached) {
    out.add(static_cast<double>(snapshot.attached->block));
    out.add(static_cast<double>(snapshot.attached->link));
    out.add(snapshot.attached->link_from_block);
  }
  for (const BodyState& block : snapshot.blocks) {
    out.add(block.pose);
    out.add(block.linear);
    out.add(block.angular);
  }
  for (const OdeBodyState& body : snapshot.arm.bodies) out.add(body);
  for (const OdeBodyState& body : snapshot.block_bodies) out.add(body);
  out.add(static_cast<double>(snapshot.contacts.size()));
  for (const Contact& contact : snapshot.contacts) {
    out.add(static_cast<double>(contact.block));
    out.add(static_cast<double>(contact.link));
    out.add(contact.point);
    out.add(contact.normal);
    out.add(contact.force);
  }
  add_islands(out, snapshot.islands);
  return out.take();
}

Snapshot deserialize(const Model& model, const std::vector<double>& numbers) {
  const std::size_t links = model.links.size();
  const std::size_t joints = model.moving.size();
  const std::size_t blocks = model.blocks.size();
  Reader in(numbers);
  const auto same = [&](const char* what, std::size_t expected) {
    const std::size_t got = in.index(what, 1000000);
    if (got != expected) {
      throw std::invalid_argument("snapshot: " + std::to_string(got) + " " + what + ", this world has " + std::to_string(expected));
    }
  };
  same("links", links);
  same("joints", joints);
  same("blocks", blocks);
  const std::size_t body_count = in.index("bodies", links + 1);

  Snapshot out;
  out.joints.positions = in.numbers(joints);
  out.joints.velocities = in.numbers(joints);
  out.joints.efforts = in.numbers(joints);
  out.joints.limit_effort = in.numbers(joints);
  out.joints.last_command = in.numbers(joints);
  out.control.gains_command = in.numbers(joints);
  out.joints.locked = in.flags(joints);
  out.joints.idle_ticks = in.wholes(joints, 0, max_int);
  out.control.stop = in.wholes(joints, -1, 1);
  out.arm.motor_states = in.wholes(joints, -1, 1);
  out.separated = in.flags(links * blocks);
  out.ticks_until_sleep = in.wholes(blocks, -max_int, max_int);
  out.arm.built_base = in.pose();
  out.base.world_from_base = in.pose();
  out.base.linear = in.vec();
  out.base.angular = in.vec();
  out.base.held = in.flag();
  out.ode.seed = static_cast<unsigned long>(in.index("seed", max_exact_integer));
  out.ode.warnings = static_cast<std::uint64_t>(in.index("count of complaints", max_exact_integer));
  if (in.flag()) {
    const std::size_t block = in.index("attached block", blocks);
    const std::size_t link = in.index("attached link", links);
    out.attached = Attachment{block, link, in.pose()};
  }
  out.blocks.resize(blocks);
  for (BodyState& block : out.blocks) {
    block.pose = in.pose();
    block.linear = in.vec();
    block.angular = in.vec();
  }
  if (const std::size_t needed = arm_body_count(model, out.joints.locked); needed != body_count) {
    throw std::invalid_argument("snapshot: " + std::to_string(body_count) + " bodies, its free joints need " + std::to_string(needed));
  }
  for (std::size_t k = 0; k < body_count; ++k) out.arm.bodies.push_back(in.body());
  for (std::size_t k = 0; k < blocks; ++k) out.block_bodies.push_back(in.body());
  out.contacts.resize(in.index("contacts", World::contact_capacity + 1));
  for (Contact& contact : out.contacts) {
    contact.block = in.index("contact's block", blocks);
    contact.link = in.index("contact's link", links);
    contact.point = in.vec();
    contact.normal = in.vec();
    contact.force = in.number();
  }
  out.islands = read_islands(in, blocks);
  in.finish();
  return out;
}

}  // namespace proact::dynamics
