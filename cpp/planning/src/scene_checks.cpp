// Questions to a scene: what touches, and how far a motion may go on before anything could.
#include "proact/planning/scene.hpp"

#include "shapes.hpp"

#include <algorithm>
#include <cmath>

namespace proact::planning {

namespace {

/// A body whose ball is farther than this from something is not looked at more closely, metres: a step as long
/// as the ball allows costs less than the poses of all its shapes.
constexpr double far_enough = 0.04;

/// The same for a single shape, whose box costs more than its ball.
constexpr double far_for_a_shape = 0.015;

/// A pair whose volumes are `gap` apart and close in at `speed` cannot meet within gap / speed; a pair at rest that
/// is apart stays apart.
void consider(double gap, double speed, double& least) {
  if (gap > 0.0 && gap < least * speed) least = gap / speed;
}

/// True if a pair that far apart leaves `least` as it is.
bool settled(double gap, double speed, double least) { return gap > 0.0 && gap >= least * speed; }

}  // namespace

std::vector<NamePair> Scene::collisions(const double* q) { return report(q, false); }

std::vector<NamePair> Scene::collisions_of_all_links(const double* q) { return report(q, true); }

bool Scene::is_free(const double* q) {
  const std::vector<double> still(chain_.size(), 0.0);
  return clearance(q, still.data(), 1.0) >= 0.0;
}

double Scene::clearance(const double* q, const double* dq, double enough) {
  ++state_checks_;
  pose_bodies(q);
  set_speeds(dq, enough);
  double least = enough;
  for (std::size_t b = bodies_.size(); b-- > 1;) {
    if (!bodies_[b].members.empty() && !obstacles_clear(b, least)) return -1.0;
  }
  for (std::size_t a = 0; a + 1 < bodies_.size(); ++a) {
    for (std::size_t b = a + 1; b < bodies_.size(); ++b) {
      if (!pairs_[a * bodies_.size() + b].empty() && !bodies_clear(a, b, least)) return -1.0;
    }
  }
  return least;
}

bool Scene::obstacles_clear(std::size_t b, double& least) {
  Body& body = bodies_[b];
  const double speed = speed_[b];
  for (std::size_t o = 0; o < obstacles_.size(); ++o) {
    const Obstacle& obstacle = obstacles_[o];
    const double ball_gap = distance(body.centre, obstacle.box) - body.ball;
    if (settled(ball_gap, speed, least)) continue;
    if (ball_gap > far_enough) {
      consider(ball_gap, speed, least);
      continue;
    }
    centre_members(body);
    for (Member& member : body.members) {
      const double shape_gap = distance(member.centre, obstacle.box) - member.ball;
      if (settled(shape_gap, speed, least) || contact_allowed(member.owner, o)) continue;
      if (shape_gap > far_for_a_shape) {
        consider(shape_gap, speed, least);
        continue;
      }
      pose_member(body, member);
      const double gap = distance(member.box, obstacle.box);
      if (settled(gap, speed, least)) continue;
      if (gap > 0.0) {
        consider(gap, speed, least);
      } else if (touch(member.solid, member.world_from_shape, obstacle.solid, obstacle.world_from_shape)) {
        return false;
      } else {
        least = 0.0;
      }
    }
  }
  return true;
}

bool Scene::bodies_clear(std::size_t a, std::size_t b, double& least) {
  Body& one = bodies_[a];
  Body& other = bodies_[b];
  const double speed = pair_speed_[a * bodies_.size() + b];
  const double ball_gap = (one.centre - other.centre).norm() - one.ball - other.ball;
  if (settled(ball_gap, speed, least)) return true;
  if (ball_gap > far_enough) {
    consider(ball_gap, speed, least);
    return true;
  }
  centre_members(one);
  centre_members(other);
  for (const auto& [first_index, second_index] : pairs_[a * bodies_.size() + b]) {
    Member& first = one.members[first_index];
    Member& second = other.members[second_index];
    const double shape_gap = (first.centre - second.centre).norm() - first.ball - second.ball;
    if (settled(shape_gap, speed, least)) continue;
    if (shape_gap > far_for_a_shape) {
      consider(shape_gap, speed, least);
      continue;
    }
    pose_member(one, first);
    pose_member(other, second);
    const double gap = distance(first.box, second.box);
    if (settled(gap, speed, least)) continue;
    if (gap > 0.0) {
      consider(gap, speed, least);
    } else if (touch(first.solid, first.world_from_shape, second.solid, second.world_from_shape)) {
      return false;
    } else {
      least = 0.0;
    }
  }
  return true;
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

void Scene::pose_bodies(const double* q) {
  Pose pose = world_from_base_;
  bodies_[0].world_from_body = to_transform(pose);
  for (std::size_t k = 0; k < chain_.size(); ++k) {
    pose = turned(pose * chain_[k].parent_from_joint, chain_[k].axis, q[k]);
    bodies_[k + 1].world_from_body = to_transform(pose);
  }
  for (Body& body : bodies_) {
    body.centre = body.world_from_body * body.body_centre;
    body.centred = false;
  }
}

void Scene::centre_members(Body& body) {
  if (body.centred) return;
  for (Member& member : body.members) {
    member.centre = body.world_from_body * member.body_from_shape.translation();
    member.posed = false;
  }
  body.centred = true;
}

void Scene::pose_member(const Body& body, Member& member) {
  if (member.posed) return;
  member.world_from_shape = body.world_from_body * member.body_from_shape;
  member.box = bounds(member.solid, member.world_from_shape);
  member.posed = true;
}

void Scene::set_speeds(const double* dq, double span) {
  const std::size_t bodies = bodies_.size();
  speed_.assign(bodies, 0.0);
  pair_speed_.assign(bodies * bodies, 0.0);
  if (std::all_of(dq, dq + chain_.size(), [](double v) { return v == 0.0; })) return;
  any_speed_.assign(bodies * bodies, 0.0);
  for (std::size_t b = 1; b < bodies; ++b) {
    // Only the joints between two bodies move them against each other.
    double anywhere = 0.0;
    double here = 0.0;
    for (std::size_t a = b; a-- > 0;) {
      // Joint a turns body a + 1 about an axis through that body's origin, and all bodies beyond it.
      const Transform& child = bodies_[a + 1].world_from_body;
      const Vec3& own = chain_[a].axis;
      const Vector axis = child.linear() * Vector(own.x, own.y, own.z);
      const double farther = a + 1 < b ? any_speed_[(a + 1) * bodies + b] * span : 0.0;
      const double arm = axis.cross(bodies_[b].centre - child.translation()).norm() + bodies_[b].ball + farther;
      const double lever = lever_[a * bodies + b];
      here += std::abs(dq[a]) * std::min(arm, lever);
      anywhere += std::abs(dq[a]) * lever;
      any_speed_[a * bodies + b] = anywhere;
      pair_speed_[a * bodies + b] = here;
    }
    speed_[b] = here;
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
    centre_members(body);
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
