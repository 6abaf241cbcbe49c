// The shapes of the arm in joint angles, moved by hand as far as they are near anything they could touch.
#pragma once

#include "engines/reduced/arm_tree.hpp"
#include "geoms.hpp"
#include "link_groups.hpp"

#include <array>
#include <cstddef>
#include <vector>

namespace proact::dynamics {

class NearLinks {
 public:
  explicit NearLinks(Geoms& geoms) : geoms_(geoms) {}

  /// Finds where shapes are in their bodies. Called whenever links have been joined to other bodies.
  void hang(const LinkGroups& links);
  /// Brings the shapes of links up to date that are near anything they could touch; all others are nowhere. Expects
  /// the blocks' bounds.
  void update(const ArmTree& tree);

 private:
  struct Sphere {
    Vec3 centre;
    double radius;
  };
  /// Shapes of one body that follow each other.
  struct Run {
    std::size_t body;
    std::size_t first;
    std::size_t last;  ///< behind the last one
    bool nowhere;      ///< all of them are, since the last update
  };

  bool look_around(const Sphere& sphere);
  bool update_shapes(const Run& run, const Pose& pose);

  Geoms& geoms_;
  std::vector<Pose> body_from_shape_;  ///< by shape of a link
  std::vector<Sphere> spheres_;        ///< by body: around all its shapes, its own frame
  std::vector<Run> runs_;
  std::vector<std::array<dReal, 6>> obstacles_;  ///< bounds of fixed objects, then of blocks, side by side in memory
  std::vector<std::array<dReal, 6>> close_;      ///< those of them that are near the body that is looked at
};

}  // namespace proact::dynamics
