//! `proact emg train`: a guided calibration, from whatever source, to a model file.

pub use super::train_args::{CalibrationPageArgs, TrainArgs};
use super::{
    band_check,
    calibration_ui::{
        CalibrationUi, RoundAction, open_calibration_ui, refusal_text, report_text, shortfall_text,
        sites_text,
    },
    recording_checks,
    train_args::{calibration_config, check_empty},
    training_output,
    training_source::{SourceUpdate, TrainingSource},
};
use crate::interrupt::interrupt_flag;
use proact_app::{emg_model_file::read_model, print_result, print_status};
use proact_devices::{
    EmgPacket, Recording, RecordingFolder, SourceInfo, SourceRegistry, accepted_fault_texts, findings_json,
    try_process,
};
use proact_emg::{
    BandProposal, Calibration, CalibrationConfig, CalibrationEvent, CalibrationPhase, CalibrationReport,
    EmgConfig, EmgModel, RecordingFault, RotationReport, accuracy_at_shift, check_rotation,
};
use proact_files::{check_output, is_regular_or_missing, write_atomically};
use proact_types::{Command, EmgSample, Gesture, format_number};
use serde_json::{Value, json};
use std::{
    error::Error,
    path::Path,
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    time::{Duration, Instant},
};

/// Repetitions refused in a row after which somebody has to look at the band.
const MAX_REFUSALS: usize = 6;

/// Guides, trains, writes.
///
/// # Errors
/// A source or a place that cannot be used, a band that is red or turned, an accuracy that is not reached: the model is
/// written all the same then, and so are the recordings.
pub(super) fn run(sources: &SourceRegistry, args: &TrainArgs, json: bool) -> Result<(), Box<dyn Error>> {
    if !(0.001..=1e6).contains(&args.timeout) {
        let timeout = format_number(args.timeout);
        return Err(format!("--timeout is {timeout}, expected 0.001 to 1000000 seconds").into());
    }
    // Asked before anybody holds a gesture.
    if args.out.exists() && is_regular_or_missing(&args.out) && !args.replace {
        return Err(format!(
            "{} is there already; name another file with --out, or --replace it",
            args.out.display()
        )
        .into());
    }
    check_output(&args.out)?;
    if args.resume.is_none() && (args.save.is_some() || args.source.source.file().is_none()) {
        check_empty(&args.recordings_dir())?;
    }
    let stop = interrupt_flag()?;
    sources.find(&args.source.source)?;
    let mut training = match (args.source.source.scheme(), args.source.source.file()) {
        (_, Some(dir)) if args.resume.is_some() => {
            return Err(format!("{} is recorded already: leave --resume out", dir.display()).into());
        }
        (_, Some(dir)) if dir.is_dir() => TrainingRun::from_recordings(args, dir)?,
        (_, Some(path)) => {
            return Err(format!(
                "{} does not say which gesture is made when; name a folder of recordings",
                path.display()
            )
            .into());
        }
        ("keys", _) => return Err("keys are no person: train on --source synthetic instead".into()),
        ("libemg-udp" | "libemg-tcp", _) => {
            return Err("LibEMG sends classes, not samples: there is nothing to train on".into());
        }
        _ => TrainingRun::from_source(sources, args, json, stop)?,
    };
    training.wait_until_ready()?;
    training.check_band(args)?;
    if let (Some(report), Some(earlier)) = (&training.rotation_report, &training.earlier_model) {
        training.ui.show_message(&band_check::evidence_text(report));
        let held_out = training.held_out_accuracy;
        if let Some(done) = band_check::verdict(report, earlier, &args.out, args.accept_rotation, held_out)? {
            training.ui.show_result(&done);
            return training_output::print_training_result(&done, json);
        }
    }
    match training.calibrate(args) {
        Ok(()) => training.write_model(args, json),
        Err(error) => Err(training.add_resume_hint(error)),
    }
}

/// Recordings, each of one gesture.
type GestureRecordings = Vec<(Gesture, Vec<EmgSample>)>;

/// What is needed for a calibration.
struct TrainingRun {
    info: SourceInfo,
    config: CalibrationConfig,
    calibration: Calibration,
    source: TrainingSource,
    ui: Box<dyn CalibrationUi>,
    stop: Arc<AtomicBool>,
    timeout: Duration,
    refused_count: usize,
    rotation_report: Option<RotationReport>,
    /// Share of windows that did not propose a turn which the earlier model recognises as it is, and turned.
    held_out_accuracy: Option<[f64; 2]>,
    earlier_model: Option<EmgModel>,
    /// What is wrong with recordings.
    faults: Vec<RecordingFault>,
    /// Where repetitions go as soon as they are kept.
    recording_folder: Option<RecordingFolder>,
    /// Somebody asked for the recordings.
    keep_recordings: bool,
}

impl TrainingRun {
    fn from_source(
        sources: &SourceRegistry,
        args: &TrainArgs,
        json: bool,
        stop: Arc<AtomicBool>,
    ) -> Result<TrainingRun, Box<dyn Error>> {
        let source =
            args.source.open(sources, args.window.rate_hz, args.window.wants_imu(), args.faults.policy())?;
        let info = source.info().clone();
        let five = Command::ALL.map(Gesture::from);
        let rest = args.rest.unwrap_or_default();
        let known = args.window.decoder.required_gestures(&five, rest);
        let gestures = if args.gestures.is_empty() { &known } else { &args.gestures };
        let config = calibration_config(args, &info, gestures, rest)?;
        let emg_config =
            EmgConfig { rest, ..args.window.live_config(info.rate_hz, info.channels, &info.imu)? };
        if emg_config.classifier.is_process() {
            print_status("trying the program with made-up windows");
            try_process(&emg_config, &config.gestures).map_err(|error| {
                format!("{error}; it was tried before anything was recorded: mend the program, then begin")
            })?;
        }
        let screen = open_calibration_ui(&args.page, json, &info.name)?;
        let feed = TrainingSource::from_source(source);
        TrainingRun::new(args, info, config, feed, screen, stop)
    }

    fn from_recordings(args: &TrainArgs, dir: &Path) -> Result<TrainingRun, Box<dyn Error>> {
        if !args.gestures.is_empty() {
            return Err(
                "a folder of recordings says itself which gestures it has; leave --gestures out".into()
            );
        }
        let mut recordings = args.window.open(dir)?;
        let rest = args.rest.unwrap_or(recordings.rest);
        for &rep in &args.repetitions {
            for gesture in recordings.gestures() {
                recordings.find(gesture, rep)?;
            }
        }
        recordings.items.retain(|r| args.repetitions.is_empty() || args.repetitions.contains(&r.repetition));
        recording_checks::sort_by_prompt_order(&mut recordings, rest);
        let info = SourceInfo {
            name: dir.display().to_string(),
            rate_hz: recordings.rate_hz,
            channels: recordings.channels,
            packet_samples: 1,
            zero_code: 0.0,
            rails: None,
            loss_is_counted: true,
            volts_per_code: None,
            imu: recordings.imu.clone(),
        };
        let config = calibration_config(args, &info, &recordings.gestures(), rest)?;
        let faults = args.faults.check_recordings(&recordings, &[])?;
        recording_checks::missing_recording_notes(&recordings).into_iter().for_each(print_status);
        let screen =
            open_calibration_ui(&CalibrationPageArgs { page: false, ..args.page.clone() }, true, &info.name)?;
        let training = TrainingRun::new(
            args,
            info,
            config,
            TrainingSource::Recorded(recordings),
            screen,
            Arc::default(),
        )?;
        Ok(TrainingRun { faults, ..training })
    }

    fn new(
        args: &TrainArgs,
        info: SourceInfo,
        config: CalibrationConfig,
        feed: TrainingSource,
        screen: Box<dyn CalibrationUi>,
        stop: Arc<AtomicBool>,
    ) -> Result<TrainingRun, Box<dyn Error>> {
        let calibration = Calibration::new(config.clone())?;
        let timeout = Duration::from_secs_f64(args.timeout);
        Ok(TrainingRun {
            info,
            config,
            calibration,
            source: feed,
            ui: screen,
            stop,
            timeout,
            refused_count: 0,
            rotation_report: None,
            held_out_accuracy: None,
            earlier_model: None,
            faults: Vec::new(),
            keep_recordings: args.save.is_some() || args.resume.is_some(),
            recording_folder: None,
        })
    }

    /// Compares the band's place with that of an earlier model, if there is one.
    fn check_band(&mut self, args: &TrainArgs) -> Result<(), Box<dyn Error>> {
        let Some(path) = &args.band_check else { return Ok(()) };
        let model = read_model(path, &self.info)?;
        let gestures = band_check::band_check_gestures(&model);
        let config = CalibrationConfig {
            emg: model.config.clone(),
            gestures: gestures.clone(),
            max_rounds: 1,
            positions: Vec::new(),
            ..self.config.clone()
        };
        self.calibration = Calibration::new(config)?;
        match &self.source {
            TrainingSource::Recorded(recordings) => {
                for gesture in gestures {
                    let newest = recordings.items.iter().rfind(|r| r.gesture == gesture);
                    let newest = newest.ok_or_else(|| {
                        format!("{} has no {gesture}, which the band check needs", recordings.path.display())
                    })?;
                    self.calibration.add(gesture, newest.numbered_samples().collect())?;
                }
            }
            TrainingSource::Live { .. } => {
                self.ui.show_message("Band check: two gestures tell whether the band sits as it did.");
                self.record_round()?;
            }
        }
        let repetitions =
            self.calibration.repetitions().iter().map(|r| (r.gesture, r.samples.clone())).collect();
        let report = check_rotation(&model, &band_check::extract_windows(&model, repetitions)?)?;
        if let (BandProposal::Roll(shift), true) = (report.proposal, args.accept_rotation) {
            let others = self.other_recordings(&model)?;
            let windows = band_check::extract_windows(&model, others)?;
            let at = |shift| accuracy_at_shift(&model.classifier, &windows, shift);
            self.held_out_accuracy = if windows.is_empty() { None } else { Some([at(0)?, at(shift)?]) };
        }
        self.rotation_report = Some(report);
        self.earlier_model = Some(model);
        self.calibration = Calibration::new(self.config.clone())?;
        Ok(())
    }

    /// Recordings of the model's gestures beside those that the band check has seen: of a folder all others, else one of
    /// each gesture, which are recorded now.
    fn other_recordings(&mut self, model: &EmgModel) -> Result<GestureRecordings, Box<dyn Error>> {
        let known = model.classifier.gestures();
        match &self.source {
            TrainingSource::Recorded(recordings) => {
                let seen = |r: &Recording| {
                    let newest = recordings.items.iter().rfind(|other| other.gesture == r.gesture);
                    band_check::band_check_gestures(model).contains(&r.gesture)
                        && newest.is_some_and(|n| n.repetition == r.repetition)
                };
                let others = recordings.items.iter().filter(|r| known.contains(&r.gesture) && !seen(r));
                Ok(others.map(|r| (r.gesture, r.numbered_samples().collect())).collect())
            }
            TrainingSource::Live { .. } => {
                let config = CalibrationConfig {
                    emg: model.config.clone(),
                    gestures: CalibrationConfig::round(known, model.config.rest),
                    max_rounds: 1,
                    positions: Vec::new(),
                    ..self.config.clone()
                };
                self.calibration = Calibration::new(config)?;
                self.ui.show_message(
                    "The band seems turned: each gesture once tells whether the turned model is better.",
                );
                self.record_round()?;
                Ok(self.calibration.repetitions().iter().map(|r| (r.gesture, r.samples.clone())).collect())
            }
        }
    }

    /// Shows lights until the person begins.
    fn wait_until_ready(&mut self) -> Result<(), Box<dyn Error>> {
        while !self.ui.ready() {
            self.advance()?;
            self.ui.show(&self.calibration);
        }
        // What was prompted meanwhile is prompted again, to somebody who looks.
        self.calibration = Calibration::new(self.config.clone())?;
        Ok(())
    }

    fn calibrate(&mut self, args: &TrainArgs) -> Result<(), Box<dyn Error>> {
        let emg = &self.config.emg;
        let (rate_hz, channels, rest) = (emg.rate_hz, emg.channels, emg.rest);
        let gestures = self.config.gestures.clone();
        if let Some(dir) = &args.resume {
            let imu = &self.info.imu;
            let (folder, mut recordings) =
                RecordingFolder::resume(dir, rate_hz, channels, &gestures, rest, imu)?;
            recording_checks::sort_by_prompt_order(&mut recordings, rest);
            let kept: Vec<_> =
                recordings.items.iter().map(|r| (r.gesture, r.numbered_samples().collect())).collect();
            self.ui.show_message(&format!("{} repetitions are in {}: going on", kept.len(), dir.display()));
            self.calibration.resume(kept)?;
            self.recording_folder = Some(folder);
        } else if args.save.is_some() || matches!(self.source, TrainingSource::Live { .. }) {
            self.recording_folder = Some(RecordingFolder::create(
                &args.recordings_dir(),
                rate_hz,
                &gestures,
                rest,
                &self.info.imu,
            )?);
        }
        if let TrainingSource::Recorded(recordings) = &self.source {
            for recording in &recordings.items {
                self.calibration.add(recording.gesture, recording.numbered_samples().collect())?;
                if let Some(folder) = &self.recording_folder {
                    folder.write_recording(recording)?;
                }
            }
            return Ok(self.calibration.review()?);
        }
        loop {
            self.record_round()?;
            self.ui.show_report(&self.calibration);
            match self.wait_for_action()? {
                RoundAction::Proceed => {
                    self.calibration.start_next_round();
                }
                RoundAction::RecordAgain(gesture) => {
                    let of_gesture =
                        self.calibration.repetitions().iter().filter(|r| r.gesture == gesture).count();
                    if self.calibration.redo_repetition(gesture, None)
                        && let (Some(folder), Some(newest)) =
                            (&self.recording_folder, of_gesture.checked_sub(1))
                    {
                        folder.remove_recording(gesture, u32::try_from(newest)?)?;
                    }
                }
                RoundAction::Stop => return Ok(()),
            }
        }
    }

    /// Prompts and records until there is something to review.
    fn record_round(&mut self) -> Result<(), Box<dyn Error>> {
        let (mut progress, mut kept) = (Instant::now(), 0);
        let mut why = None;
        while self.calibration.phase() != CalibrationPhase::Reviewing {
            for event in self.advance()? {
                match event {
                    CalibrationEvent::Prompted(prompt) => {
                        if let Some(text) =
                            self.source.prompt_position(&self.config.positions, prompt.repetition)
                        {
                            self.ui.show_message(&text);
                        }
                        self.source.prompt(prompt.gesture);
                    }
                    CalibrationEvent::RepetitionRejected(prompt, refusal) => {
                        self.refused_count += 1;
                        let text = refusal_text(&refusal);
                        self.ui.show_message(&format!("{} was not kept: {text}", prompt.gesture));
                        if self.calibration.consecutive_rejections() >= MAX_REFUSALS {
                            return Err(format!("{MAX_REFUSALS} repetitions in a row were not kept, the last because {text}; look at the band").into());
                        }
                    }
                    CalibrationEvent::Blocked(_, refusal) => {
                        let text = refusal_text(&refusal);
                        self.ui.show_message(&format!("waiting: {text}"));
                        why = Some(text);
                    }
                    CalibrationEvent::RepetitionAccepted(_) => {
                        if let Some(folder) = &self.recording_folder {
                            folder.write_newest(&self.calibration)?;
                        }
                        kept += 1;
                        progress = Instant::now();
                    }
                    _ => {}
                }
            }
            self.ui.show(&self.calibration);
            let usual = Duration::from_secs_f64(self.config.prepare_secs + self.config.repetition_secs);
            if progress.elapsed() > self.timeout + usual {
                let why = why.unwrap_or_else(|| "no repetition was completed".to_owned());
                return Err(format!("nothing could be recorded for {:.0} s after {kept} repetitions: {why}; training refuses red channels", progress.elapsed().as_secs_f64()).into());
            }
        }
        self.source.prompt(self.config.emg.rest);
        Ok(())
    }

    /// What the person, or the rule, wants after a round. The stream goes on meanwhile.
    fn wait_for_action(&mut self) -> Result<RoundAction, Box<dyn Error>> {
        loop {
            if let Some(choice) = self.ui.poll_action(&self.calibration)? {
                return Ok(choice);
            }
            self.advance()?;
            self.ui.show(&self.calibration);
        }
    }

    /// Takes what the source brings next.
    fn advance(&mut self) -> Result<Vec<CalibrationEvent>, Box<dyn Error>> {
        if self.stop.load(Ordering::Relaxed) {
            return Err("stopped before the end".into());
        }
        let mut packet = EmgPacket::default();
        let Some(SourceUpdate { now, message: messages }) = self.source.poll(&mut packet)? else {
            return Ok(Vec::new());
        };
        messages.iter().for_each(|text| self.ui.show_message(text));
        // Without a packet `samples` is empty.
        Ok(self.calibration.step(now, &packet.samples)?)
    }

    /// `error` ended the calibration: where what was recorded is, and how to go on.
    fn add_resume_hint(&self, error: Box<dyn Error>) -> Box<dyn Error> {
        let Some(folder) =
            self.recording_folder.as_ref().filter(|_| matches!(self.source, TrainingSource::Live { .. }))
        else {
            return error;
        };
        let (kept, dir) = (self.calibration.repetitions().len(), folder.path().display());
        if kept == 0 {
            self.remove_temporary_recordings();
            return format!("{error}; nothing was recorded").into();
        }
        format!(
            "{error}; no model was written, but {kept} repetitions are in {dir}: go on with --resume {dir}"
        )
        .into()
    }

    /// What nobody asked to keep goes when it is of no more use.
    fn remove_temporary_recordings(&self) {
        if let Some(folder) = self.recording_folder.as_ref().filter(|_| !self.keep_recordings) {
            // A folder too many is no reason to fail.
            let _ = std::fs::remove_dir_all(folder.path());
        }
    }

    fn write_model(mut self, args: &TrainArgs, json: bool) -> Result<(), Box<dyn Error>> {
        let model = match self.calibration.finish() {
            Ok(model) => model,
            Err(error) => return Err(self.add_resume_hint(error.into())),
        };
        let live = args.window.live_config(self.info.rate_hz, self.info.channels, &self.info.imu)?;
        let emg_config = EmgConfig { rest: self.config.emg.rest, ..live };
        let (model, evaluation) =
            training_output::decode_by_process(&emg_config, model, self.calibration.repetitions())
                .map_err(|error| self.add_resume_hint(error))?;
        let model = EmgModel { accepted_faults: accepted_fault_texts(&self.faults), ..model };
        write_atomically(&args.out, &model.to_json()?).map_err(|error| self.add_resume_hint(error.into()))?;
        let mut object = self.result_json(args, &model);
        if let Some(evaluation) = &evaluation {
            object["process"] = json!(evaluation);
        }
        let (kept, report) = (self.calibration.repetitions(), self.calibration.report());
        let figures = training_output::write_figures(&args.out, &model, kept, report, evaluation.as_ref())
            .map_err(|error| self.add_resume_hint(error))?;
        object["plots"] = training_output::figure_paths(&args.out, &figures);
        self.ui.show_result(&training_output::result_for_page(&object, &figures));
        if let Some(report) = self.calibration.report().filter(|_| !json) {
            print_result(
                report_text(report)
                    + &sites_text(&model)
                    + &training_output::process_text(evaluation.as_ref()),
            )?;
        }
        training_output::print_training_result(&object, json)?;
        match self.calibration.report() {
            Some(evaluation) if evaluation.good_enough => {
                self.remove_temporary_recordings();
                Ok(())
            }
            evaluation => {
                let reached = shortfall_text(evaluation, &self.config);
                let more = match &self.recording_folder {
                    Some(folder) if matches!(self.source, TrainingSource::Live { .. }) => {
                        format!(": go on with --resume {} --replace", folder.path().display())
                    }
                    _ => String::new(),
                };
                Err(format!(
                    "not good enough: {reached}; the model is in {}; record more rounds, or the worst gesture again{more}",
                    args.out.display()
                )
                .into())
            }
        }
    }

    /// What the command answers.
    fn result_json(&self, args: &TrainArgs, model: &EmgModel) -> Value {
        let calibration_report = self.calibration.report();
        let of = |value: &dyn Fn(&CalibrationReport) -> Value| calibration_report.map_or(Value::Null, value);
        json!({
            "model": args.out.display().to_string(),
            "accuracy": of(&|r| json!(r.accuracy)), "accuracy_without_imu": of(&|r| json!(r.accuracy_without_imu)),
            "positions": self.config.positions, "windows": of(&|r| json!(r.windows)),
            "classes": of(&|r| json!(r.classes)), "confusion": of(&|r| json!(r.confusion)),
            "recall": of(&|r| json!(r.recall)), "drives": of(&|r| json!(r.drives)), "sites": model.classifier.sites(), "repetitions": of(&|r| json!(r.repetitions)),
            "good_enough": calibration_report.is_some_and(|r| r.good_enough), "rounds": self.calibration.rounds(),
            "refused": self.refused_count, "faults": self.faults, "findings": findings_json(&self.faults),
            "accepted_faults": model.accepted_faults, "centring": model.dc_offset, "band": self.rotation_report,
            "recordings": args.resume.as_ref().or(args.save.as_ref()).map(|dir| dir.display().to_string()),
        })
    }
}
