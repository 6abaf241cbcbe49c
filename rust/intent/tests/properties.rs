//! What holds for every intent model and every input.

use proact_intent::{Candidates, IntentModel, IntentModelName, IntentOptions, Posterior};
use proact_types::{BlockColour, BlockId, GazeSample, Point, SimTime, Vector};
use proptest::{prelude::*, sample::select};

/// Sums of four numbers in another order, over a few hundred samples.
const ROUNDING: f64 = 1e-9;

/// A coordinate that now and then is not a number.
fn coordinate() -> impl Strategy<Value = f64> {
    prop_oneof![20 => -1.5..1.5, 1 => select(vec![f64::NAN, f64::INFINITY, 0.0])]
}

fn vector() -> impl Strategy<Value = Vector> {
    [coordinate(), coordinate(), coordinate()].prop_map(Vector::from)
}

fn gaze() -> impl Strategy<Value = GazeSample> {
    (vector(), vector(), prop::bool::weighted(0.9)).prop_map(|(origin, direction, valid)| GazeSample {
        origin: Point::from(origin),
        direction,
        valid,
    })
}

fn colour() -> impl Strategy<Value = Option<BlockColour>> {
    select(vec![None, Some(BlockColour::Red), Some(BlockColour::Blue)])
}

fn scene() -> impl Strategy<Value = Candidates> {
    let four = || [vector(), vector(), vector(), vector()];
    (four(), any::<[bool; 4]>(), colour(), prop::option::of(vector())).prop_map(
        |(centres, pickable, last_released, tip)| Candidates {
            centres: centres.map(Point::from),
            pickable,
            last_released,
            tip: tip.map(Point::from),
        },
    )
}

fn options() -> impl Strategy<Value = IntentOptions> {
    (0.005..0.5, 0.0..0.5, 0.0..3.0, 1.0..800.0, 0.0..0.2, 0.0..100.0).prop_map(
        |(sigma, weight_other, switching_per_s, look_ms, elsewhere, straightness_per_m)| IntentOptions {
            sigma,
            weight_other,
            switching_per_s,
            look_ms,
            elsewhere,
            straightness_per_m,
            ..IntentOptions::default()
        },
    )
}

/// Milliseconds since the sample before, gaze, scene.
type Stream = Vec<(u64, GazeSample, Candidates)>;

/// Samples over one scene that changes now and then.
fn stream() -> impl Strategy<Value = Stream> {
    prop::collection::vec((scene(), prop::collection::vec((0_u64..1500, gaze()), 1..12)), 1..4).prop_map(
        |parts| {
            parts
                .into_iter()
                .flat_map(|(scene, looks)| looks.into_iter().map(move |(dt, gaze)| (dt, gaze, scene)))
                .collect()
        },
    )
}

fn run(name: IntentModelName, options: &IntentOptions, stream: &Stream) -> Vec<Option<Posterior>> {
    let mut model: Box<dyn IntentModel> = name.build(options).expect("options in range");
    let mut now = SimTime(0);
    stream
        .iter()
        .map(|(dt, gaze, scene)| {
            now = now.plus_millis(*dt);
            model.observe(now, gaze, scene)
        })
        .collect()
}

/// Renumbers the blocks: swaps the two reds, the two blues, and the colours.
fn renumbered(scene: &Candidates, from: [usize; 4]) -> Candidates {
    let other = |colour| match colour {
        BlockColour::Red => BlockColour::Blue,
        BlockColour::Blue => BlockColour::Red,
    };
    let swapped = BlockId::ALL[from[0]].colour() == BlockColour::Blue;
    // Red is due at the start, as after a blue block.
    let released = scene.last_released.unwrap_or(BlockColour::Blue);
    Candidates {
        centres: from.map(|k| scene.centres[k]),
        pickable: from.map(|k| scene.pickable[k]),
        last_released: Some(if swapped { other(released) } else { released }),
        tip: scene.tip,
    }
}

const RENUMBERINGS: [[usize; 4]; 7] =
    [[1, 0, 2, 3], [0, 1, 3, 2], [1, 0, 3, 2], [2, 3, 0, 1], [3, 2, 0, 1], [2, 3, 1, 0], [3, 2, 1, 0]];

proptest! {
    #[test]
    fn every_posterior_sums_to_one_and_gives_nothing_to_blocks_that_cannot_be_meant(
        name in select(IntentModelName::ALL.to_vec()),
        options in options(),
        stream in stream(),
    ) {
        for (answer, (_, _, scene)) in run(name, &options, &stream).iter().zip(&stream) {
            let Some(p) = answer else { continue };
            prop_assert!((p.iter().sum::<f64>() - 1.0).abs() < ROUNDING, "{name}: {p:?}");
            for (i, value) in p.iter().enumerate() {
                prop_assert!(value.is_finite() && *value >= 0.0, "{name}: {p:?}");
                let known = scene.pickable[i] && scene.centres[i].coords.iter().all(|v| v.is_finite());
                prop_assert!(known || *value == 0.0, "{name}: {p:?} in {scene:?}");
            }
        }
    }

    #[test]
    fn no_posterior_depends_on_the_order_of_the_blocks(
        name in select(IntentModelName::ALL.to_vec()),
        options in options(),
        stream in stream(),
        from in select(RENUMBERINGS.to_vec()),
    ) {
        // "None" and "blue" mean the same prior, but the change from one to the other begins a new selection.
        let named: Stream = stream.iter().map(|(dt, g, s)| (*dt, *g, renumbered(s, [0, 1, 2, 3]))).collect();
        let other: Stream = named.iter().map(|(dt, g, s)| (*dt, *g, renumbered(s, from))).collect();
        let answers = run(name, &options, &named);
        for (a, b) in answers.iter().zip(run(name, &options, &other)) {
            let expected = a.map(|p| from.map(|k| p[k]));
            let close = match (expected, b) {
                (Some(e), Some(b)) => (0..4).all(|i| (e[i] - b[i]).abs() < ROUNDING),
                (e, b) => e == b,
            };
            prop_assert!(close, "{name}: {expected:?}, renumbered {b:?}");
        }
    }

    #[test]
    fn equal_streams_give_equal_bits(
        name in select(IntentModelName::ALL.to_vec()),
        options in options(),
        stream in stream(),
    ) {
        let bits = |run: Vec<Option<Posterior>>| -> Vec<Option<[u64; 4]>> {
            run.into_iter().map(|p| p.map(|p| p.map(f64::to_bits))).collect()
        };
        prop_assert_eq!(bits(run(name, &options, &stream)), bits(run(name, &options, &stream)));
    }
}

const SCENE: Candidates = Candidates {
    centres: [
        Point::new(0.6, 0.1, -0.5),
        Point::new(0.6, -0.1, -0.5),
        Point::new(0.8, 0.1, -0.5),
        Point::new(0.8, -0.1, -0.5),
    ],
    pickable: [true; 4],
    last_released: None,
    tip: None,
};

fn ask(name: IntentModelName, gaze: &GazeSample) -> Option<Posterior> {
    name.build(&IntentOptions::default()).expect("defaults").observe(SimTime(20), gaze, &SCENE)
}

#[test]
fn blinks_broken_gaze_and_blocks_behind_tell_a_model_of_the_present_gaze_nothing_and_others_the_prior() {
    let good = GazeSample { origin: Point::origin(), direction: Vector::new(0.6, 0.1, -0.5), valid: true };
    let silent = [
        GazeSample { valid: false, ..good },
        GazeSample { direction: Vector::new(f64::NAN, 0.0, 0.0), ..good },
        GazeSample { direction: Vector::zeros(), ..good },
        GazeSample { origin: Point::new(f64::INFINITY, 0.0, 0.0), ..good },
        GazeSample { direction: -good.direction, ..good },
    ];
    for gaze in &silent {
        for name in [IntentModelName::GazeOnly, IntentModelName::Product] {
            assert_eq!(ask(name, gaze), None, "{name}: {gaze:?}");
        }
        for name in [IntentModelName::PriorOnly, IntentModelName::Filtered, IntentModelName::HandMotion] {
            let p = ask(name, gaze).expect("the prior needs no gaze");
            let prior = [0.375, 0.375, 0.125, 0.125];
            assert!((0..4).all(|i| (p[i] - prior[i]).abs() < ROUNDING), "{name}: {p:?} for {gaze:?}");
        }
    }
    for name in IntentModelName::ALL {
        assert!(ask(name, &good).is_some(), "{name}");
    }
}

#[test]
fn with_nothing_to_pick_every_model_is_silent() {
    let gaze = GazeSample { origin: Point::origin(), direction: Vector::x(), valid: true };
    for name in IntentModelName::ALL {
        let mut model = name.build(&IntentOptions::default()).expect("defaults");
        let nothing = Candidates { pickable: [false; 4], ..SCENE };
        assert_eq!(model.observe(SimTime(20), &gaze, &nothing), None, "{name}");
    }
}
