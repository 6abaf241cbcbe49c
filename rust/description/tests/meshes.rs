//! The committed meshes are what the program in `examples/make_meshes` makes, and the description uses them all.
#![allow(clippy::unwrap_used, clippy::disallowed_methods)]

#[allow(missing_docs)]
#[path = "../examples/make_meshes/arm.rs"]
mod arm;
#[allow(missing_docs)]
#[path = "../examples/make_meshes/hand.rs"]
mod hand;
#[allow(missing_docs)]
#[path = "../examples/make_meshes/solid.rs"]
mod solid;

use proact_arm::VisualGeometry;
use std::{collections::BTreeSet, path::PathBuf};

/// Most bytes that all meshes together may have: they travel to every page that opens.
const BUDGET: usize = 700_000;

fn folder() -> PathBuf {
    PathBuf::from(concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../../ros1_ws/src/proact_description/arms/mpl_right/meshes"
    ))
}

fn made() -> Vec<(&'static str, Vec<u8>)> {
    arm::meshes().into_iter().chain(hand::meshes()).map(|(name, solid)| (name, solid.to_stl())).collect()
}

#[test]
fn the_committed_meshes_are_those_that_the_program_makes() {
    let made = made();
    for (name, bytes) in &made {
        let committed = std::fs::read(folder().join(format!("{name}.stl"))).unwrap();
        assert!(
            committed == *bytes,
            "{name}.stl differs: cargo run --release -p proact-description --example make_meshes"
        );
    }
    assert_eq!(std::fs::read_dir(folder()).unwrap().count(), made.len(), "a mesh that nothing makes");
    let total: usize = made.iter().map(|(_, bytes)| bytes.len()).sum();
    assert!(total <= BUDGET, "{total} bytes");
}

#[test]
fn every_mesh_is_closed_and_faces_outwards() {
    for (name, bytes) in made() {
        let number = |at: usize| f64::from(f32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()));
        let count = (bytes.len() - 84) / 50;
        assert_eq!(u32::from_le_bytes(bytes[80..84].try_into().unwrap()) as usize, count);
        // Signed volume by the divergence theorem: positive if the faces look outwards, and independent of the
        // origin only if there is no hole.
        let volume = |shift: f64| -> f64 {
            (0..count)
                .map(|k| {
                    let vertex = |j: usize| {
                        let at = 84 + 50 * k + 12 * (j + 1);
                        nalgebra::Vector3::new(number(at), number(at + 4), number(at + 8)).add_scalar(shift)
                    };
                    vertex(0).dot(&vertex(1).cross(&vertex(2))) / 6.0
                })
                .sum()
        };
        let (here, elsewhere) = (volume(0.0), volume(0.1));
        assert!(here > 0.0, "{name} is inside out");
        // Vertices are on a grid of 1 um, which moves a surface of 0.1 m^2 by at most 1e-7 m^3.
        assert!((here - elsewhere).abs() < 1e-7, "{name} has a hole: {here} against {elsewhere}");
    }
}

#[test]
fn the_description_uses_every_mesh_and_no_other() {
    let prefix = "package://proact_description/arms/mpl_right/meshes/";
    let model = proact_description::mpl_right_arm();
    let used: BTreeSet<String> = model
        .links
        .iter()
        .flat_map(|link| &link.visuals)
        .map(|visual| match &visual.geometry {
            VisualGeometry::Mesh { file, .. } => file.strip_prefix(prefix).unwrap().to_owned(),
            VisualGeometry::Shape(shape) => panic!("a bare {shape:?} is drawn"),
        })
        .collect();
    let made: BTreeSet<String> = made().iter().map(|(name, _)| format!("{name}.stl")).collect();
    assert_eq!(used, made);
}
