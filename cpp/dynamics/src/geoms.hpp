// The convex shapes of links, fixed objects and blocks, as ODE knows them.
#pragma once

#include "contact_points.hpp"
#include "ode_runtime.hpp"
#include "proact/dynamics/model.hpp"

#include <array>
#include <cstddef>
#include <vector>

namespace proact::dynamics {

struct Geom {
  GeomPtr id;
  Shape shape;
  std::size_t owner;  ///< index of the link, fixed object or block
  Pose owner_from_shape;
  Pose world_from_shape;        ///< of this tick
  std::array<dReal, 6> bounds;  ///< of this tick: low and high x, y, z
  double bounding_radius;       ///< radius of the sphere around its centre

  PlacedShape placed() const { return {&shape, world_from_shape, id.get()}; }
  /// Hangs the shape on a body of ODE.
  void attach(dBodyID body, const Pose& body_from_shape) const;
};

/// Whether two bounds have no point in common. Asked of every pair in every tick, hence inline, and without branches, which
/// nobody could foretell.
inline bool bounds_disjoint(const std::array<dReal, 6>& a, const std::array<dReal, 6>& b) {
  return (a[0] > b[1]) | (b[0] > a[1]) | (a[2] > b[3]) | (b[2] > a[3]) | (a[4] > b[5]) | (b[4] > a[5]);
}

class Geoms {
 public:
  explicit Geoms(const Model& model);

  std::vector<Geom> links;  ///< those of one link stand together
  /// Those of the links that may be near something they could touch in this tick, ascending; the bounds of all others are empty.
  std::vector<std::size_t> near_links;
  std::vector<Geom> fixed;
  std::vector<Geom> blocks;

  /// Asks ODE where shapes that hang on bodies are.
  static void update(std::vector<Geom>& geoms);
};

}  // namespace proact::dynamics
