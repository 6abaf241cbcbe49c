#include "simulation.hpp"

#include "snapshot.hpp"

#include <cmath>
#include <stdexcept>
#include <string>
#include <utility>

namespace proact::dynamics {

namespace {

Model validated(Model model) {
  validate(model);
  return model;
}

}  // namespace

World::Simulation::Simulation(Model model)
    : model_(validated(std::move(model))),
      ode_world_(model_.options),
      contact_joints_(model_.options, ode_world_.id()),
      base_(model_),
      joints_(model_),
      control_(model_, joints_),
      attachment_(model_.options),
      blocks_(model_, ode_world_.id()),
      geoms_(model_),
      collisions_(model_, geoms_, blocks_, attachment_),
      islands_(model_, blocks_, attachment_),
      arm_(make_arm({model_, ode_world_.id(), base_, joints_, control_, blocks_, attachment_, geoms_, contact_joints_,
                     islands_})) {
  arm_->build();
  arm_->place_geoms();
  collisions_.refuse_overlaps();
}

void World::Simulation::refuse_failed() const {
  if (failed()) throw std::runtime_error(failure_);
}

void World::Simulation::check_command(const double* position, const double* velocity, const Pose& world_from_base) const {
  for (std::size_t k = 0; k < model_.moving.size(); ++k) {
    if (!std::isfinite(position[k]) || !std::isfinite(velocity[k])) {
      throw std::invalid_argument("the command of joint \"" + model_.joints[model_.moving[k]].name + "\" is not finite");
    }
  }
  if (!is_finite(world_from_base)) throw std::invalid_argument("the pose of the base is not finite");
}

void World::Simulation::step(const double* position, const double* velocity, const Pose& world_from_base) {
  refuse_failed();
  check_command(position, velocity, world_from_base);
  try {
    advance(position, velocity, world_from_base);
  } catch (const std::exception& error) {
    failure_ = std::string("the world is unusable since an earlier failure: ") + error.what();
    throw;
  }
}

/// One tick.
void World::Simulation::advance(const double* position, const double* velocity, const Pose& world_from_base) {
  if (joints_.update_rigid(position, velocity)) arm_->build();
  base_.begin_step(world_from_base);
  arm_->drive(position, velocity);
  contact_joints_.clear();
  arm_->place_geoms();
  islands_.wake_near(geoms_);
  collisions_.find(*arm_);
  islands_.assign_contacts(collisions_.constraints());
  if (!arm_->resolve_contacts(collisions_)) ode_world_.add_warning();
  islands_.integrate();
  step_ode();
  base_.end_step();
  arm_->finish();
  contact_joints_.read_forces(collisions_, islands_);
  islands_.end_step();
  read_blocks();
}

void World::Simulation::step_ode() {
  blocks_.put_to_sleep(attachment_);
  if (arm_->moved_by_ode() || !blocks_.all_asleep()) {
    const std::uint64_t complaints = ode_world_.state().warnings;
    ode_world_.step();
    if (ode_world_.state().warnings != complaints) islands_.stop_using_ode();
  }
  if (!joints_.all_finite() || !arm_->all_finite()) throw std::runtime_error("the arm left the finite numbers");
  blocks_.check_finite();
}

void World::Simulation::read_blocks() {
  for (std::size_t k = 0; k < blocks_.count(); ++k) {
    if (!attachment_.is_merged_block(k)) {
      blocks_.read(k);
      continue;
    }
    const Attachment& attachment = *attachment_.attached();
    const LinkGroups& links = arm_->links();
    const FrameMotion body = arm_->motion(links.body_of(attachment.link));
    const Pose pose = body.pose * links.body_from_link(attachment.link) * attachment.link_from_block;
    blocks_.set_state(k, {pose, body.linear + cross(body.angular, pose.position - body.pose.position), body.angular});
  }
}

Pose World::Simulation::link_pose(std::size_t link) const {
  const LinkGroups& links = arm_->links();
  if (link >= links.link_count()) {
    throw std::invalid_argument("link " + std::to_string(link) + ", there are " + std::to_string(links.link_count()));
  }
  return arm_->motion(links.body_of(link)).pose * links.body_from_link(link);
}

void World::Simulation::check_block(std::size_t block) const {
  if (block >= blocks_.count()) {
    throw std::invalid_argument("block " + std::to_string(block) + ", there are " + std::to_string(blocks_.count()));
  }
}

void World::Simulation::attach(std::size_t block, std::size_t link) {
  refuse_failed();
  check_block(block);
  if (const auto& attached = attachment_.attached(); attached) {
    throw std::invalid_argument("block \"" + model_.blocks[attached->block].name + "\" is attached already, release it first");
  }
  attachment_.attach({block, link, inverse(link_pose(link)) * blocks_.states()[block].pose});
  if (attachment_.is_separate()) {
    dBodyEnable(blocks_.body(block));
  } else {
    dBodyDisable(blocks_.body(block));
  }
  collisions_.require_separation(block);
  arm_->build();
}

void World::Simulation::release() {
  if (!attachment_.attached()) return;
  const std::size_t block = attachment_.attached()->block;
  attachment_.detach();
  blocks_.reset_body(block);
  arm_->build();
}

void World::Simulation::place(std::size_t block, const BodyState& state) {
  refuse_failed();
  check_block(block);
  const std::string name = "block \"" + model_.blocks[block].name + "\"";
  if (!is_finite(state.pose) || !is_finite(state.linear) || !is_finite(state.angular)) {
    throw std::invalid_argument("the place or the speed of " + name + " is not finite");
  }
  if (attachment_.is_attached(block)) throw std::invalid_argument(name + " is attached, release it first");
  const OdeBodyState before = OdeBodyState::capture(blocks_.body(block));
  set_body_pose(blocks_.body(block), state.pose);
  arm_->place_geoms();
  try {
    collisions_.refuse_overlaps_of(block);
  } catch (...) {
    before.restore(blocks_.body(block));
    arm_->place_geoms();
    throw;
  }
  blocks_.set_state(block, state);
  blocks_.reset_body(block);
  islands_.wake(block);
  // Of a heap only those wake that lose a neighbour or get one.
  for (std::size_t k = 0; k < blocks_.count(); ++k) {
    if (!attachment_.is_attached(k) && !islands_.is_resting(k)) blocks_.wake(k);
  }
}

std::vector<double> World::Simulation::save() const {
  refuse_failed();
  Snapshot snapshot;
  snapshot.joints = joints_.state();
  snapshot.control = control_.state();
  snapshot.base = base_.state();
  snapshot.arm = arm_->state();
  snapshot.ode = ode_world_.state();
  snapshot.attached = attachment_.attached();
  snapshot.blocks = blocks_.states();
  snapshot.ticks_until_sleep = blocks_.ticks_until_sleep();
  snapshot.block_bodies = blocks_.ode_states();
  snapshot.separated = collisions_.separated();
  snapshot.contacts = collisions_.contacts();
  snapshot.islands = islands_.state();
  return serialize(model_, snapshot);
}

void World::Simulation::restore(const std::vector<double>& numbers) {
  refuse_failed();
  // All is read and checked before anything changes.
  const Snapshot snapshot = deserialize(model_, numbers);
  joints_.restore(snapshot.joints);
  control_.restore(snapshot.control);
  base_.restore(snapshot.base);
  ode_world_.restore(snapshot.ode);
  attachment_.restore(snapshot.attached);
  blocks_.restore(snapshot.blocks, snapshot.ticks_until_sleep);
  contact_joints_.clear();
  collisions_.restore(snapshot.separated, snapshot.contacts);
  islands_.restore(snapshot.islands);
  arm_->restore(snapshot.arm);
  blocks_.restore_bodies(snapshot.block_bodies);
}

}  // namespace proact::dynamics
