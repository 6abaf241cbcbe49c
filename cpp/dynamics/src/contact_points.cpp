#include "contact_points.hpp"

#include <algorithm>

namespace proact::dynamics {

namespace {

// Corners that stand for a round face. Six put the tipping edge of a standing cylinder at 0.87 to 1 of its
// radius, and the first corner is turned to the lowest point, so that tipping over the rim is exact.
constexpr std::size_t face_corners = 6;
// A face counts as touching flat within 11 degrees; beyond, the deepest point alone is in contact.
constexpr double flat_cosine = 0.98;
// Two lines count as parallel within 3 degrees.
constexpr double parallel_sine = 0.05;

/// The face (three corners or more), line (two) or point (one) of a shape that lies farthest along a direction.
struct Feature {
  std::array<Vec3, 16> corners{};
  std::size_t count = 0;
  Vec3 normal;  ///< of a face, outward

  void add(const Vec3& corner) {
    if (count < corners.size()) corners[count++] = corner;
  }
};

Feature cylinder_feature(const PlacedShape& placed, const Vec3& direction) {
  const double radius = placed.shape->size[0];
  const double half = 0.5 * placed.shape->size[1];
  const Vec3 axis = rotate(placed.pose.rotation, {0.0, 0.0, 1.0});
  const double along = dot(axis, direction);
  const Vec3 sideways = direction - axis * along;
  const double side = norm(sideways);
  Feature feature;
  if (std::fabs(along) < 0.7) {
    const Vec3 middle = placed.pose.position + sideways * (radius / side);
    feature.add(middle + axis * half);
    feature.add(middle - axis * half);
    return feature;
  }
  // A direction exactly along the axis has no lowest point of the rim: any will do.
  const Vec3 first = side > 1e-9 ? sideways * (1.0 / side) : rotate(placed.pose.rotation, {1.0, 0.0, 0.0});
  const Vec3 second = cross(axis, first);
  feature.normal = along > 0.0 ? axis : axis * -1.0;
  const Vec3 center = placed.pose.position + feature.normal * half;
  for (std::size_t k = 0; k < face_corners; ++k) {
    const double angle = 2.0 * pi * static_cast<double>(k) / static_cast<double>(face_corners);
    feature.add(center + first * (radius * std::cos(angle)) + second * (radius * std::sin(angle)));
  }
  return feature;
}

Feature capsule_feature(const PlacedShape& placed, const Vec3& direction) {
  const Vec3 axis = rotate(placed.pose.rotation, {0.0, 0.0, 0.5 * placed.shape->size[1]});
  const Vec3 outward = direction * placed.shape->size[0];
  Feature feature;
  feature.add(placed.pose.position + outward + axis);
  feature.add(placed.pose.position + outward - axis);
  return feature;
}

Feature box_feature(const PlacedShape& placed, const Vec3& direction) {
  const Vec3 local = rotate(conjugate(placed.pose.rotation), direction);
  const std::array<double, 3> d{local.x, local.y, local.z};
  std::size_t face = 0;
  for (std::size_t k = 1; k < 3; ++k) {
    if (std::fabs(d[k]) > std::fabs(d[face])) face = k;
  }
  const std::size_t u = (face + 1) % 3;
  const std::size_t v = (face + 2) % 3;
  const auto corner = [&](double along_u, double along_v) {
    std::array<double, 3> p{};
    p[face] = 0.5 * placed.shape->size[face] * (d[face] < 0.0 ? -1.0 : 1.0);
    p[u] = 0.5 * placed.shape->size[u] * along_u;
    p[v] = 0.5 * placed.shape->size[v] * along_v;
    return placed.pose * Vec3{p[0], p[1], p[2]};
  };
  Feature feature;
  feature.add(corner(-1.0, -1.0));
  feature.add(corner(1.0, -1.0));
  feature.add(corner(1.0, 1.0));
  feature.add(corner(-1.0, 1.0));
  std::array<double, 3> normal{};
  normal[face] = d[face] < 0.0 ? -1.0 : 1.0;
  feature.normal = rotate(placed.pose.rotation, {normal[0], normal[1], normal[2]});
  return feature;
}

Feature feature_towards(const PlacedShape& placed, const Vec3& direction) {
  switch (placed.shape->kind) {
    case ShapeKind::box: return box_feature(placed, direction);
    case ShapeKind::cylinder: return cylinder_feature(placed, direction);
    case ShapeKind::capsule: return capsule_feature(placed, direction);
    case ShapeKind::sphere: break;
  }
  Feature point;
  point.add(placed.pose.position + direction * placed.shape->size[0]);
  return point;
}

/// Keeps the part of `feature` on the inner side of the plane through `origin` with outward normal `outward`.
Feature clip(const Feature& feature, const Vec3& origin, const Vec3& outward) {
  Feature kept;
  // A line has one edge, a face as many as corners.
  const std::size_t edges = feature.count == 2 ? 1 : feature.count;
  const auto cut = [&](const Vec3& from, double out_from, const Vec3& to, double out_to) {
    kept.add(from + (to - from) * (out_from / (out_from - out_to)));
  };
  for (std::size_t k = 0; k < edges; ++k) {
    const Vec3& from = feature.corners[k];
    const Vec3& to = feature.corners[(k + 1) % feature.count];
    const double out_from = dot(from - origin, outward);
    const double out_to = dot(to - origin, outward);
    if (out_from <= 0.0) kept.add(from);
    if ((out_from <= 0.0) != (out_to <= 0.0)) cut(from, out_from, to, out_to);
    if (edges == 1 && out_to <= 0.0) kept.add(to);
  }
  return kept;
}

/// Points of `touching` within the face `face`; `sign` turns the face's normal into that of the contact.
void face_contacts(const Feature& face, const Feature& touching, double sign, ContactPoints& out) {
  Vec3 middle{};
  for (std::size_t k = 0; k < face.count; ++k) middle = middle + face.corners[k] * (1.0 / static_cast<double>(face.count));
  Feature rest = touching;
  for (std::size_t k = 0; k < face.count && rest.count > 0; ++k) {
    const Vec3& from = face.corners[k];
    Vec3 outward = cross(face.normal, face.corners[(k + 1) % face.count] - from);
    if (dot(outward, middle - from) > 0.0) outward = outward * -1.0;
    rest = clip(rest, from, outward);
  }
  for (std::size_t k = 0; k < rest.count; ++k) {
    const double depth = dot(middle - rest.corners[k], face.normal);
    if (depth > 0.0) out.add({rest.corners[k] + face.normal * (0.5 * depth), face.normal * sign, depth});
  }
}

/// The two ends of the stretch over which two nearly parallel lines lie side by side.
void line_contacts(const Feature& a, const Feature& b, const Vec3& normal, ContactPoints& out) {
  const Vec3 line_a = a.corners[1] - a.corners[0];
  const Vec3 line_b = b.corners[1] - b.corners[0];
  const double length = norm(line_a);
  const Vec3 along = line_a * (1.0 / length);
  if (norm(cross(along, line_b)) > parallel_sine * norm(line_b)) return;
  const double b0 = dot(b.corners[0] - a.corners[0], along);
  const double b1 = dot(b.corners[1] - a.corners[0], along);
  const double low = std::max(0.0, std::min(b0, b1));
  const double high = std::min(length, std::max(b0, b1));
  // A general collider leaves a small part of the normal along the lines; it would push the shapes lengthwise.
  Vec3 sideways = normal - along * dot(normal, along);
  if (high - low < 1e-3 * length || norm(sideways) < flat_cosine) return;
  sideways = sideways * (1.0 / norm(sideways));
  for (const double place : {low, high}) {
    const Vec3 on_a = a.corners[0] + along * place;
    const Vec3 on_b = b.corners[0] + line_b * ((place - b0) / (b1 - b0));
    const double depth = dot(on_b - on_a, sideways);
    if (depth > 0.0) out.add({(on_a + on_b) * 0.5, sideways, depth});
  }
}

bool is_round(const PlacedShape& placed) {
  return placed.shape->kind == ShapeKind::cylinder || placed.shape->kind == ShapeKind::capsule;
}

}  // namespace

void find_contacts(const PlacedShape& a, const PlacedShape& b, ContactPoints& out) {
  out.count = 0;
  std::array<dContactGeom, ContactPoints::capacity> found;
  const int count = dCollide(a.geom, b.geom, static_cast<int>(found.size()), found.data(), sizeof(dContactGeom));
  if (count <= 0) return;
  const auto deepest = std::max_element(found.begin(), found.begin() + count,
                                        [](const auto& x, const auto& y) { return x.depth < y.depth; });
  const Vec3 normal = to_vec(deepest->normal);
  const bool spheres = a.shape->kind == ShapeKind::sphere || b.shape->kind == ShapeKind::sphere;
  if ((is_round(a) || is_round(b)) && !spheres) {
    const Feature on_a = feature_towards(a, normal * -1.0);
    const Feature on_b = feature_towards(b, normal);
    if (on_b.count > 2 && dot(on_b.normal, normal) > flat_cosine) {
      face_contacts(on_b, on_a, 1.0, out);
    } else if (on_a.count > 2 && dot(on_a.normal, normal) < -flat_cosine) {
      face_contacts(on_a, on_b, -1.0, out);
    } else if (on_a.count == 2 && on_b.count == 2) {
      line_contacts(on_a, on_b, normal, out);
    }
    if (out.count > 0) return;
  }
  for (int k = 0; k < count; ++k) {
    const dContactGeom& contact = found[static_cast<std::size_t>(k)];
    out.add({to_vec(contact.pos), to_vec(contact.normal), contact.depth});
  }
}

}  // namespace proact::dynamics
