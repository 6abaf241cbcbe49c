//! Writes the visual meshes of the MPL arm: `cargo run --release -p proact-description --example make_meshes`.
//!
//! The shapes are our own design around the collision shapes of the description; a test compares the committed
//! files with what this program makes.
// This program exists to write files.
#![allow(clippy::disallowed_methods)]

mod arm;
mod hand;
mod solid;

use std::{error::Error, path::PathBuf};

fn main() -> Result<(), Box<dyn Error>> {
    let default =
        concat!(env!("CARGO_MANIFEST_DIR"), "/../../ros1_ws/src/proact_description/arms/mpl_right/meshes");
    let folder = std::env::args_os().nth(1).map_or_else(|| PathBuf::from(default), PathBuf::from);
    std::fs::create_dir_all(&folder)?;
    let mut total = 0;
    for (name, solid) in arm::meshes().into_iter().chain(hand::meshes()) {
        let bytes = solid.to_stl();
        total += bytes.len();
        println!("{name}.stl: {} triangles", (bytes.len() - 84) / 50);
        std::fs::write(folder.join(format!("{name}.stl")), bytes)?;
    }
    println!("{} KB in {}", total / 1000, folder.display());
    Ok(())
}
