// Who touches whom. Every pair is visited in the same order whatever happened before, so that the contacts and
// with them the results depend on nothing but the state.
#pragma once

#include "block_attachment.hpp"
#include "block_bodies.hpp"
#include "contact_constraint.hpp"
#include "geoms.hpp"
#include "proact/dynamics/world.hpp"

#include <cstddef>
#include <string>
#include <vector>

namespace proact::dynamics {

class Arm;

class Collisions {
 public:
  Collisions(const Model& model, const Geoms& geoms, const BlockBodies& blocks, const BlockAttachment& carrying);

  /// Finds what touches in this tick, and brakes blocks that roll. Expects all shapes placed.
  void find(const Arm& arm);
  /// Throws std::invalid_argument if a block overlaps anything. Expects all shapes placed.
  void refuse_overlaps();
  /// The same for one block.
  void refuse_overlaps_of(std::size_t block);
  /// From now on a block touches each link only once they have come apart.
  void require_separation(std::size_t block);

  /// All of this tick.
  const std::vector<ContactConstraint>& constraints() const { return constraints_; }
  /// Those of blocks with links.
  const std::vector<Contact>& contacts() const { return contacts_; }
  void set_force(std::size_t contact, double force) { contacts_[contact].force = force; }

  /// [block][link]: contacts act.
  const std::vector<bool>& separated() const { return separated_; }
  void restore(const std::vector<bool>& parted, const std::vector<Contact>& contacts);

 private:
  void find_links_with_fixed(const Arm& arm);
  void find_blocks_with_fixed(const Arm& arm, bool at_rest);
  void find_blocks(const Arm& arm);
  void find_blocks_with_links(const Arm& arm);
  void add_constraints(const ContactSide& first, const ContactSide& second, double friction);
  void refuse(const Geom& block, const Geom& other, const std::string& name);
  ContactSide contact_side(const Arm& arm, std::size_t block) const;
  void find_resting();
  void find_touched();

  const Model& model_;
  const Geoms& geoms_;
  const BlockBodies& blocks_;
  const BlockAttachment& carrying_;
  std::vector<bool> separated_;
  std::vector<ContactConstraint> constraints_;
  std::vector<char> resting_;  ///< by block, of this tick
  std::vector<std::array<dReal, 6>> bounds_;  ///< of the blocks in this tick
  std::vector<char> touched_;  ///< by block, in its sleep
  std::vector<std::size_t> overlapping_;  ///< links that have not come apart from the block that is looked at
  std::vector<Contact> contacts_;
  ContactPoints found_;  ///< of one pair
};

}  // namespace proact::dynamics
