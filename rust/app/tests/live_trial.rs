//! A trial that a person drives, without a browser: what comes at its first instants, and what its record holds.

#![allow(clippy::unwrap_used, clippy::disallowed_methods)] // A test of files and of real time.

use proact_app::{Arm, LiveTrial, LiveTrialEnd, Recorder, TrialInputs, UserDevices, page_content, trial};
use proact_bridge::{ClientInput, LatencyRow, LatencyStage, PageOptions, PageServer};
use proact_devices::FeedbackSinks;
use proact_intent::GazeOffset;
use proact_testbed::{Setup, TrialConfig, TrialResult};
use proact_types::{Command, DisplayFrame};
use std::{
    path::Path,
    sync::atomic::{AtomicBool, Ordering},
    time::Duration,
};

/// A trial that does not end by itself is ended after this time.
const TIMEOUT: Duration = Duration::from_secs(20);

/// What is asked for at the `n`th look, from 0: a trial looks before its first tick, and then before each frame.
struct Script {
    look: usize,
    asked: Vec<(usize, ClientInput)>,
    frames: usize,
}

impl TrialInputs for Script {
    fn drain(&mut self) -> Vec<ClientInput> {
        let poll_index = self.look;
        self.look += 1;
        self.asked.iter().filter(|(when, _)| *when == poll_index).map(|(_, input)| input.clone()).collect()
    }

    fn frame_shown(&mut self, _frame: &DisplayFrame) {
        self.frames += 1;
    }
}

/// Drives a trial of method A by the page alone, in which `script` comes; how it ended, its result, and its frames.
fn drive(
    script: Vec<(usize, ClientInput)>,
    limit_secs: f64,
    dir: &Path,
) -> (LiveTrialEnd, TrialResult, usize) {
    let mut config = TrialConfig::new("A", 1, Setup::named("still").unwrap());
    config.limit_secs = limit_secs;
    let arm = Arm::from_config(&config).unwrap();
    let trial::Assembly { trial, plans, .. } = trial::live_trial(config).unwrap();
    let recorder = Recorder::create(dir, trial.testbed().config(), &arm, None).unwrap();
    let content = page_content(trial.testbed(), &arm);
    let page = PageServer::start(PageOptions { port: 0, ..PageOptions::default() }, content).unwrap();
    let interrupted = AtomicBool::new(false);
    let mut inputs = Script { look: 0, asked: script, frames: 0 };
    let (ended, result) = std::thread::scope(|scope| {
        let (done, waits) = std::sync::mpsc::channel::<()>();
        let interrupted = &interrupted;
        scope.spawn(move || {
            if waits.recv_timeout(TIMEOUT).is_err_and(|end| end == std::sync::mpsc::RecvTimeoutError::Timeout)
            {
                interrupted.store(true, Ordering::Relaxed);
            }
        });
        let ended = LiveTrial {
            trial,
            recorder: Some(recorder.with_plans(plans).unwrap()),
            dir: Some(dir.to_owned()),
            page: &page,
            inputs: &mut inputs,
            devices: &mut UserDevices::new(None, None, FeedbackSinks::default(), None),
            gaze_offset: &mut GazeOffset::default(),
            results: None,
            interrupted,
        }
        .run()
        .unwrap();
        drop(done);
        ended
    });
    (ended, result, inputs.frames)
}

fn restart() -> ClientInput {
    ClientInput::Restart { method: Some("B".to_owned()), same_seed: true }
}

// It lay there until the person's first action, for which time waits from the second frame on.
#[test]
fn a_choice_in_the_first_instants_of_a_trial_is_taken_at_once() {
    for poll_index in 0..4 {
        let dir = tempfile::tempdir().unwrap();
        let (ended, ..) = drive(vec![(poll_index, restart())], 60.0, &dir.path().join("trial"));
        assert_eq!(
            ended,
            LiveTrialEnd::Restart { method: Some("B".to_owned()), same_arrangement: true },
            "look {poll_index}"
        );
    }
}

#[test]
fn the_record_of_a_trial_in_real_time_says_what_each_stage_took() {
    let dir = tempfile::tempdir().unwrap();
    let trial = dir.path().join("trial");
    let acts = vec![
        (1, ClientInput::Gesture(Command::WristExtension)),
        (30, ClientInput::Gesture(Command::NoMotion)),
    ];
    let (ended, result, frames) = drive(acts, 1.0, &trial);
    assert_eq!(ended, LiveTrialEnd::Finished);
    assert!(frames >= 60, "{frames}");
    let text = std::fs::read_to_string(trial.join("latency.json")).unwrap();
    let table: serde_json::Value = serde_json::from_str(&text).unwrap();
    let rows: Vec<LatencyRow> = serde_json::from_value(table["stages"].clone()).unwrap();
    let row = |stage| rows.iter().find(|row| row.stage == stage);
    let ticks = (1e3 * result.sim_seconds).round() as u64;
    let stages = [
        LatencyStage::Emg,
        LatencyStage::Intent,
        LatencyStage::Method,
        LatencyStage::Actuation,
        LatencyStage::World,
        LatencyStage::Task,
        LatencyStage::Tick,
    ];
    for stage in stages {
        let row = row(stage).unwrap_or_else(|| panic!("{stage:?} in {text}"));
        assert_eq!(row.count, ticks, "{row:?}");
        assert!(row.median_ms <= row.p99_ms && row.p99_ms <= row.worst_ms && row.worst_ms > 0.0, "{row:?}");
    }
    let [world, tick] = [LatencyStage::World, LatencyStage::Tick].map(|stage| row(stage).unwrap().worst_ms);
    assert!(tick >= world, "a tick holds its physics: {tick} {world}");
    // A key: the gesture moves a joint after some milliseconds, and a frame shows it within a sixtieth of a second.
    let moved = row(LatencyStage::Motion).unwrap_or_else(|| panic!("{text}"));
    assert!(moved.count == 1 && (1.0..500.0).contains(&moved.worst_ms), "{moved:?}");
    let frame = row(LatencyStage::Frame).unwrap();
    assert!(frame.count == 1 && frame.worst_ms <= 17.1, "{frame:?}");
    // No muscle, no armband, no page.
    for stage in
        [LatencyStage::Recognition, LatencyStage::Queue, LatencyStage::Render, LatencyStage::EndToEnd]
    {
        assert!(row(stage).is_none(), "{stage:?}");
    }
    let sums = std::fs::read_to_string(trial.join("SHA256SUMS")).unwrap();
    assert!(sums.contains("latency.json"), "the record vouches for it: {sums}");
}
