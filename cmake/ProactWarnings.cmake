# Compiler flags shared by every C++ target of ProACT: the ctest builds here, and catkin later.
#
#   include(ProactWarnings)
#   proact_target_options(my_target)
#
# The numerical flags equal those that each crate's build.rs hands to its own compiler run, so that a C++
# test and the Rust program compute the same bits.

set(PROACT_SANITIZE "" CACHE STRING
  "Sanitizers to build with: empty, \"address,undefined\" or \"thread\"")
set_property(CACHE PROPERTY PROACT_SANITIZE PROPERTY STRINGS "" "address,undefined" "thread")

if(NOT PROACT_SANITIZE MATCHES "^(|address|undefined|address,undefined|thread)$")
  message(FATAL_ERROR
    "PROACT_SANITIZE is \"${PROACT_SANITIZE}\"; expected empty, \"address,undefined\" or \"thread\"")
endif()

function(proact_target_options target)
  target_compile_features(${target} PUBLIC cxx_std_17)
  set_target_properties(${target} PROPERTIES CXX_EXTENSIONS OFF POSITION_INDEPENDENT_CODE ON)
  # A contracted multiply-add rounds once where the plain pair rounds twice; whether the compiler contracts
  # depends on inlining, so the two builds would part company in the last bit.
  target_compile_options(${target} PRIVATE
    -O2 -ffp-contract=off -Wall -Wextra -Wconversion -Werror)
  if(PROACT_SANITIZE)
    # -O2 makes the optimizer report false "maybe uninitialized" findings inside instrumented library headers.
    target_compile_options(${target} PRIVATE
      -fsanitize=${PROACT_SANITIZE} -fno-sanitize-recover=all -fno-omit-frame-pointer -g
      -Wno-maybe-uninitialized)
    target_link_options(${target} PUBLIC -fsanitize=${PROACT_SANITIZE})
  endif()
endfunction()
