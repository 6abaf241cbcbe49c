//! A trial with a simulated participant, from its first tick to its record.

use crate::{
    Experimenter, Pace, Recorder, Rosbridge, TrackedShoulder,
    latency::StageClock,
    live::{TRACKING_EVERY, TrialInputs},
    person::give_feedback,
    tell,
};
use proact_bridge::{ClientInput, PageServer};
use proact_devices::FeedbackSinks;
use proact_testbed::{Session, Step, TrialEnd, TrialResult};
use std::{
    error::Error,
    path::Path,
    sync::atomic::{AtomicBool, Ordering},
    time::{Duration, Instant},
};

/// A trial that is shown waits so long for a page to draw it.
const PAGE_WAIT: Duration = Duration::from_secs(10);

/// Who watches a trial.
pub struct Audience<'a> {
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

/// Runs a simulated trial: flat out if nobody watches, in real time for the page, for clients of rosbridge and with a tracked
/// shoulder. Written to `recorder`, whose directory is `dir`; `on_step` sees each tick.
///
/// # Errors
/// A native library or the disk refuses.
pub fn run_to_end(
    mut session: Session,
    mut recorder: Option<Recorder>,
    audience: &mut Audience<'_>,
    dir: Option<&Path>,
    mut on_step: impl FnMut(&Step),
) -> Result<TrialResult, Box<dyn Error>> {
    let (page, interrupted) = (audience.page, audience.interrupted);
    if let (Some(dir), Some(shoulder)) = (dir, &audience.shoulder) {
        shoulder.calibrations().keep(dir)?;
    }
    let mut live = page.map(|page| (Pace::new(), Experimenter::new(page, session.testbed(), dir, None)));
    let real_time = audience.rosbridge.is_some() || audience.shoulder.is_some();
    let mut alone = (page.is_none() && real_time).then(Pace::new);
    let mut shown_tracking = Instant::now();
    let mut start = Instant::now();
    // Whoever conducts a study says when something is shown, and to whom.
    let mut awaited = page.filter(|_| audience.inputs.is_none());
    let ended = loop {
        let mut ending = interrupted.load(Ordering::Relaxed).then_some(TrialEnd::Interrupt);
        if let (Some((pace, experimenter)), Some(page)) = (&mut live, page) {
            let mut by_page = page;
            let from: &mut dyn TrialInputs = match &mut audience.inputs {
                Some(inputs) => *inputs,
                None => &mut by_page,
            };
            let mut inputs = from.drain();
            inputs.extend(experimenter.wait_while_still(pace, None, from, interrupted));
            for input in inputs {
                if let ClientInput::Study(action) = input
                    && experimenter.act(action)
                {
                    ending = Some(TrialEnd::Abort);
                }
            }
        }
        if let Some(shoulder) = audience.shoulder.as_mut().filter(|_| session.testbed().frame_is_due()) {
            shoulder.drive(&mut session)?;
            if let Some(page) = page.filter(|_| shown_tracking.elapsed() >= TRACKING_EVERY) {
                shown_tracking = Instant::now();
                page.set_tracking(&[shoulder.report()]);
            }
        }
        let mut clock = StageClock::start();
        let step = match live {
            Some(_) => session.step_watched(ending.is_some(), &mut |stage| clock.done(stage))?,
            None => session.step(ending.is_some())?,
        };
        if let Some(recorder) = &mut recorder {
            recorder.write(&step, session.testbed().plant().state())?;
        }
        give_feedback(&mut audience.feedback, &step.output.cues);
        on_step(&step);
        if let Some(frame) = &step.frame {
            if let Some(page) = page {
                page.publish(frame);
            }
            if let Some(inputs) = &mut audience.inputs {
                inputs.shown(frame);
            }
            // The first instant is what a page draws first, and there it waits.
            if let Some(page) = awaited.take() {
                wait_for_picture(page, interrupted);
                start = Instant::now();
                if let Some((pace, _)) = &mut live {
                    *pace = Pace::new();
                }
            }
            if let Some(rosbridge) = &audience.rosbridge {
                rosbridge.publish(frame);
            }
        }
        if let Some((pace, experimenter)) = &mut live {
            experimenter.take(&step, &session, &clock);
            pace.tick();
        }
        if let Some(pace) = &mut alone {
            pace.tick();
        }
        match ending {
            Some(ended) => break ended,
            None if step.output.finished => break session.result().ended,
            None => {}
        }
    };
    if let (Some(dir), Some(shoulder)) = (dir, &mut audience.shoulder) {
        shoulder.keep_trunk(dir)?;
    }
    if let (Some(dir), Some((_, experimenter))) = (dir, &mut live) {
        experimenter.keep(dir)?;
    }
    finish(&session, recorder, dir, start, ended)
}

/// The result of a trial that began at `start` on the clock and was `ended`, which closes its record in `dir`.
///
/// # Errors
/// The disk refuses.
pub(crate) fn finish(
    session: &Session,
    recorder: Option<Recorder>,
    dir: Option<&Path>,
    start: Instant,
    ended: TrialEnd,
) -> Result<TrialResult, Box<dyn Error>> {
    let mut result = TrialResult { ended, ..session.result() };
    result.wall_seconds = start.elapsed().as_secs_f64();
    result.real_time_factor = result.sim_seconds / result.wall_seconds.max(1e-9);
    result.trial_dir = dir.map(|d| d.display().to_string());
    if let Some(recorder) = recorder {
        recorder.finish(&result)?;
    }
    Ok(result)
}

/// Tells whoever watches standard error what is wrong with a trial that is over.
pub fn tell_faults(result: &TrialResult) {
    result.trial_faults.iter().for_each(|fault| tell(format_args!("fault of the trial: {}", fault.reason)));
}

/// Gives a browser a moment to come and to draw, so that it misses nothing of the trial.
fn wait_for_picture(page: &PageServer, interrupted: &AtomicBool) {
    let start = Instant::now();
    let waits = || start.elapsed() < PAGE_WAIT && !interrupted.load(Ordering::Relaxed);
    while !page.has_drawn() && waits() {
        std::thread::sleep(Duration::from_millis(20));
    }
}
