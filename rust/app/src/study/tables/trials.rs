//! What the records of the trials that count say.

use super::{Counted, Told, columns};
use crate::read_trunk;
use proact_analysis::{
    measures::{GazeMeasure, ShoulderMeasure},
    table::{Cell, Table, word},
};
use proact_bridge::ResultLine;
use proact_emg::{Light, QualityConfig, QualityMonitor};
use proact_recording::{Trial, read_result};
use proact_testbed::{TrialConfig, TrialResult};
use proact_types::{Event, EventKind, ObjectId, Pose, Scene, SimTime};
use std::error::Error;

/// Millimetres in a metre.
const MM: f64 = 1e3;

/// The tables of trials, with those of raw samples if asked for. A record that cannot be read is an error, or left out and named in
/// `unread`.
pub(super) fn tables(
    told: &Told<'_>,
    raw: bool,
    mut unread: Option<&mut Vec<String>>,
) -> Result<Vec<Table>, Box<dyn Error>> {
    let mut tables = TrialTables {
        trials: Table::new("trials", "a trial of the plan that counts", columns::TRIALS),
        blocks: Table::new("blocks", "an object in a trial", columns::BLOCKS),
        actions: Table::new("actions", "something that person, method or hand did", columns::ACTIONS),
        gaze: Table::new("gaze", "a phase of a trial: with an empty hand, or holding", columns::GAZE),
        compensation: Table::new("compensation", "a trial", columns::COMPENSATION),
        emg: Table::new("emg_quality", "a channel of the armband in a trial", columns::EMG_QUALITY),
        raw_gaze: Table::new("raw_gaze", "a sample of the gaze", columns::RAW_GAZE),
        raw_shoulder: Table::new("raw_shoulder", "a pose of the shoulder", columns::RAW_SHOULDER),
    };
    for counted in told.counted() {
        let dir = told.study.folder.join(&counted.record);
        if let Err(error) = tables.take(told, &counted, raw) {
            let named = format!("{}: {error}", dir.display());
            match &mut unread {
                Some(unread) => unread.push(named),
                None => return Err(named.into()),
            }
        }
    }
    let TrialTables { trials, blocks, actions, gaze, compensation, emg, raw_gaze, raw_shoulder } = tables;
    let mut all = vec![trials, blocks, actions, gaze, compensation, emg];
    if raw {
        all.extend([raw_gaze, raw_shoulder]);
    }
    Ok(all)
}

struct TrialTables {
    trials: Table,
    blocks: Table,
    actions: Table,
    gaze: Table,
    compensation: Table,
    emg: Table,
    raw_gaze: Table,
    raw_shoulder: Table,
}

impl TrialTables {
    fn take(&mut self, told: &Told<'_>, counted: &Counted<'_>, raw: bool) -> Result<(), Box<dyn Error>> {
        let dir = told.study.folder.join(&counted.record);
        let record = Trial::open(&dir)?;
        let result: TrialResult = read_result(&dir)?;
        let config = TrialConfig::from_toml(&record.header().config_toml)?;
        let key = told.trial_key(counted.planned);
        self.trial(told, counted, &result);
        if result.failure().is_none() {
            self.blocks.rows.extend(block_rows(&key, &result.beside, &result.result));
        }
        let events = record.events()?;
        let arm = crate::Arm::recorded(&dir, &config)?;
        let task = config.build_task(arm.model())?;
        self.actions(&key, &events, task.scene());
        self.inputs(&key, &record, &config, &events, &read_trunk(&dir)?, raw)
    }

    fn trial(&mut self, told: &Told<'_>, counted: &Counted<'_>, result: &TrialResult) {
        let planned = counted.planned;
        let departures = told.departures(std::iter::once(&counted.spot));
        let mut row = told.trial_key(planned);
        row.extend([
            planned.position.into(),
            planned.arrangement.clone().into(),
            // Whole numbers of SQLite end at 2^63, and those of many other programs before.
            planned.seed.to_string().into(),
            result.method.as_str().into(),
            result.task.as_str().into(),
            result.arm.as_str().into(),
            result.setup.as_str().into(),
            serde_json::to_value(result.ended)
                .ok()
                .and_then(|ended| ended.as_str().map(str::to_owned))
                .into(),
            counted.attempt.into(),
            if departures.is_empty() { Cell::Missing } else { "*".into() },
            departures.into(),
            result.counted_score().into(),
            result.score_name.as_str().into(),
            result.sim_seconds.into(),
            result.gesture_source.as_str().into(),
            result.unsolved_ticks.into(),
            counted.record.as_str().into(),
            result.digest.as_str().into(),
            told.look.simulated.into(),
        ]);
        self.trials.push(row);
    }

    fn actions(&mut self, key: &[Cell], events: &[Event], scene: &Scene) {
        let name = |id: ObjectId| scene.objects.get(id.index()).map(|object| object.name.clone());
        for event in events {
            let (object, detail): (Option<String>, String) = match &event.kind {
                EventKind::GestureChanged { gesture } => (None, gesture.to_string()),
                EventKind::GraspMade { object, .. } | EventKind::GraspEnded { object, .. } => {
                    (name(*object), String::new())
                }
                EventKind::GraspFailed { object, reason } => (object.and_then(name), word(reason)),
                EventKind::Locked { object } => (object.and_then(name), String::new()),
                EventKind::PlanFinished { status, reason, .. } => {
                    let why = reason.as_ref().map_or(String::new(), |reason| format!(": {reason}"));
                    (None, word(status) + &why)
                }
                EventKind::PlansFailed { count, reason } => (None, format!("{count} in a row: {reason}")),
                EventKind::MethodNote { text } => (None, text.clone()),
                EventKind::Stopped { reason, .. } => (None, reason.clone()),
                EventKind::Unlocked
                | EventKind::PlanRequested { .. }
                | EventKind::Rearmed
                | EventKind::MotionStopped
                | EventKind::MotionFinished => (None, String::new()),
                _ => continue,
            };
            let mut row = key.to_vec();
            row.extend([
                secs(event.time).into(),
                kind_of(event).into(),
                object.into(),
                if detail.is_empty() { Cell::Missing } else { detail.into() },
            ]);
            self.actions.push(row);
        }
    }

    /// What entered the trial from outside: eyes, shoulder, muscles.
    fn inputs(
        &mut self,
        key: &[Cell],
        record: &Trial,
        config: &TrialConfig,
        events: &[Event],
        trunk_poses: &[(SimTime, Pose)],
        raw: bool,
    ) -> Result<(), Box<dyn Error>> {
        let mut phases = Phases::new(events);
        let mut shoulder = ShoulderMeasure::default();
        let mut emg = config.emg.as_ref().map(|emg| EmgTally::new(emg.rate_hz, emg.channels));
        for input in record.inputs()? {
            let input = input?;
            let (time, input) = (input.tick, input.input);
            if let Some(gaze) = &input.gaze {
                phases.push(time, gaze);
                if raw {
                    let values = gaze.origin.iter().chain(gaze.direction.iter()).map(|v| Cell::from(*v));
                    let row = key.iter().cloned().chain([secs(time).into()]).chain(values);
                    self.raw_gaze.push(row.chain([gaze.valid.into()]).collect());
                }
            }
            if let Some(pose) = &input.shoulder {
                shoulder.push(pose);
                if raw {
                    let values = pose.translation.vector.iter().chain(pose.rotation.coords.iter());
                    let row = key.iter().cloned().chain([secs(time).into()]);
                    self.raw_shoulder.push(row.chain(values.map(|v| Cell::from(*v))).collect());
                }
            }
            if let Some(emg) = &mut emg {
                input.emg.iter().for_each(|sample| emg.push(time, sample));
            }
        }
        for (phase, seconds, gaze) in phases.finish(record.end()) {
            let share = |part: u64, whole: u64| (whole > 0).then(|| part as f64 / whole as f64);
            let mut row = key.to_vec();
            row.extend([
                phase.into(),
                seconds.into(),
                gaze.samples.into(),
                share(gaze.valid, gaze.samples).into(),
                gaze.path_deg.into(),
                gaze.fixations.into(),
                (gaze.fixations > 0).then(|| gaze.fixated_ms as f64 / gaze.fixations as f64).into(),
            ]);
            self.gaze.push(row);
        }
        let known = |value: f64| shoulder.is_known().then_some(value);
        let mut row = key.to_vec();
        row.extend([
            known(shoulder.path_m).into(),
            known(shoulder.range_m * MM).into(),
            known(shoulder.turn_deg).into(),
        ]);
        let mut trunk = ShoulderMeasure::default();
        trunk_poses.iter().for_each(|(_, pose)| trunk.push(pose));
        let known = |value: f64| trunk.is_known().then_some(value);
        row.extend([known(trunk.range_m * MM).into(), known(trunk.turn_deg).into()]);
        self.compensation.push(row);
        emg.into_iter().flat_map(|emg| emg.rows(key)).for_each(|row| self.emg.push(row));
        Ok(())
    }
}

/// What became of each object, from what the task put beside its result or into it.
pub(crate) fn block_rows(
    key: &[Cell],
    beside: &serde_json::Map<String, serde_json::Value>,
    result: &serde_json::Map<String, serde_json::Value>,
) -> Vec<Vec<Cell>> {
    let lines = beside.get("outcomes").or_else(|| result.get("outcomes"));
    let lines: Vec<ResultLine> =
        lines.and_then(|lines| serde_json::from_value(lines.clone()).ok()).unwrap_or_default();
    let row = |line: ResultLine| {
        let mut row = key.to_vec();
        row.extend([
            line.name.into(),
            line.outcome.into(),
            line.pick_s.into(),
            line.place_s.into(),
            line.error_m.map(|error| error * MM).into(),
        ]);
        row
    };
    lines.into_iter().map(row).collect()
}

fn secs(time: SimTime) -> f64 {
    // Divided, so that 18 ms are 0.018 and not a digit more.
    time.0 as f64 / 1e3
}

/// The event's name, as in `events.jsonl`.
fn kind_of(event: &Event) -> String {
    let value = serde_json::to_value(event).unwrap_or_default();
    let kind = value.get("event").and_then(|kind| kind.as_str());
    kind.unwrap_or_default().to_owned()
}

/// Gazes by what the hand does meanwhile.
struct Phases {
    /// When the hand begins and ends to hold something.
    turns: std::collections::VecDeque<(SimTime, bool)>,
    holding: bool,
    since: SimTime,
    /// With an empty hand, and holding: milliseconds, and gazes.
    spent: [(u64, GazeMeasure); 2],
}

impl Phases {
    fn new(events: &[Event]) -> Self {
        let turns = events.iter().filter_map(|event| match event.kind {
            EventKind::ObjectAttached { .. } => Some((event.time, true)),
            EventKind::ObjectReleased { .. } => Some((event.time, false)),
            _ => None,
        });
        Self { turns: turns.collect(), holding: false, since: SimTime(0), spent: Default::default() }
    }

    fn turn(&mut self, until: SimTime) {
        while let Some((time, holding)) = self.turns.front().copied().filter(|(time, _)| *time <= until) {
            self.turns.pop_front();
            self.spent[usize::from(self.holding)].0 += time.millis_since(self.since);
            (self.holding, self.since) = (holding, time);
        }
    }

    fn push(&mut self, time: SimTime, gaze: &proact_types::GazeSample) {
        self.turn(time);
        self.spent[usize::from(self.holding)].1.push(time, gaze);
    }

    fn finish(mut self, end: SimTime) -> [(&'static str, f64, GazeMeasure); 2] {
        self.turn(end);
        self.spent[usize::from(self.holding)].0 += end.millis_since(self.since);
        let [empty, holding] = self.spent;
        [("empty_hand", empty), ("holding", holding)]
            .map(|(name, (millis, gaze))| (name, millis as f64 * 1e-3, gaze.finish()))
    }
}

/// How good the armband's signals were, over a whole trial.
struct EmgTally {
    monitor: QualityMonitor,
    samples: u64,
    verdicts: u64,
    channels: Vec<ChannelTally>,
    lost_sum: f64,
}

#[derive(Clone, Default)]
struct ChannelTally {
    sd_sum: f64,
    mains_sum: f64,
    red: u64,
    amber: u64,
}

impl EmgTally {
    fn new(rate_hz: f64, channels: usize) -> Self {
        let monitor = QualityMonitor::new(QualityConfig::default(), rate_hz, channels, &[]);
        let channels = vec![ChannelTally::default(); monitor.channels().len()];
        Self { monitor, samples: 0, verdicts: 0, channels, lost_sum: 0.0 }
    }

    fn push(&mut self, time: SimTime, sample: &proact_types::EmgSample) {
        self.samples += 1;
        if !self.monitor.push(time, sample) {
            return;
        }
        self.verdicts += 1;
        self.lost_sum += self.monitor.stream().lost_share;
        for (tally, now) in self.channels.iter_mut().zip(self.monitor.channels()) {
            tally.sd_sum += now.sd;
            tally.mains_sum += now.mains_share;
            tally.red += u64::from(now.light == Light::Red);
            tally.amber += u64::from(now.light == Light::Amber);
        }
    }

    fn rows(self, key: &[Cell]) -> Vec<Vec<Cell>> {
        if self.samples == 0 {
            return Vec::new();
        }
        let (samples, verdicts, gaps) = (self.samples, self.verdicts, self.monitor.stream().gaps);
        let mean = |sum: f64| (verdicts > 0).then(|| sum / verdicts as f64);
        let lost = mean(self.lost_sum);
        let row = |(index, tally): (usize, &ChannelTally)| {
            let mut row = key.to_vec();
            row.extend([
                (index + 1).into(),
                samples.into(),
                gaps.into(),
                lost.into(),
                mean(tally.sd_sum).into(),
                mean(tally.mains_sum).into(),
                mean(tally.amber as f64).into(),
                mean(tally.red as f64).into(),
            ]);
            row
        };
        self.channels.iter().enumerate().map(row).collect()
    }
}
