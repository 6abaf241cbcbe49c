//! A recorded trial as it was displayed, to be scrubbed and compared on a page.

use crate::{
    film_of_emg::FilmOfEmg,
    page_content,
    replay::{Opened, ReplayOptions, never_begun, open_trial},
};
use proact_bridge::RecordedTrial;
use proact_control::MethodRegistry;
use proact_recording::Trial;
use proact_testbed::{SpanDigest, Testbed, first_divergence};
use proact_types::{DisplayFrame, Event, Pose, SimTime};
use std::{error::Error, path::Path};

/// Of the 60 frames of a second every second one is kept: the page interpolates between them.
pub(crate) const KEPT: u64 = 2;

/// A trial as it was displayed, from its configuration and input log.
pub fn recompute(methods: &MethodRegistry, dir: &Path) -> Result<RecordedTrial, Box<dyn Error>> {
    if never_begun(&Trial::open(dir)?) {
        return Err(format!(
            "{} was interrupted before its first digest: there is nothing to show",
            dir.display()
        )
        .into());
    }
    let Opened { record, config, arm, mut testbed, recorded, result, .. } =
        open_trial(dir, &ReplayOptions { methods: methods.clone(), ..ReplayOptions::default() })?;
    let last = record.end();
    let body = config.setup.body;
    let upright = Default::default();
    // The head sits on the trunk as the shoulder does.
    let shoulder_from_head = body.shoulder_pose(&upright).inv_mul(&body.head_pose(&upright));
    let mut muscles = config.emg.as_ref().map(|emg| FilmOfEmg::new(emg, testbed.emg_gestures(), last));
    let mut film = Film { frames: Vec::new(), events: Vec::new(), count: 0 };
    let mut spans: Vec<SpanDigest> = Vec::new();
    for tick in record.ticks()? {
        let (now, input) = tick?;
        let output = testbed.tick(&input, now == last)?;
        if let Some(muscles) = &mut muscles {
            muscles.take(now, &input.emg, output.emg.as_deref());
        }
        spans.extend(output.span);
        if testbed.frame_is_due() || now == last {
            film.take(&mut testbed, &shoulder_from_head, now == last)?;
        }
    }
    Ok(RecordedTrial {
        name: dir.file_name().unwrap_or(dir.as_os_str()).to_string_lossy().into_owned(),
        method: config.method_label(),
        setup: config.setup.name.clone(),
        seed: Some(config.seed),
        seconds: SimTime(last.0).as_secs(),
        score: testbed.task().state().score,
        content: page_content(&testbed, &arm),
        agrees: Some(first_divergence(&recorded, &spans).is_none()),
        finished: result.is_some(),
        frames: film.frames,
        emg: muscles.map(FilmOfEmg::finish),
    })
}

/// The frames that are kept.
struct Film {
    frames: Vec<DisplayFrame>,
    /// Of frames that were left out.
    events: Vec<Event>,
    count: u64,
}

impl Film {
    fn take(
        &mut self,
        testbed: &mut Testbed,
        shoulder_from_head: &Pose,
        last: bool,
    ) -> Result<(), Box<dyn Error>> {
        let head = testbed.plant().state().world_from_base * shoulder_from_head;
        let mut frame = testbed.frame(head)?;
        self.events.append(&mut frame.events);
        self.count += 1;
        if self.count % KEPT == 1 || last {
            frame.events = std::mem::take(&mut self.events);
            self.frames.push(frame);
        }
        Ok(())
    }
}
