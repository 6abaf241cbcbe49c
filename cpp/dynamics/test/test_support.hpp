// What the test programs of the dynamics core share.
#pragma once

#include "proact/dynamics/world.hpp"

#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <functional>
#include <stdexcept>
#include <string>
#include <vector>

namespace proact::dynamics::testing {

inline int failures = 0;

inline void check(bool good, const std::string& what) {
  if (good) return;
  std::fprintf(stderr, "FAILED: %s\n", what.c_str());
  ++failures;
}

inline void check_refused(const std::string& name, const std::string& expected, const std::function<void()>& action) {
  try {
    action();
    check(false, name + ": was accepted");
  } catch (const std::exception& error) {
    check(std::string(error.what()).find(expected) != std::string::npos,
          name + ": \"" + error.what() + "\" does not contain \"" + expected + "\"");
  }
}

/// Base and `count` links of 0.1 m along x, each turning about y; all but the first joint belong to the hand.
inline Model chain(std::size_t count) {
  Model model;
  model.world_from_base = {{0.0, 0.0, 2.0}, {}};
  model.links.push_back({"base", 0.0, {}, {}, {}});
  for (std::size_t k = 0; k < count; ++k) {
    Link link{"link" + std::to_string(k), 0.1, {{0.05, 0.0, 0.0}, {}}, {1e-5, 0, 0, 1e-4, 0, 1e-4}, {}};
    link.collisions.push_back({{{0.05, 0.0, 0.0}, {0.0, std::sqrt(0.5), 0.0, std::sqrt(0.5)}},
                               {ShapeKind::cylinder, {0.01, 0.09, 0.0}}});
    model.links.push_back(link);
    Joint joint{"joint" + std::to_string(k), JointKind::revolute, k, {}, {0, 1, 0}, -2.0, 2.0, 2.0, 5.0, 0.01, 0.0};
    if (k > 0) joint.origin.position.x = 0.1;
    model.joints.push_back(joint);
    model.moving.push_back(k);
    model.positions.push_back(0.0);
  }
  model.arm_count = 1;
  return model;
}

inline Block cylinder(const std::string& name, Pose pose) {
  return {name, {ShapeKind::cylinder, {0.025, 0.05, 0.0}}, 0.1, 0.4, 0.8, pose};
}

inline void add_table(Model& model) {
  model.fixed.push_back({"table", {ShapeKind::box, {4.0, 4.0, 0.1}}, {{0.0, 0.0, -0.05}, {}}, 0.4});
}

inline void run(World& world, int ticks) {
  const std::vector<double> position = world.positions();
  const std::vector<double> velocity(position.size(), 0.0);
  for (int k = 0; k < ticks; ++k) world.step(position.data(), velocity.data(), world.world_from_base());
}

/// Adds numbers to a hash of their bits (FNV-1a).
class Digest {
 public:
  void add(double value) {
    std::uint64_t bits = 0;
    std::memcpy(&bits, &value, sizeof bits);
    for (int k = 0; k < 8; ++k) {
      hash_ = (hash_ ^ (bits & 0xffU)) * 0x100000001b3ULL;
      bits >>= 8U;
    }
  }
  void add(const Vec3& v) {
    for (const double value : {v.x, v.y, v.z}) add(value);
  }
  void add(const World& world) {
    for (const auto* values : {&world.positions(), &world.velocities(), &world.efforts()}) {
      for (const double value : *values) add(value);
    }
    for (const BodyState& block : world.blocks()) {
      add(block.pose.position);
      for (const double value : {block.pose.rotation.x, block.pose.rotation.y, block.pose.rotation.z, block.pose.rotation.w}) add(value);
      add(block.linear);
      add(block.angular);
    }
    for (const Contact& contact : world.contacts()) {
      add(contact.point);
      add(contact.normal);
      add(contact.force);
    }
  }
  std::uint64_t value() const { return hash_; }

 private:
  std::uint64_t hash_ = 0xcbf29ce484222325ULL;
};

inline int finish(const char* name) {
  if (failures == 0) std::printf("all %s tests passed\n", name);
  return failures == 0 ? EXIT_SUCCESS : EXIT_FAILURE;
}

}  // namespace proact::dynamics::testing
