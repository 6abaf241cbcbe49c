# For the copy of liblsl in the crate lsl-sys; .cargo/config.toml names this file.
#
# With glibc 2.34 and newer PTHREAD_STACK_MIN is a function call, and the copy's old Boost wants to know in the
# preprocessor whether it is above zero. A header before all others makes it a number again.
add_compile_options(-include ${CMAKE_CURRENT_LIST_DIR}/liblsl.h)
