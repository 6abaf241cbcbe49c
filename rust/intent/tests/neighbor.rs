//! Settles by measurement whether a block can be selected by looking straight at it when a neighbour of the other
//! colour is due (ProACT, arXiv:2407.05025, footnote to the table of weights: after a drop "the system still allows"
//! it), and for which spread and weights. The tables stand in `docs/intent.md`, which must agree.

use proact_intent::{IntentOptions, posterior, prior_weights};
use proact_types::{GazeSample, ObjectId, Point, TaskContext, Vector};
use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use std::fmt::Write;

const DOCUMENT: &str = include_str!("../../../docs/intent.md");
/// Root mean square of the whole angle of the tracker's error, degrees (paper: "within a 1.5 degree error").
const GAZE_ERROR_DEG: f64 = 1.5;
const TRIALS: u32 = 10_000;
const SIGMAS: [f64; 5] = [0.02, 0.03, 0.05, 0.07, 0.1];
/// Weight of each block that is not due: no context, two to one, the paper's three to one, seven to one.
const WEIGHTS: [f64; 4] = [0.25, 1.0 / 6.0, 0.125, 0.0625];
/// Angles between two blocks as seen by the eye, degrees. 3.4 is two blocks that touch, seen from 0.85 m; 5.9 to
/// 10.4 are the neighbours of the arrangement.
const ANGLES: [f64; 7] = [2.0, 3.4, 4.2, 5.9, 7.2, 8.4, 10.4];

/// Red was released last: blue is due. Which block does the person look at?
#[derive(Clone, Copy)]
enum LookedAt {
    /// The red one that fell: the task speaks against it.
    Dropped,
    /// The blue one: the task speaks for it.
    Due,
}

/// Two blocks, `degrees` apart, at a distance of one metre; the others are behind the eye.
fn centers_at(degrees: f64) -> [Point; 4] {
    let angle = degrees.to_radians();
    let behind = Point::new(-1.0, 0.0, 0.0);
    [Point::new(1.0, 0.0, 0.0), behind, Point::new(angle.cos(), angle.sin(), 0.0), behind]
}

fn selected(options: &IntentOptions, degrees: f64, fixated: LookedAt, error_rad: [f64; 2]) -> bool {
    let centers = centers_at(degrees);
    let (target, other) = match fixated {
        LookedAt::Dropped => (0, 2),
        LookedAt::Due => (2, 0),
    };
    let straight = centers[target].coords;
    let aside = Vector::z().cross(&straight);
    let direction = straight + aside * error_rad[0].tan() + Vector::z() * error_rad[1].tan();
    let gaze = GazeSample { origin: Point::origin(), direction, valid: true };
    let blue_is_due =
        TaskContext { expected_objects: [2, 3].map(ObjectId).into_iter().collect(), selection_number: 1 };
    let prior = prior_weights(centers.len(), Some(&blue_is_due), options);
    let p = posterior(&gaze, &centers, &[true; 4], &prior, options)
        .expect("a finite gaze")
        .expect("two blocks ahead");
    p[target] > p[other]
}

fn options(sigma: f64, weight_other: f64) -> IntentOptions {
    IntentOptions { gaze_sigma: sigma, off_task_weight: weight_other, ..IntentOptions::default() }
}

/// Share of looks that select what is looked at, the tracker's error being Gaussian about both axes.
fn share(options: &IntentOptions, degrees: f64, fixated: LookedAt) -> f64 {
    let spread = (GAZE_ERROR_DEG / std::f64::consts::SQRT_2).to_radians();
    // The same errors in every cell, so that cells differ by their parameters alone.
    let mut rng = ChaCha8Rng::seed_from_u64(0x6e65_6967_6862_6f75);
    let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
    let hits = (0..TRIALS)
        .filter(|_| selected(options, degrees, fixated, [spread * normal(), spread * normal()]))
        .count();
    hits as f64 / f64::from(TRIALS)
}

/// Smallest angle from which a look without error selects the dropped block, degrees.
fn limit(options: &IntentOptions) -> f64 {
    let (mut low, mut high) = (0.0, 60.0);
    for _ in 0..50 {
        let middle = 0.5 * (low + high);
        if selected(options, middle, LookedAt::Dropped, [0.0; 2]) { high = middle } else { low = middle }
    }
    high
}

/// Angle of `ANGLES` without its unit, as the head of a column.
fn heads() -> String {
    ANGLES.iter().map(|a| format!(" {a:.1}° |")).collect()
}

fn dropped_table() -> String {
    let mut table =
        format!("| sigma | weight | limit |{}\n|---|---|---|{}\n", heads(), "---|".repeat(ANGLES.len()));
    for weight in WEIGHTS {
        // Without context the spread has no say: the nearest block wins.
        let even = weight == 0.25;
        for sigma in if even { &SIGMAS[..1] } else { &SIGMAS[..] } {
            let options = options(*sigma, weight);
            let cells: String = ANGLES
                .iter()
                .map(|a| format!(" {:.0} % |", 100.0 * share(&options, *a, LookedAt::Dropped)))
                .collect();
            let named = if even { "any".to_owned() } else { sigma.to_string() };
            let limit = if even { 0.0 } else { limit(&options) };
            writeln!(table, "| {named} | {weight:.3} | {limit:.1}° |{cells}").expect("text grows");
        }
    }
    table
}

/// What a spread is worth when the task's word is as good as its weights: three looks in four at the due block.
fn balance_table() -> String {
    let mut table = format!("| sigma |{}\n|---|{}\n", heads(), "---|".repeat(ANGLES.len()));
    for sigma in SIGMAS {
        let options = options(sigma, 0.125);
        let cells: String = ANGLES
            .iter()
            .map(|&angle| {
                let right = 0.75 * share(&options, angle, LookedAt::Due)
                    + 0.25 * share(&options, angle, LookedAt::Dropped);
                format!(" {:.1} % |", 100.0 * right)
            })
            .collect();
        writeln!(table, "| {sigma} |{cells}").expect("text grows");
    }
    table
}

#[test]
fn the_document_shows_the_tables_as_measured() {
    let missing: String =
        [dropped_table(), balance_table()].into_iter().filter(|table| !DOCUMENT.contains(table)).collect();
    assert!(missing.is_empty(), "docs/intent.md must show:\n{missing}");
}

#[test]
fn without_error_the_limit_is_sigma_times_the_root_of_twice_the_log_odds() {
    // x = tan(angle) > sigma sqrt(2 ln(due / other)): the blocks' weights are in the ratio 3 to 1.
    for sigma in SIGMAS {
        let expected = (sigma * (2.0 * 3.0_f64.ln()).sqrt()).atan().to_degrees();
        let found = limit(&options(sigma, 0.125));
        assert!((found - expected).abs() < 1e-6, "{sigma}: {found}, expected {expected}");
    }
    assert!((limit(&options(0.1, 0.125)) - 8.4).abs() < 0.05, "the original's spread");
    assert!((limit(&options(0.05, 0.125)) - 4.2).abs() < 0.05, "the default's");
}

#[test]
fn the_shares_agree_with_the_normal_distribution() {
    // For small angles the dropped block wins while the error toward the neighbour is below
    // angle / 2 - sigma^2 ln 3 / angle. By hand for 5.9 degrees and sigma 0.05: 0.05149 - 0.02667 = 0.02482 rad,
    // the error's spread is 0.01851 rad, so the share is Phi(1.341) = 0.910.
    let measured = share(&options(0.05, 0.125), 5.9, LookedAt::Dropped);
    // Three standard errors of the share and the curvature of the tangent.
    assert!((measured - 0.910).abs() < 0.012, "{measured}");
}

#[test]
fn at_the_originals_spread_no_neighbour_of_the_arrangement_can_be_re_selected_reliably() {
    // Nearest neighbours of the arrangement: 5.9 degrees, as seen by the eye of the seated set-up.
    assert!(share(&options(0.1, 0.125), 5.9, LookedAt::Dropped) < 0.05);
    assert!(share(&options(0.05, 0.125), 5.9, LookedAt::Dropped) > 0.85);
    assert!(share(&options(0.03, 0.125), 5.9, LookedAt::Dropped) > 0.97);
    // Two blocks that touch: the tracker alone, without any context, is right nineteen times in twenty.
    assert!(share(&options(0.05, 0.25), 3.4, LookedAt::Dropped) > 0.93);
    assert!(share(&options(0.05, 0.125), 3.4, LookedAt::Dropped) < 0.30);
}
