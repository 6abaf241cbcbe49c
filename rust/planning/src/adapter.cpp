#include "proact-planning/src/adapter.hpp"

#include "proact-planning/src/bridge.rs.h"

#include <algorithm>
#include <stdexcept>
#include <string>

// Lengths of joint vectors are checked on the Rust side, where the error can name both numbers.
namespace proact::planning {

namespace {

PlacedShape placed_of(const ShapeRow& row) {
  return {{row.kind, row.size, nullptr}, pose_from_array(row.pose)};
}

Resolution resolution_of(const SearchRow& search) {
  return {search.step_rad, search.step_m, search.equal_steps};
}

JointQuery query_of(const SearchRow& search) {
  JointQuery query;
  query.planner = search.planner;
  for (std::size_t k = 0; k + 1 < search.parameters.size(); k += 2) {
    query.parameters.emplace_back(std::string(search.parameters[k]), std::string(search.parameters[k + 1]));
  }
  query.seed = search.seed;
  query.max_iterations = search.max_iterations;
  query.max_seconds = search.max_seconds;
  query.more_searches = search.more_searches;
  query.range = search.range;
  query.shortcut_attempts = search.shortcut_attempts;
  query.resolution = resolution_of(search);
  return query;
}

std::vector<std::vector<double>> rows_of(rust::Slice<const double> flat, std::size_t joints) {
  std::vector<std::vector<double>> rows;
  for (const double* row = flat.data(); row != flat.data() + flat.size(); row += joints) {
    rows.emplace_back(row, row + joints);
  }
  return rows;
}

rust::Vec<double> flat(const std::vector<std::vector<double>>& rows) {
  rust::Vec<double> all;
  for (const auto& row : rows) {
    for (const double value : row) all.push_back(value);
  }
  return all;
}

JointQuery query_between(const Scene& scene, rust::Slice<const double> start, rust::Slice<const double> goals,
                         const SearchRow& search) {
  JointQuery query = query_of(search);
  query.start.assign(start.begin(), start.end());
  query.goals = rows_of(goals, scene.joint_count());
  return query;
}

PlanRow row_of(const JointPlan& plan) {
  return {plan.status, plan.goal, flat(plan.path), plan.iterations, plan.state_checks, plan.seconds, plan.timed_out};
}

}  // namespace

std::unique_ptr<Arm> new_arm() { return std::make_unique<Arm>(); }

void add_link(Arm& arm, rust::Str name, rust::Slice<const ShapeRow> shapes) {
  Link link;
  link.name = std::string(name);
  for (const ShapeRow& row : shapes) link.shapes.push_back(placed_of(row));
  arm.links.push_back(std::move(link));
}

void add_joint(Arm& arm, const JointRow& row) {
  arm.joints.push_back({row.parent, row.child, row.kind, pose_from_array(row.pose), row.axis, row.lower, row.upper});
}

void set_groups(Arm& arm, rust::Slice<const std::size_t> chain, rust::Slice<const std::size_t> hand, std::size_t tip) {
  arm.arm.assign(chain.begin(), chain.end());
  arm.hand.assign(hand.begin(), hand.end());
  arm.tip = tip;
}

void allow_pair(Arm& arm, std::size_t a, std::size_t b) { arm.allowed_collisions.emplace_back(a, b); }

std::shared_ptr<Roadmap> new_roadmap(const RoadmapRow& row, std::size_t joints) {
  auto roadmap = std::make_shared<Roadmap>();
  roadmap->milestones = rows_of({row.milestones.data(), row.milestones.size()}, joints);
  for (std::size_t k = 0; k + 1 < row.edges.size(); k += 2) roadmap->edges.emplace_back(row.edges[k], row.edges[k + 1]);
  return roadmap;
}

std::unique_ptr<Scene> new_scene(const Arm& arm) { return std::make_unique<Scene>(arm); }

void set_base(Scene& scene, const std::array<double, 7>& pose) { scene.set_base(pose_from_array(pose)); }

void set_hand(Scene& scene, rust::Slice<const double> angles) {
  scene.set_hand(std::vector<double>(angles.begin(), angles.end()));
}

void set_obstacles(Scene& scene, rust::Slice<const rust::String> names, rust::Slice<const ShapeRow> shapes,
                   rust::Slice<const MeshRow> meshes) {
  std::vector<Object> obstacles;
  for (std::size_t k = 0; k < names.size(); ++k) obstacles.push_back({std::string(names[k]), placed_of(shapes[k])});
  for (const MeshRow& row : meshes) {
    auto mesh = std::make_shared<Mesh>();
    for (std::size_t k = 0; k + 2 < row.vertices.size(); k += 3) {
      mesh->vertices.push_back({row.vertices[k], row.vertices[k + 1], row.vertices[k + 2]});
    }
    for (std::size_t k = 0; k + 2 < row.triangles.size(); k += 3) {
      mesh->triangles.push_back({row.triangles[k], row.triangles[k + 1], row.triangles[k + 2]});
    }
    obstacles.push_back({std::string(row.name), {{ShapeKind::mesh, {}, std::move(mesh)}, pose_from_array(row.pose)}});
  }
  scene.set_obstacles(obstacles);
}

void set_attached(Scene& scene, rust::Str name, const ShapeRow& shape) {
  scene.set_attached(Object{std::string(name), placed_of(shape)});
}

void clear_attached(Scene& scene) { scene.set_attached(std::nullopt); }

void set_padding(Scene& scene, double padding_m) { scene.set_padding(padding_m); }

void allow_contact(Scene& scene, rust::Str member, rust::Str obstacle) {
  scene.allow_contact(std::string(member), std::string(obstacle));
}

void clear_allowed_contacts(Scene& scene) { scene.clear_allowed_contacts(); }

rust::Vec<ContactRow> collisions(Scene& scene, rust::Slice<const double> q, bool all_links) {
  rust::Vec<ContactRow> rows;
  for (const auto& [a, b] : all_links ? scene.collisions_of_all_links(q.data()) : scene.collisions(q.data())) {
    rows.push_back({rust::String(a), rust::String(b)});
  }
  return rows;
}

bool is_free(Scene& scene, rust::Slice<const double> q) { return scene.is_free(q.data()); }

bool motion_is_free(Scene& scene, rust::Slice<const double> a, rust::Slice<const double> b, const SearchRow& search) {
  return motion_is_free(scene, a.data(), b.data(), resolution_of(search));
}

bool path_is_free(Scene& scene, rust::Slice<const double> states, const SearchRow& search) {
  return path_is_free(scene, states.data(), states.size() / scene.joint_count(), resolution_of(search));
}

bool states_are_free(Scene& scene, rust::Slice<const double> states) {
  return states_are_free(scene, states.data(), states.size() / scene.joint_count());
}

PlanRow plan_joint(Scene& scene, rust::Slice<const double> start, rust::Slice<const double> goals,
                   const SearchRow& search, const std::shared_ptr<Roadmap>& roadmap, const CancelFlag& cancel) {
  JointQuery query = query_between(scene, start, goals, search);
  query.roadmap = roadmap;
  return row_of(plan_joint(scene, query, cancel));
}

PlanRow plan_joint_constrained(Scene& scene, rust::Slice<const double> start, rust::Slice<const double> goals,
                         const SearchRow& search, StateCheck& check, const CancelFlag& cancel) {
  JointQuery query = query_between(scene, start, goals, search);
  const std::size_t joints = scene.joint_count();
  query.accepts = [&check, joints](const double* q) { return check.accepts({q, joints}); };
  return row_of(plan_joint(scene, query, cancel));
}

std::size_t count_free(Scene& scene, rust::Slice<const double> states) {
  std::size_t free = 0;
  const std::size_t joints = scene.joint_count();
  for (std::size_t k = 0; k + joints <= states.size(); k += joints) free += scene.is_free(states.data() + k) ? 1 : 0;
  return free;
}

std::size_t count_accepted(rust::Slice<const double> states, std::size_t joints, StateCheck& check) {
  std::size_t accepted = 0;
  for (std::size_t k = 0; k + joints <= states.size(); k += joints) {
    accepted += check.accepts({states.data() + k, joints}) ? 1 : 0;
  }
  return accepted;
}

RoadmapRow grow_roadmap(Scene& scene, const SearchRow& search, std::size_t milestones, const CancelFlag& cancel) {
  const Roadmap roadmap = grow_roadmap(scene, query_of(search), milestones, cancel);
  RoadmapRow row{flat(roadmap.milestones), {}};
  for (const auto& [a, b] : roadmap.edges) {
    row.edges.push_back(a);
    row.edges.push_back(b);
  }
  return row;
}

BaselineRow search_baseline(const Scene& scene, rust::Slice<const double> start, rust::Slice<const double> goals,
                        const SearchRow& search) {
  BaselineSettings settings;
  const JointQuery query = query_of(search);
  settings.planner = query.planner;
  settings.seconds = query.max_seconds;
  if (query.resolution.fixed_validity_step > 0.0) settings.fixed_validity_step = query.resolution.fixed_validity_step;
  const BaselinePlan plan = search_baseline(scene, {start.begin(), start.end()}, rows_of(goals, scene.joint_count()),
                                            settings, query.seed);
  return {flat(plan.path), plan.attempts, plan.search_secs, plan.cpu_secs};
}

void check_planner(const SearchRow& search) { check_planner(query_of(search)); }

std::shared_ptr<CancelFlag> new_cancel_flag() { return std::make_shared<CancelFlag>(); }

void raise_flag(const CancelFlag& flag) { flag.raise(); }

void lower_flag(const CancelFlag& flag) { flag.lower(); }

}  // namespace proact::planning
