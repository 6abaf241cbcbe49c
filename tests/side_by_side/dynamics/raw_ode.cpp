// A chain of seven links that swings down from the horizontal, and a box-shaped block that falls onto a table, on
// ODE alone. Prints one digest of all joint angles, speeds and the block's pose and twist for every tick.
//
// Lengths, masses and inertias are powers of two, so that no order of operations rounds differently while the bodies
// are set up: every difference that is left would come from the stepping.

#include "digest.hpp"

#include <ode/ode.h>

#include <array>
#include <cstdio>
#include <vector>

namespace {

constexpr int links = 7;
constexpr double link_length = 0.125;
constexpr double step = 1e-3;
constexpr double erp = 0.2;
constexpr double friction = 0.4;
constexpr double damping = 0.05;

void touch(dWorldID world, dJointGroupID group, dGeomID block, dGeomID table) {
  std::array<dContactGeom, 8> found;
  const int count = dCollide(block, table, static_cast<int>(found.size()), found.data(), sizeof(dContactGeom));
  for (int k = 0; k < count; ++k) {
    dContact contact{};
    contact.surface.mode = dContactApprox1 | dContactSoftERP | dContactSoftCFM;
    contact.surface.mu = friction;
    contact.surface.soft_erp = 0.2;
    contact.surface.soft_cfm = 1e-3;
    contact.geom = found[static_cast<std::size_t>(k)];
    dJointAttach(dJointCreateContact(world, group, &contact), dGeomGetBody(block), nullptr);
  }
}

}  // namespace

int main() {
  dInitODE2(0);
  const dWorldID world = dWorldCreate();
  const dJointGroupID group = dJointGroupCreate(0);
  dWorldSetGravity(world, 0, 0, -9.80665);
  dWorldSetERP(world, erp);
  dWorldSetCFM(world, 1e-7);
  dWorldSetContactSurfaceLayer(world, 5e-5);
  dWorldSetContactMaxCorrectingVel(world, 0.5);

  const dBodyID block = dBodyCreate(world);
  dMass mass;
  dMassSetBoxTotal(&mass, 0.125, 0.0625, 0.0625, 0.125);
  dBodySetMass(block, &mass);
  const dQuaternion tilted{0.5, 0.5, 0.5, 0.5};
  dBodySetPosition(block, 3, 0, 0.25);
  dBodySetQuaternion(block, tilted);
  dBodySetAngularVel(block, 0, 0, 0);
  const dGeomID block_geom = dCreateBox(nullptr, 0.0625, 0.0625, 0.125);
  dGeomSetBody(block_geom, block);
  const dGeomID table_geom = dCreateBox(nullptr, 8, 8, 0.125);
  dGeomSetPosition(table_geom, 0, 0, -0.0625);
  // Turned a little, so that the block lands on an edge and tips.
  const dQuaternion slope{0.995, 0.09987492177719089, 0, 0};
  dGeomSetQuaternion(table_geom, slope);

  std::vector<dBodyID> bodies{dBodyCreate(world)};
  for (int k = 0; k < links; ++k) bodies.push_back(dBodyCreate(world));
  dBodySetKinematic(bodies[0]);
  dBodySetPosition(bodies[0], 0, 0, 2);
  for (int k = 1; k <= links; ++k) {
    dMassSetParameters(&mass, 0.125, 0, 0, 0, 0.0009765625, 0.0009765625, 0.0009765625, 0, 0, 0);
    const dBodyID body = bodies[static_cast<std::size_t>(k)];
    dBodySetMass(body, &mass);
    dBodySetPosition(body, (k - 0.5) * link_length, 0, 2);
  }
  std::vector<dJointID> hinges;
  for (int k = 1; k <= links; ++k) {
    const dJointID hinge = dJointCreateHinge(world, nullptr);
    dJointAttach(hinge, bodies[static_cast<std::size_t>(k)], bodies[static_cast<std::size_t>(k - 1)]);
    dJointSetHingeAnchor(hinge, (k - 1) * link_length, 0, 2);
    dJointSetHingeAxis(hinge, 0, 1, 0);
    hinges.push_back(hinge);
  }

  Digest digest;
  for (int tick = 0; tick < 1000; ++tick) {
    for (int k = 0; k < links; ++k) {
      const dJointID hinge = hinges[static_cast<std::size_t>(k)];
      // Implicit Euler of each joint by itself; the first joint's parent cannot move.
      const double inertia = k == 0 ? 0.0009765625 : 0.00048828125;
      dJointAddHingeTorque(hinge, -damping * dJointGetHingeAngleRate(hinge) / (1.0 + step * damping / inertia));
    }
    dJointGroupEmpty(group);
    touch(world, group, block_geom, table_geom);
    dWorldStep(world, step);
    for (const dJointID hinge : hinges) digest.add(dJointGetHingeAngle(hinge));
    for (const dJointID hinge : hinges) digest.add(dJointGetHingeAngleRate(hinge));
    for (int k = 0; k < 3; ++k) digest.add(dBodyGetPosition(block)[k]);
    for (const int k : {1, 2, 3, 0}) digest.add(dBodyGetQuaternion(block)[k]);
    for (int k = 0; k < 3; ++k) digest.add(dBodyGetLinearVel(block)[k]);
    for (int k = 0; k < 3; ++k) digest.add(dBodyGetAngularVel(block)[k]);
    std::printf("%016llx\n", static_cast<unsigned long long>(digest.value()));
  }
  return 0;
}
