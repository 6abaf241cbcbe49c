use crate::{BenchFigure, BenchReport, quantile};
use proact_app::{RealTimePacer, trial};
use proact_control::MethodRegistry;
use proact_devices::EmgOrigin;
use proact_testbed::{
    Setup, TrialConfig,
    ports::{Plant, PlantError},
};
use proact_types::{
    BodyState, Command, GazeSample, Heartbeat, HeartbeatKind, InputSource, PlantCommand, PlantState, SimTime,
    TickInput,
};
use std::{
    error::Error,
    sync::{Arc, Mutex},
    time::Instant,
};

/// What the wearer does, 600 ms each: every gesture, with rest between them.
const GESTURES: [Command; 8] = [
    Command::WristExtension,
    Command::NoMotion,
    Command::HandOpen,
    Command::NoMotion,
    Command::WristFlexion,
    Command::NoMotion,
    Command::HandClose,
    Command::NoMotion,
];
const GESTURE_TICKS: u64 = 600;
/// Gaze at 60 Hz, as headsets give it; the shoulder at 100 Hz.
const GAZE_TICKS: u64 = 16;
const TRACKING_TICKS: u64 = 10;

/// From the packet that completes a window to the joint target, live: paced by the clock, plans in their own thread,
/// physics between the ticks. `ticks` of 1 ms for each method.
///
/// # Errors
/// A trial that cannot be put together.
pub(crate) fn chain(ticks: u64) -> Result<BenchReport, Box<dyn Error>> {
    let mut figures = Vec::new();
    let mut all = Vec::new();
    for method in MethodRegistry::standard().names() {
        let times = measure(method, ticks)?;
        for (name, share) in [("median", 0.5), ("99 %", 0.99), ("worst", 1.0)] {
            let name = format!("method {method}, packet to joint target, {name}");
            figures.push(BenchFigure::without_peer(&name, quantile(&times, share), "us", ""));
        }
        all.extend(times);
    }
    let note = format!("goal: under 1000; {} windows of four methods", all.len());
    figures.insert(
        0,
        BenchFigure::without_peer("packet to joint target, 99 %", quantile(&all, 0.99), "us", &note),
    );
    Ok(BenchReport::new("chain", figures))
}

/// Microseconds from the last sample of each window to the target that the plant is handed.
fn measure(method: &str, ticks: u64) -> Result<Vec<f64>, Box<dyn Error>> {
    let config = TrialConfig::new(method, 1, Setup::named("still")?);
    let handed = LastTargetTime::default();
    let noted = handed.clone();
    let (mut testbed, mut feed) = trial::live_testbed(config, &EmgOrigin::Synthetic, |plant| {
        Box::new(TimestampingPlant { plant, last_target_time: noted })
    })?;
    let body = testbed.config().setup.body;
    let (eye, shoulder) = (body.eye_m, body.shoulder_pose(&Default::default()));
    let mut pace = RealTimePacer::new();
    let mut times = Vec::new();
    for tick in 1..=ticks {
        pace.wait_for_tick();
        let now = SimTime(tick);
        let command = GESTURES[(tick / GESTURE_TICKS) as usize % GESTURES.len()];
        let blocks = &testbed.plant().state().objects;
        let fixation_point =
            blocks[(tick / (4 * GESTURE_TICKS)) as usize % blocks.len()].pose.translation.vector;
        let gaze = GazeSample { origin: eye, direction: fixation_point - eye.coords, valid: true };
        let input = TickInput {
            emg: feed.sample_at(now, command),
            gaze: tick.is_multiple_of(GAZE_TICKS).then_some(gaze),
            shoulder: tick.is_multiple_of(TRACKING_TICKS).then_some(shoulder),
            // The ray is that of a pointer, which may rest.
            heartbeats: [Heartbeat { source: InputSource::Page, kind: HeartbeatKind::PointingDevice }]
                .into_iter()
                .collect(),
            ..TickInput::default()
        };
        let begin = Instant::now();
        let output = testbed.tick(&input, false)?;
        let target = handed.0.lock().map_err(|_| "the plant failed")?.take();
        if let (Some(_), Some(target)) = (output.emg.filter(|decision| decision.published), target) {
            times.push(target.duration_since(begin).as_secs_f64() * 1e6);
        }
        if output.finished {
            break;
        }
    }
    Ok(times)
}

/// When the plant was last handed a target.
#[derive(Clone, Debug, Default)]
struct LastTargetTime(Arc<Mutex<Option<Instant>>>);

/// A plant that notes when a target arrives.
struct TimestampingPlant {
    plant: Box<dyn Plant>,
    last_target_time: LastTargetTime,
}

impl Plant for TimestampingPlant {
    fn step(&mut self, command: &PlantCommand) -> Result<(), PlantError> {
        if let Ok(mut handed) = self.last_target_time.0.lock() {
            *handed = Some(Instant::now());
        }
        self.plant.step(command)
    }

    fn state(&self) -> &PlantState {
        self.plant.state()
    }

    fn attach(&mut self, block: usize, link: usize) -> Result<(), PlantError> {
        self.plant.attach(block, link)
    }

    fn release(&mut self) {
        self.plant.release();
    }

    fn place(&mut self, block: usize, body: &BodyState) -> Result<(), PlantError> {
        self.plant.place(block, body)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_window_of_every_method_is_timed() {
        let report = chain(400).unwrap();
        assert_eq!(report.figures.len(), 13);
        assert!(report.figures.iter().all(|figure| figure.value > 0.0), "{report}");
        // A window of 100 ms, then one every 50 ms.
        assert!(report.figures[0].note.contains(&format!("{} windows", 4 * 7)), "{}", report.figures[0].note);
    }
}
