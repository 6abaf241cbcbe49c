// A tick asks for no memory once the largest number of contacts has been seen, and waits for no lock.

#include "test_support.hpp"

#include <dlfcn.h>
#include <ode/ode.h>
#include <pthread.h>

#include <mutex>
#include <new>

namespace {

unsigned long requests = 0;
unsigned long locks = 0;

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

// Stands before the library's own, which does the work. A std::mutex comes here too.
extern "C" int pthread_mutex_lock(pthread_mutex_t* mutex) {
  static int (*real)(pthread_mutex_t*) = nullptr;
  if (real == nullptr) real = reinterpret_cast<int (*)(pthread_mutex_t*)>(dlsym(RTLD_NEXT, "pthread_mutex_lock"));
  ++locks;
  return real(mutex);
}

using namespace proact;
using namespace proact::dynamics;
using namespace proact::dynamics::testing;

namespace {

/// The arm swings against a block; a hand joint moves, rests until it is rigid, and moves again; a block is taken and let go.
void use(World& world, int rounds) {
  std::vector<double> position(3, 0.0);
  const std::vector<double> velocity(3, 0.0);
  for (int k = 0; k < rounds * 1000; ++k) {
    position[0] = 0.05 * std::sin(0.01 * k);
    if (k % 1000 < 500) position[1] = -0.05 * std::sin(0.02 * (k % 1000));
    if (k % 1000 == 600) world.attach(0, 1);
    if (k % 1000 == 700) world.release();
    world.step(position.data(), velocity.data(), world.world_from_base());
  }
}

void a_tick_asks_for_no_memory_and_no_lock(bool sleep) {
  Model model = chain(3);
  add_table(model);
  model.options.sleep = sleep;
  model.world_from_base.position.z = 0.05;
  model.blocks.push_back(cylinder("standing", {{1.0, 0, 0.025}, {}}));
  model.blocks.push_back(cylinder("pushed", {{0.15, 0.0, 0.086}, {}}));
  World world(std::move(model));
  use(world, 2);
  const unsigned long requests_before = requests;
  const unsigned long locks_before = locks;
  use(world, 2);
  const unsigned long during = requests - requests_before;
  check(requests_before > 0, "the counter must see the construction");
  // The two vectors of commands are the test's own.
  check(during <= 2, std::to_string(during) + " requests for memory in 2,000 ticks");
  check(locks == locks_before, std::to_string(locks - locks_before) + " locks in 2,000 ticks");
}

}  // namespace

int main() {
  dSetAllocHandler(counted);
  dSetReallocHandler(counted_again);
  std::mutex mutex;
  mutex.lock();
  mutex.unlock();
  check(locks > 0, "the counter must see a lock");
  a_tick_asks_for_no_memory_and_no_lock(false);
  a_tick_asks_for_no_memory_and_no_lock(true);
  return finish("allocation");
}
