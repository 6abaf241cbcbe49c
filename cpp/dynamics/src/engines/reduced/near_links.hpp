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
  /// Lists the shapes of links that are near anything they could touch, and brings them up to date; all others are nowhere.
  /// Expects the blocks' bounds.
  void update(const ArmTree& tree);

 private:
  struct Sphere {
    Vec3 centre;
    double radius;
  };
  /// How long what was near nothing when it was looked at stays so without another look.
  struct Far {
    Vec3 centre;           ///< when it was looked at
    double travel = -1.0;  ///< of the blocks and of itself together until it could be near something, metres
  };
  /// Shapes of one body that follow each other.
  struct Run {
    std::size_t body;
    std::size_t first;
    std::size_t last;  ///< behind the last one
    bool nowhere;      ///< all of them are, since the last update
    Far far;
  };

  void move_blocks();
  Far far(const Sphere& sphere) const;
  bool is_still(const Far& far, const Vec3& centre) const;
  bool look_around(const Sphere& sphere);
  bool update_shapes(const Run& run, const Pose& pose);

  Geoms& geoms_;
  std::vector<Pose> body_from_shape_;  ///< by shape of a link
  std::vector<Far> far_;               ///< by shape of a link
  std::vector<Sphere> spheres_;        ///< by body: around all its shapes, its own frame
  std::vector<Run> runs_;
  std::vector<std::array<dReal, 6>> obstacles_;  ///< bounds of fixed objects, then of blocks, side by side in memory
  std::vector<std::array<dReal, 6>> close_;      ///< those of them that are near the body that is looked at
  double travelled_ = 0.0;                       ///< no bound of a block has moved farther than this in all, metres
};

}  // namespace proact::dynamics
