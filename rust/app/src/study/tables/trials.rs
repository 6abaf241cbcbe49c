//! What the records of the trials that count say.

use super::{CountedTrial, StudyTables, columns, misplaced_record};
use crate::{
    analysis::append,
    record_keys::{is_fatal_for_analysis, with_path},
    replay::recorded_config,
};
use proact_analysis::{
    gaze_measure::GazeMeasure,
    table::{Table, TableCell, serialized_name},
};
use proact_emg::{ChannelStatus, QualityConfig, QualityMonitor};
use proact_recording::TrialRecord;
use proact_tasks::{ObjectResult, ResultError};
use proact_testbed::{TrialConfig, TrialResult};
use proact_types::{Event, EventKind, ObjectId, Scene, SimTime};
use std::error::Error;

/// Millimetres in a metre.
const MM_PER_M: f64 = 1e3;

/// The tables of trials, with those of raw samples if asked for. A record that cannot be read is an error, or left out and named in
/// `unread`.
pub(super) fn tables(
    study_tables: &StudyTables<'_>,
    raw: bool,
    mut unread: Option<&mut Vec<String>>,
) -> Result<Vec<Table>, Box<dyn Error>> {
    let mut tables = TrialTables {
        trials: Table::new("trials", "a trial of the plan that counts", columns::TRIALS),
        blocks: Table::new("blocks", "an object in a trial", columns::BLOCKS),
        actions: Table::new("actions", "something that person, method or hand did", columns::ACTIONS),
        gaze: Table::new("gaze", "a phase of a trial: with an empty hand, or holding", columns::GAZE),
        emg: Table::new("emg_quality", "a channel of the armband in a trial", columns::EMG_QUALITY),
        raw_gaze: Table::new("raw_gaze", "a sample of the gaze", columns::RAW_GAZE),
        raw_shoulder: Table::new("raw_shoulder", "a pose of the shoulder", columns::RAW_SHOULDER),
    };
    for counted in study_tables.counted_trials() {
        let dir = counted.dir(study_tables);
        if let Err(error) = tables.take(study_tables, &counted, raw) {
            let named = with_path(&dir, &error);
            match &mut unread {
                Some(unread) if !is_fatal_for_analysis(&*error) => unread.push(named),
                _ => return Err(named.into()),
            }
        }
    }
    let TrialTables { trials, blocks, actions, gaze, emg, raw_gaze, raw_shoulder } = tables;
    let mut all = vec![trials, blocks, actions, gaze, emg];
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
    emg: Table,
    raw_gaze: Table,
    raw_shoulder: Table,
}

impl TrialTables {
    fn take(
        &mut self,
        tables: &StudyTables<'_>,
        counted: &CountedTrial<'_>,
        raw: bool,
    ) -> Result<(), Box<dyn Error>> {
        let dir = counted.dir(tables);
        let (record, result) = misplaced_record::read_checked_record(counted, &dir)?;
        let config = recorded_config(&record)?;
        let key = tables.trial_key(counted.planned);
        self.trial(tables, counted, &result);
        append(&mut self.blocks, counted_block_rows(&key, &result)?);
        let events = record.events()?;
        let arm = crate::Arm::from_record(&dir, &config)?;
        let task = config.build_task(arm.model())?;
        self.actions(&key, &events, task.scene())?;
        self.inputs(&key, &record, &config, &events, raw)
    }

    fn trial(&mut self, tables: &StudyTables<'_>, counted: &CountedTrial<'_>, result: &TrialResult) {
        let planned = counted.planned;
        let departures = tables.deviation_labels(std::iter::once(&counted.step_id));
        let mut row = tables.trial_key(planned);
        row.extend([
            planned.position.into(),
            planned.arrangement.clone().into(),
            // Whole numbers of SQLite end at 2^63, and those of many other programs before.
            planned.seed.to_string().into(),
            result.method.as_str().into(),
            result.task.as_str().into(),
            result.arm.as_str().into(),
            result.setup.as_str().into(),
            serialized_name(&result.ended).into(),
            counted.attempt.into(),
            if departures.is_empty() { TableCell::Missing } else { "*".into() },
            departures.into(),
            result.counted_score().into(),
            result.score_name.as_str().into(),
            result.sim_seconds.into(),
            result.gesture_source.as_str().into(),
            result.unsolved_ticks.into(),
            counted.record.as_str().into(),
            result.digest.as_str().into(),
            tables.view.simulated.into(),
        ]);
        append(&mut self.trials, [row]);
    }

    fn actions(
        &mut self,
        key: &[TableCell],
        events: &[Event],
        scene: &Scene,
    ) -> Result<(), serde_json::Error> {
        let name = |id: ObjectId| scene.objects.get(id.index()).map(|object| object.name.clone());
        for event in events {
            let (object, detail): (Option<String>, String) = match &event.kind {
                EventKind::GestureChanged { gesture } => (None, gesture.to_string()),
                EventKind::GraspMade { object, .. } | EventKind::GraspEnded { object, .. } => {
                    (name(*object), String::new())
                }
                EventKind::GraspFailed { object, reason } => (object.and_then(name), serialized_name(reason)),
                EventKind::Locked { object } => (object.and_then(name), String::new()),
                EventKind::PlanFinished { status, reason, .. } => {
                    let why = reason.as_ref().map_or(String::new(), |reason| format!(": {reason}"));
                    (None, serialized_name(status) + &why)
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
                event_name(event)?.into(),
                object.into(),
                if detail.is_empty() { TableCell::Missing } else { detail.into() },
            ]);
            append(&mut self.actions, [row]);
        }
        Ok(())
    }

    /// What entered the trial from outside: eyes, shoulder, muscles.
    fn inputs(
        &mut self,
        key: &[TableCell],
        record: &TrialRecord,
        config: &TrialConfig,
        events: &[Event],
        raw: bool,
    ) -> Result<(), Box<dyn Error>> {
        let mut phases = GazeByHandState::new(events);
        let mut emg = config.emg.as_ref().map(|emg| EmgQualityTally::new(emg.rate_hz, emg.channels));
        for input in record.inputs()? {
            let input = input?;
            let (time, input) = (input.tick, input.input);
            if let Some(gaze) = &input.gaze {
                phases.push(time, gaze);
                if raw {
                    let values = gaze.origin.iter().chain(gaze.direction.iter()).map(|v| TableCell::from(*v));
                    let row = key.iter().cloned().chain([secs(time).into()]).chain(values);
                    append(&mut self.raw_gaze, [row.chain([gaze.valid.into()]).collect()]);
                }
            }
            if let Some(pose) = input.shoulder.as_ref().filter(|_| raw) {
                let values = pose.translation.vector.iter().chain(pose.rotation.coords.iter());
                let row = key.iter().cloned().chain([secs(time).into()]);
                append(&mut self.raw_shoulder, [row.chain(values.map(|v| TableCell::from(*v))).collect()]);
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
                (gaze.fixations > 0).then(|| gaze.fixation_ms as f64 / gaze.fixations as f64).into(),
            ]);
            append(&mut self.gaze, [row]);
        }
        append(&mut self.emg, emg.into_iter().flat_map(|emg| emg.rows(key)));
        Ok(())
    }
}

/// The blocks of a trial, for tasks that tell: none of one that failed. Of one that was broken off their names alone, since what
/// becomes of an object is known at the end.
///
/// # Errors
/// A key or an outcome that is unknown.
pub(crate) fn counted_block_rows(
    key: &[TableCell],
    result: &TrialResult,
) -> Result<Vec<Vec<TableCell>>, ResultError> {
    let mut rows = match result.failure() {
        Some(_) => Vec::new(),
        None => block_rows(key, &result.result)?,
    };
    if result.is_aborted() {
        rows.iter_mut().for_each(|row| row.truncate(key.len() + 1));
    }
    Ok(rows)
}

/// What became of each object, for tasks that tell.
///
/// # Errors
/// A key or an outcome that is unknown.
pub(crate) fn block_rows(
    key: &[TableCell],
    result: &serde_json::Map<String, serde_json::Value>,
) -> Result<Vec<Vec<TableCell>>, ResultError> {
    let row = |line: ObjectResult| {
        let mut row = key.to_vec();
        row.extend([
            line.block.into(),
            line.outcome.as_str().into(),
            line.pick_s.into(),
            line.place_s.into(),
            (line.distance_m * MM_PER_M).into(),
        ]);
        row
    };
    Ok(proact_tasks::object_results(result)?.into_iter().map(row).collect())
}

fn secs(time: SimTime) -> f64 {
    // Divided, so that 18 ms are 0.018 and not a digit more.
    time.0 as f64 / 1e3
}

/// The event's name, as in `events.jsonl`.
pub(crate) fn event_name(event: &Event) -> Result<String, serde_json::Error> {
    #[derive(serde::Deserialize)]
    struct EventName {
        event: String,
    }
    Ok(serde_json::from_value::<EventName>(serde_json::to_value(event)?)?.event)
}

/// Gazes by what the hand does meanwhile.
struct GazeByHandState {
    /// When the hand begins and ends to hold something.
    grasp_changes: std::collections::VecDeque<(SimTime, bool)>,
    holding: bool,
    since: SimTime,
    /// With an empty hand, and holding: milliseconds, and gazes.
    totals: [(u64, GazeMeasure); 2],
}

impl GazeByHandState {
    fn new(events: &[Event]) -> Self {
        let turns = events.iter().filter_map(|event| match event.kind {
            EventKind::ObjectAttached { .. } => Some((event.time, true)),
            EventKind::ObjectReleased { .. } => Some((event.time, false)),
            _ => None,
        });
        Self { grasp_changes: turns.collect(), holding: false, since: SimTime(0), totals: Default::default() }
    }

    fn advance_to(&mut self, until: SimTime) {
        while let Some((time, holding)) =
            self.grasp_changes.front().copied().filter(|(time, _)| *time <= until)
        {
            self.grasp_changes.pop_front();
            self.totals[usize::from(self.holding)].0 += time.millis_since(self.since);
            (self.holding, self.since) = (holding, time);
        }
    }

    fn push(&mut self, time: SimTime, gaze: &proact_types::GazeSample) {
        self.advance_to(time);
        self.totals[usize::from(self.holding)].1.push(time, gaze);
    }

    fn finish(mut self, end: SimTime) -> [(&'static str, f64, GazeMeasure); 2] {
        self.advance_to(end);
        self.totals[usize::from(self.holding)].0 += end.millis_since(self.since);
        let [empty, holding] = self.totals;
        [("empty_hand", empty), ("holding", holding)]
            .map(|(name, (millis, gaze))| (name, millis as f64 * 1e-3, gaze.finish()))
    }
}

/// How good the armband's signals were, over a whole trial.
struct EmgQualityTally {
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

impl EmgQualityTally {
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
        for (channel_tally, now) in self.channels.iter_mut().zip(self.monitor.channels()) {
            channel_tally.sd_sum += now.sd;
            channel_tally.mains_sum += now.mains_share;
            channel_tally.red += u64::from(now.status == ChannelStatus::Red);
            channel_tally.amber += u64::from(now.status == ChannelStatus::Amber);
        }
    }

    fn rows(self, key: &[TableCell]) -> Vec<Vec<TableCell>> {
        if self.samples == 0 {
            return Vec::new();
        }
        let (samples, verdicts, gaps) = (self.samples, self.verdicts, self.monitor.stream().gaps);
        let mean = |sum: f64| (verdicts > 0).then(|| sum / verdicts as f64);
        let lost = mean(self.lost_sum);
        let row = |(index, channel_tally): (usize, &ChannelTally)| {
            let mut row = key.to_vec();
            row.extend([
                (index + 1).into(),
                samples.into(),
                gaps.into(),
                lost.into(),
                mean(channel_tally.sd_sum).into(),
                mean(channel_tally.mains_sum).into(),
                mean(channel_tally.amber as f64).into(),
                mean(channel_tally.red as f64).into(),
            ]);
            row
        };
        self.channels.iter().enumerate().map(row).collect()
    }
}
