#include "collisions.hpp"

#include "arm.hpp"

#include <algorithm>
#include <limits>
#include <stdexcept>

namespace proact::dynamics {

namespace {

// Things may start with this much overlap, metres; more would push them apart visibly.
constexpr double allowed_overlap = 1e-3;

/// Bounds of all shapes of links together.
std::array<dReal, 6> link_bounds(const Geoms& geoms) {
  constexpr dReal infinity = std::numeric_limits<dReal>::infinity();
  std::array<dReal, 6> all{infinity, -infinity, infinity, -infinity, infinity, -infinity};
  for (const std::size_t shape : geoms.near_links) {
    const std::array<dReal, 6>& bounds = geoms.links[shape].bounds;
    for (std::size_t k = 0; k < 6; k += 2) {
      all[k] = std::min(all[k], bounds[k]);
      all[k + 1] = std::max(all[k + 1], bounds[k + 1]);
    }
  }
  return all;
}

}  // namespace

Collisions::Collisions(const Model& model, const Geoms& geoms, const BlockBodies& blocks, const BlockAttachment& carrying)
    : model_(model),
      geoms_(geoms),
      blocks_(blocks),
      carrying_(carrying),
      separated_(model.links.size() * model.blocks.size(), true) {
  constraints_.reserve(World::contact_capacity);
  contacts_.reserve(World::contact_capacity);
  bounds_.reserve(blocks.count());
  overlapping_.reserve(model.links.size());
}

ContactSide Collisions::contact_side(const Arm& arm, std::size_t block) const {
  if (carrying_.is_merged_block(block)) return arm.contact_side(carrying_.attached()->link);
  return {blocks_.body(block), block, no_index};
}

void Collisions::find_resting() {
  resting_.resize(blocks_.count());
  for (std::size_t k = 0; k < resting_.size(); ++k) {
    resting_[k] = !carrying_.is_attached(k) && blocks_.is_asleep(k) ? 1 : 0;
  }
}

void Collisions::find(const Arm& arm) {
  contacts_.clear();
  constraints_.clear();
  find_resting();
  find_links_with_fixed(arm);
  find_blocks_with_fixed(arm, false);
  find_blocks(arm);
  find_blocks_with_links(arm);
  // Who is touched in its sleep needs what it rests on from the first tick on.
  find_blocks_with_fixed(arm, true);
}

/// Adds what find_contacts() has found of a pair that is not listed.
void Collisions::add_constraints(const ContactSide& first, const ContactSide& second, double friction) {
  for (std::size_t k = 0; k < found_.count; ++k) {
    constraints_.push_back({first, second, friction, found_.points[k], no_index});
  }
}

void Collisions::find_links_with_fixed(const Arm& arm) {
  for (const std::size_t shape : geoms_.near_links) {
    const Geom& link = geoms_.links[shape];
    // Neither the base nor the room can be moved by a push.
    if (arm.links().body_of(link.owner) == 0) continue;
    for (const Geom& fixed : geoms_.fixed) {
      if (bounds_disjoint(link.bounds, fixed.bounds)) continue;
      find_contacts(link.placed(), fixed.placed(), found_);
      add_constraints(arm.contact_side(link.owner), {}, model_.fixed[fixed.owner].friction);
    }
  }
}

void Collisions::find_touched() {
  touched_.assign(blocks_.count(), 0);
  for (const ContactConstraint& touch : constraints_) {
    if (touch.first.block != no_index) touched_[touch.first.block] = 1;
    if (touch.second.block != no_index) touched_[touch.second.block] = 1;
  }
}

/// Of the blocks that are awake, or of those that are touched in their sleep.
void Collisions::find_blocks_with_fixed(const Arm& arm, bool at_rest) {
  if (at_rest) find_touched();
  for (const Geom& block : geoms_.blocks) {
    if ((resting_[block.owner] != 0) != at_rest || (at_rest && touched_[block.owner] == 0)) continue;
    bool touches = false;
    for (const Geom& fixed : geoms_.fixed) {
      if (bounds_disjoint(block.bounds, fixed.bounds)) continue;
      find_contacts(block.placed(), fixed.placed(), found_);
      const double friction = std::min(model_.blocks[block.owner].friction, model_.fixed[fixed.owner].friction);
      add_constraints(contact_side(arm, block.owner), {}, friction);
      touches = touches || found_.count > 0;
    }
    if (touches && !carrying_.is_attached(block.owner)) blocks_.apply_rolling_resistance(block.owner);
  }
}

void Collisions::find_blocks(const Arm& arm) {
  if (std::all_of(resting_.begin(), resting_.end(), [](char resting) { return resting != 0; })) return;
  // Side by side in memory, since each is read as often as there are blocks.
  bounds_.clear();
  for (const Geom& block : geoms_.blocks) bounds_.push_back(block.bounds);
  for (std::size_t i = 0; i < geoms_.blocks.size(); ++i) {
    const Geom& a = geoms_.blocks[i];
    for (std::size_t j = i + 1; j < geoms_.blocks.size(); ++j) {
      if (bounds_disjoint(bounds_[i], bounds_[j]) || (resting_[i] != 0 && resting_[j] != 0)) continue;
      const Geom& b = geoms_.blocks[j];
      find_contacts(a.placed(), b.placed(), found_);
      const double friction = std::min(model_.blocks[i].friction, model_.blocks[j].friction);
      add_constraints(contact_side(arm, i), contact_side(arm, j), friction);
    }
  }
}

void Collisions::find_blocks_with_links(const Arm& arm) {
  const std::size_t links = model_.links.size();
  const std::vector<Geom>& shapes = geoms_.links;
  const std::vector<std::size_t>& near = geoms_.near_links;
  const std::array<dReal, 6> arms = link_bounds(geoms_);
  for (const Geom& block : geoms_.blocks) {
    if (carrying_.is_attached(block.owner)) continue;
    const auto parted = separated_.begin() + static_cast<std::ptrdiff_t>(block.owner * links);
    // Of a heap hardly any block is near the arm.
    if (bounds_disjoint(block.bounds, arms)) {
      std::fill_n(parted, links, true);
      continue;
    }
    // Shapes of one link stand together, so one pass sees whether any of them still overlaps the block.
    overlapping_.clear();
    for (std::size_t next = 0; next < near.size();) {
      const std::size_t link = shapes[near[next]].owner;
      const bool acts = separated_[block.owner * links + link];
      bool overlaps = false;
      for (; next < near.size() && shapes[near[next]].owner == link; ++next) {
        const Geom& geom = shapes[near[next]];
        if (bounds_disjoint(block.bounds, geom.bounds)) continue;
        find_contacts(block.placed(), geom.placed(), found_);
        overlaps = overlaps || found_.count > 0;
        if (!acts) continue;
        const ContactSide side = contact_side(arm, block.owner);
        const ContactSide link_side = arm.contact_side(link);
        const double friction = model_.blocks[block.owner].friction_finger;
        for (std::size_t k = 0; k < found_.count; ++k) {
          const ContactPoint& point = found_.points[k];
          const bool listed = contacts_.size() < World::contact_capacity;
          if (listed) contacts_.push_back({block.owner, link, point.position, point.normal, 0.0});
          constraints_.push_back({side, link_side, friction, point, listed ? contacts_.size() - 1 : no_index});
        }
      }
      if (overlaps && !acts) overlapping_.push_back(link);
    }
    std::fill_n(parted, links, true);
    for (const std::size_t link : overlapping_) separated_[block.owner * links + link] = false;
  }
}

void Collisions::require_separation(std::size_t block) {
  const std::size_t links = model_.links.size();
  std::fill_n(separated_.begin() + static_cast<std::ptrdiff_t>(block * links), links, false);
}

void Collisions::refuse(const Geom& block, const Geom& other, const std::string& name) {
  if (bounds_disjoint(block.bounds, other.bounds)) return;
  find_contacts(block.placed(), other.placed(), found_);
  for (std::size_t k = 0; k < found_.count; ++k) {
    if (found_.points[k].depth > allowed_overlap) {
      throw std::invalid_argument("block \"" + model_.blocks[block.owner].name + "\" is " +
                                  std::to_string(1e3 * found_.points[k].depth) + " mm inside " + name +
                                  ", at most 1 mm is allowed");
    }
  }
}

void Collisions::refuse_overlaps() {
  for (std::size_t block = 0; block < geoms_.blocks.size(); ++block) refuse_overlaps_of(block);
}

void Collisions::refuse_overlaps_of(std::size_t which) {
  const Geom& block = geoms_.blocks[which];
  for (const Geom& fixed : geoms_.fixed) refuse(block, fixed, "\"" + model_.fixed[fixed.owner].name + "\"");
  for (const Geom& link : geoms_.links) refuse(block, link, "link \"" + model_.links[link.owner].name + "\"");
  for (const Geom& other : geoms_.blocks) {
    if (other.owner != block.owner) refuse(block, other, "block \"" + model_.blocks[other.owner].name + "\"");
  }
}

void Collisions::restore(const std::vector<bool>& parted, const std::vector<Contact>& contacts) {
  separated_ = parted;
  // Not taken over whole, which would give back the memory reserved for a tick.
  contacts_.assign(contacts.begin(), contacts.end());
}

}  // namespace proact::dynamics
