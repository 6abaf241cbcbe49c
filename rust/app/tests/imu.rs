//! A live trial with a model that knows the position of the arm: what the inertial measurement unit says is in the input log, a
//! frozen one stops the arm with its reason, and the record replays.
#![allow(clippy::unwrap_used, clippy::disallowed_methods)] // A test of files.

mod common;

use common::{config, generator, moved};
use proact_app::{Arm, Recorder, ReplayOptions, replay_trial, trial};
use proact_control::MethodRegistry;
use proact_devices::{SimulatedImu, SyntheticEmg};
use proact_emg::{EmgConfig, EmgModel, ImuChannel, ImuConfig};
use proact_testbed::ports;
use proact_types::{Command, EmgSample, SimTime, StopCause};

const TICKS: u64 = 4000;
/// From then on the unit repeats its last values; after `frozen_ms` that stops the arm.
const FREEZES: u64 = 1500;

/// An armband at 1 kHz whose unit has 50 values a second.
struct Worn {
    emg: SyntheticEmg,
    imu: SimulatedImu,
    newest: [f64; 10],
}

impl Worn {
    fn new(seed: u64) -> Worn {
        Worn { emg: generator(seed), imu: SimulatedImu::new(seed), newest: [0.0; 10] }
    }

    fn sample(&mut self, counter: u64, gesture: Command, freezes: u64) -> EmgSample {
        if counter.is_multiple_of(20) && counter < freezes {
            self.newest = self.imu.sample();
        }
        let mut channels = self.emg.next(gesture);
        for (c, value) in channels.iter_mut().enumerate() {
            *value *= self.imu.gain(c, 8);
        }
        channels.extend(self.newest);
        EmgSample { counter, channels }
    }
}

impl ports::EmgSource for Worn {
    fn sample_at(&mut self, now: SimTime, _intended: Command) -> Vec<EmgSample> {
        let gesture = if now.0 < 500 { Command::NoMotion } else { Command::WristExtension };
        [self.sample(now.0, gesture, FREEZES)].into_iter().collect()
    }
}

/// Trained with the arm hanging, level and overhead.
fn model() -> EmgModel {
    let imu =
        ImuConfig::record_only(ImuChannel::armband_channels()).with_features(&["acceleration"]).unwrap();
    let mut worn = Worn::new(1);
    let mut takes = Vec::new();
    for position_index in 0..3 {
        worn.imu.set_position(position_index, 3);
        // It is there before the recording begins.
        for _ in 0..100 {
            worn.imu.sample();
        }
        for gesture in Command::ALL {
            let samples: Vec<EmgSample> =
                (0..3000).map(|counter| worn.sample(counter, gesture, u64::MAX)).collect();
            takes.push((gesture, samples));
        }
    }
    let slices: Vec<(Command, &[EmgSample])> = takes.iter().map(|(g, s)| (*g, s.as_slice())).collect();
    EmgModel::train(&EmgConfig { imu, ..EmgConfig::default() }, &[0.0; 8], &slices).unwrap()
}

#[test]
fn the_unit_is_in_the_log_stops_the_arm_when_it_freezes_and_the_trial_replays() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path().join("trial");
    let (model, config) = (model(), config(false));
    let worn = trial::TrainedArmband { trained: &model, samples: Box::new(Worn::new(2)) };
    let arm = Arm::from_config(&config).unwrap();
    let trial::Assembly { mut trial, classifier, arm, .. } =
        trial::live_trial_with_armband(&MethodRegistry::standard(), &arm, config, Some(worn)).unwrap();
    let used = trial.testbed().config().clone();
    let mut recorder = Recorder::create(&dir, &used, &arm, classifier.as_ref()).unwrap();
    let (mut targets, mut stops) = (Vec::new(), Vec::new());
    for tick in 1..=TICKS {
        let step = trial.step(tick == TICKS).unwrap();
        assert!(step.input.emg.iter().all(|sample| sample.channels.len() == 18), "the unit is an input");
        recorder.write(&step, trial.testbed().plant().state()).unwrap();
        targets.push(trial.testbed().targets().to_vec());
        stops.extend(trial.testbed().stop().map(|stop| (tick, stop.clone())));
    }
    recorder.finish(&trial.result()).unwrap();
    assert!(moved(&targets, 700, 1500) > 0.1, "{} rad before", moved(&targets, 700, 1500));
    let (at, stop) = stops.first().expect("the frozen unit stops it");
    assert_eq!(stop.cause, StopCause::Frozen, "{stop:?}");
    assert!((2480..2560).contains(at), "at {at} ms");
    assert!(stop.reason.contains("inertial measurement unit repeats its values"), "{stop:?}");
    assert_eq!(moved(&targets, 3000, 3990), 0.0, "and it stands");
    let replay = replay_trial(&dir, ReplayOptions::default()).unwrap();
    assert!(replay.agrees, "{replay:?}");
}
