//! A trial with a simulated participant, from its first tick to its record.

use crate::{Experimenter, Feedback, Pace, Recorder, Rosbridge};
use proact_bridge::{ClientInput, PageServer};
use proact_testbed::{Session, TrialResult};
use proact_types::DisplayFrame;
use std::{
    error::Error,
    path::Path,
    sync::atomic::AtomicBool,
    time::{Duration, Instant},
};

/// A trial that is shown waits so long for its first page.
const PAGE_WAIT: Duration = Duration::from_secs(3);

/// Who watches a trial.
pub struct Audience<'a> {
    /// The page, if there is one.
    pub page: Option<&'a PageServer>,
    /// Clients of rosbridge, if they are served.
    pub rosbridge: Option<Rosbridge>,
    /// What is heard or felt.
    pub feedback: Feedback,
}

/// Runs a simulated trial: flat out if nobody watches, in real time for the page and for clients of rosbridge. Written to
/// `recorder`, whose directory is `dir`; `on_frame` sees each instant that is displayed.
///
/// # Errors
/// A native library or the disk refuses.
pub fn run_to_end(
    mut session: Session,
    mut recorder: Option<Recorder>,
    audience: &mut Audience<'_>,
    dir: Option<&Path>,
    mut on_frame: impl FnMut(&DisplayFrame),
) -> Result<TrialResult, Box<dyn Error>> {
    let page = audience.page;
    if let Some(page) = page {
        wait_for_page(page);
    }
    let mut live = page.map(|page| {
        (Pace::new(), Experimenter::new(page, session.testbed().config(), dir, None), AtomicBool::new(false))
    });
    let mut alone = (page.is_none() && audience.rosbridge.is_some()).then(Pace::new);
    let start = Instant::now();
    loop {
        let mut last = false;
        if let (Some((pace, experimenter, interrupted)), Some(page)) = (&mut live, page) {
            let mut inputs = page.drain_inputs();
            inputs.extend(experimenter.wait_while_paused(pace, interrupted));
            for input in inputs {
                if let ClientInput::Study(action) = input {
                    last |= experimenter.act(action);
                }
            }
        }
        let began = Instant::now();
        let step = session.step(last)?;
        if let Some(recorder) = &mut recorder {
            recorder.write(&step, session.testbed().plant().state())?;
        }
        audience.feedback.begin(&step.output.cues);
        if let Some(frame) = &step.frame {
            on_frame(frame);
            if let Some(page) = page {
                page.publish(frame);
            }
            if let Some(rosbridge) = &audience.rosbridge {
                rosbridge.publish(frame);
            }
        }
        if let Some((pace, experimenter, _)) = &mut live {
            experimenter.take(&step, began.elapsed());
            pace.tick();
        }
        if let Some(pace) = &mut alone {
            pace.tick();
        }
        if step.output.finished || last {
            break;
        }
    }
    finish(&session, recorder, dir, start)
}

/// The result of a trial that began at `start` on the clock, which closes its record in `dir`.
///
/// # Errors
/// The disk refuses.
pub(crate) fn finish(
    session: &Session,
    recorder: Option<Recorder>,
    dir: Option<&Path>,
    start: Instant,
) -> Result<TrialResult, Box<dyn Error>> {
    let mut result = session.result();
    result.wall_seconds = start.elapsed().as_secs_f64();
    result.real_time_factor = result.sim_seconds / result.wall_seconds.max(1e-9);
    result.trial_dir = dir.map(|d| d.display().to_string());
    if let Some(recorder) = recorder {
        recorder.finish(&result)?;
    }
    Ok(result)
}

/// Gives a browser a moment to come, so that it misses nothing of the trial.
fn wait_for_page(page: &PageServer) {
    let start = Instant::now();
    while page.client_count() == 0 && start.elapsed() < PAGE_WAIT {
        std::thread::sleep(Duration::from_millis(20));
    }
}
