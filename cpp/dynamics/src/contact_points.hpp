// Where two shapes touch, with as many points as a rigid contact needs.
#pragma once

#include "ode_runtime.hpp"
#include "proact/dynamics/model.hpp"

#include <array>
#include <cstddef>

namespace proact::dynamics {

/// A shape at a place in the world.
struct PlacedShape {
  const Shape* shape;
  Pose pose;  ///< world_from_shape
  dGeomID geom;
};

struct ContactPoint {
  Vec3 position;
  Vec3 normal;  ///< from the second shape into the first
  double depth;
};

struct ContactPoints {
  static constexpr std::size_t capacity = 8;
  std::array<ContactPoint, capacity> points;
  std::size_t count = 0;

  void add(const ContactPoint& point) {
    if (count < capacity) points[count++] = point;
  }
};

/// Contacts of two shapes; none when they are apart.
///
/// ODE's own colliders find the touching direction. Where one of the shapes is a cylinder or a capsule they
/// give a single point (two for a tilted cylinder on a box), on which nothing can rest; there the points are
/// those where the touching face or line of one shape lies within that of the other.
void find_contacts(const PlacedShape& a, const PlacedShape& b, ContactPoints& out);

}  // namespace proact::dynamics
