#include "proact/dynamics/world.hpp"

#include "simulation.hpp"

#include <mutex>
#include <utility>
#include <vector>

namespace proact::dynamics {

World::World(Model model) : simulation_(std::make_unique<Simulation>(std::move(model))) {}

World::~World() {
  if (!simulation_->failed()) return;
  // An error thrown through ODE leaves its job list half done, and tidying that up ends the process. So a failed
  // simulation is kept until the process ends, and so is the list that holds it.
  static std::mutex mutex;
  static auto* const kept = new std::vector<std::unique_ptr<Simulation>>;
  const std::lock_guard lock(mutex);
  kept->push_back(std::move(simulation_));
}

std::size_t World::joint_count() const noexcept { return simulation_->model().moving.size(); }
std::size_t World::block_count() const noexcept { return simulation_->model().blocks.size(); }

void World::step(const double* position, const double* velocity, const Pose& world_from_base) {
  simulation_->step(position, velocity, world_from_base);
}

const std::vector<double>& World::positions() const noexcept { return simulation_->joints().positions(); }
const std::vector<double>& World::velocities() const noexcept { return simulation_->joints().velocities(); }
const std::vector<double>& World::efforts() const noexcept { return simulation_->joints().efforts(); }
const std::vector<double>& World::limit_effort() const noexcept { return simulation_->joints().limit_effort(); }
const Pose& World::world_from_base() const noexcept { return simulation_->base().pose(); }
const std::vector<BodyState>& World::blocks() const noexcept { return simulation_->blocks().states(); }
const std::vector<Contact>& World::contacts() const noexcept { return simulation_->collisions().contacts(); }
const std::optional<Attachment>& World::attached() const noexcept { return simulation_->attachment().attached(); }

void World::attach(std::size_t block, std::size_t link) { simulation_->attach(block, link); }
void World::release() { simulation_->release(); }
void World::place(std::size_t block, const BodyState& state) { simulation_->place(block, state); }
std::vector<double> World::save() const { return simulation_->save(); }
void World::restore(const std::vector<double>& numbers) { simulation_->restore(numbers); }
bool World::base_held() const noexcept { return simulation_->base().state().held; }
Pose World::link_pose(std::size_t link) const { return simulation_->link_pose(link); }
std::size_t World::arm_body_count() const noexcept { return simulation_->arm().links().body_count(); }
std::uint64_t World::solver_warnings() const noexcept { return simulation_->ode_world().state().warnings; }
const std::string& World::last_solver_warning() const noexcept { return simulation_->ode_world().last_warning(); }

}  // namespace proact::dynamics
