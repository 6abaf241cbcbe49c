//! A trial with a simulated participant, from its first tick to its record.

use crate::{
    RealTimePacer, Recorder, Rosbridge, StatusPublisher, TrackedShoulder,
    latency::StageTimer,
    live::{TRACKING_REPORT_PERIOD, TrialInputs},
    print_status,
    user_devices::send_feedback,
};
use proact_bridge::{ClientInput, PageServer};
use proact_devices::FeedbackSinks;
use proact_testbed::{RunningTrial, Testbed, TrialEnd, TrialResult, TrialStep};
use std::{
    error::Error,
    path::Path,
    sync::atomic::{AtomicBool, Ordering},
    time::{Duration, Instant},
};

/// A trial that is shown waits so long for a page to draw it.
const FIRST_PICTURE_TIMEOUT: Duration = Duration::from_secs(10);

/// Who watches a trial.
pub struct RunOutputs<'a> {
    /// The page, if there is one.
    pub page: Option<&'a PageServer>,
    /// What is asked for meanwhile, if not by the page alone.
    pub inputs: Option<&'a mut dyn TrialInputs>,
    /// Clients of rosbridge, if they are served.
    pub rosbridge: Option<Rosbridge>,
    /// A shoulder that motion capture sees, in the place of the participant's own.
    pub shoulder: Option<TrackedShoulder>,
    /// What is heard or felt.
    pub feedback: FeedbackSinks,
    /// Raised by Ctrl-C or a request to end: the trial then ends with its next tick, and its record is closed.
    pub interrupted: &'a AtomicBool,
}

impl<'a> RunOutputs<'a> {
    /// No outputs: the trial runs as fast as it can.
    pub fn none(interrupted: &'a AtomicBool) -> Self {
        Self {
            page: None,
            inputs: None,
            rosbridge: None,
            shoulder: None,
            feedback: FeedbackSinks::default(),
            interrupted,
        }
    }
}

/// Runs a simulated trial: flat out if nobody watches, in real time for the page, for clients of rosbridge and with a tracked
/// shoulder. Written to `recorder`, whose directory is `dir`; `on_step` sees each tick.
///
/// # Errors
/// A native library or the disk refuses.
pub fn run_to_end(
    mut trial: RunningTrial,
    mut recorder: Option<Recorder>,
    outputs: &mut RunOutputs<'_>,
    dir: Option<&Path>,
    mut on_step: impl FnMut(&TrialStep, &Testbed),
) -> Result<TrialResult, Box<dyn Error>> {
    let (page, interrupted) = (outputs.page, outputs.interrupted);
    if let (Some(dir), Some(shoulder)) = (dir, &outputs.shoulder) {
        shoulder.calibrations().save_to_record(dir)?;
    }
    let mut live =
        page.map(|page| (RealTimePacer::new(), StatusPublisher::new(page, trial.testbed(), dir, None)));
    let real_time = outputs.rosbridge.is_some() || outputs.shoulder.is_some();
    let mut alone = (page.is_none() && real_time).then(RealTimePacer::new);
    let mut shown_tracking = Instant::now();
    let mut start = Instant::now();
    // Whoever conducts a study says when something is shown, and to whom.
    let mut awaited = page.filter(|_| outputs.inputs.is_none());
    let ended = loop {
        let mut ending = interrupted.load(Ordering::Relaxed).then_some(TrialEnd::Interrupt);
        if let (Some((pace, experimenter)), Some(page)) = (&mut live, page) {
            let mut by_page = page;
            let from: &mut dyn TrialInputs = match &mut outputs.inputs {
                Some(inputs) => *inputs,
                None => &mut by_page,
            };
            let mut inputs = from.drain();
            inputs.extend(experimenter.wait_while_paused(pace, None, from, interrupted));
            for input in inputs {
                if let ClientInput::Study(action) = input
                    && experimenter.apply_action(action)
                {
                    ending = Some(TrialEnd::Abort);
                }
            }
        }
        if let Some(shoulder) = outputs.shoulder.as_mut().filter(|_| trial.testbed().frame_is_due()) {
            shoulder.apply_to(&mut trial)?;
            if let Some(page) = page.filter(|_| shown_tracking.elapsed() >= TRACKING_REPORT_PERIOD) {
                shown_tracking = Instant::now();
                page.set_tracking(&[shoulder.report()]);
            }
        }
        let mut clock = StageTimer::start();
        let step = match live {
            Some(_) => {
                trial.step_with_stage_timing(ending.is_some(), &mut |stage| clock.stage_ended(stage))?
            }
            None => trial.step(ending.is_some())?,
        };
        if let Some(recorder) = &mut recorder {
            recorder.write(&step, trial.testbed().plant().state())?;
        }
        send_feedback(&mut outputs.feedback, &step.output.cues);
        on_step(&step, trial.testbed());
        if let Some(frame) = &step.frame {
            if let Some(page) = page {
                page.publish(frame);
            }
            if let Some(inputs) = &mut outputs.inputs {
                inputs.frame_shown(frame);
            }
            // The first instant is what a page draws first, and there it waits.
            if let Some(page) = awaited.take() {
                wait_for_first_picture(page, interrupted);
                start = Instant::now();
                if let Some((pace, _)) = &mut live {
                    *pace = RealTimePacer::new();
                }
            }
            if let Some(rosbridge) = &outputs.rosbridge {
                rosbridge.publish(frame);
            }
        }
        if let Some((pace, experimenter)) = &mut live {
            experimenter.record_tick(&step, &trial, &clock);
            pace.wait_for_tick();
        }
        if let Some(pace) = &mut alone {
            pace.wait_for_tick();
        }
        match ending {
            Some(ended) => break ended,
            None if step.output.finished => break trial.result().ended,
            None => {}
        }
    };
    if let (Some(dir), Some(shoulder)) = (dir, &mut outputs.shoulder) {
        shoulder.save_trunk(dir)?;
    }
    if let (Some(dir), Some((_, experimenter))) = (dir, &mut live) {
        experimenter.save(dir)?;
    }
    finish_trial(&trial, recorder, dir, start, ended)
}

/// The result of a trial that began at `start` on the clock and was `ended`, which closes its record in `dir`.
///
/// # Errors
/// The disk refuses.
pub(crate) fn finish_trial(
    trial: &RunningTrial,
    recorder: Option<Recorder>,
    dir: Option<&Path>,
    start: Instant,
    ended: TrialEnd,
) -> Result<TrialResult, Box<dyn Error>> {
    let mut result = TrialResult { ended, ..trial.result() };
    result.wall_seconds = start.elapsed().as_secs_f64();
    result.real_time_factor = result.sim_seconds / result.wall_seconds.max(1e-9);
    result.trial_dir = dir.map(|d| d.display().to_string());
    if let Some(recorder) = recorder {
        recorder.finish(&result)?;
    }
    Ok(result)
}

/// Tells whoever watches standard error what is wrong with a trial that is over.
pub fn print_faults(result: &TrialResult) {
    result
        .trial_faults
        .iter()
        .for_each(|fault| print_status(format_args!("fault of the trial: {}", fault.reason)));
}

/// Gives a browser a moment to come and to draw, so that it misses nothing of the trial.
fn wait_for_first_picture(page: &PageServer, interrupted: &AtomicBool) {
    let start = Instant::now();
    let waits = || start.elapsed() < FIRST_PICTURE_TIMEOUT && !interrupted.load(Ordering::Relaxed);
    while !page.has_drawn() && waits() {
        std::thread::sleep(Duration::from_millis(20));
    }
}
