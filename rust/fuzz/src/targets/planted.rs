//! Faults on purpose: each kind that the driver must find. They wait for a byte, so that not every input is one.

use super::TargetFn;
use std::path::Path;

fn fail_on_even_length(fault: fn()) -> TargetFn {
    Box::new(move |bytes| {
        if bytes.len() % 2 == 0 {
            fault();
        }
    })
}

pub(super) fn panic(_: &Path) -> TargetFn {
    fail_on_even_length(|| panic!("planted"))
}

pub(super) fn thread(_: &Path) -> TargetFn {
    fail_on_even_length(|| drop(std::thread::spawn(|| panic!("planted in a thread")).join()))
}

pub(super) fn stack(_: &Path) -> TargetFn {
    fail_on_even_length(|| {
        std::hint::black_box(deeper(&[0; 64]));
    })
}

fn deeper(below: &[u64; 64]) -> u64 {
    let mut here = *std::hint::black_box(below);
    here[0] += 1;
    if here[0] == u64::MAX { 0 } else { deeper(&here) + here[1] }
}

pub(super) fn hang(_: &Path) -> TargetFn {
    fail_on_even_length(|| while std::hint::black_box(true) {})
}

pub(super) fn memory(_: &Path) -> TargetFn {
    fail_on_even_length(|| {
        let mut kept: Vec<Vec<u8>> = Vec::new();
        while std::hint::black_box(true) {
            // Zeros are not written: the bound is one of addresses, and two gigabytes of pages would take seconds.
            kept.push(std::hint::black_box(vec![0; 64 << 20]));
        }
    })
}
