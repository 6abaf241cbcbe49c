#include "shapes.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace proact::planning {

namespace {

using Vector = Eigen::Vector3d;

/// Shapes that shrink below this are kept this thin: FCL needs an extent.
constexpr double smallest_extent = 1e-4;

/// Nothing that an arm could reach is farther away or longer than this, metres; squares of the largest numbers would
/// overflow in FCL.
constexpr double max_coordinate_m = 1000.0;

std::size_t extents_of(ShapeKind kind) {
  switch (kind) {
    case ShapeKind::box: return 3;
    case ShapeKind::sphere: return 1;
    case ShapeKind::cylinder:
    case ShapeKind::capsule: return 2;
    case ShapeKind::mesh: return 0;
  }
  throw std::invalid_argument("unknown kind of shape");
}

void require_mesh(const Shape& shape, const std::string& name) {
  if (!shape.mesh || shape.mesh->vertices.empty() || shape.mesh->triangles.empty()) {
    throw std::invalid_argument("\"" + name + "\": the mesh needs at least one triangle");
  }
  for (const auto& vertex : shape.mesh->vertices) {
    for (const double coordinate : vertex) {
      if (!(std::abs(coordinate) <= max_coordinate_m)) {
        throw std::invalid_argument("\"" + name + "\": a vertex of the mesh is at " + std::to_string(coordinate) +
                                    " m, expected a number of at most 1000 either way");
      }
    }
  }
  for (const auto& triangle : shape.mesh->triangles) {
    for (const std::size_t corner : triangle) {
      if (corner >= shape.mesh->vertices.size()) {
        throw std::invalid_argument("\"" + name + "\": a triangle names vertex " + std::to_string(corner) +
                                    ", the mesh has " + std::to_string(shape.mesh->vertices.size()));
      }
    }
  }
}

std::shared_ptr<fcl::CollisionGeometryd> make_bvh(const Mesh& mesh) {
  std::vector<fcl::Vector3d> vertices;
  for (const auto& vertex : mesh.vertices) vertices.push_back(to_fcl(Vector(vertex[0], vertex[1], vertex[2])));
  std::vector<fcl::Triangle> triangles;
  for (const auto& corner : mesh.triangles) triangles.emplace_back(corner[0], corner[1], corner[2]);
  auto tree = std::make_shared<fcl::BVHModel<fcl::OBBRSSd>>();
  tree->beginModel(static_cast<int>(triangles.size()), static_cast<int>(vertices.size()));
  tree->addSubModel(vertices, triangles);
  tree->endModel();
  return tree;
}

}  // namespace

Eigen::Isometry3d to_transform(const Pose& pose) {
  const auto& [p, q] = pose;
  Eigen::Isometry3d result = Eigen::Isometry3d::Identity();
  result.linear() = Eigen::Quaterniond(q.w, q.x, q.y, q.z).toRotationMatrix();
  result.translation() = Vector(p.x, p.y, p.z);
  return result;
}

Pose validated_pose(const Pose& pose, const std::string& name) {
  const auto& [p, q] = pose;
  const double length = std::sqrt(q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w);
  const bool near = is_finite(p) && std::max({std::abs(p.x), std::abs(p.y), std::abs(p.z)}) <= max_coordinate_m;
  if (!near || !(std::abs(length - 1.0) < 1e-6)) {
    throw std::invalid_argument("\"" + name + "\": the pose needs a finite position of at most 1000 m either way and a unit quaternion");
  }
  return {p, normalized(q)};
}

void require_extent(const Shape& shape, const std::string& name) {
  if (shape.kind == ShapeKind::mesh) require_mesh(shape, name);
  for (std::size_t k = 0; k < extents_of(shape.kind); ++k) {
    if (!(shape.size[k] > 0.0 && shape.size[k] <= max_coordinate_m)) {
      throw std::invalid_argument("\"" + name + "\": extent " + std::to_string(k) + " of its shape is " +
                                  std::to_string(shape.size[k]) + " m, expected a length above zero and at most 1000");
    }
  }
}

Solid make_solid(const Shape& shape, double padding, const std::string& name) {
  require_extent(shape, name);
  Solid solid;
  solid.shape = shape;
  // Lengths grow at both ends, radii once; a capsule's ends grow with its radius.
  const auto grown = [padding](double extent, double times) {
    return std::max(extent + times * padding, smallest_extent);
  };
  std::array<double, 3>& size = solid.shape.size;
  switch (shape.kind) {
    case ShapeKind::box:
      for (double& side : size) side = grown(side, 2.0);
      break;
    case ShapeKind::cylinder:
      size[0] = grown(size[0], 1.0);
      size[1] = grown(size[1], 2.0);
      break;
    case ShapeKind::sphere:
    case ShapeKind::capsule:
      size[0] = grown(size[0], 1.0);
      break;
    case ShapeKind::mesh:
      solid.margin = std::max(padding, 0.0);
      for (const auto& vertex : shape.mesh->vertices) {
        const Vector point(vertex[0], vertex[1], vertex[2]);
        solid.local.low = solid.local.low.cwiseMin(point);
        solid.local.high = solid.local.high.cwiseMax(point);
      }
      break;
  }
  return solid;
}

const std::shared_ptr<fcl::CollisionGeometryd>& geometry_of(const Solid& solid) {
  if (solid.geometry) return solid.geometry;
  const std::array<double, 3>& size = solid.shape.size;
  switch (solid.shape.kind) {
    case ShapeKind::box: solid.geometry = std::make_shared<fcl::Boxd>(size[0], size[1], size[2]); break;
    case ShapeKind::sphere: solid.geometry = std::make_shared<fcl::Sphered>(size[0]); break;
    case ShapeKind::cylinder: solid.geometry = std::make_shared<fcl::Cylinderd>(size[0], size[1]); break;
    case ShapeKind::capsule: solid.geometry = std::make_shared<fcl::Capsuled>(size[0], size[1]); break;
    case ShapeKind::mesh: solid.geometry = make_bvh(*solid.shape.mesh); break;
  }
  return solid.geometry;
}

Box bounds(const Solid& solid, const Eigen::Isometry3d& world_from_shape) {
  const Shape& shape = solid.shape;
  const Eigen::Matrix3d& r = world_from_shape.linear();
  Vector half = Vector::Zero();
  Vector middle = world_from_shape.translation();
  switch (shape.kind) {
    case ShapeKind::box:
      half = r.cwiseAbs() * (0.5 * Vector(shape.size[0], shape.size[1], shape.size[2]));
      break;
    case ShapeKind::sphere:
      half = Vector::Constant(shape.size[0]);
      break;
    case ShapeKind::cylinder: {
      const Vector axis = r.col(2);
      for (int k = 0; k < 3; ++k) {
        half[k] = 0.5 * shape.size[1] * std::abs(axis[k]) +
                  shape.size[0] * std::sqrt(std::max(0.0, 1.0 - axis[k] * axis[k]));
      }
      break;
    }
    case ShapeKind::capsule:
      half = 0.5 * shape.size[1] * r.col(2).cwiseAbs() + Vector::Constant(shape.size[0]);
      break;
    case ShapeKind::mesh:
      middle = world_from_shape * Vector(0.5 * (solid.local.low + solid.local.high));
      half = r.cwiseAbs() * (0.5 * (solid.local.high - solid.local.low)) + Vector::Constant(solid.margin);
      break;
  }
  return {middle - half, middle + half};
}

double bounding_radius(const Solid& solid) {
  const Shape& shape = solid.shape;
  switch (shape.kind) {
    case ShapeKind::box: return 0.5 * Vector(shape.size[0], shape.size[1], shape.size[2]).norm();
    case ShapeKind::sphere: return shape.size[0];
    case ShapeKind::cylinder: return std::hypot(shape.size[0], 0.5 * shape.size[1]);
    case ShapeKind::capsule: return shape.size[0] + 0.5 * shape.size[1];
    case ShapeKind::mesh: return solid.local.low.cwiseAbs().cwiseMax(solid.local.high.cwiseAbs()).norm() + solid.margin;
  }
  throw std::invalid_argument("unknown kind of shape");
}

bool shapes_collide(const Solid& a, const Eigen::Isometry3d& a_pose, const Solid& b, const Eigen::Isometry3d& b_pose) {
  static const fcl::CollisionRequestd request(1, false);
  fcl::CollisionResultd result;
  if (fcl::collide(geometry_of(a).get(), to_fcl(a_pose), geometry_of(b).get(), to_fcl(b_pose), request, result) > 0) return true;
  const double margin = a.margin + b.margin;
  if (margin <= 0.0) return false;
  // A mesh cannot be grown as a primitive can; how close it is tells the same.
  static const fcl::DistanceRequestd near;
  fcl::DistanceResultd apart;
  return fcl::distance(geometry_of(a).get(), to_fcl(a_pose), geometry_of(b).get(), to_fcl(b_pose), near, apart) < margin;
}

}  // namespace proact::planning
