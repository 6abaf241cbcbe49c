// The shapes of the arm in joint angles, moved by hand as far as they are near anything they could touch.
#pragma once

#include "engines/reduced/arm_tree.hpp"
#include "geoms.hpp"
#include "link_groups.hpp"

#include <array>
#include <cstddef>
#include <vector>

namespace proact::dynamics {

class LinkBroadPhase {
 public:
  explicit LinkBroadPhase(Geoms& geoms) : geoms_(geoms) {}

  /// Finds where shapes are in their bodies. Called whenever links have been joined to other bodies.
  void attach_shapes(const LinkGroups& links);
  /// Lists the shapes of links that are near anything they could touch, and brings them up to date; all others are nowhere.
  /// Expects the blocks' bounds.
  void update(const ArmTree& tree);

 private:
  struct Sphere {
    Vec3 center;
    double radius;
  };
  /// How long what was near nothing when it was looked at stays so without another look.
  struct FarBound {
    Vec3 center;           ///< when it was looked at
    double travel = -1.0;  ///< of the blocks and of itself together until it could be near something, metres
  };
  /// Shapes of one body that follow each other.
  struct ShapeRun {
    std::size_t body;
    std::size_t first;
    std::size_t last;  ///< behind the last one
    bool is_far;       ///< all of them are, since the last update
    FarBound far_bound;
  };

  void update_block_bounds();
  FarBound far_bound(const Sphere& sphere) const;
  bool stays_far(const FarBound& far, const Vec3& center) const;
  bool find_near_obstacles(const Sphere& sphere);
  bool update_shapes(const ShapeRun& run, const Pose& pose);

  Geoms& geoms_;
  std::vector<Pose> body_from_shape_;  ///< by shape of a link
  std::vector<FarBound> far_bounds_;   ///< by shape of a link
  std::vector<Sphere> spheres_;        ///< by body: around all its shapes, its own frame
  std::vector<ShapeRun> runs_;
  std::vector<std::array<dReal, 6>> obstacles_;       ///< bounds of fixed objects, then of blocks, side by side in memory
  std::vector<std::array<dReal, 6>> near_obstacles_;  ///< those of them that are near the body that is looked at
  double block_travel_m_ = 0.0;                       ///< no bound of a block has moved farther than this in all, metres
};

}  // namespace proact::dynamics
