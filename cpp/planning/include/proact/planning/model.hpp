// What a planning scene is built from: plain values, metres and radians. No cxx, no ROS.
#pragma once

#include "proact/geometry.hpp"

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <utility>
#include <vector>

namespace proact::planning {

enum class ShapeKind : std::uint8_t { box, sphere, cylinder, capsule, mesh };

/// Triangles over vertices, metres. Its surface collides; what is wholly inside does not touch it.
struct Mesh {
  std::vector<std::array<double, 3>> vertices;
  std::vector<std::array<std::size_t, 3>> triangles;
};

/// A shape in its own frame: a mesh, or a primitive centred there with its axis along z. `size` is: box x, y, z side lengths; sphere radius;
/// cylinder radius, length; capsule radius, length of the tube without its round ends. The rest is ignored.
struct Shape {
  ShapeKind kind = ShapeKind::sphere;
  std::array<double, 3> size{0.0, 0.0, 0.0};
  std::shared_ptr<const Mesh> mesh{};
};

/// A shape somewhere in the frame of its owner.
struct PlacedShape {
  Shape shape;
  Pose pose;
};

struct Link {
  std::string name;
  std::vector<PlacedShape> shapes;
};

using proact::JointKind;

/// A joint; `pose` is parent_from_child at position zero, `axis` a direction in the joint frame. Positions are in rad, or m.
struct Joint {
  std::size_t parent = 0;
  std::size_t child = 0;
  JointKind kind = JointKind::fixed;
  Pose pose;
  std::array<double, 3> axis{0.0, 0.0, 1.0};
  double lower = 0.0;
  double upper = 0.0;
};

/// An arm: a serial chain of moving joints (`arm`, base to tip) that carries a hand. All indices are into
/// `links` and `joints`; a parent link stands before its children and link 0 is the base.
struct Arm {
  std::vector<Link> links;
  std::vector<Joint> joints;
  std::vector<std::size_t> arm;
  std::vector<std::size_t> hand;
  std::size_t tip = 0;
  /// Pairs of links that may touch.
  std::vector<std::pair<std::size_t, std::size_t>> allowed_collisions;
};

/// A named shape: an obstacle in `world`, or the carried object in the tip's frame.
struct Object {
  std::string name;
  PlacedShape placed;
};

using NamePair = std::pair<std::string, std::string>;

}  // namespace proact::planning
