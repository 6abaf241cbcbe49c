//! Compiles the C++ core and its adapter, and links Debian's ODE.

use std::path::{Path, PathBuf};

fn main() {
    // Clippy links nothing, so that there is nothing to compile for it.
    let wrapper = std::env::var_os("RUSTC_WORKSPACE_WRAPPER");
    if wrapper.is_some_and(|program| Path::new(&program).ends_with("clippy-driver")) {
        return;
    }
    let core = Path::new(&std::env::var_os("CARGO_MANIFEST_DIR").expect("Cargo tells where the crate is"))
        .join("../../cpp/dynamics");
    let mut build = cxx_build::bridge("src/bridge.rs");
    build
        .file("src/adapter.cpp")
        .include(core.join("include"))
        .include(core.join("src"))
        .include(core.join("../common/include"))
        .std("c++17")
        // The C++ tests are compiled with the same level: results must agree bit for bit.
        .opt_level(2)
        .flag("-ffp-contract=off");
    for source in [
        "arm",
        "arm_joints",
        "block_bodies",
        "collisions",
        "contact_joints",
        "contact_points",
        "engines/ode/ode_arm",
        "engines/reduced/arm_tree",
        "engines/reduced/coupled_blocks",
        "engines/reduced/link_broad_phase",
        "engines/reduced/reduced_arm",
        "engines/reduced/velocity_problem",
        "geoms",
        "joint_control",
        "large_islands",
        "link_groups",
        "model",
        "moving_base",
        "ode_body_state",
        "ode_runtime",
        "ode_world",
        "pgs_contact_solver",
        "simulation",
        "snapshot",
        "world",
    ] {
        build.file(core.join("src").join(source).with_extension("cpp"));
    }
    for include in probe("ode", false) {
        build.flag(format!("-isystem{}", include.display()));
    }
    build.compile("proact_dynamics");
    // Behind the core that needs it: a linker that takes libraries as needed drops those that come before.
    probe("ode", true);

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
    let mut config = pkg_config::Config::new();
    let library =
        config.atleast_version("0.16").cargo_metadata(links).probe(package).unwrap_or_else(|error| {
            panic!("{package} 0.16 or newer was not found ({error}). On Debian: apt-get install libode-dev")
        });
    library.include_paths.into_iter().filter(|path| path != Path::new("/usr/include")).collect()
}
