#include "large_islands.hpp"

#include "engines/reduced/arm_tree.hpp"
#include "proact/dynamics/world.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>

namespace proact::dynamics {

namespace {

// A link wakes what it is nearer to than this, metres: at 2 m/s a tick before they touch.
constexpr double wake_distance_m = 2e-3;
// A contact point is the one of the last tick if it is no farther from it than this, metres.
constexpr double match_distance_m = 2e-3;
// A block at rest wakes when the forces on it have changed by more than this share of its weight. How a heap shares out
// forces is not determined, and what settles anew around a block that has come to rest changes them by a third.
constexpr double wake_force_ratio = 0.5;
// Or when a neighbour that bore or pressed this share of its weight has come off.
constexpr double lost_force_ratio = 0.1;
// One that rests for so many ticks longer than others must comes to rest although those that touch it still move.
constexpr int max_extra_rest_ticks = 250;

bool is_arm(const ContactSide& side) { return side.block == no_index && (side.arm != no_index || side.body != nullptr); }

}  // namespace

LargeIslands::LargeIslands(const Model& model, BlockBodies& blocks, const BlockAttachment& carrying)
    : model_(model),
      blocks_(blocks),
      carrying_(carrying),
      large_(blocks.count(), 0),
      resting_(blocks.count(), 0),
      arm_connected_(blocks.count(), 0),
      has_other_solver_(blocks.count(), 0),
      parent_(blocks.count() + 1),
      size_(blocks.count() + 1),
      kept_awake_(blocks.count(), 0),
      island_activity_(blocks.count() + 1, 0),
      lost_neighbor_(blocks.count(), 0),
      body_of_(blocks.count(), no_index),
      force_(blocks.count()),
      torque_(blocks.count()) {
  solver_.normal_softness = model.options.contact_cfm;
  remaining_constraints_.reserve(World::contact_capacity);
  constraints_.reserve(World::contact_capacity);
  order_.reserve(World::contact_capacity);
  solved_.reserve(World::contact_capacity);
  resting_contacts_.reserve(World::contact_capacity);
  cached_contacts_.reserve(World::contact_capacity);
  recorded_forces_.reserve(World::contact_capacity);
  resting_forces_.reserve(World::contact_capacity);
  moving_.reserve(blocks.count());
  solver_.reserve(blocks.count(), World::contact_capacity);
}

void LargeIslands::wake_near(const Geoms& geoms) {
  for (const Geom& block : geoms.blocks) {
    if (large_[block.owner] == 0 || carrying_.is_attached(block.owner)) continue;
    std::array<dReal, 6> wide = block.bounds;
    for (std::size_t k = 0; k < 6; k += 2) {
      wide[k] -= wake_distance_m;
      wide[k + 1] += wake_distance_m;
    }
    const bool near = std::any_of(geoms.near_links.begin(), geoms.near_links.end(),
                                  [&](std::size_t link) { return !bounds_disjoint(wide, geoms.links[link].bounds); });
    kept_awake_[block.owner] = near ? 1 : 0;
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
void LargeIslands::find_islands(const std::vector<ContactConstraint>& touches) {
  for (std::size_t k = 0; k < parent_.size(); ++k) parent_[k] = k;
  std::fill(size_.begin(), size_.end(), 1);
  for (const ContactConstraint& touch : touches) {
    if (touch.first.block != no_index && touch.second.block != no_index) join(touch.first.block, touch.second.block);
  }
  for (const RestingForce& press : resting_forces_) join(press.block, press.neighbor);
  const bool coupled = model_.options.engine == Engine::reduced;
  std::fill(has_other_solver_.begin(), has_other_solver_.end(), coupled && ode_unreliable_ ? 0 : 1);
  for (const ContactConstraint& touch : touches) {
    if (is_arm(touch.first) && touch.second.block != no_index) has_other_solver_[root(touch.second.block)] = 1;
    if (is_arm(touch.second) && touch.first.block != no_index) has_other_solver_[root(touch.first.block)] = 1;
  }
  for (std::size_t k = 0; k < large_.size(); ++k) {
    large_[k] = size_[root(k)] > model_.options.large_island || has_other_solver_[root(k)] == 0 ? 1 : 0;
  }
  // What is left of a heap sleeps as any other block does.
  const auto small = [&](const RestingForce& press) { return large_[press.block] == 0; };
  resting_forces_.erase(std::remove_if(resting_forces_.begin(), resting_forces_.end(), small), resting_forces_.end());
  for (std::size_t k = 0; k < large_.size(); ++k) {
    if (large_[k] == 0) resting_[k] = 0;
  }
}

/// Tells which blocks that move hang together with the arm.
void LargeIslands::find_arm_connected(const std::vector<ContactConstraint>& touches) {
  const std::size_t arm = large_.size();
  for (std::size_t k = 0; k < parent_.size(); ++k) parent_[k] = k;
  const auto node = [&](const ContactSide& side) {
    if (is_arm(side)) return arm;
    return side.block != no_index && resting_[side.block] == 0 ? side.block : no_index;
  };
  for (const ContactConstraint& touch : touches) {
    const std::size_t a = node(touch.first);
    const std::size_t b = node(touch.second);
    if (a != no_index && b != no_index) join(a, b);
  }
  const std::size_t held = root(arm);
  for (std::size_t k = 0; k < large_.size(); ++k) arm_connected_[k] = root(k) == held ? 1 : 0;
}

void LargeIslands::assign_contacts(const std::vector<ContactConstraint>& touches) {
  remaining_constraints_.clear();
  constraints_.clear();
  solver_.bodies.clear();
  solver_.points.clear();
  for (const std::size_t block : moving_) body_of_[block] = no_index;
  moving_.clear();
  recorded_forces_.clear();
  if (large_.size() <= model_.options.large_island && !ode_unreliable_) {
    remaining_constraints_.assign(touches.begin(), touches.end());
    return;
  }
  // Nothing has moved since all of it came to rest.
  if (touches.empty() && blocks_.all_asleep()) return;
  find_islands(touches);
  const bool coupled = model_.options.engine == Engine::reduced;
  if (!coupled) find_arm_connected(touches);

  const auto mine = [&](const ContactSide& side) { return side.block != no_index && large_[side.block] != 0; };
  for (const ContactConstraint& touch : touches) {
    const bool heaps = mine(touch.first) || mine(touch.second);
    if (!heaps) {
      remaining_constraints_.push_back(touch);
      continue;
    }
    // Who stands still is part of the room. Others of a large island are awake as soon as they are touched.
    ContactConstraint seen = touch;
    for (ContactSide* const side : {&seen.first, &seen.second}) {
      if (side->block == no_index) continue;
      if (resting_[side->block] != 0) {
        seen.resting_block = side->block;
        *side = ContactSide{};
      } else if (blocks_.is_asleep(side->block)) {
        blocks_.wake(side->block);
      }
    }
    const auto moves = [](const ContactSide& side) { return side.block != no_index || is_arm(side); };
    if (!moves(seen.first) && !moves(seen.second)) continue;
    const auto hangs = [&](const ContactSide& side) {
      return is_arm(side) || (side.block != no_index && arm_connected_[side.block] != 0);
    };
    const bool arms = coupled ? is_arm(seen.first) || is_arm(seen.second) : hangs(seen.first) || hangs(seen.second);
    (arms ? remaining_constraints_ : constraints_).push_back(seen);
  }
  for (std::size_t k = 0; k < large_.size(); ++k) {
    if (large_[k] == 0 || resting_[k] != 0 || carrying_.is_attached(k) || blocks_.is_asleep(k)) continue;
    if (!coupled && arm_connected_[k] != 0) continue;
    body_of_[k] = moving_.size();
    moving_.push_back(k);
  }
}

std::uint64_t LargeIslands::pair_of(const ContactConstraint& touch) const {
  const auto number = [&](const ContactSide& side) -> std::uint64_t {
    if (side.block != no_index) return side.block;
    return touch.resting_block != no_index ? touch.resting_block : large_.size();
  };
  return number(touch.first) * (large_.size() + 1) + number(touch.second);
}

/// The impulse of the nearest point of the same pair in the last tick that is not taken.
Vec3 LargeIslands::warm_start_impulse(const ContactConstraint& touch) {
  const std::uint64_t pair = pair_of(touch);
  const auto before = [](const CachedContact& a, std::uint64_t b) { return a.pair < b; };
  double nearest = match_distance_m * match_distance_m;
  CachedContact* found = nullptr;
  for (auto it = std::lower_bound(cached_contacts_.begin(), cached_contacts_.end(), pair, before);
       it != cached_contacts_.end() && it->pair == pair; ++it) {
    const Vec3 way = it->position - touch.point.position;
    const double distance = dot(way, way);
    if (it->used || distance >= nearest) continue;
    nearest = distance;
    found = &*it;
  }
  if (found == nullptr) return {};
  found->used = true;
  return found->impulse;
}

void LargeIslands::add_body(std::size_t block) {
  const dBodyID body = blocks_.body(block);
  dMass mass;
  dBodyGetMass(body, &mass);
  const SymmetricMatrix3 own{mass.I[0], mass.I[1], mass.I[2], mass.I[5], mass.I[6], mass.I[10]};
  const Quat turn = to_quat(dBodyGetQuaternion(body));
  const SymmetricMatrix3 inverse_inertia = rotated(turn, inverse(own));
  const Vec3 angular = angular_velocity(body);
  const Vec3 torque = to_vec(dBodyGetTorque(body)) - cross(angular, rotated(turn, own) * angular);
  dBodySetTorque(body, 0, 0, 0);
  solver_.bodies.push_back({linear_velocity(body) + model_.options.gravity * tick_secs,
                            angular + inverse_inertia * torque * tick_secs, 1.0 / mass.mass, inverse_inertia, 0.0});
}

void LargeIslands::begin_solve() {
  for (const std::size_t block : moving_) add_body(block);
  const Options& options = model_.options;
  for (const ContactConstraint& touch : constraints_) {
    PgsContactSolver::Point point;
    const auto lever = [&](const ContactSide& side, std::size_t& body, Vec3& out) {
      if (side.block == no_index) return;
      body = body_of_[side.block];
      out = touch.point.position - to_vec(dBodyGetPosition(blocks_.body(side.block)));
    };
    lever(touch.first, point.first, point.first_lever);
    lever(touch.second, point.second, point.second_lever);
    point.normal = touch.point.normal;
    point.speed = std::min(options.contact_erp / tick_secs * std::max(0.0, touch.point.depth - options.surface_layer),
                           options.max_correcting_speed_m_per_s);
    point.friction = touch.friction;
    point.impulse = warm_start_impulse(touch);
    solver_.points.push_back(point);
  }
  solver_.begin();
}

double LargeIslands::small_speed() const {
  return std::max(model_.options.sweep_tolerance_m_per_s, model_.options.sweep_tolerance_ratio * solver_.mean_speed());
}

void LargeIslands::solve() {
  const Options& options = model_.options;
  solver_.solve(solver_.mean_speed() > options.motion_speed_m_per_s ? options.sweeps_in_motion : options.sweeps,
                small_speed());
}

void LargeIslands::integrate() {
  for (std::size_t k = 0; k < moving_.size(); ++k) {
    const dBodyID body = blocks_.body(moving_[k]);
    const PgsContactSolver::Body& speeds = solver_.bodies[k];
    set_body_pose(body, integrate_pose(body_pose(body), speeds.linear, speeds.angular, tick_secs));
    set_body_velocity(body, speeds.linear, speeds.angular);
    dBodyDisable(body);
  }
}

void LargeIslands::record_impulse(const ContactConstraint& touch, const Vec3& impulse) {
  if (touch.resting_block == no_index) return;
  const ContactSide& other = touch.first.block != no_index ? touch.first : touch.second;
  const Vec3 force = impulse * ((touch.first.block == other.block ? -1.0 : 1.0) / tick_secs);
  const Vec3 lever = touch.point.position - to_vec(dBodyGetPosition(blocks_.body(touch.resting_block)));
  recorded_forces_.push_back({touch.resting_block, other.block, force, cross(lever, force)});
}

double LargeIslands::weight(std::size_t block) const { return model_.blocks[block].mass * norm(model_.options.gravity); }

/// Keeps the impulses as guesses: of this tick, and of pairs that were not solved because one of them is at rest.
void LargeIslands::cache_impulses() {
  // Points of one pair stay in their order. What sorts or merges in place stably would ask for memory.
  order_.clear();
  for (std::size_t k = 0; k < constraints_.size(); ++k) order_.emplace_back(pair_of(constraints_[k]), k);
  std::sort(order_.begin(), order_.end());
  solved_.clear();
  for (const auto& [pair, k] : order_) {
    solved_.push_back({pair, constraints_[k].point.position, solver_.points[k].impulse, false});
  }
  const auto before = [](const CachedContact& a, const CachedContact& b) { return a.pair < b.pair; };
  resting_contacts_.clear();
  const std::uint64_t numbers = large_.size() + 1;
  const auto rests = [&](std::uint64_t block) { return block < large_.size() && resting_[block] != 0; };
  for (const CachedContact& old : cached_contacts_) {
    if (!rests(old.pair / numbers) && !rests(old.pair % numbers)) continue;
    if (!std::binary_search(solved_.begin(), solved_.end(), old, before)) {
      resting_contacts_.push_back({old.pair, old.position, old.impulse, false});
    }
  }
  cached_contacts_.clear();
  std::merge(solved_.begin(), solved_.end(), resting_contacts_.begin(), resting_contacts_.end(),
             std::back_inserter(cached_contacts_), before);
}

void LargeIslands::wake(std::size_t block) {
  blocks_.wake(block);
  if (resting_[block] == 0) return;
  resting_[block] = 0;
  const auto of_block = [block](const RestingForce& press) { return press.block == block; };
  resting_forces_.erase(std::remove_if(resting_forces_.begin(), resting_forces_.end(), of_block), resting_forces_.end());
}

void LargeIslands::put_to_rest(std::size_t block) {
  set_body_velocity(blocks_.body(block), {}, {});
  dBodyDisable(blocks_.body(block));
  resting_[block] = 1;
  const std::size_t first = resting_forces_.size();
  const auto add = [&](std::size_t neighbor, const Vec3& force, const Vec3& lever) {
    for (std::size_t k = first; k < resting_forces_.size(); ++k) {
      if (resting_forces_[k].neighbor != neighbor) continue;
      resting_forces_[k].force = resting_forces_[k].force + force;
      resting_forces_[k].torque = resting_forces_[k].torque + cross(lever, force);
      return;
    }
    resting_forces_.push_back({block, neighbor, force, cross(lever, force)});
  };
  for (std::size_t k = 0; k < constraints_.size(); ++k) {
    const ContactConstraint& touch = constraints_[k];
    const PgsContactSolver::Point& point = solver_.points[k];
    const bool is_first = touch.first.block == block;
    if (!is_first && touch.second.block != block) continue;
    const std::size_t other = is_first ? touch.second.block : touch.first.block;
    const std::size_t neighbor = other != no_index ? other : touch.resting_block;
    if (neighbor == no_index) continue;
    add(neighbor, point.impulse * ((is_first ? 1.0 : -1.0) / tick_secs), is_first ? point.first_lever : point.second_lever);
  }
}

void LargeIslands::end_step() {
  if (moving_.empty() && recorded_forces_.empty()) return;
  for (const std::size_t block : moving_) dBodyEnable(blocks_.body(block));

  // How the forces on blocks at rest have changed.
  std::fill(force_.begin(), force_.end(), Vec3{});
  std::fill(torque_.begin(), torque_.end(), Vec3{});
  const auto add = [&](const RestingForce& press, double sign) {
    force_[press.block] = force_[press.block] + press.force * sign;
    torque_[press.block] = torque_[press.block] + press.torque * sign;
  };
  for (std::size_t k = 0; k < constraints_.size(); ++k) record_impulse(constraints_[k], solver_.points[k].impulse);
  for (const RestingForce& press : recorded_forces_) add(press, 1.0);
  std::fill(lost_neighbor_.begin(), lost_neighbor_.end(), 0);
  for (const RestingForce& press : resting_forces_) {
    if (resting_[press.neighbor] != 0) continue;
    add(press, -1.0);
    const auto touches = [&](const RestingForce& now) {
      return now.block == press.block && now.neighbor == press.neighbor;
    };
    const bool off = norm(press.force) > lost_force_ratio * weight(press.block) &&
                     std::none_of(recorded_forces_.begin(), recorded_forces_.end(), touches);
    if (off) lost_neighbor_[press.block] = 1;
  }
  cache_impulses();
  for (std::size_t k = 0; k < resting_.size(); ++k) {
    if (resting_[k] == 0) continue;
    const auto& size = model_.blocks[k].shape.size;
    const double changed = norm(force_[k]) + 2.0 * norm(torque_[k]) / std::max(size[0], std::max(size[1], size[2]));
    if (lost_neighbor_[k] != 0 || changed > wake_force_ratio * weight(k)) wake(k);
  }
  if (model_.options.sleep) update_resting();
}

/// Blocks that move and hang together come to rest at once, so that none of them feels the others' forces settle anew;
/// where a hand keeps some awake, one by one.
void LargeIslands::update_resting() {
  for (std::size_t k = 0; k < parent_.size(); ++k) parent_[k] = k;
  for (const ContactConstraint& touch : constraints_) {
    if (touch.first.block != no_index && touch.second.block != no_index) join(touch.first.block, touch.second.block);
  }
  std::fill(island_activity_.begin(), island_activity_.end(), 0);
  for (const std::size_t block : moving_) {
    if (!blocks_.count_idle_tick(block)) island_activity_[root(block)] |= 1;
    if (kept_awake_[block] != 0) island_activity_[root(block)] |= 2;
  }
  for (const std::size_t block : moving_) {
    const int stirred = island_activity_[root(block)];
    const int long_idle = stirred == 0 || (stirred & 2) != 0 ? 0 : max_extra_rest_ticks;
    if (blocks_.ticks_until_sleep()[block] <= -long_idle) put_to_rest(block);
  }
}

LargeIslands::State LargeIslands::state() const {
  return {{large_.begin(), large_.end()},
          {resting_.begin(), resting_.end()},
          resting_forces_,
          cached_contacts_,
          ode_unreliable_};
}

void LargeIslands::restore(const State& state) {
  large_.assign(state.large.begin(), state.large.end());
  resting_.assign(state.resting.begin(), state.resting.end());
  resting_forces_ = state.resting_forces;
  cached_contacts_ = state.cached_contacts;
  ode_unreliable_ = state.ode_unreliable;
}

}  // namespace proact::dynamics
