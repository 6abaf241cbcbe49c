//! Finds how a hand pinches a narrow object: two digits on opposite faces, from above.
//!
//! Force closure is judged by Nguyen's condition for two soft fingers (V.-D. Nguyen, "Constructing force-closure grasps",
//! Int. J. Robotics Research 7(3), 1988; Murray, Li and Sastry, "A Mathematical Introduction to Robotic Manipulation",
//! 1994, section 5.3): the line through the two contacts lies strictly inside both cones of friction. Contacts are those of
//! the model's collision shapes. Known weaknesses: the object is a cube, and the palm and wrist are not looked at beyond
//! the tip's link.

mod two_digit_grip;

use crate::{ArmModel, ArmModelError, CLOSED_POSE, Grasp, NamedPose, OPEN_POSE, upright_axis};
use proact_types::Vector;
use two_digit_grip::{PinchHand, TwoDigitGrip};

/// The closed pose is so much narrower on each side than the object, metres: fingers must press.
const PRESS_DEPTH_M: f64 = 0.003;
/// So much room there is on each side of the object before the hand closes, metres.
const OPEN_CLEARANCE_M: f64 = 0.0065;
/// With less room the hand would push the object over on its way down, metres.
const MIN_OPEN_CLEARANCE_M: f64 = 0.003;
/// Between the line through the contacts and the edge of the cones, at least, rad.
const CONE_MARGIN_RAD: f64 = 5.0 * std::f64::consts::PI / 180.0;
/// Digits that overlap by more than this would jam, metres.
const MAX_DIGIT_OVERLAP_M: f64 = 0.002;
/// Postures from which each pair of digits is tried, and how many of them, the best, are improved.
const STARTS: usize = 1500;
const REFINED_STARTS: usize = 24;
/// First and last step of the improvement, rad.
const STEP_RANGE_RAD: [f64; 2] = [0.25, 0.0005];
/// The digits open in steps of this length, metres.
const OPENING_STEP_M: f64 = 0.0005;
/// Step of the roll and lean that are tried for the ranges, rad.
const TILT_STEP_RAD: f64 = std::f64::consts::PI / 180.0;

/// A pinch that was found, and what speaks for it.
#[derive(Clone, Debug, PartialEq)]
pub struct PinchGrasp {
    /// The grasp; its poses are `open` and `closed`.
    pub grasp: Grasp,
    /// The hand pose before it closes, by the name that the grasp has for it.
    pub open: NamedPose,
    /// The hand pose that it closes to.
    pub closed: NamedPose,
    /// First links of the two digits.
    pub digits: [String; 2],
    /// Largest angle between the line through the contacts and the faces' normals, rad.
    pub contact_angle_rad: f64,
    /// Half the opening of the cones of friction, rad.
    pub cone_half_angle_rad: f64,
    /// Between the digits when the hand is closed, and before it closes, metres.
    pub gaps_m: [f64; 2],
    /// Least distance of the hand from the table while it closes around the object that stands on it, metres.
    pub table_clearance_m: f64,
    /// How far the open hand sticks out beyond the object among its neighbours, and to the side of its middle, metres.
    pub overhang_m: [f64; 2],
}

/// Why no pinch was found.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PinchError {
    /// A pose is missing.
    #[error(transparent)]
    Model(#[from] ArmModelError),
    /// The friction is no number, or not above zero.
    #[error("friction is {got}, expected a number above 0")]
    Friction {
        /// As given.
        got: f64,
    },
    /// The width is no length that a hand could hold.
    #[error("width is {got} m, expected 0.005 to 0.2 m")]
    Width {
        /// As given, metres.
        got: f64,
    },
    /// No digits move towards each other between the poses `open` and `closed`.
    #[error(
        "no two digits of {model:?} close on each other from the pose \"open\" to \"closed\": correct the poses"
    )]
    NoDigits {
        /// The model's name.
        model: String,
    },
    /// No posture holds the object.
    #[error(
        "no pinch of {width} m found for {model:?}: the best has its contacts {angle_deg:.0} degrees off (the cone of \
         friction has {cone_deg:.0}), {gap_mm:.1} mm between the digits, {table_clearance_mm:.1} mm above the table, {obstruction_mm:.1} mm \
         of something else in the way, and {open_clearance_mm:.1} mm of room when open"
    )]
    NotFound {
        /// The model's name.
        model: String,
        /// Of the object, metres.
        width: f64,
        /// Of the best posture, degrees.
        angle_deg: f64,
        /// Half the opening of the cones, degrees.
        cone_deg: f64,
        /// Between the digits, mm.
        gap_mm: f64,
        /// Over the table, mm.
        table_clearance_mm: f64,
        /// In the way, mm.
        obstruction_mm: f64,
        /// On each side when open, mm.
        open_clearance_mm: f64,
    },
}

/// Finds a pinch of a cube of `width`, metres, that stands on a table, with the coefficient of `friction` between finger and
/// object. Deterministic; takes seconds.
///
/// # Errors
/// [`PinchError`].
pub fn find_pinch(model: &ArmModel, width: f64, friction: f64) -> Result<PinchGrasp, PinchError> {
    if !(friction.is_finite() && friction > 0.0) {
        return Err(PinchError::Friction { got: friction });
    }
    if !(0.005..=0.2).contains(&width) {
        return Err(PinchError::Width { got: width });
    }
    let cone = friction.atan();
    let (open, closed) = (model.pose("hand", OPEN_POSE)?, model.pose("hand", CLOSED_POSE)?);
    let pairs = closing_pairs(model, open, closed);
    let mut found: Vec<(f64, Posture, [usize; 2])> = Vec::new();
    for pair in pairs {
        let mut search = PinchSearch::new(model, pair, closed, width);
        found.extend(search.best_postures().into_iter().map(|(cost, posture)| (cost, posture, pair)));
    }
    found.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut best = None;
    for (_, posture, pair) in found {
        let pinch = PinchSearch::new(model, pair, closed, width).grasp_at(&posture, cone);
        match pinch {
            Ok(pinch) => return Ok(pinch),
            Err(error) => best = best.or(Some(error)),
        }
    }
    Err(best.unwrap_or(PinchError::NoDigits { model: model.name.clone() }))
}

/// Pairs of digits, by their first links, whose ends move against each other from `open` to `closed`.
fn closing_pairs(model: &ArmModel, open: &[f64], closed: &[f64]) -> Vec<[usize; 2]> {
    let digits = model.digits();
    let roots: Vec<usize> = (0..model.links.len()).filter(|l| digits[*l] == Some(*l)).collect();
    let mut pairs = Vec::new();
    for (k, &a) in roots.iter().enumerate() {
        for &b in &roots[k + 1..] {
            let mut hand = PinchHand::new(model, [a, b]);
            hand.set_posture(open);
            let from = [hand.contact_pad(0), hand.contact_pad(1)];
            hand.set_posture(closed);
            let moved = [hand.contact_pad(0) - from[0], hand.contact_pad(1) - from[1]];
            let between = from[1] - from[0];
            // Each goes towards the other, or at least one does and the other stays.
            if moved[0].dot(&between) >= -1e-9
                && moved[1].dot(&between) <= 1e-9
                && (moved[0] - moved[1]).dot(&between) > 1e-6
                && moved[0].dot(&moved[1]) <= 0.0
            {
                pairs.push([a, b]);
            }
        }
    }
    pairs
}

/// Angles of the hand and its roll, rad.
#[derive(Clone, Debug)]
struct Posture {
    hand: Vec<f64>,
    roll: f64,
}

/// A joint that the search turns or slides.
#[derive(Clone, Copy, Debug)]
struct FreeJoint {
    /// In the hand's vector.
    place: usize,
    lower: f64,
    upper: f64,
    /// What a step in radians is multiplied by to be one of this joint's.
    per_radian: f64,
}

struct PinchSearch<'a> {
    hand: PinchHand<'a>,
    width: f64,
    reference_grasp: Grasp,
    /// What moves the pair: places in the hand's vector, with their limits.
    free_joints: Vec<FreeJoint>,
    /// Where all others stay.
    rest_posture: Vec<f64>,
}

impl<'a> PinchSearch<'a> {
    fn new(model: &'a ArmModel, pair: [usize; 2], closed: &[f64], width: f64) -> Self {
        let digits = model.digits();
        let digit_of = |k: usize| digits[model.joints[model.hand[k]].child];
        let couplings = model.couplings();
        // A joint that follows another moves with it, wherever that is.
        let mut movers: Vec<usize> = (0..model.hand.len())
            .filter(|&k| digit_of(k).is_some_and(|digit| pair.contains(&digit)))
            .map(|k| couplings.master_of(k).unwrap_or(k))
            .collect();
        movers.sort_unstable();
        movers.dedup();
        let free = movers.into_iter().map(|place| {
            let joint = &model.joints[model.hand[place]];
            let per_radian = joint.kind.per_radian();
            FreeJoint { place, lower: joint.limits.lower, upper: joint.limits.upper, per_radian }
        });
        let like = two_digit_grip::reference_grasp(model);
        let mut search = Self {
            hand: PinchHand::new(model, pair),
            width,
            free_joints: free.filter(|joint| joint.upper > joint.lower).collect(),
            rest_posture: closed.to_vec(),
            reference_grasp: like,
        };
        search.retract_other_digits();
        search
    }

    /// Each digit that has no part goes where its lowest link is highest: curled up, stretched, or as the hand's poses.
    fn retract_other_digits(&mut self) {
        let model = self.hand.model;
        let digits = model.digits();
        let up = upright_axis(self.reference_grasp.roll_rad, 0.0);
        let others: Vec<usize> = (0..model.links.len())
            .filter(|l| digits[*l] == Some(*l) && !self.hand.pair.iter().any(|(of, _)| of == l))
            .collect();
        for digit in others {
            let joints: Vec<usize> = (0..model.hand.len())
                .filter(|k| digits[model.joints[model.hand[*k]].child] == Some(digit))
                .collect();
            let mut best = (f64::NEG_INFINITY, self.rest_posture.clone());
            for direction in 0..4 {
                let mut hand = self.rest_posture.clone();
                // Joints that spread the digit stay; those that bend it are the last three.
                let bends = joints.len().min(3);
                for (n, &k) in joints[joints.len() - bends..].iter().enumerate() {
                    let limits = model.joints[model.hand[k]].limits;
                    let straight = 0.0_f64.clamp(limits.lower, limits.upper);
                    hand[k] = match direction {
                        0 => straight,
                        1 if n == 0 => straight,
                        1 => limits.upper,
                        2 => limits.upper,
                        _ => hand[k],
                    };
                }
                self.hand.set_posture(&hand);
                let height = self.hand.lowest_height_of(digit, &up);
                if height > best.0 + 1e-6 {
                    best = (height, hand);
                }
            }
            self.rest_posture = best.1;
        }
    }

    fn cost(&mut self, posture: &Posture) -> f64 {
        self.hand.set_posture(&posture.hand);
        let Some(hold) = self.hand.grip(self.width, posture.roll) else { return f64::INFINITY };
        let crossing = ((self.hand.digit_overlap() - MAX_DIGIT_OVERLAP_M).max(0.0) * 1e3).powi(2);
        let roll = ((posture.roll - self.reference_grasp.roll_rad) / 0.5).powi(2);
        hold.cost(self.width, self.width - 2.0 * PRESS_DEPTH_M) + crossing + 0.2 * roll
    }

    /// The best postures, best first, with their costs.
    fn best_postures(&mut self) -> Vec<(f64, Posture)> {
        let [low, high] = self.reference_grasp.roll_range_rad;
        let starts: Vec<Posture> = (0..STARTS)
            .map(|n| {
                let mut posture =
                    Posture { hand: self.rest_posture.clone(), roll: low + (high - low) * halton(n, 0) };
                for (axis, joint) in self.free_joints.iter().enumerate() {
                    posture.hand[joint.place] =
                        joint.lower + (joint.upper - joint.lower) * halton(n, axis + 1);
                }
                posture
            })
            .collect();
        let mut costs: Vec<(f64, Posture)> = starts.into_iter().map(|p| (self.cost(&p), p)).collect();
        costs.sort_by(|a, b| a.0.total_cmp(&b.0));
        costs.truncate(REFINED_STARTS);
        let mut improved: Vec<(f64, Posture)> = costs.into_iter().map(|start| self.refine(start)).collect();
        improved.sort_by(|a, b| a.0.total_cmp(&b.0));
        improved
    }

    /// Goes down from a posture along one joint at a time (Hooke and Jeeves, 1961), steps halved where none helps.
    fn refine(&mut self, start: (f64, Posture)) -> (f64, Posture) {
        let (mut cost, mut posture) = start;
        let [mut step, last] = STEP_RANGE_RAD;
        let [low, high] = self.reference_grasp.roll_range_rad;
        while step > last {
            let mut better = false;
            for axis in 0..=self.free_joints.len() {
                for sign in [1.0, -1.0] {
                    let mut next = posture.clone();
                    match self.free_joints.get(axis) {
                        Some(joint) => {
                            let there = next.hand[joint.place] + sign * step * joint.per_radian;
                            next.hand[joint.place] = there.clamp(joint.lower, joint.upper);
                        }
                        None => next.roll = (next.roll + sign * step).clamp(low, high),
                    }
                    let found = self.cost(&next);
                    if found < cost {
                        (cost, posture, better) = (found, next, true);
                        break;
                    }
                }
            }
            if !better {
                step *= 0.5;
            }
        }
        (cost, posture)
    }

    /// The pinch of a posture, if it passes.
    fn grasp_at(&mut self, posture: &Posture, cone: f64) -> Result<PinchGrasp, PinchError> {
        let (width, model) = (self.width, self.hand.model);
        let up = upright_axis(posture.roll, 0.0);
        self.hand.set_posture(&posture.hand);
        let not_found = |hold: Option<&TwoDigitGrip>, clearance: f64| PinchError::NotFound {
            model: model.name.clone(),
            width,
            angle_deg: hold.map_or(90.0, |hold| hold.contact_angle_rad.to_degrees()),
            cone_deg: cone.to_degrees(),
            gap_mm: hold.map_or(0.0, |hold| 1e3 * hold.gap_m),
            table_clearance_mm: hold.map_or(0.0, |hold| 1e3 * hold.table_clearance_m),
            obstruction_mm: hold.map_or(0.0, |hold| 1e3 * hold.obstruction_m),
            open_clearance_mm: 1e3 * clearance,
        };
        let Some(closed) = self.hand.grip(width, posture.roll) else { return Err(not_found(None, 0.0)) };
        let crossing = self.hand.digit_overlap();
        let open = self.open_posture(posture, &closed.closing, &up);
        // The object must stand clear all the way: the hand is as low as its lowest posture allows.
        let mut lowest = f64::INFINITY;
        for k in 0..=8 {
            self.hand.set_posture(&interpolate(&posture.hand, &open, f64::from(k) / 8.0));
            lowest = lowest.min(self.hand.lowest_height(&up));
        }
        let floor = |center: &proact_types::Point| center.coords.dot(&up) - 0.5 * width;
        let drop = (floor(&closed.center) + two_digit_grip::TABLE_CLEARANCE_M - lowest).max(0.0);
        let center = closed.center - up * drop;
        let closed = TwoDigitGrip {
            height_offset_m: closed.height_offset_m + drop,
            table_clearance_m: lowest - floor(&center),
            ..closed
        };
        self.hand.set_posture(&open);
        let wide = self.hand.grip_along(width, &up, &closed.closing);
        let clearance_m = 0.5 * (wide.gap_m - width);
        let pressed = (closed.gap_m - (width - 2.0 * PRESS_DEPTH_M)).abs() < 0.5 * PRESS_DEPTH_M;
        let passes = closed.contact_angle_rad < cone - CONE_MARGIN_RAD && pressed && closed.is_clear(width);
        if !passes
            || clearance_m < MIN_OPEN_CLEARANCE_M
            || wide.obstruction_m > 1e-3
            || crossing > 2.0 * MAX_DIGIT_OVERLAP_M
        {
            return Err(not_found(Some(&closed), clearance_m));
        }
        let (roll_range, lean) = self.tilt_range(posture, &closed, &center, cone - CONE_MARGIN_RAD);
        let name = |what: &str| format!("pinch_{:.0}_{what}", 1e3 * width);
        let couplings = model.couplings();
        let pose = |what: &str, hand: &[f64]| NamedPose {
            name: name(what),
            group: "hand".to_owned(),
            angles: {
                let mut hand = hand.to_vec();
                couplings.place(&mut hand);
                hand.iter().map(|angle| (angle * 1e4).round() / 1e4).collect()
            },
        };
        let rounded = |v: Vector, to: f64| v.map(|x| (x * to).round() / to);
        let round = |x: f64, to: f64| (x * to).round() / to;
        let grasp = Grasp {
            width_range_m: [
                round(closed.gap_m + PRESS_DEPTH_M, 1e3),
                round(wide.gap_m - MIN_OPEN_CLEARANCE_M, 1e3),
            ],
            center: rounded(center.coords, 1e5),
            open_pose: name("open").into(),
            closed_pose: name("closed").into(),
            closing_direction: Some(rounded(closed.closing, 1e4)),
            roll_rad: round(posture.roll, 1e4),
            roll_range_rad: roll_range.map(|roll| round(roll, 1e4)),
            max_lean_rad: round(lean, 1e4),
            capture_radius_m: round(0.5 * (wide.gap_m + width), 1e3),
            withdrawal_direction: self.reference_grasp.withdrawal_direction,
        };
        Ok(PinchGrasp {
            grasp,
            open: pose("open", &open),
            closed: pose("closed", &posture.hand),
            digits: self.hand.pair.map(|(of, _)| model.links[of].name.clone()),
            contact_angle_rad: closed.contact_angle_rad,
            cone_half_angle_rad: cone,
            gaps_m: [closed.gap_m, wide.gap_m],
            table_clearance_m: closed.table_clearance_m,
            overhang_m: wide.overhang_m,
        })
    }

    /// The hand of `posture` opened: each digit of the pair straight away from the other, neither up nor aside, as far as
    /// its joints let it.
    fn open_posture(&mut self, posture: &Posture, closing: &Vector, up: &Vector) -> Vec<f64> {
        let mut hand = posture.hand.clone();
        let digits = self.hand.model.digits();
        for (which, away) in [(0, -closing), (1, *closing)] {
            let root = self.hand.pair[which].0;
            let of_digit = |joint: &&FreeJoint| {
                digits[self.hand.model.joints[self.hand.model.hand[joint.place]].child] == Some(root)
            };
            let joints: Vec<FreeJoint> = self.free_joints.iter().filter(of_digit).copied().collect();
            for _ in 0..((PRESS_DEPTH_M + OPEN_CLEARANCE_M) / OPENING_STEP_M).round() as usize {
                let at = |search: &mut Self, hand: &[f64]| {
                    search.hand.set_posture(hand);
                    search.hand.contact_pad(which)
                };
                let here = at(self, &hand);
                let mut columns = Vec::new();
                for joint in &joints {
                    let mut nudged = hand.clone();
                    nudged[joint.place] += 1e-5;
                    columns.push((at(self, &nudged) - here) / 1e-5);
                }
                // Least squares with a little damping: J' (J J' + d)^-1 e.
                let mut square = nalgebra::Matrix3::identity() * 1e-7;
                columns.iter().for_each(|c| square += c * c.transpose());
                let Some(inverse) = square.try_inverse() else { break };
                let pull = inverse * (away * OPENING_STEP_M + up * 0.0);
                for (joint, column) in joints.iter().zip(&columns) {
                    hand[joint.place] =
                        (hand[joint.place] + column.dot(&pull)).clamp(joint.lower, joint.upper);
                }
            }
        }
        hand
    }

    /// Range of the roll and largest lean, within those of the hand's other grasps, at which the contacts stay within
    /// `cone` and the hand clear of the table.
    fn tilt_range(
        &mut self,
        posture: &Posture,
        closed: &TwoDigitGrip,
        center: &proact_types::Point,
        cone: f64,
    ) -> ([f64; 2], f64) {
        self.hand.set_posture(&posture.hand);
        let width = self.width;
        let good = |roll: f64, lean: f64| {
            let up = upright_axis(roll, lean);
            let tilt = closed.closing.dot(&up).abs().asin();
            let floor = center.coords.dot(&up) - 0.5 * width;
            closed.contact_angle_rad + tilt < cone
                && self.hand.lowest_height(&up) - floor > 0.3 * two_digit_grip::TABLE_CLEARANCE_M
        };
        let [low, high] = self.reference_grasp.roll_range_rad;
        let until = |sign: f64, end: f64| {
            let steps = ((end - posture.roll).abs() / TILT_STEP_RAD) as usize;
            let ok = (1..=steps)
                .take_while(|n| good(posture.roll + sign * *n as f64 * TILT_STEP_RAD, 0.0))
                .count();
            posture.roll + sign * ok as f64 * TILT_STEP_RAD
        };
        let range = [until(-1.0, low), until(1.0, high)];
        let steps = (self.reference_grasp.max_lean_rad / TILT_STEP_RAD).round() as usize;
        let lean = (1..=steps)
            .take_while(|n| {
                let lean = *n as f64 * TILT_STEP_RAD;
                good(posture.roll, lean) && good(posture.roll, -lean)
            })
            .count() as f64
            * TILT_STEP_RAD;
        (range, lean)
    }
}

fn interpolate(from: &[f64], to: &[f64], share: f64) -> Vec<f64> {
    from.iter().zip(to).map(|(a, b)| a + share * (b - a)).collect()
}

/// Point `n` of the van der Corput sequence in the base that is prime number `axis`: points of all axes fill the space evenly
/// (Halton, 1960).
fn halton(n: usize, axis: usize) -> f64 {
    const PRIMES: [usize; 16] = [2, 3, 5, 7, 11, 13, 17, 19, 23, 29, 31, 37, 41, 43, 47, 53];
    let base = PRIMES[axis % PRIMES.len()];
    // The first points of large bases are all small.
    let (mut rest, mut share, mut sum) = (n + 64, 1.0, 0.0);
    while rest > 0 {
        share /= base as f64;
        sum += share * (rest % base) as f64;
        rest /= base;
    }
    sum
}
