// Process-wide and per-thread state of ODE, and owners for its handles.
#pragma once

#include "proact/geometry.hpp"

#include <ode/ode.h>

#include <cstddef>
#include <memory>
#include <mutex>
#include <string>
#include <type_traits>

static_assert(sizeof(dReal) == 8, "ProACT needs ODE built with double precision");

namespace proact::dynamics {

/// Starts ODE once in the process and makes its data for the calling thread. From then on ODE's fatal errors
/// are thrown as std::runtime_error instead of ending the process, and its messages are counted.
void prepare_ode_in_this_thread();

/// Messages of ODE in the calling thread so far, such as a complementarity problem that it could not solve well.
unsigned long ode_message_count();

/// The latest of them, "" before the first; at most message_size - 1 characters.
const char* ode_last_message();
constexpr std::size_t message_size = 256;

/// Held while the iterative solver runs: its random generator belongs to the process.
std::mutex& generator_mutex();

template <auto Destroy>
struct OdeDeleter {
  template <typename T>
  void operator()(T* handle) const {
    Destroy(handle);
  }
};

template <typename Id, auto Destroy>
using OdePtr = std::unique_ptr<std::remove_pointer_t<Id>, OdeDeleter<Destroy>>;

using ThreadingPtr = OdePtr<dThreadingImplementationID, dThreadingFreeImplementation>;
using WorldPtr = OdePtr<dWorldID, dWorldDestroy>;
using JointGroupPtr = OdePtr<dJointGroupID, dJointGroupDestroy>;
using GeomPtr = OdePtr<dGeomID, dGeomDestroy>;

inline Vec3 to_vec(const dReal* v) { return {v[0], v[1], v[2]}; }
/// ODE's quaternions have the scalar first.
inline Quat to_quat(const dReal* q) { return {q[1], q[2], q[3], q[0]}; }

inline void set_body_pose(dBodyID body, const Pose& pose) {
  const dQuaternion q{pose.rotation.w, pose.rotation.x, pose.rotation.y, pose.rotation.z};
  dBodySetPosition(body, pose.position.x, pose.position.y, pose.position.z);
  dBodySetQuaternion(body, q);
}
inline void set_geom_pose(dGeomID geom, const Pose& pose) {
  const dQuaternion q{pose.rotation.w, pose.rotation.x, pose.rotation.y, pose.rotation.z};
  dGeomSetPosition(geom, pose.position.x, pose.position.y, pose.position.z);
  dGeomSetQuaternion(geom, q);
}
inline Pose body_pose(dBodyID body) { return {to_vec(dBodyGetPosition(body)), to_quat(dBodyGetQuaternion(body))}; }

}  // namespace proact::dynamics
