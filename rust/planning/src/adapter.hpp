// What cxx sees: slices and rows in and out over the plain core.
#pragma once

#include "proact/planning/baseline_search.hpp"
#include "rust/cxx.h"

#include <array>
#include <memory>

namespace proact::planning {

struct ShapeRow;
struct JointRow;
struct ContactRow;
struct SearchRow;
struct PlanRow;
struct BaselineRow;
struct MeshRow;
struct RoadmapRow;
struct StateCheck;

std::unique_ptr<Arm> new_arm();
void add_link(Arm& arm, rust::Str name, rust::Slice<const ShapeRow> shapes);
void add_joint(Arm& arm, const JointRow& joint);
void set_groups(Arm& arm, rust::Slice<const std::size_t> chain, rust::Slice<const std::size_t> hand, std::size_t tip);
void allow_pair(Arm& arm, std::size_t a, std::size_t b);

std::shared_ptr<Roadmap> new_roadmap(const RoadmapRow& row, std::size_t joints);

std::unique_ptr<Scene> new_scene(const Arm& arm);
void set_base(Scene& scene, const std::array<double, 7>& pose);
void set_hand(Scene& scene, rust::Slice<const double> angles);
void set_obstacles(Scene& scene, rust::Slice<const rust::String> names, rust::Slice<const ShapeRow> shapes,
                   rust::Slice<const MeshRow> meshes);
void set_attached(Scene& scene, rust::Str name, const ShapeRow& shape);
void clear_attached(Scene& scene);
void set_padding(Scene& scene, double padding_m);
void allow_contact(Scene& scene, rust::Str member, rust::Str obstacle);
void clear_allowed_contacts(Scene& scene);
rust::Vec<ContactRow> collisions(Scene& scene, rust::Slice<const double> q, bool all_links);
bool is_free(Scene& scene, rust::Slice<const double> q);
bool motion_is_free(Scene& scene, rust::Slice<const double> a, rust::Slice<const double> b, const SearchRow& search);
bool path_is_free(Scene& scene, rust::Slice<const double> states, const SearchRow& search);
bool states_are_free(Scene& scene, rust::Slice<const double> states);
PlanRow plan_joint(Scene& scene, rust::Slice<const double> start, rust::Slice<const double> goals,
                   const SearchRow& search, const std::shared_ptr<Roadmap>& roadmap, const CancelFlag& cancel);
PlanRow plan_joint_constrained(Scene& scene, rust::Slice<const double> start, rust::Slice<const double> goals,
                         const SearchRow& search, StateCheck& check, const CancelFlag& cancel);
std::size_t count_free(Scene& scene, rust::Slice<const double> states);
std::size_t count_accepted(rust::Slice<const double> states, std::size_t joints, StateCheck& check);
RoadmapRow grow_roadmap(Scene& scene, const SearchRow& search, std::size_t milestones, const CancelFlag& cancel);
BaselineRow search_baseline(const Scene& scene, rust::Slice<const double> start, rust::Slice<const double> goals,
                        const SearchRow& search);
void check_planner(const SearchRow& search);

std::shared_ptr<CancelFlag> new_cancel_flag();
// The flag is an atomic: raising it through a shared reference is what it is for.
void raise_flag(const CancelFlag& flag);
void lower_flag(const CancelFlag& flag);

}  // namespace proact::planning
