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
const WATCHED_MS: u64 = 2000;
/// No joint of the arm is faster than this at rest, rad/s.
const AT_REST: f64 = 0.02;
/// A joint that lags its target by more than this leans on something, rad.
const LEANS: f64 = 1e-3;
/// No joint creeps further than this in the time after it came to rest, rad: neither under its weight nor into what it leans on.
const CREEP: f64 = 2e-3;
/// A tap on the gesture that chooses what moves, and the pause after it, ms.
const TAP_MS: u64 = 60;
/// Of a trial.
const PUSHES: usize = 20;

fn testbed(arm: &str, mut config: TrialConfig) -> (Testbed, Arc<ArmModel>) {
    let model = Arc::new(ArmFolder::shipped(arm).unwrap().model().unwrap());
    config = config.with_arm(Pinned::named(arm), &model);
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
struct Driver {
    testbed: Testbed,
    model: Arc<ArmModel>,
    rng: ChaCha8Rng,
    /// Among the blocks; none where gaze chooses nothing.
    looked_at: Option<usize>,
}

impl Driver {
    fn tick(&mut self, gesture: Option<Gesture>) {
        let blocks = &self.testbed.plant().state().objects;
        let eye = Point::new(-0.4, 0.0, 1.8);
        let due = (self.testbed.now().0 + 1).is_multiple_of(10);
        let gaze = self.looked_at.filter(|_| due).map(|block| {
            let direction = blocks[block].pose.translation.vector - eye.coords;
            GazeSample { origin: eye, direction, valid: true }
        });
        self.testbed.tick(&TickInput { gesture, gaze, ..TickInput::default() }, false).unwrap();
    }

    fn make(&mut self, gesture: Gesture, ms: u64) {
        self.tick(Some(gesture));
        (1..ms).for_each(|_| self.tick(None));
    }

    /// Chooses what moves, or opens or closes the hand, and moves it until it is to be released.
    fn push(&mut self, jogs: bool) {
        let block = self.rng.random_range(0..4);
        self.looked_at = (!jogs).then_some(block);
        if jogs {
            for _ in 0..self.rng.random_range(0..7) {
                self.make(Gesture::HandOpen, TAP_MS);
                self.make(Gesture::NoMotion, TAP_MS);
            }
            if self.rng.random_bool(0.15) {
                self.make(Gesture::HandClose, 120);
                self.make(Gesture::NoMotion, 500);
            }
        } else {
            match self.rng.random_range(0..6) {
                0 => self.make(Gesture::HandClose, 1000),
                1 => self.make(Gesture::HandOpen, 1000),
                _ => {}
            }
            self.make(Gesture::NoMotion, 200);
        }
        let forth = self.rng.random_bool(0.5) || !jogs;
        let gesture = if forth { Gesture::WristExtension } else { Gesture::WristFlexion };
        let ms = self.rng.random_range(500..4000);
        self.make(gesture, ms);
    }

    /// Whether something keeps the arm from its target, or its motors are at their limit.
    fn leans(&self) -> bool {
        let state = self.testbed.plant().state();
        (0..self.model.arm_count()).any(|k| {
            let most = self.model.joints[self.model.arm[k]].limits.effort;
            (self.testbed.targets()[k] - state.position[k]).abs() > LEANS
                || state.effort[k].abs() > 0.99 * most
        })
    }
}

/// Pushes, releases and watches.
fn check(engine: Engine, arm: &str, method: &str, seed: u64) {
    let mut config = TrialConfig::new(method, seed, Setup::named("still").unwrap());
    config.physics.engine = engine;
    let trial = format!("{engine:?}, {arm}, method {method}, seed {seed}");
    let (testbed, model) = testbed(arm, config);
    let arm = model.arm_count();
    let mut driver = Driver { testbed, model, rng: ChaCha8Rng::seed_from_u64(1000 + seed), looked_at: None };
    (1..500).for_each(|_| driver.tick(None));
    let mut leaning = 0;
    for push in 0..PUSHES {
        driver.push(["A", "B"].contains(&method));
        leaning += usize::from(driver.leans());
        driver.make(Gesture::NoMotion, REST_MS + 1);
        let rest = driver.testbed.plant().state().position.clone();
        for ms in REST_MS + 1..WATCHED_MS {
            let state = driver.testbed.plant().state();
            for (joint, speed) in state.velocity[..arm].iter().enumerate() {
                assert!(
                    speed.abs() < AT_REST,
                    "{trial}, push {push}: joint {joint} at {speed:.3} rad/s {ms} ms after the release, expected below {AT_REST}"
                );
            }
            driver.tick(None);
        }
        let end = &driver.testbed.plant().state().position;
        let crept = rest.iter().zip(end).take(arm).fold(0.0, |most: f64, (a, b)| most.max((a - b).abs()));
        assert!(
            crept < CREEP,
            "{trial}, push {push}: a joint crept by {crept:.4} rad, expected below {CREEP}"
        );
    }
    println!("{trial}: {leaning} of {PUSHES} pushes end against something");
    assert!(leaning > 0, "{trial}: no push ends against something");
}

#[test]
fn an_arm_that_leans_on_something_is_at_rest_a_quarter_of_a_second_after_the_release() {
    for (arm, method, seed) in [
        ("mpl_right", "A", 1),
        ("mpl_right", "A", 3),
        ("mpl_right", "B", 8),
        ("mpl_right", "C", 1),
        ("mpl_left", "A", 3),
        ("wam", "A", 2),
        ("wam", "C", 2),
    ] {
        check(Engine::Reduced, arm, method, seed);
    }
}

#[test]
fn an_arm_of_bodies_is_at_rest_a_quarter_of_a_second_after_the_release() {
    for (arm, method, seed) in [("mpl_right", "A", 1), ("mpl_left", "C", 1), ("wam", "A", 2)] {
        check(Engine::Ode, arm, method, seed);
    }
}
