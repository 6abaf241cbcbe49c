//! Writes the MPL left arm: `cargo run --release -p proact-description --example make_left_arm`.
//!
//! The left arm is the mirror image of the right one; a test compares the committed files with what this program
//! makes. The library embeds them, so they must exist, if only empty, when it is built.
// This program exists to write files.
#![allow(clippy::disallowed_methods)]

use std::{error::Error, path::Path};

fn main() -> Result<(), Box<dyn Error>> {
    let package = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../ros1_ws/src/proact_description");
    let (urdf, srdf) = proact_description::left_arm_texts()?;
    std::fs::write(package.join("arms/mpl_left/arm.urdf"), urdf)?;
    std::fs::write(package.join("arms/mpl_left/arm.srdf"), srdf)?;
    println!("wrote the arm.urdf and arm.srdf of mpl_left under {}", package.display());
    Ok(())
}
