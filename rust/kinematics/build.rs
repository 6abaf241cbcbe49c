//! Compiles the C++ core and its adapter, and links Debian's KDL.

use std::path::{Path, PathBuf};

fn main() {
    // Clippy links nothing, so that there is nothing to compile for it.
    let wrapper = std::env::var_os("RUSTC_WORKSPACE_WRAPPER");
    if wrapper.is_some_and(|program| Path::new(&program).ends_with("clippy-driver")) {
        return;
    }
    let core = Path::new(&std::env::var_os("CARGO_MANIFEST_DIR").expect("Cargo tells where the crate is"))
        .join("../../cpp/kinematics");
    let mut build = cxx_build::bridge("src/bridge.rs");
    build.file("src/adapter.cpp");
    for source in ["arm", "benchmark", "description", "inverse_solver", "tree_dynamics"] {
        build.file(core.join(format!("src/{source}.cpp")));
    }
    // The flags are those of cmake/ProactWarnings.cmake, so that both builds compute the same bits.
    build
        .include(core.join("include"))
        .include(core.join("../common/include"))
        .std("c++17")
        .opt_level(2)
        .flag("-ffp-contract=off")
        .flag("-Wall")
        .flag("-Wextra");

    for package in ["orocos-kdl", "eigen3"] {
        for include in probe(package, false) {
            build.flag(format!("-isystem{}", include.display()));
        }
    }
    build.compile("proact_kinematics");
    // Behind the core that needs it: a linker that takes libraries as needed drops those that come before.
    probe("orocos-kdl", true);

    for watched in ["src/bridge.rs", "src/adapter.cpp", "src/adapter.hpp"] {
        println!("cargo:rerun-if-changed={watched}");
    }
    for folder in [".", "../common"] {
        println!("cargo:rerun-if-changed={}", core.join(folder).display());
    }
}

/// Include folders of a Debian library, linking it on the way if `links`.
///
/// The compiler's own folder is left out: as `-isystem` it hides the C headers from `<cstdlib>`.
fn probe(package: &str, links: bool) -> Vec<PathBuf> {
    let library = pkg_config::Config::new().cargo_metadata(links).probe(package).unwrap_or_else(|error| {
        panic!(
            "{package} was not found ({error}). On Debian: apt-get install liborocos-kdl-dev libeigen3-dev"
        )
    });
    let own = |path: &PathBuf| path.canonicalize().is_ok_and(|path| path == Path::new("/usr/include"));
    library.include_paths.into_iter().filter(|path| !own(path)).collect()
}
