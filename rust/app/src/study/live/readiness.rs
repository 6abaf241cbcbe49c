//! What is ready before a trial, each with its age and a verdict, instead of waits.

use super::{LiveStudy, training::TrainingOutcome};
use proact_study::{PlannedStep, ProtocolStep, ReadinessCheck, SessionItem};
use std::{
    path::Path,
    time::{Duration, Instant},
};

/// A calibrated gaze may be off by so much, degrees: the usual limit for eye trackers in headsets.
const MAX_GAZE_ERROR_DEG: f64 = 2.0;
/// What should send all the time and did not for so long is silent.
const SILENCE_TIMEOUT: Duration = Duration::from_secs(1);
/// A trial of five minutes takes about 60 MB; with less than this the disk is as good as full.
const MIN_FREE_BYTES: u64 = 1 << 30;

/// When devices were heard last.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct DeviceLiveness {
    gaze: Option<Instant>,
    limb: Option<Instant>,
    /// Samples of the armband so far, and when they were more than before.
    samples: u64,
    emg_at: Option<Instant>,
}

fn readiness_check(name: &str, ready: bool, found: String, since: Option<Instant>) -> ReadinessCheck {
    ReadinessCheck {
        name: name.to_owned(),
        ready,
        detail: found,
        age_secs: since.map(|at| at.elapsed().as_secs_f64().round()),
    }
}

impl LiveStudy<'_> {
    /// What is ready for the next trial, and what is not.
    pub(super) fn checks(&mut self) -> Vec<ReadinessCheck> {
        let mut checks = vec![self.page()];
        checks.push(self.gestures());
        checks.extend(self.armband_alive());
        checks.extend(self.gaze());
        checks.extend(self.trackers());
        checks.push(disk(&self.state.conductor.study.folder));
        checks.push(self.clock());
        checks
    }

    fn page(&self) -> ReadinessCheck {
        match self.state.page.client_count() {
            0 => readiness_check("pages", false, "no page is open".to_owned(), None),
            1 => readiness_check("pages", true, "1 page is open".to_owned(), None),
            pages => readiness_check("pages", true, format!("{pages} pages are open"), None),
        }
    }

    fn gestures(&self) -> ReadinessCheck {
        let keys = self.equipment.source.is_none();
        match &self.training {
            _ if !keys && self.equipment.armband.is_none() => {
                readiness_check("gestures", false, "not trained yet".to_owned(), None)
            }
            Some(TrainingOutcome { at, accuracy, passed, model: _ }) => {
                let accuracy = accuracy.map(|share| format!("{:.1} % of windows recognised", 100.0 * share));
                let passed_text = match passed {
                    Some(true) => Some("the test is passed".to_owned()),
                    Some(false) => Some("the test is not passed".to_owned()),
                    None => None,
                };
                let found: Vec<String> = accuracy.into_iter().chain(passed_text).collect();
                let found = if found.is_empty() { "trained".to_owned() } else { found.join(", ") };
                readiness_check("gestures", passed.unwrap_or(true), found, Some(*at))
            }
            None if keys => readiness_check("gestures", true, "keys of the page".to_owned(), None),
            None => {
                let planned = self.session_includes(|step| matches!(step, ProtocolStep::Train { .. }));
                let found = "a model of an earlier training";
                readiness_check("gestures", !planned, found.to_owned(), None)
            }
        }
    }

    /// Whether the session under way plans such a step.
    fn session_includes(&self, wanted: impl Fn(&ProtocolStep) -> bool) -> bool {
        let Some(under) = &self.state.active_session else { return false };
        let session = self.state.conductor.progress().session(under.participant, &under.session);
        session.is_some_and(|session| {
            session
                .items
                .iter()
                .any(|step| matches!(step, SessionItem::Step(PlannedStep { step, .. }) if wanted(step)))
        })
    }

    fn armband_alive(&mut self) -> Option<ReadinessCheck> {
        let armband = self.equipment.armband.as_ref()?;
        let samples = armband.received();
        if samples > self.device_liveness.samples {
            (self.device_liveness.samples, self.device_liveness.emg_at) = (samples, Some(Instant::now()));
        }
        Some(liveness_check("armband", self.device_liveness.emg_at))
    }

    fn gaze(&self) -> Option<ReadinessCheck> {
        let name = "gaze";
        match self.state.gaze_check {
            Some(gaze) => {
                let error = gaze
                    .error_deg
                    .map_or("no valid gaze".to_owned(), |error| format!("{error:.1} degrees off"));
                let found = if gaze.calibrated { format!("calibrated, {error} before") } else { error };
                let ready =
                    gaze.calibrated || gaze.error_deg.is_some_and(|error| error <= MAX_GAZE_ERROR_DEG);
                Some(readiness_check(name, ready, found, Some(gaze.at)))
            }
            None if self.session_includes(|step| matches!(step, ProtocolStep::CalibrateGaze { .. })) => {
                Some(readiness_check(name, false, "not calibrated in this sitting".to_owned(), None))
            }
            None => None,
        }
    }

    /// Whether a method of the plan uses gaze. One that the registry does not have may do so.
    fn uses_gaze(&self) -> bool {
        let plan = &self.state.conductor.study.plan;
        (0..plan.conditions.len()).any(|condition| {
            let method = plan.trial_options(condition).method;
            let entry = method.as_deref().map(|name| self.registry.methods.get(name));
            !matches!(entry, Some(Ok(entry)) if !entry.needs().gaze)
        })
    }

    fn trackers(&mut self) -> Vec<ReadinessCheck> {
        let uses_gaze = self.uses_gaze();
        let Some(person) = &mut self.equipment.user_devices else { return Vec::new() };
        let [gaze, limb] = person.poll_between_trials();
        let mut checks = Vec::new();
        for (name, sent, received_at) in [
            ("eye tracker", gaze, &mut self.device_liveness.gaze),
            ("limb", limb, &mut self.device_liveness.limb),
        ] {
            let Some(sent) = sent else { continue };
            if sent {
                *received_at = Some(Instant::now());
            }
            let alive = liveness_check(name, *received_at);
            checks.push(if name == "eye tracker" && !uses_gaze && !alive.ready {
                readiness_check(name, true, "sends nothing; no method of the plan uses it".to_owned(), None)
            } else {
                alive
            });
        }
        if let Some((ready, found)) = person.shoulder_status() {
            checks.push(readiness_check("shoulder", ready, found, None));
        }
        checks
    }

    fn clock(&self) -> ReadinessCheck {
        let behind = self.state.conductor.clock_behind_secs();
        let now = jiff::Zoned::now().strftime("%Y-%m-%d %H:%M").to_string();
        match behind {
            Some(secs) => {
                readiness_check("clock", false, format!("{now}, {secs:.0} s behind the last event"), None)
            }
            None => readiness_check("clock", true, now, None),
        }
    }
}

/// Whether something that should send all the time does.
fn liveness_check(name: &str, received_at: Option<Instant>) -> ReadinessCheck {
    match received_at {
        Some(at) if at.elapsed() < SILENCE_TIMEOUT => {
            readiness_check(name, true, "sends".to_owned(), Some(at))
        }
        Some(at) => readiness_check(name, false, "silent".to_owned(), Some(at)),
        None => readiness_check(name, false, "has sent nothing yet".to_owned(), None),
    }
}

fn disk(folder: &Path) -> ReadinessCheck {
    match nix::sys::statvfs::statvfs(folder) {
        Ok(disk) => {
            let free = disk.blocks_available() * disk.fragment_size();
            let found = format!("{:.1} GB free", free as f64 * 1e-9);
            readiness_check("disk", free >= MIN_FREE_BYTES, found, None)
        }
        Err(error) => readiness_check("disk", false, error.to_string(), None),
    }
}
