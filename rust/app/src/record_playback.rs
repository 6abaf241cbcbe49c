//! A recorded trial as it was displayed, to be scrubbed and compared on a page.

use crate::{
    emg_playback::EmgPlayback,
    page_content,
    replay::{OpenedTrial, ReplayOptions, is_unstarted, open_trial},
};
use proact_bridge::RecordedTrial;
use proact_control::MethodRegistry;
use proact_recording::TrialRecord;
use proact_testbed::{SpanDigest, Testbed, first_divergence};
use proact_types::{DisplayFrame, Event, Pose, SimTime};
use std::{error::Error, path::Path};

/// Of the 60 frames of a second every second one is kept: the page interpolates between them.
pub(crate) const FRAME_STRIDE: u64 = 2;

/// A trial as it was displayed, from its configuration and input log.
pub fn recompute_playback(methods: &MethodRegistry, dir: &Path) -> Result<RecordedTrial, Box<dyn Error>> {
    if is_unstarted(&TrialRecord::open(dir)?) {
        return Err(format!(
            "{} was interrupted before its first digest: there is nothing to show",
            dir.display()
        )
        .into());
    }
    let OpenedTrial { record, config, arm, mut testbed, recorded_spans: recorded, result, .. } =
        open_trial(dir, &ReplayOptions { methods: methods.clone(), ..ReplayOptions::default() })?;
    let last = record.end();
    let body = config.setup.body;
    let upright = Default::default();
    // The head sits on the trunk as the shoulder does.
    let shoulder_from_head = body.shoulder_pose(&upright).inv_mul(&body.head_pose(&upright));
    let mut muscles = config.emg.as_ref().map(|emg| EmgPlayback::new(emg, testbed.emg_gestures(), last));
    let mut playback_frames = PlaybackFrames { frames: Vec::new(), events: Vec::new(), count: 0 };
    let mut spans: Vec<SpanDigest> = Vec::new();
    for tick in record.ticks()? {
        let (now, input) = tick?;
        let output = testbed.tick(&input, now == last)?;
        if let Some(muscles) = &mut muscles {
            muscles.push_tick(now, &input.emg, output.emg.as_deref());
        }
        spans.extend(output.span_digest);
        if testbed.frame_is_due() || now == last {
            playback_frames.push_frame(&mut testbed, &shoulder_from_head, now == last)?;
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
        digest_matches: Some(first_divergence(&recorded, &spans).is_none()),
        finished: result.is_some(),
        frames: playback_frames.frames,
        emg: muscles.map(EmgPlayback::finish),
    })
}

/// The frames that are kept.
struct PlaybackFrames {
    frames: Vec<DisplayFrame>,
    /// Of frames that were left out.
    events: Vec<Event>,
    count: u64,
}

impl PlaybackFrames {
    fn push_frame(
        &mut self,
        testbed: &mut Testbed,
        shoulder_from_head: &Pose,
        last: bool,
    ) -> Result<(), Box<dyn Error>> {
        let head = testbed.plant().state().world_from_base * shoulder_from_head;
        let mut frame = testbed.frame(head)?;
        self.events.append(&mut frame.events);
        self.count += 1;
        if self.count % FRAME_STRIDE == 1 || last {
            frame.events = std::mem::take(&mut self.events);
            self.frames.push(frame);
        }
        Ok(())
    }
}
