// Questions to a scene: what touches, and how far a motion may go on before anything could.
#include "proact/planning/scene.hpp"

#include "separation.hpp"
#include "shapes.hpp"

#include <algorithm>
#include <cmath>

namespace proact::planning {

namespace {

/// A body whose ball is farther than this from something is not looked at more closely, metres: a step as long
/// as the ball allows costs less than the poses of all its shapes.
constexpr double coarse_distance_m = 0.02;

/// The same for a single shape, whose box costs more than its ball.
constexpr double coarse_shape_distance_m = 0.01;

/// Squared distances of a point from boxes, whose corners are the rows of `low` and `high`.
void squared_distances(const Eigen::Vector3d& point, const Eigen::Array<double, Eigen::Dynamic, 3>& low,
                       const Eigen::Array<double, Eigen::Dynamic, 3>& high, Eigen::ArrayXd& squares) {
  squares = (low.col(0) - point[0]).max(point[0] - high.col(0)).max(0.0).square() +
            (low.col(1) - point[1]).max(point[1] - high.col(1)).max(0.0).square() +
            (low.col(2) - point[2]).max(point[2] - high.col(2)).max(0.0).square();
}

/// Squared distances of points, the rows of `points`, from a box.
void squared_distances(const Eigen::Array<double, Eigen::Dynamic, 3>& points, const Box& box, Eigen::ArrayXd& squares) {
  squares = (box.low[0] - points.col(0)).max(points.col(0) - box.high[0]).max(0.0).square() +
            (box.low[1] - points.col(1)).max(points.col(1) - box.high[1]).max(0.0).square() +
            (box.low[2] - points.col(2)).max(points.col(2) - box.high[2]).max(0.0).square();
}

}  // namespace

std::vector<NamePair> Scene::collisions(const double* q) { return report(q, false); }

std::vector<NamePair> Scene::collisions_of_all_links(const double* q) { return report(q, true); }

bool Scene::is_free(const double* q) { return clearance(q, zeros_.data(), 1.0) >= 0.0; }

double Scene::clearance(const double* q, const double* dq, double enough) { return clearance(q, dq, enough, true); }

double Scene::clearance_around(const double* q, const double* reach, double enough) {
  return clearance(q, reach, enough, false);
}

double Scene::clearance(const double* q, const double* dq, double enough, bool straight) {
  ++state_checks_;
  pose_bodies(q);
  set_rates(dq, enough, straight);
  double least = enough;
  near_.clear();
  for (std::size_t b = bodies_.size(); b-- > 1;) {
    if (!bodies_[b].members.empty()) list_near_obstacles(b, least);
  }
  for (std::size_t a = 0; a + 1 < bodies_.size(); ++a) {
    for (std::size_t b = a + 1; b < bodies_.size(); ++b) {
      if (!pairs_[a * bodies_.size() + b].empty()) list_near_bodies(a, b, least);
    }
  }
  // What overlaps by its box may touch; the others are settled the sooner for what is found there.
  for (const NearPair& pair : near_) {
    if (pair.gap <= 0.0 && !check_pair(pair, least)) return -1.0;
  }
  for (const NearPair& pair : near_) {
    if (pair.gap > 0.0 && pair.gap < pair.rate->travel(least)) check_pair(pair, least);
  }
  return least;
}

void Scene::tighten_bound(double gap, const TravelBound& rate, double& least) {
  if (gap < rate.travel(least)) least = std::min(least, rate.time(gap));
}

bool Scene::check_pair(const NearPair& pair, double& least) {
  const double enough = pair.rate->travel(least);
  const double proved = distance_lower_bound(*pair.first, *pair.first_pose, *pair.second, *pair.second_pose, enough);
  const double gap = std::max(pair.gap, proved);
  if (gap > 0.0) {
    tighten_bound(gap, *pair.rate, least);
    return true;
  }
  least = 0.0;
  return !shapes_collide(*pair.first, *pair.first_pose, *pair.second, *pair.second_pose);
}

void Scene::list_near_obstacles(std::size_t b, double& least) {
  Body& body = bodies_[b];
  const TravelBound& rate = rates_[b];
  // A pair that is apart, and farther than it can close in, leaves `least` as it is.
  double travel = rate.travel(least);
  squared_distances(body.center, low_, high_, squared_distances_);
  for (std::size_t o = 0; o < obstacles_.size(); ++o) {
    const double squares = squared_distances_[static_cast<Eigen::Index>(o)];
    const double within = body.bounding_radius + travel;
    if (squares > within * within) continue;
    const double ball_gap = std::sqrt(squares) - body.bounding_radius;
    if (ball_gap > coarse_distance_m) {
      tighten_bound(ball_gap, rate, least);
      travel = rate.travel(least);
      continue;
    }
    const Obstacle& obstacle = obstacles_[o];
    center_members(body);
    squared_distances(body.centers, obstacle.box, squares_);
    for (std::size_t m = 0; m < body.members.size(); ++m) {
      Member& member = body.members[m];
      const double member_squares = squares_[static_cast<Eigen::Index>(m)];
      const double member_within = member.bounding_radius + travel;
      if (member_squares > member_within * member_within || contact_allowed(member.owner, o)) continue;
      const double shape_gap = std::sqrt(member_squares) - member.bounding_radius;
      if (shape_gap > coarse_shape_distance_m) {
        tighten_bound(shape_gap, rate, least);
        travel = rate.travel(least);
        continue;
      }
      pose_member(body, member);
      const double gap = distance(member.box, obstacle.box);
      if (gap > 0.0 && gap >= travel) continue;
      near_.push_back({&member.solid, &member.world_from_shape, &obstacle.solid, &obstacle.world_from_shape, gap, &rate});
    }
  }
}

void Scene::list_near_bodies(std::size_t a, std::size_t b, double& least) {
  Body& one = bodies_[a];
  Body& other = bodies_[b];
  const TravelBound& rate = rates_[a * bodies_.size() + b];
  double travel = rate.travel(least);
  const double ball_gap = (one.center - other.center).norm() - one.bounding_radius - other.bounding_radius;
  if (ball_gap > 0.0 && ball_gap >= travel) return;
  if (ball_gap > coarse_distance_m) {
    tighten_bound(ball_gap, rate, least);
    return;
  }
  center_members(one);
  center_members(other);
  for (const auto& [first_index, second_index] : pairs_[a * bodies_.size() + b]) {
    Member& first = one.members[first_index];
    Member& second = other.members[second_index];
    const double squares = (one.centers.row(static_cast<Eigen::Index>(first_index)) -
                            other.centers.row(static_cast<Eigen::Index>(second_index))).square().sum();
    const double within = first.bounding_radius + second.bounding_radius + travel;
    if (squares > within * within) continue;
    const double shape_gap = std::sqrt(squares) - first.bounding_radius - second.bounding_radius;
    if (shape_gap > coarse_shape_distance_m) {
      tighten_bound(shape_gap, rate, least);
      travel = rate.travel(least);
      continue;
    }
    pose_member(one, first);
    pose_member(other, second);
    const double gap = distance(first.box, second.box);
    if (gap > 0.0 && gap >= travel) continue;
    near_.push_back({&first.solid, &first.world_from_shape, &second.solid, &second.world_from_shape, gap, &rate});
  }
}

double Scene::max_travel(const double* dq) const {
  double farthest = 0.0;
  for (std::size_t b = 1; b < bodies_.size(); ++b) {
    double sum = 0.0;
    for (std::size_t j = 0; j < b; ++j) sum += std::abs(dq[j]) * lever_[j * bodies_.size() + b];
    farthest = std::max(farthest, sum);
  }
  return farthest;
}

void Scene::pose_bodies(const double* q) {
  bodies_[0].world_from_body = world_from_base_;
  for (std::size_t k = 0; k < chain_.size(); ++k) {
    const ChainJoint& joint = chain_[k];
    const Transform& parent = bodies_[k].world_from_body;
    Transform& child = bodies_[k + 1].world_from_body;
    // Rodrigues' formula for the turn, behind the joint's own pose.
    const Eigen::Matrix3d turned = joint.along + std::cos(q[k]) * joint.across + std::sin(q[k]) * joint.around;
    child.linear().noalias() = parent.linear() * turned;
    child.translation().noalias() = parent.linear() * joint.origin + parent.translation();
    axes_[k].noalias() = parent.linear() * joint.turned_axis;
    if (joint.kind == JointKind::prismatic) child.translation() += q[k] * axes_[k];
  }
  for (Body& body : bodies_) {
    body.center.noalias() = body.world_from_body.linear() * body.body_center + body.world_from_body.translation();
    body.centers_valid = false;
  }
}

void Scene::center_members(Body& body) {
  if (body.centers_valid) return;
  Eigen::Index row = 0;
  for (Member& member : body.members) {
    const Vector center = body.world_from_body.linear() * member.body_from_shape.translation() + body.world_from_body.translation();
    body.centers.row(row++) = center.transpose().array();
    member.is_posed = false;
  }
  body.centers_valid = true;
}

void Scene::pose_member(const Body& body, Member& member) {
  if (member.is_posed) return;
  member.world_from_shape = body.world_from_body * member.body_from_shape;
  member.box = bounds(member.solid, member.world_from_shape);
  member.is_posed = true;
}

void Scene::set_rates(const double* dq, double span, bool straight) {
  const std::size_t bodies = bodies_.size();
  if (std::all_of(dq, dq + chain_.size(), [](double v) { return v == 0.0; })) {
    std::fill(rates_.begin(), rates_.end(), TravelBound{});
    return;
  }
  for (std::size_t b = 1; b < bodies; ++b) {
    // Only the joints between two bodies move them against each other.
    const Body& body = bodies_[b];
    if (body.members.empty()) continue;
    double anywhere = 0.0;
    double here = 0.0;
    double bend = 0.0;
    Vector velocity = Vector::Zero();
    Vector turn = Vector::Zero();
    for (std::size_t a = b; a-- > 0;) {
      // Joint a turns body a + 1 about an axis through that body's origin, or slides it along one, and all bodies beyond it.
      const bool slides = chain_[a].kind == JointKind::prismatic;
      const Vector swing =
          slides ? axes_[a] : axes_[a].cross(body.center - bodies_[a + 1].world_from_body.translation());
      const double lever = lever_[a * bodies + b];
      const double rate = std::abs(dq[a]);
      // On a straight motion the speed now tells more, and costs less.
      here += rate * (straight ? lever : std::min(swing.norm() + body.bounding_radius + anywhere * span, lever));
      // Each pair of joints adds to the second derivative of a point's place the product of their rates, times the lever of
      // the outer one. What slides bends nothing farther out.
      if (!slides) bend += rate * (0.5 * rate * lever + anywhere);
      anywhere += rate * lever;
      velocity += dq[a] * swing;
      if (!slides) turn += dq[a] * axes_[a];
      if (a > 0 && pairs_[a * bodies + b].empty()) continue;
      const double now = straight ? velocity.norm() + turn.norm() * body.bounding_radius : here;
      rates_[a * bodies + b] = {here, now, bend};
    }
  }
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
  for (Body& body : bodies_) {
    center_members(body);
    for (Member& member : body.members) pose_member(body, member);
  }
  std::vector<NamePair> pairs;
  const auto add = [&pairs](const std::string& a, const std::string& b) {
    const NamePair pair(a, b);
    if (std::find(pairs.begin(), pairs.end(), pair) == pairs.end()) pairs.push_back(pair);
  };
  for (std::size_t b = 1; b < bodies_.size(); ++b) {
    for (const Member& member : bodies_[b].members) {
      for (std::size_t o = 0; o < obstacles_.size(); ++o) {
        if (contact_allowed(member.owner, o) || distance(member.box, obstacles_[o].box) > 0.0) continue;
        if (shapes_collide(member.solid, member.world_from_shape, obstacles_[o].solid, obstacles_[o].world_from_shape)) {
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
          if (shapes_collide(first.solid, first.world_from_shape, second.solid, second.world_from_shape)) {
            add(owner_name(first.owner), owner_name(second.owner));
          }
        }
      }
    }
  }
  return pairs;
}

}  // namespace proact::planning
