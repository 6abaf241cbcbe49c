// FNV-1a over the bits of numbers, the same as in rust/dynamics/tests/side_by_side.rs.
#pragma once

#include <cstdint>
#include <cstring>

class Digest {
 public:
  void add(double value) {
    std::uint64_t bits = 0;
    std::memcpy(&bits, &value, sizeof bits);
    hash_ = (hash_ ^ bits) * 0x100000001b3ULL;
  }
  std::uint64_t value() const { return hash_; }

 private:
  std::uint64_t hash_ = 0xcbf29ce484222325ULL;
};
