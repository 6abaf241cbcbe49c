//! How large a description may be. Everything here is far beyond any arm, and far below what the libraries behind cannot
//! take: a link at 1e20 m overflows the planner's stack, one at 4e9 m keeps it busy for ever.

use crate::finding::Findings;

/// Longest text, bytes.
pub(crate) const MAX_TEXT_BYTES: usize = 8 << 20;
/// Deepest element in an element, and most attributes of one: XML parsers descend once a level, and compare attributes
/// in pairs.
pub(crate) const MAX_ELEMENT_DEPTH: usize = 64;
pub(crate) const MAX_ATTRIBUTES: usize = 100;
/// Most links, and most joints.
pub(crate) const MAX_LINKS: usize = 200;
/// Most shapes of all links together.
pub(crate) const MAX_SHAPES: usize = 2000;
/// Most findings that are kept: nobody reads more.
pub(crate) const MAX_FINDINGS: usize = 500;
/// Most joints between the base and a link.
pub(crate) const MAX_CHAIN_DEPTH: usize = 100;
/// Largest coordinate of an origin and largest size of a shape, metres.
pub(crate) const MAX_LENGTH_M: f64 = 10.0;
/// Smallest size of a shape, metres.
pub(crate) const MIN_LENGTH_M: f64 = 1e-6;
/// Largest mass of a link, kg.
pub(crate) const MAX_MASS_KG: f64 = 5000.0;
/// Smallest mass of a link, kg.
pub(crate) const MIN_MASS_KG: f64 = 1e-9;
/// Largest moment or product of inertia, kg m^2.
pub(crate) const MAX_INERTIA_KG_M2: f64 = 1e5;
/// Smallest principal moment of inertia as a share of the largest: a needle a thousand times as long as thick has 1e-6.
pub(crate) const MIN_MOMENT_SHARE: f64 = 1e-7;
/// Largest angle of a joint, rad.
pub(crate) const MAX_ANGLE_RAD: f64 = 100.0;
/// Largest speed of a joint, rad/s.
pub(crate) const MAX_VELOCITY_RAD_PER_S: f64 = 1000.0;
/// A limit above zero and below this is a mistake: a motion of one radian, or of one metre, would take a quarter of an hour.
pub(crate) const MIN_VELOCITY_RAD_PER_S: f64 = 1e-3;
/// Least effort limit above zero, N m.
pub(crate) const MIN_EFFORT: f64 = 1e-6;
/// Largest effort of a joint, N m, and loss in it, N m or N m s/rad.
pub(crate) const MAX_EFFORT: f64 = 1e6;

/// Notes it if `value` is larger than `max` either way; what is not finite is somebody else's matter.
pub(crate) fn check_at_most(
    max: f64,
    unit: &str,
    what: &str,
    value: f64,
    location: &str,
    findings: &mut Findings,
) {
    if value.is_finite() && value.abs() > max {
        findings.error(
            location,
            format!("{what} is larger than any arm's"),
            format!("{value:e} {unit}"),
            format!("at most {max} {unit}"),
            "Check the unit: metres, kilograms, radians.",
        );
    }
}
