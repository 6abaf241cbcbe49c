#include "proact/planning/scene.hpp"

#include <fcl/geometry/shape/box.h>
#include <fcl/geometry/shape/capsule.h>
#include <fcl/geometry/shape/cylinder.h>
#include <fcl/geometry/shape/sphere.h>
#include <fcl/narrowphase/collision.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace proact::planning {

namespace {

/// Shapes that shrink below this are kept this thin: FCL needs an extent.
constexpr double smallest_extent = 1e-4;

/// A body whose ball is farther than this from something is not looked at more closely, metres: a step as long
/// as the ball allows costs less than the poses of all its shapes.
constexpr double far_enough = 0.04;

Eigen::Isometry3d transform(const Pose& pose, const std::string& name) {
  Eigen::Quaterniond rotation(pose.quaternion[3], pose.quaternion[0], pose.quaternion[1], pose.quaternion[2]);
  const Eigen::Vector3d position(pose.position[0], pose.position[1], pose.position[2]);
  if (!position.allFinite() || !(std::abs(rotation.norm() - 1.0) < 1e-6)) {
    throw std::invalid_argument("\"" + name + "\": the pose needs a finite position and a unit quaternion");
  }
  rotation.normalize();
  Eigen::Isometry3d result = Eigen::Isometry3d::Identity();
  result.linear() = rotation.toRotationMatrix();
  result.translation() = position;
  return result;
}

std::size_t extents_of(ShapeKind kind) {
  switch (kind) {
    case ShapeKind::box: return 3;
    case ShapeKind::sphere: return 1;
    case ShapeKind::cylinder:
    case ShapeKind::capsule: return 2;
  }
  throw std::invalid_argument("unknown kind of shape");
}

void require_extent(const Shape& shape, const std::string& name) {
  for (std::size_t k = 0; k < extents_of(shape.kind); ++k) {
    if (!(shape.size[k] > 0.0) || !std::isfinite(shape.size[k])) {
      throw std::invalid_argument("\"" + name + "\": extent " + std::to_string(k) + " of its shape is " +
                                  std::to_string(shape.size[k]) + ", expected a length above zero");
    }
  }
}

Eigen::Isometry3d turned(const Eigen::Isometry3d& parent_from_joint, const Eigen::Vector3d& axis, double angle) {
  Eigen::Isometry3d result = parent_from_joint;
  result.linear() = parent_from_joint.linear() * Eigen::AngleAxisd(angle, axis).toRotationMatrix();
  return result;
}

}  // namespace

Scene::~Scene() = default;

Scene::Scene(const Arm& arm) : arm_(arm), hand_(arm.hand.size(), 0.0) {
  const std::size_t links = arm_.links.size();
  if (links == 0 || arm_.arm.empty()) throw std::invalid_argument("the arm needs at least one link and one arm joint");
  if (arm_.joints.size() + 1 != links) {
    throw std::invalid_argument("the arm has " + std::to_string(links) + " links and " +
                                std::to_string(arm_.joints.size()) + " joints, expected one joint fewer than links");
  }
  // Which body each link belongs to: arm joints open a new one, all others carry their parent's on.
  std::vector<std::size_t> arm_position(arm_.joints.size(), arm_.arm.size());
  for (std::size_t k = 0; k < arm_.arm.size(); ++k) arm_position.at(arm_.arm[k]) = k;
  std::vector<bool> is_hand(arm_.joints.size(), false);
  for (const std::size_t joint : arm_.hand) is_hand.at(joint) = true;
  body_of_link_.assign(links, 0);
  std::vector<bool> placed(links, false);
  placed[0] = true;
  chain_.resize(arm_.arm.size());
  for (std::size_t j = 0; j < arm_.joints.size(); ++j) {
    const Joint& joint = arm_.joints[j];
    if (joint.child >= links || joint.parent >= joint.child || !placed[joint.parent] || placed[joint.child]) {
      throw std::invalid_argument("joint " + std::to_string(j) + ": a parent link must stand before its child");
    }
    placed[joint.child] = true;
    const std::string& name = arm_.links[joint.child].name;
    const Eigen::Isometry3d pose = transform(joint.pose, name);
    const Vector axis(joint.axis[0], joint.axis[1], joint.axis[2]);
    if (joint.revolute && !(axis.norm() > 1e-9)) {
      throw std::invalid_argument("joint to \"" + name + "\": the axis has no direction");
    }
    const std::size_t position = arm_position[j];
    if (position < chain_.size()) {
      if (!joint.revolute || body_of_link_[joint.parent] != position) {
        throw std::invalid_argument("joint to \"" + name + "\": the arm joints must be one unbroken revolute chain");
      }
      if (!(joint.lower < joint.upper)) {
        throw std::invalid_argument("joint to \"" + name + "\": the lower limit must be below the upper one");
      }
      body_of_link_[joint.child] = position + 1;
      chain_[position] = {pose, axis.normalized(), joint.lower, joint.upper};
    } else {
      if (joint.revolute && !is_hand[j]) {
        throw std::invalid_argument("joint to \"" + name + "\": moving joints must belong to the arm or the hand");
      }
      body_of_link_[joint.child] = body_of_link_[joint.parent];
    }
  }
  if (arm_.tip >= links || body_of_link_[arm_.tip] != chain_.size()) {
    throw std::invalid_argument("the tip must be a link that the last arm joint moves");
  }
  allowed_links_.assign(links * links, false);
  for (const auto& [a, b] : arm_.allowed) {
    if (a >= links || b >= links) throw std::invalid_argument("an allowed pair names a link that does not exist");
    allowed_links_[a * links + b] = allowed_links_[b * links + a] = true;
  }
  bodies_.resize(chain_.size() + 1);
  for (std::size_t l = 0; l < links; ++l) {
    for (const PlacedShape& shape : arm_.links[l].shapes) {
      Member member;
      member.solid = make_solid(shape.shape, 0.0, arm_.links[l].name);
      member.owner = l;
      member.link_from_shape = transform(shape.pose, arm_.links[l].name);
      bodies_[body_of_link_[l]].members.push_back(std::move(member));
    }
  }
  place_hand();
}

void Scene::set_base(const Pose& world_from_base) { world_from_base_ = transform(world_from_base, "base"); }

void Scene::set_hand(const std::vector<double>& angles) {
  if (angles.size() != hand_.size()) {
    throw std::invalid_argument("got " + std::to_string(angles.size()) + " hand angles, the hand has " +
                                std::to_string(hand_.size()) + " joints");
  }
  hand_ = angles;
  place_hand();
}

void Scene::set_obstacles(const std::vector<Object>& obstacles) {
  std::vector<Obstacle> made;
  made.reserve(obstacles.size());
  for (const Object& object : obstacles) {
    for (const Obstacle& other : made) {
      if (other.name == object.name) throw std::invalid_argument("two obstacles are called \"" + object.name + "\"");
    }
    require_extent(object.placed.shape, object.name);
    Obstacle obstacle;
    obstacle.name = object.name;
    obstacle.placed = object.placed;
    obstacle.world_from_shape = transform(object.placed.pose, object.name);
    place_obstacle(obstacle);
    made.push_back(std::move(obstacle));
  }
  obstacles_ = std::move(made);
  forget_allowed_contacts();
}

void Scene::set_attached(const std::optional<Object>& attached) {
  if (attached) {
    require_extent(attached->placed.shape, attached->name);
    transform(attached->placed.pose, attached->name);  // throws before anything is changed
  }
  const std::size_t carried = arm_.links.size();
  std::vector<Member>& members = bodies_.back().members;
  members.erase(std::remove_if(members.begin(), members.end(), [&](const Member& m) { return m.owner == carried; }),
                members.end());
  attached_ = attached;
  if (attached_) {
    Member member;
    member.solid = make_solid(attached_->placed.shape, 0.0, attached_->name);
    member.owner = carried;
    member.link_from_shape = transform(attached_->placed.pose, attached_->name);
    members.push_back(std::move(member));
  }
  place_hand();
}

void Scene::set_padding(double metres) {
  if (!std::isfinite(metres)) throw std::invalid_argument("the padding must be a finite number of metres");
  if (metres == padding_) return;
  padding_ = metres;
  for (Obstacle& obstacle : obstacles_) place_obstacle(obstacle);
}

void Scene::allow_contact(const std::string& member, const std::string& obstacle) {
  const auto link = std::find_if(arm_.links.begin(), arm_.links.end(), [&](const Link& l) { return l.name == member; });
  const bool carried = attached_ && attached_->name == member;
  if (link == arm_.links.end() && !carried) throw std::invalid_argument("no link or carried object is called \"" + member + "\"");
  const auto found =
      std::find_if(obstacles_.begin(), obstacles_.end(), [&](const Obstacle& o) { return o.name == obstacle; });
  if (found == obstacles_.end()) throw std::invalid_argument("no obstacle is called \"" + obstacle + "\"");
  const auto owner = static_cast<std::size_t>(carried ? arm_.links.size() : link - arm_.links.begin());
  const auto row = static_cast<std::size_t>(found - obstacles_.begin());
  allowed_contacts_[row * (arm_.links.size() + 1) + owner] = true;
}

void Scene::forget_allowed_contacts() { allowed_contacts_.assign(obstacles_.size() * (arm_.links.size() + 1), false); }

std::vector<NamePair> Scene::collisions(const double* q) { return report(q, false); }

std::vector<NamePair> Scene::collisions_of_all_links(const double* q) { return report(q, true); }

bool Scene::is_free(const double* q) {
  const std::vector<double> still(chain_.size(), 0.0);
  return clearance(q, still.data(), 1.0) >= 0.0;
}

double Scene::clearance(const double* q, const double* dq, double enough) {
  ++state_checks_;
  pose_bodies(q);
  set_speeds(dq);
  double least = enough;
  // A pair of boxes `gap` apart that close in at `speed` cannot meet within gap / speed; a pair at rest that
  // is apart stays apart.
  const auto consider = [&least](double gap, double speed) {
    if (gap > 0.0 && gap < least * speed) least = gap / speed;
  };
  const auto settled = [&least](double gap, double speed) { return gap > 0.0 && gap >= least * speed; };

  for (std::size_t b = bodies_.size(); b-- > 1;) {
    Body& body = bodies_[b];
    if (body.members.empty()) continue;
    const double speed = speed_[b];
    for (std::size_t o = 0; o < obstacles_.size(); ++o) {
      const Obstacle& obstacle = obstacles_[o];
      const double ball_gap = distance(body.centre, obstacle.box) - body.ball;
      if (settled(ball_gap, speed)) continue;
      if (ball_gap > far_enough) {
        consider(ball_gap, speed);
        continue;
      }
      pose_members(body);
      for (const Member& member : body.members) {
        const double gap = distance(member.box, obstacle.box);
        if (settled(gap, speed) || contact_allowed(member.owner, o)) continue;
        if (gap > 0.0) {
          consider(gap, speed);
        } else if (touch(member.solid, member.world_from_shape, obstacle.solid, obstacle.world_from_shape)) {
          return -1.0;
        } else {
          least = 0.0;
        }
      }
    }
  }
  for (std::size_t a = 0; a + 1 < bodies_.size(); ++a) {
    for (std::size_t b = a + 1; b < bodies_.size(); ++b) {
      if (bodies_[a].members.empty() || bodies_[b].members.empty()) continue;
      const double speed = pair_speed_[a * bodies_.size() + b];
      const double ball_gap = (bodies_[a].centre - bodies_[b].centre).norm() - bodies_[a].ball - bodies_[b].ball;
      if (settled(ball_gap, speed)) continue;
      if (ball_gap > far_enough) {
        consider(ball_gap, speed);
        continue;
      }
      pose_members(bodies_[a]);
      pose_members(bodies_[b]);
      for (const Member& first : bodies_[a].members) {
        const double first_gap = distance(bodies_[b].centre, first.box) - bodies_[b].ball;
        if (settled(first_gap, speed)) continue;
        for (const Member& second : bodies_[b].members) {
          const double gap = distance(first.box, second.box);
          if (settled(gap, speed) || links_allowed(first.owner, second.owner)) continue;
          if (gap > 0.0) {
            consider(gap, speed);
          } else if (touch(first.solid, first.world_from_shape, second.solid, second.world_from_shape)) {
            return -1.0;
          } else {
            least = 0.0;
          }
        }
      }
    }
  }
  return least;
}

double Scene::travel(const double* dq) const {
  double farthest = 0.0;
  for (std::size_t b = 1; b < bodies_.size(); ++b) {
    double sum = 0.0;
    for (std::size_t j = 0; j < b; ++j) sum += std::abs(dq[j]) * lever_[j * bodies_.size() + b];
    farthest = std::max(farthest, sum);
  }
  return farthest;
}

Scene::Solid Scene::make_solid(const Shape& shape, double padding, const std::string& name) {
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
      solid.geometry = std::make_shared<fcl::Boxd>(size[0], size[1], size[2]);
      break;
    case ShapeKind::sphere:
      size[0] = grown(size[0], 1.0);
      solid.geometry = std::make_shared<fcl::Sphered>(size[0]);
      break;
    case ShapeKind::cylinder:
      size[0] = grown(size[0], 1.0);
      size[1] = grown(size[1], 2.0);
      solid.geometry = std::make_shared<fcl::Cylinderd>(size[0], size[1]);
      break;
    case ShapeKind::capsule:
      size[0] = grown(size[0], 1.0);
      solid.geometry = std::make_shared<fcl::Capsuled>(size[0], size[1]);
      break;
  }
  return solid;
}

Scene::Box Scene::bounds(const Shape& shape, const Transform& world_from_shape) {
  const Eigen::Matrix3d& r = world_from_shape.linear();
  Vector half = Vector::Zero();
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
  }
  return {world_from_shape.translation() - half, world_from_shape.translation() + half};
}

double Scene::distance(const Box& a, const Box& b) {
  const Vector gap = (a.low - b.high).cwiseMax(b.low - a.high).cwiseMax(Vector::Zero());
  return gap.norm();
}

double Scene::distance(const Vector& point, const Box& box) {
  return (box.low - point).cwiseMax(point - box.high).cwiseMax(Vector::Zero()).norm();
}

double Scene::reach(const Shape& shape) {
  switch (shape.kind) {
    case ShapeKind::box: return 0.5 * Vector(shape.size[0], shape.size[1], shape.size[2]).norm();
    case ShapeKind::sphere: return shape.size[0];
    case ShapeKind::cylinder: return std::hypot(shape.size[0], 0.5 * shape.size[1]);
    case ShapeKind::capsule: return shape.size[0] + 0.5 * shape.size[1];
  }
  throw std::invalid_argument("unknown kind of shape");
}

void Scene::place_hand() {
  // body_from_link for every link, at the hand's present angles.
  std::vector<double> angle(arm_.joints.size(), 0.0);
  for (std::size_t k = 0; k < hand_.size(); ++k) angle[arm_.hand[k]] = hand_[k];
  std::vector<bool> opens_body(arm_.joints.size(), false);
  for (const std::size_t joint : arm_.arm) opens_body[joint] = true;
  std::vector<Transform> body_from_link(arm_.links.size(), Transform::Identity());
  for (std::size_t j = 0; j < arm_.joints.size(); ++j) {
    const Joint& joint = arm_.joints[j];
    const Transform pose = transform(joint.pose, arm_.links[joint.child].name);
    if (opens_body[j]) {
      // The chain is driven from the frame of the parent body, so a fixed joint on the way goes into it.
      const std::size_t body = body_of_link_[joint.child];
      chain_[body - 1].parent_from_joint = body_from_link[joint.parent] * pose;
    } else {
      const Vector axis(joint.axis[0], joint.axis[1], joint.axis[2]);
      const Transform parent_from_link = joint.revolute ? turned(pose, axis.normalized(), angle[j]) : pose;
      body_from_link[joint.child] = body_from_link[joint.parent] * parent_from_link;
    }
  }
  for (Body& body : bodies_) {
    for (Member& member : body.members) {
      const std::size_t link = member.owner < arm_.links.size() ? member.owner : arm_.tip;
      member.body_from_shape = body_from_link[link] * member.link_from_shape;
    }
  }
  update_radii();
}

void Scene::place_obstacle(Obstacle& obstacle) const {
  obstacle.solid = make_solid(obstacle.placed.shape, padding_, obstacle.name);
  obstacle.box = bounds(obstacle.solid.shape, obstacle.world_from_shape);
}

void Scene::update_radii() {
  for (Body& body : bodies_) {
    body.radius = body.ball = 0.0;
    Box box;
    for (const Member& member : body.members) {
      const Box own = bounds(member.solid.shape, member.body_from_shape);
      box.low = box.low.cwiseMin(own.low);
      box.high = box.high.cwiseMax(own.high);
    }
    body.body_centre = body.members.empty() ? Vector(Vector::Zero()) : Vector(0.5 * (box.low + box.high));
    for (const Member& member : body.members) {
      const Vector& at = member.body_from_shape.translation();
      const double around = reach(member.solid.shape);
      body.radius = std::max(body.radius, at.norm() + around);
      body.ball = std::max(body.ball, (at - body.body_centre).norm() + around);
    }
  }
  // A point of body b is never farther from the axis of joint j than the links between them are long.
  lever_.assign(chain_.size() * bodies_.size(), 0.0);
  for (std::size_t j = 0; j < chain_.size(); ++j) {
    double length = 0.0;
    for (std::size_t b = j + 1; b < bodies_.size(); ++b) {
      if (b > j + 1) length += chain_[b - 1].parent_from_joint.translation().norm();
      lever_[j * bodies_.size() + b] = length + bodies_[b].radius;
    }
  }
}

void Scene::pose_bodies(const double* q) {
  bodies_[0].world_from_body = world_from_base_;
  for (std::size_t k = 0; k < chain_.size(); ++k) {
    bodies_[k + 1].world_from_body =
        bodies_[k].world_from_body * turned(chain_[k].parent_from_joint, chain_[k].axis, q[k]);
  }
  for (Body& body : bodies_) {
    body.centre = body.world_from_body * body.body_centre;
    body.members_posed = false;
  }
}

void Scene::pose_members(Body& body) {
  if (body.members_posed) return;
  for (Member& member : body.members) {
    member.world_from_shape = body.world_from_body * member.body_from_shape;
    member.box = bounds(member.solid.shape, member.world_from_shape);
  }
  body.members_posed = true;
}

void Scene::set_speeds(const double* dq) {
  const std::size_t bodies = bodies_.size();
  speed_.assign(bodies, 0.0);
  pair_speed_.assign(bodies * bodies, 0.0);
  for (std::size_t b = 1; b < bodies; ++b) {
    // Only the joints between two bodies move them against each other.
    double sum = 0.0;
    for (std::size_t a = b; a-- > 0;) {
      sum += std::abs(dq[a]) * lever_[a * bodies + b];
      pair_speed_[a * bodies + b] = sum;
    }
    speed_[b] = sum;
  }
}

bool Scene::touch(const Solid& a, const Transform& a_pose, const Solid& b, const Transform& b_pose) const {
  static const fcl::CollisionRequestd request(1, false);
  fcl::CollisionResultd result;
  return fcl::collide(a.geometry.get(), a_pose, b.geometry.get(), b_pose, request, result) > 0;
}

bool Scene::contact_allowed(std::size_t owner, std::size_t obstacle) const {
  return allowed_contacts_[obstacle * (arm_.links.size() + 1) + owner];
}

bool Scene::links_allowed(std::size_t a, std::size_t b) const {
  const std::size_t links = arm_.links.size();
  return a < links && b < links && allowed_links_[a * links + b];
}

const std::string& Scene::owner_name(std::size_t owner) const {
  return owner < arm_.links.size() ? arm_.links[owner].name : attached_->name;
}

std::vector<NamePair> Scene::report(const double* q, bool within_bodies) {
  ++state_checks_;
  pose_bodies(q);
  for (Body& body : bodies_) pose_members(body);
  std::vector<NamePair> pairs;
  const auto add = [&pairs](const std::string& a, const std::string& b) {
    const NamePair pair(a, b);
    if (std::find(pairs.begin(), pairs.end(), pair) == pairs.end()) pairs.push_back(pair);
  };
  for (std::size_t b = 1; b < bodies_.size(); ++b) {
    for (const Member& member : bodies_[b].members) {
      for (std::size_t o = 0; o < obstacles_.size(); ++o) {
        if (contact_allowed(member.owner, o) || distance(member.box, obstacles_[o].box) > 0.0) continue;
        if (touch(member.solid, member.world_from_shape, obstacles_[o].solid, obstacles_[o].world_from_shape)) {
          add(owner_name(member.owner), obstacles_[o].name);
        }
      }
    }
  }
  for (std::size_t a = 0; a < bodies_.size(); ++a) {
    for (std::size_t b = within_bodies ? a : a + 1; b < bodies_.size(); ++b) {
      for (const Member& first : bodies_[a].members) {
        for (const Member& second : bodies_[b].members) {
          // Within one body each pair of links is met once, and what is carried touches the hand by design.
          const bool same_body = a == b;
          if (same_body && (first.owner >= second.owner || second.owner == arm_.links.size())) continue;
          if (links_allowed(first.owner, second.owner) || distance(first.box, second.box) > 0.0) continue;
          if (touch(first.solid, first.world_from_shape, second.solid, second.world_from_shape)) {
            add(owner_name(first.owner), owner_name(second.owner));
          }
        }
      }
    }
  }
  return pairs;
}

}  // namespace proact::planning
