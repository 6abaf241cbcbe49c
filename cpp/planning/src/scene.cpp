#include "proact/planning/scene.hpp"

#include "shapes.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace proact::planning {

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
    validated_pose(joint.pose, name);
    const Vec3 axis{joint.axis[0], joint.axis[1], joint.axis[2]};
    if (joint.kind != JointKind::fixed && !(norm(axis) > 1e-9)) {
      throw std::invalid_argument("joint to \"" + name + "\": the axis has no direction");
    }
    const std::size_t position = arm_position[j];
    if (position < chain_.size()) {
      if (joint.kind == JointKind::fixed || body_of_link_[joint.parent] != position) {
        throw std::invalid_argument("joint to \"" + name + "\": the arm joints must be one unbroken chain");
      }
      if (!(joint.lower < joint.upper)) {
        throw std::invalid_argument("joint to \"" + name + "\": the lower limit must be below the upper one");
      }
      body_of_link_[joint.child] = position + 1;
      chain_[position].kind = joint.kind;
      chain_[position].axis = normalized(axis);
      chain_[position].lower = joint.lower;
      chain_[position].upper = joint.upper;
    } else {
      if (joint.kind != JointKind::fixed && !is_hand[j]) {
        throw std::invalid_argument("joint to \"" + name + "\": moving joints must belong to the arm or the hand");
      }
      body_of_link_[joint.child] = body_of_link_[joint.parent];
    }
  }
  if (arm_.tip >= links || body_of_link_[arm_.tip] != chain_.size()) {
    throw std::invalid_argument("the tip must be a link that the last arm joint moves");
  }
  allowed_links_.assign(links * links, 0);
  for (const auto& [a, b] : arm_.allowed_collisions) {
    if (a >= links || b >= links) throw std::invalid_argument("an allowed pair names a link that does not exist");
    allowed_links_[a * links + b] = allowed_links_[b * links + a] = 1;
  }
  bodies_.resize(chain_.size() + 1);
  rates_.assign(bodies_.size() * bodies_.size(), {});
  axes_.assign(chain_.size(), Vector::Zero());
  zeros_.assign(chain_.size(), 0.0);
  for (std::size_t l = 0; l < links; ++l) {
    for (const PlacedShape& shape : arm_.links[l].shapes) {
      Member member;
      member.solid = make_solid(shape.shape, 0.0, arm_.links[l].name);
      member.owner = l;
      member.link_from_shape = transform_of(shape.pose, arm_.links[l].name);
      bodies_[body_of_link_[l]].members.push_back(std::move(member));
    }
  }
  list_pairs();
  place_hand();
}

void Scene::set_base(const Pose& world_from_base) {
  world_from_base_ = transform_of(world_from_base, "base");
  base_ = world_from_base;
}

SceneContent Scene::content() const {
  SceneContent content{base_, hand_, {}, attached_, padding_};
  for (const Obstacle& obstacle : obstacles_) content.obstacles.push_back({obstacle.name, obstacle.placed});
  return content;
}

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
    obstacle.world_from_shape = transform_of(object.placed.pose, object.name);
    place_obstacle(obstacle);
    made.push_back(std::move(obstacle));
  }
  obstacles_ = std::move(made);
  list_boxes();
  clear_allowed_contacts();
}

void Scene::set_attached(const std::optional<Object>& attached) {
  if (attached) {
    require_extent(attached->placed.shape, attached->name);
    transform_of(attached->placed.pose, attached->name);  // throws before anything is changed
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
    member.link_from_shape = transform_of(attached_->placed.pose, attached_->name);
    members.push_back(std::move(member));
  }
  list_pairs();
  place_hand();
}

void Scene::set_padding(double padding_m) {
  if (!std::isfinite(padding_m)) throw std::invalid_argument("the padding must be a finite number of metres");
  if (padding_m == padding_) return;
  padding_ = padding_m;
  for (Obstacle& obstacle : obstacles_) place_obstacle(obstacle);
  list_boxes();
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
  allowed_contacts_[row * (arm_.links.size() + 1) + owner] = 1;
}

void Scene::clear_allowed_contacts() { allowed_contacts_.assign(obstacles_.size() * (arm_.links.size() + 1), 0); }

void Scene::place_hand() {
  // body_from_link for every link, at the hand's present angles.
  std::vector<double> angle(arm_.joints.size(), 0.0);
  for (std::size_t k = 0; k < hand_.size(); ++k) angle[arm_.hand[k]] = hand_[k];
  std::vector<bool> opens_body(arm_.joints.size(), false);
  for (const std::size_t joint : arm_.arm) opens_body[joint] = true;
  std::vector<Pose> body_from_link(arm_.links.size());
  for (std::size_t j = 0; j < arm_.joints.size(); ++j) {
    const Joint& joint = arm_.joints[j];
    const Pose pose = validated_pose(joint.pose, arm_.links[joint.child].name);
    if (opens_body[j]) {
      // The chain is driven from the frame of the parent body, so a fixed joint on the way goes into it.
      const std::size_t body = body_of_link_[joint.child];
      place_joint(chain_[body - 1], body_from_link[joint.parent] * pose);
    } else {
      const Pose at_zero = body_from_link[joint.parent] * pose;
      const Vec3 axis{joint.axis[0], joint.axis[1], joint.axis[2]};
      body_from_link[joint.child] =
          joint.kind == JointKind::fixed ? at_zero : joint_pose(at_zero, joint.kind, normalized(axis), angle[j]);
    }
  }
  for (Body& body : bodies_) {
    for (Member& member : body.members) {
      const std::size_t link = member.owner < arm_.links.size() ? member.owner : arm_.tip;
      member.body_from_shape = to_transform(body_from_link[link]) * member.link_from_shape;
    }
  }
  update_radii();
}

void Scene::place_joint(ChainJoint& joint, const Pose& parent_from_joint) {
  joint.parent_from_joint = parent_from_joint;
  const Transform transform = to_transform(parent_from_joint);
  const Vector axis(joint.axis.x, joint.axis.y, joint.axis.z);
  Eigen::Matrix3d cross;
  cross << 0.0, -axis.z(), axis.y(), axis.z(), 0.0, -axis.x(), -axis.y(), axis.x(), 0.0;
  const Eigen::Matrix3d projection = axis * axis.transpose();
  joint.origin = transform.translation();
  joint.turned_axis = transform.linear() * axis;
  if (joint.kind == JointKind::prismatic) {
    joint.along = transform.linear();
    joint.across = joint.around = Eigen::Matrix3d::Zero();
    return;
  }
  joint.along = transform.linear() * projection;
  joint.across = transform.linear() * (Eigen::Matrix3d::Identity() - projection);
  joint.around = transform.linear() * cross;
}

void Scene::place_obstacle(Obstacle& obstacle) const {
  if (obstacle.placed.shape.kind == ShapeKind::mesh && obstacle.solid.geometry) {
    obstacle.solid.margin = std::max(padding_, 0.0);  // its tree stays
  } else {
    obstacle.solid = make_solid(obstacle.placed.shape, padding_, obstacle.name);
  }
  obstacle.box = bounds(obstacle.solid, obstacle.world_from_shape);
}

void Scene::list_boxes() {
  low_.resize(static_cast<Eigen::Index>(obstacles_.size()), 3);
  high_.resize(low_.rows(), 3);
  Eigen::Index row = 0;
  for (const Obstacle& obstacle : obstacles_) {
    low_.row(row) = obstacle.box.low.transpose().array();
    high_.row(row++) = obstacle.box.high.transpose().array();
  }
}

void Scene::update_radii() {
  for (Body& body : bodies_) {
    body.bounding_radius = 0.0;
    Box box;
    for (const Member& member : body.members) {
      const Box own = bounds(member.solid, member.body_from_shape);
      box.low = box.low.cwiseMin(own.low);
      box.high = box.high.cwiseMax(own.high);
    }
    body.bounding_radii.resize(static_cast<Eigen::Index>(body.members.size()));
    body.centers.resize(body.bounding_radii.size(), 3);
    body.body_center = body.members.empty() ? Vector(Vector::Zero()) : Vector(0.5 * (box.low + box.high));
    // The ball's centre, too, never moves faster than the levers below say.
    body.reach = body.body_center.norm();
    Eigen::Index row = 0;
    for (Member& member : body.members) {
      const Vector& at = member.body_from_shape.translation();
      const double around = member.bounding_radius = body.bounding_radii[row++] = bounding_radius(member.solid);
      body.reach = std::max(body.reach, at.norm() + around);
      body.bounding_radius = std::max(body.bounding_radius, (at - body.body_center).norm() + around);
    }
  }
  // A point of body b is never farther from the axis of joint j than the links between them are long, slides drawn out. What
  // joint j slides moves as far as it does.
  lever_.assign(chain_.size() * bodies_.size(), 0.0);
  for (std::size_t j = 0; j < chain_.size(); ++j) {
    double length = 0.0;
    for (std::size_t b = j + 1; b < bodies_.size(); ++b) {
      if (b > j + 1) {
        const ChainJoint& joint = chain_[b - 1];
        length += norm(joint.parent_from_joint.position);
        if (joint.kind == JointKind::prismatic) length += std::max(std::abs(joint.lower), std::abs(joint.upper));
      }
      lever_[j * bodies_.size() + b] = chain_[j].kind == JointKind::prismatic ? 1.0 : length + bodies_[b].reach;
    }
  }
}

void Scene::list_pairs() {
  pairs_.assign(bodies_.size() * bodies_.size(), {});
  for (std::size_t a = 0; a < bodies_.size(); ++a) {
    for (std::size_t b = a + 1; b < bodies_.size(); ++b) {
      for (std::size_t first = 0; first < bodies_[a].members.size(); ++first) {
        for (std::size_t second = 0; second < bodies_[b].members.size(); ++second) {
          if (!links_allowed(bodies_[a].members[first].owner, bodies_[b].members[second].owner)) {
            pairs_[a * bodies_.size() + b].emplace_back(first, second);
          }
        }
      }
    }
  }
}

}  // namespace proact::planning
