//! Compiles the C++ core and its adapter, and links Debian's urdfdom.

use std::path::{Path, PathBuf};

fn main() {
    // Clippy links nothing, so that there is nothing to compile for it.
    let wrapper = std::env::var_os("RUSTC_WORKSPACE_WRAPPER");
    if wrapper.is_some_and(|program| Path::new(&program).ends_with("clippy-driver")) {
        return;
    }
    let core = Path::new(&std::env::var_os("CARGO_MANIFEST_DIR").expect("Cargo tells where the crate is"))
        .join("../../cpp/description");
    let mut build = cxx_build::bridge("src/bridge.rs");
    build
        .file("src/adapter.cpp")
        .file(core.join("src/robot.cpp"))
        .include(core.join("include"))
        .include(core.join("../common/include"))
        .std("c++17")
        .opt_level(2)
        .flag("-ffp-contract=off"); // results must not depend on the compiler's choice of fused operations

    // The core silences urdfdom by its messages' own library, which newer releases of urdfdom do not name for others.
    const LIBRARIES: [(&str, &str); 2] = [("urdfdom", "1.0"), ("console_bridge", "0.4")];
    for (package, at_least) in LIBRARIES {
        for include in probe(package, at_least, false) {
            build.flag(format!("-isystem{}", include.display()));
        }
    }
    build.compile("proact_description");
    // Behind the core that needs them: a linker that takes libraries as needed drops those that come before.
    for (package, at_least) in LIBRARIES {
        probe(package, at_least, true);
    }

    // Built in by rust-embed.
    println!("cargo:rerun-if-changed=../../ros1_ws/src/proact_description/arms");
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
fn probe(package: &str, at_least: &str, links: bool) -> Vec<PathBuf> {
    let mut config = pkg_config::Config::new();
    let library =
        config.atleast_version(at_least).cargo_metadata(links).probe(package).unwrap_or_else(|error| {
            panic!("{package} was not found ({error}). On Debian: apt-get install liburdfdom-dev pkg-config")
        });
    library
        .include_paths
        .into_iter()
        .filter(|path| path.canonicalize().ok().as_deref() != Some(Path::new("/usr/include")))
        .collect()
}
