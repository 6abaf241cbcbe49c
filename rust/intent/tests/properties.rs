//! What holds for every intent model and every input.

use proact_intent::{Candidates, IntentModel, IntentModelName, IntentOptions, Posterior};
use proact_types::{GazeSample, ObjectId, ObjectSet, Point, SimTime, TaskContext, Vector};
use proptest::{prelude::*, sample::select};

/// Sums of some numbers in another order, over a few hundred samples.
const ROUNDING: f64 = 1e-9;

/// Most objects of a scene in these tests.
const MOST: usize = 17;

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

fn set(due: &[bool]) -> ObjectSet {
    (0..due.len()).filter(|k| due[*k]).map(ObjectId::new).collect()
}

/// What the task asks for among `count` objects: none, some or all of them.
fn context(count: usize) -> impl Strategy<Value = Option<TaskContext>> {
    let due = prop::collection::vec(any::<bool>(), count);
    prop::option::of(
        (due, 0_u32..3)
            .prop_map(|(due, number)| TaskContext { expected_objects: set(&due), selection_number: number }),
    )
}

fn scene(count: usize) -> impl Strategy<Value = Candidates> {
    let centers = prop::collection::vec(vector().prop_map(Point::from), count);
    let pickable = prop::collection::vec(any::<bool>(), count);
    (centers, pickable, context(count), prop::option::of(vector())).prop_map(
        |(centers, pickable, context, tip)| Candidates {
            centers,
            pickable,
            context,
            tip: tip.map(Point::from),
        },
    )
}

fn options() -> impl Strategy<Value = IntentOptions> {
    (0.005..0.5, 0.0..0.5, 0.0..3.0, 1.0..800.0, 0.0..0.2, 0.0..100.0).prop_map(
        |(sigma, weight_other, switching_per_s, look_ms, elsewhere, straightness_per_m)| IntentOptions {
            gaze_sigma: sigma,
            off_task_weight: weight_other,
            goal_switching_rate_per_s: switching_per_s,
            independent_fixation_ms: look_ms,
            off_target_likelihood: elsewhere,
            straightness_per_m,
            ..IntentOptions::default()
        },
    )
}

/// Milliseconds since the sample before, gaze, scene.
type Stream = Vec<(u64, GazeSample, Candidates)>;

/// Samples over one scene of `count` objects that changes now and then.
fn stream_of(count: usize) -> impl Strategy<Value = Stream> {
    prop::collection::vec((scene(count), prop::collection::vec((0_u64..1500, gaze()), 1..12)), 1..4).prop_map(
        |parts| {
            parts
                .into_iter()
                .flat_map(|(scene, gaze_samples)| {
                    gaze_samples.into_iter().map(move |(dt, gaze)| (dt, gaze, scene.clone()))
                })
                .collect()
        },
    )
}

fn stream() -> impl Strategy<Value = Stream> {
    (1..=MOST).prop_flat_map(stream_of)
}

/// Samples, and the same objects in another order: the place in the first order of each in the second.
fn renumbering() -> impl Strategy<Value = (Stream, Vec<usize>)> {
    (1..=MOST).prop_flat_map(|count| (stream_of(count), Just((0..count).collect::<Vec<_>>()).prop_shuffle()))
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

/// The same scene with its objects in another order.
fn renumbered(scene: &Candidates, from: &[usize]) -> Candidates {
    let due = |context: TaskContext| {
        let due: Vec<bool> =
            from.iter().map(|k| context.expected_objects.contains(ObjectId::new(*k))).collect();
        TaskContext { expected_objects: set(&due), ..context }
    };
    Candidates {
        centers: from.iter().map(|k| scene.centers[*k]).collect(),
        pickable: from.iter().map(|k| scene.pickable[*k]).collect(),
        context: scene.context.map(due),
        tip: scene.tip,
    }
}

proptest! {
    #[test]
    fn every_posterior_sums_to_one_and_gives_nothing_to_objects_that_cannot_be_meant(
        name in select(IntentModelName::ALL.to_vec()),
        options in options(),
        stream in stream(),
    ) {
        for (answer, (_, _, scene)) in run(name, &options, &stream).iter().zip(&stream) {
            let Some(p) = answer else { continue };
            prop_assert_eq!(p.len(), scene.centers.len(), "{}", name);
            prop_assert!((p.iter().sum::<f64>() - 1.0).abs() < ROUNDING, "{name}: {p:?}");
            for (i, value) in p.iter().enumerate() {
                prop_assert!(value.is_finite() && *value >= 0.0, "{name}: {p:?}");
                let known = scene.pickable[i] && scene.centers[i].coords.iter().all(|v| v.is_finite());
                prop_assert!(known || *value == 0.0, "{name}: {p:?} in {scene:?}");
            }
        }
    }

    #[test]
    fn no_posterior_depends_on_the_order_of_the_objects(
        name in select(IntentModelName::ALL.to_vec()),
        options in options(),
        (stream, from) in renumbering(),
    ) {
        let other: Stream = stream.iter().map(|(dt, g, s)| (*dt, *g, renumbered(s, &from))).collect();
        let answers = run(name, &options, &stream);
        for (a, b) in answers.iter().zip(run(name, &options, &other)) {
            let expected: Option<Posterior> = a.as_ref().map(|p| from.iter().map(|k| p[*k]).collect());
            let close = match (&expected, &b) {
                (Some(e), Some(b)) => e.len() == b.len() && e.iter().zip(b).all(|(e, b)| (e - b).abs() < ROUNDING),
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
        let bits = |run: Vec<Option<Posterior>>| -> Vec<Option<Vec<u64>>> {
            run.into_iter().map(|p| p.map(|p| p.into_iter().map(f64::to_bits).collect())).collect()
        };
        prop_assert_eq!(bits(run(name, &options, &stream)), bits(run(name, &options, &stream)));
    }
}

/// Two objects that are due before two that are not.
fn two_rows() -> Candidates {
    Candidates {
        centers: [[0.6, 0.1], [0.6, -0.1], [0.8, 0.1], [0.8, -0.1]]
            .map(|[x, y]| Point::new(x, y, -0.5))
            .to_vec(),
        pickable: vec![true; 4],
        context: Some(TaskContext { expected_objects: ObjectSet::first(2), selection_number: 0 }),
        tip: None,
    }
}

fn ask(name: IntentModelName, gaze: &GazeSample) -> Option<Posterior> {
    name.build(&IntentOptions::default()).expect("defaults").observe(SimTime(20), gaze, &two_rows())
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
        let nothing = Candidates { pickable: vec![false; 4], ..two_rows() };
        assert_eq!(model.observe(SimTime(20), &gaze, &nothing), None, "{name}");
    }
}
