/* Included before every source of liblsl; liblsl.cmake says why. */
#include <limits.h>
#undef PTHREAD_STACK_MIN
/* Zero skips Boost's check of a thread's stack size; liblsl asks for none. */
#define PTHREAD_STACK_MIN 0
