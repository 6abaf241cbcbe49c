//! Shells from the shoulder to the wrist. Link frames: x ahead, -y along the limb, z away from the body.

use super::solid::{Loft, LoftAxis, Solid, barrel, section};
use std::f64::consts::PI;

const CENTER: (f64, f64) = (0.0, 0.0);

/// File names, without ending, and what is in them.
pub fn meshes() -> Vec<(&'static str, Solid)> {
    let mut out = vec![("forequarter", forequarter()), ("shoulder", shoulder())];
    out.extend(humerus());
    out.extend(elbow());
    out.extend(forearm());
    out.extend(wrist());
    out
}

/// A flange on the socket, tapering to the first joint.
fn forequarter() -> Solid {
    let profile = [
        section(0.012, (0.0, -0.006), (0.050, 0.058)),
        section(0.022, (0.0, -0.005), (0.049, 0.056)),
        section(0.040, (0.0, 0.0), (0.040, 0.041)).with_exponent(2.1),
        section(0.071, CENTER, (0.037, 0.037)).with_exponent(2.0),
    ];
    Loft::new(LoftAxis::Z, &profile).rounded(0.006, 0.002).grooved(&[0.062]).with_resolution(7, 22).solid()
}

/// A dome over the two axes of the shoulder.
fn shoulder() -> Solid {
    let profile = [
        section(0.077, CENTER, (0.038, 0.038)).with_exponent(2.0),
        section(0.095, CENTER, (0.0385, 0.0385)).with_exponent(2.0),
        section(0.120, CENTER, (0.0385, 0.0385)).with_exponent(2.0),
        section(0.135, CENTER, (0.0360, 0.0360)).with_exponent(2.0),
    ];
    Loft::new(LoftAxis::Z, &profile).rounded(0.002, 0.030).grooved(&[0.086]).with_resolution(6, 22).solid()
}

/// The upper arm: fuller at the deltoid, slim above the elbow.
fn humerus() -> Vec<(&'static str, Solid)> {
    let z = 0.01366;
    let profile = [
        section(0.012, (0.0, z), (0.036, 0.034)),
        section(-0.012, (-0.001, z + 0.001), (0.043, 0.042)),
        section(-0.045, (-0.001, z + 0.001), (0.0435, 0.042)),
        section(-0.090, (-0.0016, z), (0.039, 0.037)),
        section(-0.128, (-0.0016, z), (0.0345, 0.034)),
        section(-0.146, (-0.0016, z), (0.0345, 0.0345)).with_exponent(2.0),
    ];
    let shell = Loft::new(LoftAxis::Y, &profile)
        .rounded(0.030, 0.0015)
        .grooved(&[-0.020, -0.132])
        .with_resolution(9, 22);
    // Two plates: ahead over the biceps, and on the outer side.
    let front = shell.panel((-0.034, -0.120), (-0.75, 0.45), 0.0012);
    let back = shell.panel((-0.034, -0.120), (PI - 0.75, PI + 0.75), 0.0012);
    vec![("humerus", shell.solid()), ("humerus_panel", front.merged_with(back))]
}

/// The rotating half of the upper arm, narrowing into one cheek of the elbow.
fn elbow() -> Vec<(&'static str, Solid)> {
    let (pivot_x, pivot_y, cheek_z) = (0.00997, -0.14449, -0.0245);
    let mut profile = vec![
        section(-0.003, (-0.001, 0.001), (0.0345, 0.0345)).with_exponent(2.0),
        section(-0.030, (0.0, 0.0015), (0.0345, 0.0345)),
        section(-0.070, (0.002, 0.0), (0.0335, 0.0325)),
        section(-0.092, (0.005, -0.006), (0.0335, 0.0265)),
        section(-0.108, (0.0085, -0.0185), (0.0345, 0.0150)),
        section(-0.122, (pivot_x, cheek_z), (0.0355, 0.0092)).with_exponent(3.0),
        section(pivot_y, (pivot_x, cheek_z), (0.0360, 0.0090)).with_exponent(3.0),
    ];
    // The cheek ends as a disc around the pivot.
    for angle in [0.35_f64, 0.7, 1.0, 1.25] {
        let half = 0.036 * angle.cos();
        profile.push(
            section(pivot_y - 0.036 * angle.sin(), (pivot_x, cheek_z), (half, 0.0085)).with_exponent(3.0),
        );
    }
    let shell =
        Loft::new(LoftAxis::Y, &profile).rounded(0.0015, 0.001).grooved(&[-0.012]).with_resolution(11, 22);
    let cap = barrel(LoftAxis::Z, 0.024, 0.010, 16).translated(pivot_x, pivot_y, cheek_z - 0.0085);
    vec![("elbow", shell.solid()), ("elbow_cap", cap)]
}

/// The elbow's hub, and a forearm that tapers to the wrist.
fn forearm() -> Vec<(&'static str, Solid)> {
    let hub = barrel(LoftAxis::Z, 0.0357, 0.055, 20).translated(0.0, 0.0, 0.0285);
    let profile = [
        section(-0.006, (0.0, 0.0285), (0.0290, 0.0230)).with_exponent(3.0),
        section(-0.030, (0.0, 0.0235), (0.0365, 0.0330)),
        section(-0.060, (0.0, 0.0185), (0.0390, 0.0370)),
        section(-0.095, (0.0, 0.0165), (0.0375, 0.0355)),
        section(-0.140, (0.0, 0.016), (0.0330, 0.0320)),
        section(-0.170, (0.0, 0.016), (0.0318, 0.0318)).with_exponent(2.0),
        section(-0.182, (0.0, 0.016), (0.0325, 0.0325)).with_exponent(2.0),
    ];
    let shell = Loft::new(LoftAxis::Y, &profile)
        .rounded(0.012, 0.0015)
        .grooved(&[-0.042, -0.168])
        .with_resolution(9, 22);
    let front = shell.panel((-0.052, -0.158), (-0.62, 0.62), 0.0012);
    let back = shell.panel((-0.052, -0.158), (PI - 0.62, PI + 0.62), 0.0012);
    vec![("forearm", shell.solid()), ("forearm_hub", hub), ("forearm_panel", front.merged_with(back))]
}

/// Rotation ring with two cheeks, and the cross of the wrist's two tilting axes.
fn wrist() -> Vec<(&'static str, Solid)> {
    let ring = [
        section(-0.002, CENTER, (0.0325, 0.0325)).with_exponent(2.0),
        section(-0.012, CENTER, (0.0320, 0.0320)).with_exponent(2.0),
        section(-0.024, CENTER, (0.0290, 0.0300)).with_exponent(2.2),
        section(-0.031, CENTER, (0.0240, 0.0290)),
    ];
    let body = Loft::new(LoftAxis::Y, &ring)
        .rounded(0.0015, 0.005)
        .grooved(&[-0.012])
        .with_resolution(4, 22)
        .solid();
    let cheek = [
        section(-0.024, CENTER, (0.0150, 0.0030)).with_exponent(3.0),
        section(-0.0476, CENTER, (0.0140, 0.0028)).with_exponent(3.0),
        section(-0.0560, CENTER, (0.0112, 0.0026)).with_exponent(3.0),
        section(-0.0605, CENTER, (0.0055, 0.0022)).with_exponent(3.0),
    ];
    let cheek = Loft::new(LoftAxis::Y, &cheek).rounded(0.001, 0.001).with_resolution(4, 10).solid();
    let wristy = body
        .merged_with(cheek.clone().translated(0.0, 0.0, 0.0262))
        .merged_with(cheek.translated(0.0, 0.0, -0.0222));

    let pin = barrel(LoftAxis::Z, 0.0140, 0.0420, 16).translated(0.0, 0.0, -0.0005);
    let bridge = [
        section(-0.0262, (-0.006, -0.0024), (0.0100, 0.0100)).with_exponent(3.0),
        section(0.0, (-0.004, -0.0020), (0.0115, 0.0120)).with_exponent(3.0),
        section(0.0262, (-0.006, -0.0024), (0.0100, 0.0100)).with_exponent(3.0),
    ];
    let bridge = Loft::new(LoftAxis::X, &bridge).rounded(0.0025, 0.0025).with_resolution(3, 10).solid();
    let ear = [
        section(-0.004, (0.0, -0.0024), (0.0030, 0.0115)).with_exponent(3.0),
        section(-0.0297, (0.0, -0.0024), (0.0026, 0.0125)).with_exponent(3.0),
        section(-0.0370, (0.0, -0.0024), (0.0024, 0.0100)).with_exponent(3.0),
        section(-0.0415, (0.0, -0.0024), (0.0020, 0.0050)).with_exponent(3.0),
    ];
    let ear = Loft::new(LoftAxis::Y, &ear).rounded(0.001, 0.001).with_resolution(4, 10).solid();
    let wristx = pin
        .merged_with(bridge)
        .merged_with(ear.clone().translated(0.0248, 0.0, 0.0))
        .merged_with(ear.translated(-0.0244, 0.0, 0.0));
    vec![("wristy", wristy), ("wristx", wristx)]
}
