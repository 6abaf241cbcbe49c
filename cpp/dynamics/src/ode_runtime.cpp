#include "ode_runtime.hpp"

#include <cstdarg>
#include <cstdio>
#include <stdexcept>

namespace proact::dynamics {

namespace {

thread_local unsigned long messages = 0;
thread_local char last_message[message_size] = "";

// Models are checked before ODE sees them, so these run only on a defect of ours or of ODE. If the handler
// returned, ODE would end the process.
void throw_error(int number, const char* format, std::va_list arguments) {
  char text[512];
  std::vsnprintf(text, sizeof text, format, arguments);
  throw std::runtime_error("internal error " + std::to_string(number) + ": " + text);
}

// Without a handler ODE would print them on the standard error of whoever uses us.
void keep_message(int, const char* format, std::va_list arguments) {
  ++messages;
  std::vsnprintf(last_message, sizeof last_message, format, arguments);
}

bool initialize_ode() {
  if (dInitODE2(0) == 0) throw std::runtime_error("dInitODE2 failed");
  dSetErrorHandler(throw_error);
  dSetDebugHandler(throw_error);
  dSetMessageHandler(keep_message);
  return true;
}

}  // namespace

void prepare_ode_in_this_thread() {
  static const bool started = initialize_ode();
  static_cast<void>(started);
  if (dAllocateODEDataForThread(dAllocateMaskAll) == 0) throw std::runtime_error("dAllocateODEDataForThread failed");
}

unsigned long ode_message_count() { return messages; }

const char* ode_last_message() { return last_message; }

std::mutex& generator_mutex() {
  static std::mutex mutex;
  return mutex;
}

}  // namespace proact::dynamics
