// A tick asks for no memory once the largest number of contacts has been seen.

#include "test_support.hpp"

#include <ode/ode.h>

#include <new>

namespace {

unsigned long requests = 0;

void* counted(std::size_t size) {
  ++requests;
  return std::malloc(size);
}

void* counted_again(void* memory, std::size_t, std::size_t size) {
  ++requests;
  return std::realloc(memory, size);
}

}  // namespace

// Ours by operator new, ODE's by its handlers.
// Not inlined, or the compiler takes the pair for a mismatch of new and free.
[[gnu::noinline]] void* operator new(std::size_t size) {
  if (void* memory = counted(size)) return memory;
  throw std::bad_alloc();
}
[[gnu::noinline]] void operator delete(void* memory) noexcept { std::free(memory); }
[[gnu::noinline]] void operator delete(void* memory, std::size_t) noexcept { std::free(memory); }

using namespace proact::dynamics;
using namespace proact::dynamics::testing;

int main() {
  dSetAllocHandler(counted);
  dSetReallocHandler(counted_again);
  Model model = chain(3);
  add_table(model);
  model.options.sleep = false;
  model.world_from_base.position.z = 0.05;
  model.blocks.push_back(cylinder("standing", {{1.0, 0, 0.025}, {}}));
  model.blocks.push_back(cylinder("pushed", {{0.15, 0.0, 0.086}, {}}));
  World world(std::move(model));
  std::vector<double> position(3, 0.0);
  const std::vector<double> velocity(3, 0.0);
  const auto swing = [&](int ticks) {
    for (int k = 0; k < ticks; ++k) {
      position[0] = 0.05 * std::sin(0.01 * k);
      position[1] = -0.05 * std::sin(0.02 * k);
      world.step(position.data(), velocity.data(), world.world_from_base());
    }
  };
  swing(1000);
  const unsigned long before = requests;
  swing(1000);
  const unsigned long during = requests - before;
  check(before > 0, "the counters must see the construction");
  check(during == 0, std::to_string(during) + " requests for memory in 1,000 ticks");
  return finish("allocation");
}
