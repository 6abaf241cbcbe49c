//! What tests of EMG in live trials have in common.
#![allow(dead_code)] // Each test program uses its part.

use proact_app::{ReplayOptions, replay_trial};
use proact_control::{JogProfile, Simultaneous};
use proact_devices::{SyntheticEmg, SyntheticModel, random_stream};
use proact_testbed::{Setup, TrialConfig};
use proact_types::{Command, DegreeOfFreedom, EmgSample, Gesture};
use std::path::Path;

/// Eight channels at 1 kHz.
pub fn generator(seed: u64) -> SyntheticEmg {
    SyntheticEmg::new(&SyntheticModel::shipped().unwrap(), 1000.0, 8, 1.0, random_stream(seed, "test"))
        .unwrap()
}

/// So many samples of each gesture, to train on.
pub fn recordings(samples: u64) -> [(Gesture, Vec<EmgSample>); 5] {
    let mut emg = generator(1);
    Command::ALL.map(|gesture| {
        let take = (0..samples).map(|counter| EmgSample { counter, channels: emg.next(gesture) });
        (gesture.into(), take.collect())
    })
}

/// The same as a training takes them.
pub fn slices(recordings: &[(Gesture, Vec<EmgSample>); 5]) -> Vec<(Gesture, &[EmgSample])> {
    recordings.iter().map(|(gesture, samples)| (*gesture, samples.as_slice())).collect()
}

/// Method A, in which the wrist's drive moves the elbow, or without such a setting.
pub fn config(at_once: bool) -> TrialConfig {
    let mut config = TrialConfig::new("A", 1, Setup::named("still").unwrap());
    let JogProfile::Time { simultaneous, .. } = &mut config.profile.jog else { panic!("by time") };
    *simultaneous = at_once.then(|| Simultaneous {
        hand_on_threshold: 0.5,
        hand_off_threshold: 0.3,
        drives: [
            (DegreeOfFreedom::wrist(), "elbow".to_owned()),
            (DegreeOfFreedom::hand(), "hand".to_owned()),
        ]
        .into(),
    });
    config
}

/// The trial recorded in `dir` can be computed again.
pub fn replays(dir: &Path) {
    let replay = replay_trial(dir, ReplayOptions::default()).unwrap();
    assert!(replay.agrees, "{replay:?}");
}

/// By how much the joint of the arm moved that moved most between two ticks, rad, of what was asked of the joints after each tick.
pub fn moved(targets: &[Vec<f64>], from: usize, to: usize) -> f64 {
    let arm = targets[from].iter().zip(&targets[to]).take(7);
    arm.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}
