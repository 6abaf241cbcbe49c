#include "ode_world.hpp"

#include <mutex>
#include <stdexcept>

namespace proact::dynamics {

OdeWorld::OdeWorld(const Options& options) : solver_(options.solver), state_{options.seed, 0} {
  prepare_ode_in_this_thread();

  // Worlds on ODE's default threading share its job queue and abort when two of them step at once.
  threading_.reset(dThreadingAllocateSelfThreadedImplementation());
  world_.reset(dWorldCreate());
  if (!threading_ || !world_) throw std::runtime_error("ODE could not make a world");
  dWorldSetStepThreadingImplementation(world_.get(), dThreadingImplementationGetFunctions(threading_.get()),
                                       threading_.get());

  dWorldSetGravity(world_.get(), options.gravity.x, options.gravity.y, options.gravity.z);
  dWorldSetERP(world_.get(), options.joint_erp);
  dWorldSetCFM(world_.get(), options.joint_cfm);
  dWorldSetContactSurfaceLayer(world_.get(), options.surface_layer);
  dWorldSetContactMaxCorrectingVel(world_.get(), options.max_correcting_speed_m_per_s);
  dWorldSetQuickStepNumIterations(world_.get(), options.iterations);
  dWorldSetAutoDisableFlag(world_.get(), 0);
  // So that a complaint asks for no memory within a tick.
  last_warning_.reserve(message_size);
}

void OdeWorld::step() {
  const unsigned long before = ode_message_count();
  int done = 1;
  if (solver_ == Solver::direct) {
    done = dWorldStep(world_.get(), tick_secs);
  } else {
    // The order of constraints comes from a generator that all worlds share: each brings its own seed.
    const std::lock_guard<std::mutex> turn(generator_mutex());
    dRandSetSeed(state_.seed);
    done = dWorldQuickStep(world_.get(), tick_secs);
    state_.seed = dRandGetSeed();
  }
  if (const unsigned long new_messages = ode_message_count() - before; new_messages > 0) {
    state_.warnings += new_messages;
    last_warning_ = ode_last_message();
  }
  if (done == 0) throw std::runtime_error("out of memory in a step");
}

}  // namespace proact::dynamics
