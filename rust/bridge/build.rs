//! Checks that the page is built before it is embedded: without this, the embedding macro's own message says
//! nothing of how to build it.

use std::path::Path;

fn main() {
    println!("cargo:rerun-if-changed=web/dist");
    println!("cargo:rerun-if-changed=web/dist-figures");
    println!("cargo:rerun-if-changed=build.rs");
    for file in [
        "web/dist/index.html",
        "web/dist/index.html.gz",
        "web/dist/experimenter.html",
        "web/dist/replay.html",
        "web/dist/calibrate.html",
        "web/dist-figures/figures.js",
    ] {
        if !Path::new(file).is_file() {
            // One line each: Cargo prints them as errors of this crate and stops here.
            println!("cargo:error=the page is not built: rust/bridge/{file} is missing");
            println!("cargo:error=run ./proact or: cd rust/bridge/web && npm ci && npm run build");
            std::process::exit(1);
        }
    }
}
