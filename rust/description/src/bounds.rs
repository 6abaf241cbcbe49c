//! How large a description may be. Everything here is far beyond any arm, and far below what the libraries behind cannot
//! take: a link at 1e20 m overflows the planner's stack, one at 4e9 m keeps it busy for ever.

use crate::finding::Findings;

/// Longest text, bytes.
pub(crate) const LONGEST_TEXT: usize = 8 << 20;
/// Deepest element in an element, and most attributes of one: XML parsers descend once a level, and compare attributes
/// in pairs.
pub(crate) const DEEPEST_ELEMENT: usize = 64;
pub(crate) const MOST_ATTRIBUTES: usize = 100;
/// Most links, and most joints.
pub(crate) const MOST_LINKS: usize = 200;
/// Most shapes of all links together.
pub(crate) const MOST_SHAPES: usize = 2000;
/// Most findings that are kept: nobody reads more.
pub(crate) const MOST_FINDINGS: usize = 500;
/// Most joints between the base and a link.
pub(crate) const DEEPEST: usize = 100;
/// Largest coordinate of an origin and largest size of a shape, metres.
pub(crate) const LONGEST: f64 = 10.0;
/// Smallest size of a shape, metres.
pub(crate) const SHORTEST: f64 = 1e-6;
/// Largest mass of a link, kg.
pub(crate) const HEAVIEST: f64 = 1000.0;
/// Smallest mass of a link, kg.
pub(crate) const LIGHTEST: f64 = 1e-9;
/// Largest moment or product of inertia, kg m^2.
pub(crate) const MOST_INERTIA: f64 = 1e5;
/// Largest angle of a joint, rad.
pub(crate) const LARGEST_ANGLE: f64 = 100.0;
/// Largest speed of a joint, rad/s.
pub(crate) const FASTEST: f64 = 1000.0;
/// Largest effort of a joint, N m, and loss in it, N m or N m s/rad.
pub(crate) const STRONGEST: f64 = 1e6;

/// Notes it if `value` is larger than `most` either way; what is not finite is somebody else's matter.
pub(crate) fn at_most(most: f64, unit: &str, what: &str, value: f64, place: &str, findings: &mut Findings) {
    if value.is_finite() && value.abs() > most {
        findings.error(
            place,
            format!("{what} is larger than any arm's"),
            format!("{value:e} {unit}"),
            format!("at most {most} {unit}"),
            "Check the unit: metres, kilograms, radians.",
        );
    }
}
