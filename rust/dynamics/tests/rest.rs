//! An arm that leans on something is at rest soon after the driver lets go: pushes into table, partition, walls, blocks and joint
//! limits, by gestures. It went on for a second: targets that had run ahead of the arm were still pursued.

#![allow(clippy::unwrap_used)]

use proact_arm::ArmModel;
use proact_control::MethodRegistry;
use proact_description::ArmFolder;
use proact_dynamics::{DynamicsOptions, Engine, OdePlant};
use proact_kinematics::Kinematics;
use proact_testbed::{Parts, Pinned, Setup, Testbed, TrialConfig, doubles::InstantPlans};
use proact_types::{GazeSample, Gesture, Point, TickInput};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::sync::Arc;

/// From the release until the arm is at rest, ms.
const REST_MS: u64 = 250;
/// Watched after a release, ms.
const WATCHED_MS: u64 = 1500;
/// No joint of the arm is faster than this at rest, rad/s.
const AT_REST: f64 = 0.02;
/// A joint that lags its target by more than this leans on something, rad.
const LEANS: f64 = 1e-3;
/// A tap on the gesture that chooses what moves, and the pause after it, ms.
const TAP_MS: u64 = 60;
const PUSHES: usize = 24;
/// Of the pushes of a trial so many at least end against something.
const LEANING: usize = 4;
/// No joint creeps further than this in the second after it came to rest, rad: neither under its weight nor into what it leans on.
const CREEP: f64 = 2e-3;

fn testbed(arm: &str, mut config: TrialConfig) -> (Testbed, Arc<ArmModel>) {
    let model = Arc::new(ArmFolder::shipped(arm).unwrap().model().unwrap());
    config = config.with_arm(Pinned { name: arm.to_owned(), hash: None }, &model);
    let start = [model.pose("arm", "start").unwrap(), model.pose("hand", "open").unwrap()].concat();
    let base = config.setup.body.shoulder_pose(&Default::default());
    let task = config.build_task(&model).unwrap();
    let options = DynamicsOptions::of(&config.physics);
    let parts = Parts {
        arm: config.arm.clone(),
        kinematics: Box::new(Kinematics::new(&model).unwrap()),
        plant: Box::new(OdePlant::new(&model, task.scene(), &start, &base, options).unwrap()),
        methods: MethodRegistry::standard(),
        // Straight lines, which lead through what stands in the way.
        plans: Box::new(InstantPlans::new(model.clone())),
        classifier: None,
        process: None,
        model: model.clone(),
    };
    (Testbed::new(config, parts).unwrap(), model)
}

/// A trial whose driver pushes at random.
struct Pushes {
    testbed: Testbed,
    arm: usize,
    /// Among the blocks.
    looked_at: usize,
}

impl Pushes {
    fn tick(&mut self, gesture: Option<Gesture>) {
        let blocks = &self.testbed.plant().state().objects;
        let eye = Point::new(-0.4, 0.0, 1.8);
        let direction = blocks[self.looked_at].pose.translation.vector - eye.coords;
        let gaze = self.testbed.now().0.is_multiple_of(10).then_some(GazeSample {
            origin: eye,
            direction,
            valid: true,
        });
        self.testbed.tick(&TickInput { gesture, gaze, ..TickInput::default() }, false).unwrap();
    }

    fn make(&mut self, gesture: Gesture, ms: u64) {
        self.tick(Some(gesture));
        (1..ms).for_each(|_| self.tick(None));
    }

    /// The greatest lag of an arm joint behind its target, rad.
    fn lag(&self) -> f64 {
        let measured = &self.testbed.plant().state().position[..self.arm];
        self.testbed
            .targets()
            .iter()
            .zip(measured)
            .fold(0.0, |most: f64, (target, is)| most.max((target - is).abs()))
    }

    /// The speed of the fastest joint of the arm, rad/s, and the joint.
    fn fastest(&self) -> (f64, usize) {
        let speeds = self.testbed.plant().state().velocity[..self.arm].iter().map(|speed| speed.abs());
        speeds.zip(0..).max_by(|a, b| a.0.total_cmp(&b.0)).unwrap()
    }
}

/// Pushes, releases and watches; how many releases found the arm leaning on something.
fn check(engine: Engine, arm: &str, method: &str, setup: &str) -> usize {
    let mut config = TrialConfig::new(method, 1, Setup::named(setup).unwrap());
    config.physics.engine = engine;
    let (testbed, model) = testbed(arm, config);
    let mut trial = Pushes { testbed, arm: model.arm_count(), looked_at: 0 };
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut leaning = 0;
    for push in 0..PUSHES {
        trial.looked_at = rng.random_range(0..4);
        for _ in 0..rng.random_range(0..7) {
            trial.make(Gesture::HandOpen, TAP_MS);
            trial.make(Gesture::NoMotion, TAP_MS);
        }
        let back = rng.random_bool(0.5) && ["A", "B"].contains(&method);
        let gesture = if back { Gesture::WristFlexion } else { Gesture::WristExtension };
        trial.make(gesture, rng.random_range(500..5000));
        leaning += usize::from(trial.lag() > LEANS);
        trial.make(Gesture::NoMotion, REST_MS);
        let rest = trial.testbed.plant().state().position.clone();
        for ms in REST_MS..WATCHED_MS {
            let (speed, joint) = trial.fastest();
            assert!(
                speed < AT_REST,
                "{engine:?}, {arm}, method {method}, {setup}, push {push}: joint {joint} at {speed:.3} rad/s {ms} ms after the \
                 release, expected below {AT_REST}"
            );
            trial.tick(None);
        }
        let end = &trial.testbed.plant().state().position;
        let crept =
            rest.iter().zip(end).take(trial.arm).fold(0.0, |most: f64, (a, b)| most.max((a - b).abs()));
        assert!(
            crept < CREEP,
            "{engine:?}, {arm}, method {method}, {setup}, push {push}: crept by {crept:.4} rad"
        );
    }
    leaning
}

#[test]
fn an_arm_that_leans_on_something_is_at_rest_a_quarter_of_a_second_after_the_release() {
    for engine in [Engine::Reduced, Engine::Ode] {
        for arm in ["mpl_right", "mpl_left", "wam"] {
            for (method, setup) in [("A", "still"), ("B", "seated"), ("C", "seated")] {
                let leaning = check(engine, arm, method, setup);
                println!(
                    "{engine:?}, {arm}, method {method}, {setup}: {leaning} of {PUSHES} pushes end against something"
                );
                assert!(
                    leaning >= LEANING,
                    "{engine:?}, {arm}, method {method}, {setup}: {leaning} lean, expected {LEANING}"
                );
            }
        }
    }
}
