//! Pose and Jacobian are asked for in every control step and must not allocate, on either side of the bridge.
//!
//! The test puts its own `malloc` in front of glibc's, so that C++ (KDL and Eigen included) and Rust are counted
//! alike. A counting Rust allocator would not see C++.
#![cfg(all(target_os = "linux", target_env = "gnu"))]
#![allow(unsafe_code)]

use nalgebra::DMatrix;
use proact_kinematics::Kinematics;
use proact_types::Pose;
use std::cell::Cell;
use std::ffi::c_void;

thread_local! {
    // Each thread counts its own: the test runner allocates in another. Constant, so that the first use does
    // not allocate itself.
    static ALLOCATIONS: Cell<usize> = const { Cell::new(0) };
}

unsafe extern "C" {
    fn __libc_malloc(size: usize) -> *mut c_void;
    fn __libc_calloc(count: usize, size: usize) -> *mut c_void;
    fn __libc_realloc(old: *mut c_void, size: usize) -> *mut c_void;
}

fn count() {
    ALLOCATIONS.with(|allocations| allocations.set(allocations.get() + 1));
}

// SAFETY: same signature and contract as the function it replaces, to which it hands on.
#[unsafe(no_mangle)]
unsafe extern "C" fn malloc(size: usize) -> *mut c_void {
    count();
    // SAFETY: as above.
    unsafe { __libc_malloc(size) }
}

// SAFETY: as `malloc`.
#[unsafe(no_mangle)]
unsafe extern "C" fn calloc(number: usize, size: usize) -> *mut c_void {
    count();
    // SAFETY: as above.
    unsafe { __libc_calloc(number, size) }
}

// SAFETY: as `malloc`.
#[unsafe(no_mangle)]
unsafe extern "C" fn realloc(old: *mut c_void, size: usize) -> *mut c_void {
    count();
    // SAFETY: as above.
    unsafe { __libc_realloc(old, size) }
}

fn allocations(mut action: impl FnMut()) -> usize {
    let before = ALLOCATIONS.with(Cell::get);
    action();
    ALLOCATIONS.with(Cell::get) - before
}

#[test]
fn pose_and_jacobian_do_not_allocate() {
    let model = proact_description::mpl_right_arm();
    let mut kinematics = Kinematics::new(&model).expect("the arm is usable");
    let mut pose = Pose::identity();
    let mut jacobian = DMatrix::zeros(6, 7);
    let q = [0.3, -0.2, 0.1, 1.2, 0.2, 0.3, -0.1];

    // The counter must bite, in C++ as in Rust, or the assertion below would prove nothing.
    assert!(allocations(|| drop(std::hint::black_box(vec![1u8; 100]))) > 0, "Rust is counted");
    let in_cpp = allocations(|| {
        kinematics.condition(&q).expect("finite angles"); // Eigen's decomposition allocates, Rust's side does not
    });
    assert!(in_cpp > 0, "C++ is counted");

    let counted = allocations(|| {
        for _ in 0..100 {
            kinematics.forward_into(&q, &mut pose).expect("finite angles");
            kinematics.jacobian_into(&q, &mut jacobian).expect("finite angles");
        }
    });
    assert_eq!(counted, 0);
}
