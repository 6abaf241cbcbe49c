// What cxx sees: slices in and out over the plain core. Lengths are those that bridge.rs names; the Rust side
// hands in fixed-size arrays or has checked them.
#pragma once

#include "proact/dynamics/world.hpp"
#include "rust/cxx.h"

#include <cstddef>
#include <cstdint>
#include <memory>

namespace proact::dynamics {

struct ContactRecord;
struct DynamicsSettings;

using In = rust::Slice<const double>;
using Out = rust::Slice<double>;

std::unique_ptr<Model> new_model(const DynamicsSettings& settings, In world_from_base);
void add_link(Model& model, rust::Str name, double mass, In inertial, In inertia);
void add_collision(Model& model, ShapeKind kind, In size, In pose);
void add_joint(Model& model, rust::Str name, JointKind kind, std::size_t parent, In origin, In axis, In numbers);
void set_moving(Model& model, rust::Slice<const std::size_t> joints, std::size_t arm_count, In positions);
void add_fixed(Model& model, rust::Str name, ShapeKind kind, In size, In pose, double friction);
void add_block(Model& model, rust::Str name, ShapeKind kind, In size, In pose, In numbers);
std::unique_ptr<World> new_world(const Model& model);

void step_world(World& world, In position, In velocity, In world_from_base);
void read_joints(const World& world, Out position, Out velocity, Out effort, Out limit_effort);
void read_block(const World& world, std::size_t block, Out out);
std::size_t contact_count(const World& world);
ContactRecord read_contact(const World& world, std::size_t index);
bool read_attached(const World& world, std::size_t& block, Out pose);
bool base_held(const World& world);
rust::Vec<double> save_world(const World& world);
void restore_world(World& world, In numbers);
void read_link(const World& world, std::size_t link, Out pose);
void attach_block(World& world, std::size_t block, std::size_t link);
void release_block(World& world);
void place_block(World& world, std::size_t block, In state);
std::size_t arm_body_count(const World& world);
std::uint64_t solver_warnings(const World& world);
rust::String last_solver_warning(const World& world);

}  // namespace proact::dynamics
