#include "large_islands.hpp"

#include "engines/reduced/arm_tree.hpp"
#include "proact/dynamics/world.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>

namespace proact::dynamics {

namespace {

// A link wakes what it is nearer to than this, metres: at 2 m/s a tick before they touch.
constexpr double near_link = 2e-3;
// A contact point is the one of the last tick if it is no farther from it than this, metres.
constexpr double same_point = 2e-3;
// A block at rest wakes when the forces on it have changed by more than this share of its weight. How a heap shares out
// forces is not determined, and what settles anew around a block that has come to rest changes them by a third.
constexpr double waking_share = 0.5;
// Or when a neighbour that bore or pressed this share of its weight has come off.
constexpr double lost_share = 0.1;
// One that rests for so many ticks longer than others must comes to rest although those that touch it still move.
constexpr int most_patience = 250;

bool is_arm(const Side& side) { return side.block == no_index && (side.arm != no_index || side.body != nullptr); }

}  // namespace

LargeIslands::LargeIslands(const Model& model, BlockBodies& blocks, const Carrying& carrying)
    : model_(model),
      blocks_(blocks),
      carrying_(carrying),
      large_(blocks.count(), 0),
      resting_(blocks.count(), 0),
      hanging_(blocks.count(), 0),
      touched_(blocks.count(), 0),
      parent_(blocks.count() + 1),
      size_(blocks.count() + 1),
      kept_(blocks.count(), 0),
      stirred_(blocks.count() + 1, 0),
      left_(blocks.count(), 0),
      body_of_(blocks.count(), no_index),
      force_(blocks.count()),
      torque_(blocks.count()) {
  sweeps_.normal_softness = model.options.contact_cfm;
  others_.reserve(World::contact_capacity);
  touches_.reserve(World::contact_capacity);
  order_.reserve(World::contact_capacity);
  solved_.reserve(World::contact_capacity);
  kept_points_.reserve(World::contact_capacity);
  remembered_.reserve(World::contact_capacity);
  noted_.reserve(World::contact_capacity);
  presses_.reserve(World::contact_capacity);
  moving_.reserve(blocks.count());
  sweeps_.reserve(blocks.count(), World::contact_capacity);
}

void LargeIslands::wake_near(const Geoms& geoms) {
  for (const Geom& block : geoms.blocks) {
    if (large_[block.owner] == 0 || carrying_.carries(block.owner)) continue;
    std::array<dReal, 6> wide = block.bounds;
    for (std::size_t k = 0; k < 6; k += 2) {
      wide[k] -= near_link;
      wide[k + 1] += near_link;
    }
    const bool near = std::any_of(geoms.near.begin(), geoms.near.end(), [&](std::size_t link) { return !apart(wide, geoms.links[link].bounds); });
    kept_[block.owner] = near ? 1 : 0;
    if (near) wake(block.owner);
  }
}

std::size_t LargeIslands::root(std::size_t node) {
  while (parent_[node] != node) {
    parent_[node] = parent_[parent_[node]];
    node = parent_[node];
  }
  return node;
}

void LargeIslands::join(std::size_t a, std::size_t b) {
  const std::size_t from = root(std::max(a, b));
  const std::size_t into = root(std::min(a, b));
  if (from == into) return;
  // The arm has the largest number and is nobody's root: it is never joined here.
  parent_[from] = into;
  size_[into] += size_[from];
}

/// Tells which blocks belong to large islands, by the contacts of this tick and those between blocks at rest.
void LargeIslands::find_islands(const std::vector<Touch>& touches) {
  for (std::size_t k = 0; k < parent_.size(); ++k) parent_[k] = k;
  std::fill(size_.begin(), size_.end(), 1);
  for (const Touch& touch : touches) {
    if (touch.first.block != no_index && touch.second.block != no_index) join(touch.first.block, touch.second.block);
  }
  for (const Press& press : presses_) join(press.block, press.neighbour);
  const bool coupled = model_.options.engine == Engine::reduced;
  std::fill(touched_.begin(), touched_.end(), coupled && distrusts_ode_ ? 0 : 1);
  for (const Touch& touch : touches) {
    if (is_arm(touch.first) && touch.second.block != no_index) touched_[root(touch.second.block)] = 1;
    if (is_arm(touch.second) && touch.first.block != no_index) touched_[root(touch.first.block)] = 1;
  }
  for (std::size_t k = 0; k < large_.size(); ++k) {
    large_[k] = size_[root(k)] > model_.options.large_island || touched_[root(k)] == 0 ? 1 : 0;
  }
  // What is left of a heap sleeps as any other block does.
  const auto small = [&](const Press& press) { return large_[press.block] == 0; };
  presses_.erase(std::remove_if(presses_.begin(), presses_.end(), small), presses_.end());
  for (std::size_t k = 0; k < large_.size(); ++k) {
    if (large_[k] == 0) resting_[k] = 0;
  }
}

/// Tells which blocks that move hang together with the arm.
void LargeIslands::find_hanging(const std::vector<Touch>& touches) {
  const std::size_t arm = large_.size();
  for (std::size_t k = 0; k < parent_.size(); ++k) parent_[k] = k;
  const auto node = [&](const Side& side) {
    if (is_arm(side)) return arm;
    return side.block != no_index && resting_[side.block] == 0 ? side.block : no_index;
  };
  for (const Touch& touch : touches) {
    const std::size_t a = node(touch.first);
    const std::size_t b = node(touch.second);
    if (a != no_index && b != no_index) join(a, b);
  }
  const std::size_t held = root(arm);
  for (std::size_t k = 0; k < large_.size(); ++k) hanging_[k] = root(k) == held ? 1 : 0;
}

void LargeIslands::split(const std::vector<Touch>& touches) {
  others_.clear();
  touches_.clear();
  sweeps_.bodies.clear();
  sweeps_.points.clear();
  for (const std::size_t block : moving_) body_of_[block] = no_index;
  moving_.clear();
  noted_.clear();
  if (large_.size() <= model_.options.large_island && !distrusts_ode_) {
    others_.assign(touches.begin(), touches.end());
    return;
  }
  // Nothing has moved since all of it came to rest.
  if (touches.empty() && blocks_.all_asleep()) return;
  find_islands(touches);
  const bool coupled = model_.options.engine == Engine::reduced;
  if (!coupled) find_hanging(touches);

  const auto mine = [&](const Side& side) { return side.block != no_index && large_[side.block] != 0; };
  for (const Touch& touch : touches) {
    const bool heaps = mine(touch.first) || mine(touch.second);
    if (!heaps) {
      others_.push_back(touch);
      continue;
    }
    // Who stands still is part of the room. Others of a large island are awake as soon as they are touched.
    Touch seen = touch;
    for (Side* const side : {&seen.first, &seen.second}) {
      if (side->block == no_index) continue;
      if (resting_[side->block] != 0) {
        seen.still = side->block;
        *side = Side{};
      } else if (blocks_.asleep(side->block)) {
        blocks_.wake(side->block);
      }
    }
    const auto moves = [](const Side& side) { return side.block != no_index || is_arm(side); };
    if (!moves(seen.first) && !moves(seen.second)) continue;
    const auto hangs = [&](const Side& side) { return is_arm(side) || (side.block != no_index && hanging_[side.block] != 0); };
    const bool arms = coupled ? is_arm(seen.first) || is_arm(seen.second) : hangs(seen.first) || hangs(seen.second);
    (arms ? others_ : touches_).push_back(seen);
  }
  for (std::size_t k = 0; k < large_.size(); ++k) {
    if (large_[k] == 0 || resting_[k] != 0 || carrying_.carries(k) || blocks_.asleep(k)) continue;
    if (!coupled && hanging_[k] != 0) continue;
    body_of_[k] = moving_.size();
    moving_.push_back(k);
  }
}

std::uint64_t LargeIslands::pair_of(const Touch& touch) const {
  const auto number = [&](const Side& side) -> std::uint64_t {
    if (side.block != no_index) return side.block;
    return touch.still != no_index ? touch.still : large_.size();
  };
  return number(touch.first) * (large_.size() + 1) + number(touch.second);
}

/// The impulse of the nearest point of the same pair in the last tick that is not taken.
Vec3 LargeIslands::guess(const Touch& touch) {
  const std::uint64_t pair = pair_of(touch);
  const auto before = [](const Remembered& a, std::uint64_t b) { return a.pair < b; };
  double nearest = same_point * same_point;
  Remembered* found = nullptr;
  for (auto it = std::lower_bound(remembered_.begin(), remembered_.end(), pair, before); it != remembered_.end() && it->pair == pair; ++it) {
    const Vec3 way = it->position - touch.point.position;
    const double distance = dot(way, way);
    if (it->taken || distance >= nearest) continue;
    nearest = distance;
    found = &*it;
  }
  if (found == nullptr) return {};
  found->taken = true;
  return found->impulse;
}

void LargeIslands::add_body(std::size_t block) {
  const dBodyID body = blocks_.body(block);
  dMass mass;
  dBodyGetMass(body, &mass);
  const Symmetric own{mass.I[0], mass.I[1], mass.I[2], mass.I[5], mass.I[6], mass.I[10]};
  const Quat turn = to_quat(dBodyGetQuaternion(body));
  const Symmetric inverse_inertia = rotated(turn, inverse(own));
  const Vec3 angular = angular_velocity(body);
  const Vec3 torque = to_vec(dBodyGetTorque(body)) - cross(angular, rotated(turn, own) * angular);
  dBodySetTorque(body, 0, 0, 0);
  sweeps_.bodies.push_back({linear_velocity(body) + model_.options.gravity * tick_secs,
                            angular + inverse_inertia * torque * tick_secs, 1.0 / mass.mass, inverse_inertia, 0.0});
}

void LargeIslands::begin() {
  for (const std::size_t block : moving_) add_body(block);
  const Options& options = model_.options;
  for (const Touch& touch : touches_) {
    ContactSweeps::Point point;
    const auto lever = [&](const Side& side, std::size_t& body, Vec3& out) {
      if (side.block == no_index) return;
      body = body_of_[side.block];
      out = touch.point.position - to_vec(dBodyGetPosition(blocks_.body(side.block)));
    };
    lever(touch.first, point.first, point.first_lever);
    lever(touch.second, point.second, point.second_lever);
    point.normal = touch.point.normal;
    point.speed = std::min(options.contact_erp / tick_secs * std::max(0.0, touch.point.depth - options.surface_layer), options.correcting_speed);
    point.friction = touch.friction;
    point.impulse = guess(touch);
    sweeps_.points.push_back(point);
  }
  sweeps_.begin();
}

double LargeIslands::small_speed() const { return std::max(model_.options.sweep_speed, model_.options.sweep_share * sweeps_.mean_speed()); }

void LargeIslands::settle() {
  const Options& options = model_.options;
  sweeps_.settle(sweeps_.mean_speed() > options.motion ? options.sweeps_in_motion : options.sweeps, small_speed());
}

void LargeIslands::move() {
  for (std::size_t k = 0; k < moving_.size(); ++k) {
    const dBodyID body = blocks_.body(moving_[k]);
    const ContactSweeps::Body& speeds = sweeps_.bodies[k];
    set_body_pose(body, moved(body_pose(body), speeds.linear, speeds.angular, tick_secs));
    set_body_velocity(body, speeds.linear, speeds.angular);
    dBodyDisable(body);
  }
}

void LargeIslands::note(const Touch& touch, const Vec3& impulse) {
  if (touch.still == no_index) return;
  const Side& other = touch.first.block != no_index ? touch.first : touch.second;
  const Vec3 force = impulse * ((touch.first.block == other.block ? -1.0 : 1.0) / tick_secs);
  const Vec3 lever = touch.point.position - to_vec(dBodyGetPosition(blocks_.body(touch.still)));
  noted_.push_back({touch.still, other.block, force, cross(lever, force)});
}

double LargeIslands::weight(std::size_t block) const { return model_.blocks[block].mass * norm(model_.options.gravity); }

/// Keeps the impulses as guesses: of this tick, and of pairs that were not solved because one of them is at rest.
void LargeIslands::remember() {
  // Points of one pair stay in their order. What sorts or merges in place stably would ask for memory.
  order_.clear();
  for (std::size_t k = 0; k < touches_.size(); ++k) order_.emplace_back(pair_of(touches_[k]), k);
  std::sort(order_.begin(), order_.end());
  solved_.clear();
  for (const auto& [pair, k] : order_) solved_.push_back({pair, touches_[k].point.position, sweeps_.points[k].impulse, false});
  const auto before = [](const Remembered& a, const Remembered& b) { return a.pair < b.pair; };
  kept_points_.clear();
  const std::uint64_t numbers = large_.size() + 1;
  const auto rests = [&](std::uint64_t block) { return block < large_.size() && resting_[block] != 0; };
  for (const Remembered& old : remembered_) {
    if (!rests(old.pair / numbers) && !rests(old.pair % numbers)) continue;
    if (!std::binary_search(solved_.begin(), solved_.end(), old, before)) kept_points_.push_back({old.pair, old.position, old.impulse, false});
  }
  remembered_.clear();
  std::merge(solved_.begin(), solved_.end(), kept_points_.begin(), kept_points_.end(), std::back_inserter(remembered_), before);
}

void LargeIslands::wake(std::size_t block) {
  blocks_.wake(block);
  if (resting_[block] == 0) return;
  resting_[block] = 0;
  const auto of_block = [block](const Press& press) { return press.block == block; };
  presses_.erase(std::remove_if(presses_.begin(), presses_.end(), of_block), presses_.end());
}

void LargeIslands::come_to_rest(std::size_t block) {
  set_body_velocity(blocks_.body(block), {}, {});
  dBodyDisable(blocks_.body(block));
  resting_[block] = 1;
  const std::size_t first = presses_.size();
  const auto add = [&](std::size_t neighbour, const Vec3& force, const Vec3& lever) {
    for (std::size_t k = first; k < presses_.size(); ++k) {
      if (presses_[k].neighbour != neighbour) continue;
      presses_[k].force = presses_[k].force + force;
      presses_[k].torque = presses_[k].torque + cross(lever, force);
      return;
    }
    presses_.push_back({block, neighbour, force, cross(lever, force)});
  };
  for (std::size_t k = 0; k < touches_.size(); ++k) {
    const Touch& touch = touches_[k];
    const ContactSweeps::Point& point = sweeps_.points[k];
    const bool is_first = touch.first.block == block;
    if (!is_first && touch.second.block != block) continue;
    const std::size_t other = is_first ? touch.second.block : touch.first.block;
    const std::size_t neighbour = other != no_index ? other : touch.still;
    if (neighbour == no_index) continue;
    add(neighbour, point.impulse * ((is_first ? 1.0 : -1.0) / tick_secs), is_first ? point.first_lever : point.second_lever);
  }
}

void LargeIslands::finish() {
  if (moving_.empty() && noted_.empty()) return;
  for (const std::size_t block : moving_) dBodyEnable(blocks_.body(block));

  // How the forces on blocks at rest have changed.
  std::fill(force_.begin(), force_.end(), Vec3{});
  std::fill(torque_.begin(), torque_.end(), Vec3{});
  const auto add = [&](const Press& press, double sign) {
    force_[press.block] = force_[press.block] + press.force * sign;
    torque_[press.block] = torque_[press.block] + press.torque * sign;
  };
  for (std::size_t k = 0; k < touches_.size(); ++k) note(touches_[k], sweeps_.points[k].impulse);
  for (const Press& press : noted_) add(press, 1.0);
  std::fill(left_.begin(), left_.end(), 0);
  for (const Press& press : presses_) {
    if (resting_[press.neighbour] != 0) continue;
    add(press, -1.0);
    const auto touches = [&](const Press& now) { return now.block == press.block && now.neighbour == press.neighbour; };
    const bool off = norm(press.force) > lost_share * weight(press.block) && std::none_of(noted_.begin(), noted_.end(), touches);
    if (off) left_[press.block] = 1;
  }
  remember();
  for (std::size_t k = 0; k < resting_.size(); ++k) {
    if (resting_[k] == 0) continue;
    const auto& size = model_.blocks[k].shape.size;
    const double changed = norm(force_[k]) + 2.0 * norm(torque_[k]) / std::max(size[0], std::max(size[1], size[2]));
    if (left_[k] != 0 || changed > waking_share * weight(k)) wake(k);
  }
  if (model_.options.sleep) let_rest();
}

/// Blocks that move and hang together come to rest at once, so that none of them feels the others' forces settle anew;
/// where a hand keeps some awake, one by one.
void LargeIslands::let_rest() {
  for (std::size_t k = 0; k < parent_.size(); ++k) parent_[k] = k;
  for (const Touch& touch : touches_) {
    if (touch.first.block != no_index && touch.second.block != no_index) join(touch.first.block, touch.second.block);
  }
  std::fill(stirred_.begin(), stirred_.end(), 0);
  for (const std::size_t block : moving_) {
    if (!blocks_.idle_long(block)) stirred_[root(block)] |= 1;
    if (kept_[block] != 0) stirred_[root(block)] |= 2;
  }
  for (const std::size_t block : moving_) {
    const int stirred = stirred_[root(block)];
    const int long_idle = stirred == 0 || (stirred & 2) != 0 ? 0 : most_patience;
    if (blocks_.until_sleep()[block] <= -long_idle) come_to_rest(block);
  }
}

LargeIslands::State LargeIslands::state() const {
  return {{large_.begin(), large_.end()}, {resting_.begin(), resting_.end()}, presses_, remembered_, distrusts_ode_};
}

void LargeIslands::restore(const State& state) {
  large_.assign(state.large.begin(), state.large.end());
  resting_.assign(state.resting.begin(), state.resting.end());
  presses_ = state.presses;
  remembered_ = state.remembered;
  distrusts_ode_ = state.distrusts_ode;
}

}  // namespace proact::dynamics
