// Rows of numbers, as the factors of small matrices are made of.
#pragma once

#include <cstddef>
#include <cstring>

namespace proact::dynamics {

/// Two numbers that the processor takes together.
using DoublePair = double __attribute__((vector_size(2 * sizeof(double))));

inline DoublePair pair_at(const double* numbers) {
  DoublePair pair;
  std::memcpy(&pair, numbers, sizeof pair);
  return pair;
}

/// Of two rows of numbers. Four sums at once, because each addition waits for the one before it.
inline double dot_product(const double* a, const double* b, std::size_t count) {
  DoublePair sums[2] = {};
  std::size_t k = 0;
  for (; k + 4 <= count; k += 4) {
    sums[0] += pair_at(a + k) * pair_at(b + k);
    sums[1] += pair_at(a + k + 2) * pair_at(b + k + 2);
  }
  double first = sums[0][0];
  for (; k < count; ++k) first += a[k] * b[k];
  return (first + sums[0][1]) + (sums[1][0] + sums[1][1]);
}

/// Takes so much of a row of numbers off another.
inline void subtract_scaled(double* from, const double* row, double so_much, std::size_t count) {
  std::size_t k = 0;
  for (; k + 2 <= count; k += 2) {
    const DoublePair rest = pair_at(from + k) - pair_at(row + k) * so_much;
    std::memcpy(from + k, &rest, sizeof rest);
  }
  if (k < count) from[k] -= row[k] * so_much;
}

}  // namespace proact::dynamics
