//! Palm and digits. Palm frame: -y to the fingers, -z out of the palm, x to the thumb; digits: -y to the tip,
//! in the thumb x to the tip.

use super::solid::{Loft, LoftAxis, LoftSection, Solid, ball, barrel, section};
use std::f64::consts::FRAC_PI_2;

/// Where the fingers start in the palm's frame: index, middle, ring, pinky.
const ROOTS: [(f64, f64, f64); 4] = [
    (0.03549, -0.0658, 0.00101),
    (0.01281, -0.0779, 0.00544),
    (-0.00986, -0.06669, 0.00151),
    (-0.03062, -0.0554, -0.00563),
];

/// File names, without ending, and what is in them.
pub fn meshes() -> Vec<(&'static str, Solid)> {
    let mut out = palm();
    out.extend([
        // Fingers share shapes: index, middle and ring have the same lengths, the pinky is shorter.
        ("finger0", root()),
        ("finger1", phalanx(0.0435, (0.0094, 0.0088), (0.0082, 0.0078))),
        ("finger2", phalanx(0.0245, (0.0080, 0.0076), (0.0072, 0.0069))),
        ("finger3", fingertip()),
        ("pinky1", phalanx(0.0330, (0.0088, 0.0083), (0.0078, 0.0074))),
        ("pinky2", phalanx(0.0175, (0.0076, 0.0072), (0.0070, 0.0067))),
        ("knuckle", barrel(LoftAxis::X, 0.01, 0.02, 14)),
        ("thumb0", thumb_root()),
        ("thumb1", thumb_phalanx()),
        ("thumb3", thumb_tip()),
        ("thumb_knuckle", barrel(LoftAxis::Z, 0.01, 0.02, 14)),
    ]);
    out
}

/// The palm, a plate on its back, a soft pad inside and four sockets for the fingers.
fn palm() -> Vec<(&'static str, Solid)> {
    let profile = [
        section(0.010, (0.0015, 0.0), (0.0190, 0.0130)).with_exponent(2.6),
        section(-0.006, (0.0020, 0.0), (0.0225, 0.0155)).with_exponent(2.8),
        section(-0.022, (0.0030, 0.0), (0.0335, 0.0185)).with_exponent(3.0),
        section(-0.040, (0.0025, 0.0005), (0.0390, 0.0180)).with_exponent(3.2),
        section(-0.056, (0.0040, 0.0010), (0.0385, 0.0150)).with_exponent(3.2),
        section(-0.068, (0.0125, 0.0025), (0.0290, 0.0125)).with_exponent(2.8),
        section(-0.073, (0.0125, 0.0030), (0.0200, 0.0105)).with_exponent(2.6),
    ];
    let shell = Loft::new(LoftAxis::Y, &profile).rounded(0.005, 0.006).with_resolution(11, 24);
    let mut sockets = Solid::default();
    for (x, y, z) in ROOTS {
        sockets = sockets.merged_with(ball(0.0112, 10).scaled(1.0, 1.1, 0.95).translated(x, y + 0.004, z));
    }
    // The wrist's second axis passes through the heel of the hand.
    sockets = sockets.merged_with(barrel(LoftAxis::X, 0.0125, 0.044, 16).translated(0.0002, 0.0, 0.0005));
    let back = shell.panel((-0.020, -0.058), (FRAC_PI_2 - 0.95, FRAC_PI_2 + 0.95), 0.0014);
    let inside = shell.panel((-0.022, -0.062), (-FRAC_PI_2 - 1.02, -FRAC_PI_2 + 0.75), 0.0016);
    let heel = ball(0.014, 12).scaled(1.0, 1.25, 0.95).translated(0.0270, -0.0240, -0.0090);
    vec![
        ("palm", shell.solid()),
        ("palm_joints", sockets),
        ("palm_back", back),
        ("palm_pad", inside.merged_with(heel)),
    ]
}

/// Spreads the finger: from the socket to the first knuckle.
fn root() -> Solid {
    let profile = [
        section(0.002, (0.0, 0.0), (0.0080, 0.0082)),
        section(-0.008, (0.0, 0.0), (0.0085, 0.0085)),
        section(-0.016, (0.0, 0.0), (0.0070, 0.0080)),
    ];
    Loft::new(LoftAxis::Y, &profile).rounded(0.005, 0.004).with_resolution(3, 14).solid()
}

/// A bone of a finger of `length` to the next joint: half widths across and deep, at the near and far end.
fn phalanx(length: f64, near: (f64, f64), far: (f64, f64)) -> Solid {
    let waist = (0.93 * (near.0 + far.0) / 2.0, 0.95 * (near.1 + far.1) / 2.0);
    let profile = [
        section(-0.10 * length, (0.0, 0.0), (0.90 * near.0, 0.90 * near.1)).with_exponent(2.8),
        section(-0.26 * length, (0.0003, 0.0), near).with_exponent(2.8),
        section(-0.58 * length, (0.0004, 0.0002), waist).with_exponent(2.6),
        section(-0.82 * length, (0.0005, 0.0003), far).with_exponent(2.6),
    ];
    Loft::new(LoftAxis::Y, &profile).rounded(0.0035, 0.0045).with_resolution(5, 14).solid()
}

/// The last bone: rounded, with a pad towards the palm.
fn fingertip() -> Solid {
    let profile = [
        section(-0.0030, (0.0, 0.0), (0.0062, 0.0062)),
        section(-0.0075, (0.0, -0.0003), (0.0070, 0.0070)),
        section(-0.0120, (0.0, -0.0005), (0.0071, 0.0072)).with_exponent(2.2),
        section(-0.0160, (0.0, 0.0), (0.0062, 0.0064)).with_exponent(2.1),
    ];
    Loft::new(LoftAxis::Y, &profile).rounded(0.0030, 0.0060).with_resolution(5, 14).solid()
}

fn along_x(profile: &[LoftSection], near: f64, far: f64) -> Solid {
    Loft::new(LoftAxis::X, profile).rounded(near, far).with_resolution(5, 14).solid()
}

/// Swings the thumb across the palm.
fn thumb_root() -> Solid {
    let profile = [
        section(-0.004, (0.0, 0.0), (0.0085, 0.0095)).with_exponent(2.6),
        section(0.008, (-0.0008, 0.0012), (0.0082, 0.0112)).with_exponent(2.8),
        section(0.017, (-0.0008, 0.0014), (0.0070, 0.0100)).with_exponent(2.8),
    ];
    along_x(&profile, 0.005, 0.004)
}

/// Both middle bones of the thumb have this shape.
fn thumb_phalanx() -> Solid {
    let (near, far) = (0.0090, 0.0082);
    let profile = [
        section(0.004, (0.0, 0.0), (0.85 * near, 1.05 * near)).with_exponent(2.6),
        section(0.010, (0.0, 0.0), (0.92 * near, 1.16 * near)).with_exponent(2.8),
        section(0.020, (0.0002, 0.0002), (0.82 * near, 1.06 * near)).with_exponent(2.6),
        section(0.028, (0.0002, 0.0003), (0.86 * far, 1.12 * far)).with_exponent(2.6),
    ];
    along_x(&profile, 0.0035, 0.004)
}

fn thumb_tip() -> Solid {
    let profile = [
        section(0.003, (0.0, 0.0), (0.0066, 0.0082)),
        section(0.009, (-0.0010, 0.0), (0.0076, 0.0088)),
        section(0.016, (-0.0010, 0.0), (0.0078, 0.0084)).with_exponent(2.2),
        section(0.021, (-0.0004, 0.0), (0.0064, 0.0070)).with_exponent(2.1),
    ];
    along_x(&profile, 0.003, 0.0062)
}
