//! Compiles the C++ core and its adapter, and links Debian's OMPL and FCL.

use std::path::{Path, PathBuf};

fn main() {
    // Clippy links nothing, so that there is nothing to compile for it.
    let wrapper = std::env::var_os("RUSTC_WORKSPACE_WRAPPER");
    if wrapper.is_some_and(|program| Path::new(&program).ends_with("clippy-driver")) {
        return;
    }
    // Asked for when run, not when compiled: the compiled script may be shared by several checkouts.
    let here = std::env::var_os("CARGO_MANIFEST_DIR").expect("Cargo tells where the crate is");
    let core = Path::new(&here).join("../../cpp/planning");
    let mut build = cxx_build::bridge("src/bridge.rs");
    build
        .file("src/adapter.cpp")
        .file(core.join("src/scene.cpp"))
        .file(core.join("src/scene_checks.cpp"))
        .file(core.join("src/shapes.cpp"))
        .file(core.join("src/separation.cpp"))
        .file(core.join("src/motions.cpp"))
        .file(core.join("src/joint_planner.cpp"))
        .file(core.join("src/planners.cpp"))
        .file(core.join("src/baseline_search.cpp"))
        .include(core.join("include"))
        .include(core.join("../common/include"))
        .std("c++17")
        .opt_level(3)
        .flag("-ffp-contract=off") // results must not depend on the compiler's choice of fused operations
        .flag("-Wall")
        .flag("-Wextra")
        .flag("-Wno-maybe-uninitialized"); // at this level it is found in Eigen, where nothing is

    for package in ["fcl", "eigen3", "ompl"] {
        for include in probe(package, false) {
            build.flag(format!("-isystem{}", include.display()));
        }
    }
    build.compile("proact_planning");
    // Behind the core that needs them: a linker that takes libraries as needed drops those that come before.
    probe("fcl", true);
    // OMPL's own list of libraries names Boost files that its package does not bring; the library alone links.
    println!("cargo:rustc-link-lib=ompl");

    for watched in ["src/bridge.rs", "src/adapter.cpp", "src/adapter.hpp"] {
        println!("cargo:rerun-if-changed={watched}");
    }
    for folder in ["include", "src", "../common"] {
        println!("cargo:rerun-if-changed={}", core.join(folder).display());
    }
}

/// Include folders of a Debian library, linking it on the way if `links`.
///
/// The compiler's own folder is left out: as `-isystem` it hides the C headers from `<cstdlib>`.
fn probe(package: &str, links: bool) -> Vec<PathBuf> {
    let library = pkg_config::Config::new().cargo_metadata(links).probe(package).unwrap_or_else(|error| {
        panic!(
            "{package} was not found ({error}). On Debian: \
             apt-get install libompl-dev libfcl-dev libccd-dev libeigen3-dev"
        )
    });
    library.include_paths.into_iter().filter(|path| path != Path::new("/usr/include")).collect()
}
