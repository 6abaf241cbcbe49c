// The shapes of the arm in joint angles, moved by hand as far as they are near anything they could touch.
#pragma once

#include "engines/reduced/arm_tree.hpp"
#include "geoms.hpp"
#include "link_groups.hpp"

#include <vector>

namespace proact::dynamics {

class NearLinks {
 public:
  explicit NearLinks(Geoms& geoms) : geoms_(geoms) {}

  /// Finds where shapes are in their bodies. Called whenever links have been joined to other bodies.
  void hang(const LinkGroups& links);
  /// Brings the shapes of links up to date that are near anything they could touch; all others are nowhere. Expects
  /// the blocks' bounds.
  void update(const LinkGroups& links, const ArmTree& tree);

 private:
  struct Sphere {
    Vec3 centre;
    double radius;
  };

  bool near_anything(const Sphere& sphere) const;

  Geoms& geoms_;
  std::vector<Pose> body_from_shape_;  ///< by shape of a link
  std::vector<Sphere> spheres_;        ///< by body: around all its shapes, its own frame
};

}  // namespace proact::dynamics
