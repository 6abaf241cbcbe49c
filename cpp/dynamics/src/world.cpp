#include "proact/dynamics/world.hpp"

#include "simulation.hpp"

#include <mutex>
#include <utility>
#include <vector>

namespace proact::dynamics {

World::World(Model model) : simulation_(std::make_unique<Simulation>(std::move(model))) {}

World::~World() {
  if (simulation_->failure_.empty()) return;
  // An error thrown through ODE leaves its job list half done, and tidying that up ends the process. So a failed
  // simulation is kept until the process ends, and so is the list that holds it.
  static std::mutex mutex;
  static auto* const kept = new std::vector<std::unique_ptr<Simulation>>;
  const std::lock_guard lock(mutex);
  kept->push_back(std::move(simulation_));
}

std::size_t World::joint_count() const noexcept { return simulation_->model_.moving.size(); }
std::size_t World::block_count() const noexcept { return simulation_->model_.blocks.size(); }

void World::step(const double* position, const double* velocity, const Pose& world_from_base) {
  simulation_->step(position, velocity, world_from_base);
}

const std::vector<double>& World::positions() const noexcept { return simulation_->positions_; }
const std::vector<double>& World::velocities() const noexcept { return simulation_->velocities_; }
const std::vector<double>& World::efforts() const noexcept { return simulation_->efforts_; }
const Pose& World::world_from_base() const noexcept { return simulation_->world_from_base_; }
const std::vector<BodyState>& World::blocks() const noexcept { return simulation_->blocks_; }
const std::vector<Contact>& World::contacts() const noexcept { return simulation_->contacts_; }
const std::optional<Attachment>& World::attached() const noexcept { return simulation_->attached_; }

void World::attach(std::size_t block, std::size_t link) { simulation_->attach(block, link); }
void World::release() { simulation_->release(); }
std::vector<double> World::save() const { return simulation_->save(); }
void World::restore(const std::vector<double>& numbers) { simulation_->restore(numbers); }
bool World::base_held() const noexcept { return simulation_->base_held_; }
Pose World::link_pose(std::size_t link) const { return simulation_->link_pose(link); }
std::size_t World::arm_body_count() const noexcept { return simulation_->arm_body_count(); }
std::uint64_t World::solver_complaints() const noexcept { return simulation_->complaints_; }
const std::string& World::last_complaint() const noexcept { return simulation_->last_complaint_; }

}  // namespace proact::dynamics
