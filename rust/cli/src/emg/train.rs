//! `proact emg train`: a guided calibration, from whatever source, to a model file.

pub use super::train_args::{PageArgs, TrainArgs};
use super::{
    band,
    feed::{Feed, Heard},
    recorded,
    screen::{Choice, Screen, open_screen, refusal_text, report_text, shortfall, sites_text},
    train_args::{calibration, check_empty},
    trained,
};
use crate::interrupt::interrupt_flag;
use proact_app::{answer, source::read_model, tell};
use proact_devices::{EmgPacket, Recording, RecordingFolder, SourceInfo, SourceRegistry, try_process};
use proact_emg::{
    BandProposal, Calibration, CalibrationConfig, CalibrationEvent, CalibrationReport, EmgConfig, EmgModel,
    Phase, RecordedFault, RotationReport, accuracy_at, check_rotation,
};
use proact_files::{check_output, is_replaced, write_whole};
use proact_types::{EmgSample, Gesture, GestureName, number_text};
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
const MOST_REFUSALS: usize = 6;

/// Guides, trains, writes.
///
/// # Errors
/// A source or a place that cannot be used, a band that is red or turned, an accuracy that is not reached: the model is
/// written all the same then, and so are the recordings.
pub(super) fn run(sources: &SourceRegistry, args: &TrainArgs, json: bool) -> Result<(), Box<dyn Error>> {
    if !(0.001..=1e6).contains(&args.patience) {
        let patience = number_text(args.patience);
        return Err(format!("--patience is {patience}, expected 0.001 to 1000000 seconds").into());
    }
    // Asked before anybody holds a gesture.
    if args.out.exists() && is_replaced(&args.out) && !args.replace {
        return Err(format!(
            "{} is there already; name another file with --out, or --replace it",
            args.out.display()
        )
        .into());
    }
    check_output(&args.out)?;
    if args.resume.is_none() && (args.save.is_some() || args.source.source.file().is_none()) {
        check_empty(&args.folder())?;
    }
    let stop = interrupt_flag()?;
    sources.find(&args.source.source)?;
    let mut training = match (args.source.source.scheme(), args.source.source.file()) {
        (_, Some(dir)) if args.resume.is_some() => {
            return Err(format!("{} is recorded already: leave --resume out", dir.display()).into());
        }
        (_, Some(dir)) if dir.is_dir() => Training::of_recordings(args, dir)?,
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
        _ => Training::live(sources, args, json, stop)?,
    };
    training.wait_until_ready()?;
    training.check_band(args)?;
    if let (Some(report), Some(earlier)) = (&training.band, &training.earlier) {
        training.screen.say(&band::text(report));
        let held_out = training.held_out;
        if let Some(done) = band::verdict(report, earlier, &args.out, args.accept_roll, held_out)? {
            training.screen.done(&done);
            return trained::print(&done, json);
        }
    }
    match training.calibrate(args) {
        Ok(()) => training.write(args, json),
        Err(error) => Err(training.stopped(error)),
    }
}

/// Recordings, each of one gesture.
type Takes = Vec<(GestureName, Vec<EmgSample>)>;

/// What is needed for a calibration.
struct Training {
    info: SourceInfo,
    config: CalibrationConfig,
    session: Calibration,
    feed: Feed,
    screen: Box<dyn Screen>,
    stop: Arc<AtomicBool>,
    patience: Duration,
    refused: usize,
    band: Option<RotationReport>,
    /// Share of windows that did not propose a turn which the earlier model recognises as it is, and turned.
    held_out: Option<[f64; 2]>,
    earlier: Option<EmgModel>,
    /// What is wrong with recordings.
    faults: Vec<RecordedFault>,
    /// Where repetitions go as soon as they are kept.
    saved: Option<RecordingFolder>,
    /// Somebody asked for the recordings.
    saving: bool,
}

impl Training {
    fn live(
        sources: &SourceRegistry,
        args: &TrainArgs,
        json: bool,
        stop: Arc<AtomicBool>,
    ) -> Result<Training, Box<dyn Error>> {
        let source = args.source.open(sources, args.window.rate, args.window.wants_imu())?;
        let info = source.info().clone();
        let five = Gesture::ALL.map(GestureName::from);
        let rest = args.rest.unwrap_or_default();
        let known = args.window.decoder.gestures(&five, rest);
        let gestures = if args.gestures.is_empty() { &known } else { &args.gestures };
        let config = calibration(args, &info, gestures, rest)?;
        let asked = EmgConfig { rest, ..args.window.live_config(info.rate_hz, info.channels, &info.imu)? };
        if asked.classifier.is_process() {
            tell("trying the program with made-up windows");
            try_process(&asked, &config.gestures).map_err(|error| {
                format!("{error}; it was tried before anything was recorded: mend the program, then begin")
            })?;
        }
        let screen = open_screen(&args.page, json, &info.name)?;
        let feed = Feed::live(source);
        Training::new(args, info, config, feed, screen, stop)
    }

    fn of_recordings(args: &TrainArgs, dir: &Path) -> Result<Training, Box<dyn Error>> {
        if !args.gestures.is_empty() {
            return Err(
                "a folder of recordings says itself which gestures it has; leave --gestures out".into()
            );
        }
        let mut recordings = args.window.open(dir)?;
        let rest = args.rest.unwrap_or(recordings.rest);
        for &rep in &args.reps {
            for gesture in recordings.gestures() {
                recordings.find(gesture, rep)?;
            }
        }
        recordings.items.retain(|r| args.reps.is_empty() || args.reps.contains(&r.repetition));
        recorded::in_order_of_prompts(&mut recordings, rest);
        let info = SourceInfo {
            name: dir.display().to_string(),
            rate_hz: recordings.rate_hz,
            channels: recordings.channels,
            packet_samples: 1,
            zero: 0.0,
            rails: None,
            loss_is_counted: true,
            volts: None,
            imu: recordings.imu.clone(),
        };
        let config = calibration(args, &info, &recordings.gestures(), rest)?;
        let faults = recorded::faults(&recordings, &config);
        if let Some(refusal) = recorded::refusal(&faults).filter(|_| !args.accept_faults) {
            return Err(refusal.into());
        }
        for said in faults.iter().map(recorded::text).chain(recorded::lacking(&recordings)) {
            tell(said);
        }
        let screen = open_screen(&PageArgs { page: false, ..args.page.clone() }, true, &info.name)?;
        let training = Training::new(args, info, config, Feed::Recorded(recordings), screen, Arc::default())?;
        Ok(Training { faults, ..training })
    }

    fn new(
        args: &TrainArgs,
        info: SourceInfo,
        config: CalibrationConfig,
        feed: Feed,
        screen: Box<dyn Screen>,
        stop: Arc<AtomicBool>,
    ) -> Result<Training, Box<dyn Error>> {
        let session = Calibration::new(config.clone())?;
        let patience = Duration::from_secs_f64(args.patience);
        Ok(Training {
            info,
            config,
            session,
            feed,
            screen,
            stop,
            patience,
            refused: 0,
            band: None,
            held_out: None,
            earlier: None,
            faults: Vec::new(),
            saving: args.save.is_some() || args.resume.is_some(),
            saved: None,
        })
    }

    /// Compares the band's place with that of an earlier model, if there is one.
    fn check_band(&mut self, args: &TrainArgs) -> Result<(), Box<dyn Error>> {
        let Some(path) = &args.check else { return Ok(()) };
        let model = read_model(path, &self.info)?;
        let asked = band::check_gestures(&model);
        let config = CalibrationConfig {
            emg: model.config.clone(),
            gestures: asked.clone(),
            most_rounds: 1,
            positions: Vec::new(),
            ..self.config.clone()
        };
        self.session = Calibration::new(config)?;
        match &self.feed {
            Feed::Recorded(recordings) => {
                for gesture in asked {
                    let newest = recordings.items.iter().rfind(|r| r.gesture == gesture);
                    let newest = newest.ok_or_else(|| {
                        format!("{} has no {gesture}, which the band check needs", recordings.path.display())
                    })?;
                    self.session.add(gesture, newest.numbered().collect())?;
                }
            }
            Feed::Live { .. } => {
                self.screen.say("Band check: two gestures tell whether the band sits as it did.");
                self.record_round()?;
            }
        }
        let repetitions = self.session.repetitions().iter().map(|r| (r.gesture, r.samples.clone())).collect();
        let report = check_rotation(&model, &band::windows_of(&model, repetitions)?)?;
        if let (BandProposal::Roll(shift), true) = (report.proposal, args.accept_roll) {
            let others = self.others(&model)?;
            let windows = band::windows_of(&model, others)?;
            let at = |shift| accuracy_at(&model.classifier, &windows, shift);
            self.held_out = if windows.is_empty() { None } else { Some([at(0)?, at(shift)?]) };
        }
        self.band = Some(report);
        self.earlier = Some(model);
        self.session = Calibration::new(self.config.clone())?;
        Ok(())
    }

    /// Recordings of the model's gestures beside those that the band check has seen: of a folder all others, else one of
    /// each gesture, which are recorded now.
    fn others(&mut self, model: &EmgModel) -> Result<Takes, Box<dyn Error>> {
        let known = model.classifier.gestures();
        match &self.feed {
            Feed::Recorded(recordings) => {
                let seen = |r: &Recording| {
                    let newest = recordings.items.iter().rfind(|other| other.gesture == r.gesture);
                    band::check_gestures(model).contains(&r.gesture)
                        && newest.is_some_and(|n| n.repetition == r.repetition)
                };
                let others = recordings.items.iter().filter(|r| known.contains(&r.gesture) && !seen(r));
                Ok(others.map(|r| (r.gesture, r.numbered().collect())).collect())
            }
            Feed::Live { .. } => {
                let config = CalibrationConfig {
                    emg: model.config.clone(),
                    gestures: CalibrationConfig::round(known, model.config.rest),
                    most_rounds: 1,
                    positions: Vec::new(),
                    ..self.config.clone()
                };
                self.session = Calibration::new(config)?;
                self.screen.say(
                    "The band seems turned: each gesture once tells whether the turned model is better.",
                );
                self.record_round()?;
                Ok(self.session.repetitions().iter().map(|r| (r.gesture, r.samples.clone())).collect())
            }
        }
    }

    /// Shows lights until the person begins.
    fn wait_until_ready(&mut self) -> Result<(), Box<dyn Error>> {
        while !self.screen.ready() {
            self.advance()?;
            self.screen.show(&self.session);
        }
        // What was prompted meanwhile is prompted again, to somebody who looks.
        self.session = Calibration::new(self.config.clone())?;
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
            recorded::in_order_of_prompts(&mut recordings, rest);
            let kept: Vec<_> = recordings.items.iter().map(|r| (r.gesture, r.numbered().collect())).collect();
            self.screen.say(&format!("{} repetitions are in {}: going on", kept.len(), dir.display()));
            self.session.resume(kept)?;
            self.saved = Some(folder);
        } else if args.save.is_some() || matches!(self.feed, Feed::Live { .. }) {
            self.saved =
                Some(RecordingFolder::create(&args.folder(), rate_hz, &gestures, rest, &self.info.imu)?);
        }
        if let Feed::Recorded(recordings) = &self.feed {
            for recording in &recordings.items {
                self.session.add(recording.gesture, recording.numbered().collect())?;
                if let Some(folder) = &self.saved {
                    folder.keep(recording)?;
                }
            }
            return Ok(self.session.review()?);
        }
        loop {
            self.record_round()?;
            self.screen.judged(&self.session);
            match self.decide()? {
                Choice::Proceed => {
                    self.session.proceed();
                }
                Choice::Again(gesture) => {
                    let of_gesture =
                        self.session.repetitions().iter().filter(|r| r.gesture == gesture).count();
                    if self.session.record_again(gesture, None)
                        && let (Some(folder), Some(newest)) = (&self.saved, of_gesture.checked_sub(1))
                    {
                        folder.discard(gesture, u32::try_from(newest)?)?;
                    }
                }
                Choice::Stop => return Ok(()),
            }
        }
    }

    /// Prompts and records until there is something to review.
    fn record_round(&mut self) -> Result<(), Box<dyn Error>> {
        let (mut progress, mut kept) = (Instant::now(), 0);
        let mut why = None;
        while self.session.phase() != Phase::Reviewing {
            for event in self.advance()? {
                match event {
                    CalibrationEvent::Prompted(prompt) => {
                        if let Some(text) =
                            self.feed.prompt_position(&self.config.positions, prompt.repetition)
                        {
                            self.screen.say(&text);
                        }
                        self.feed.prompt(prompt.gesture);
                    }
                    CalibrationEvent::Refused(prompt, refusal) => {
                        self.refused += 1;
                        let text = refusal_text(&refusal);
                        self.screen.say(&format!("{} was not kept: {text}", prompt.gesture));
                        if self.session.refusals() >= MOST_REFUSALS {
                            return Err(format!("{MOST_REFUSALS} repetitions in a row were not kept, the last because {text}; look at the band").into());
                        }
                    }
                    CalibrationEvent::Blocked(_, refusal) => {
                        let text = refusal_text(&refusal);
                        self.screen.say(&format!("waiting: {text}"));
                        why = Some(text);
                    }
                    CalibrationEvent::Kept(_) => {
                        if let Some(folder) = &self.saved {
                            folder.keep_newest(&self.session)?;
                        }
                        kept += 1;
                        progress = Instant::now();
                    }
                    _ => {}
                }
            }
            self.screen.show(&self.session);
            let usual = Duration::from_secs_f64(self.config.prepare_secs + self.config.repetition_secs);
            if progress.elapsed() > self.patience + usual {
                let why = why.unwrap_or_else(|| "no repetition was completed".to_owned());
                return Err(format!("nothing could be recorded for {:.0} s after {kept} repetitions: {why}; training refuses red channels", progress.elapsed().as_secs_f64()).into());
            }
        }
        self.feed.prompt(self.config.emg.rest);
        Ok(())
    }

    /// What the person, or the rule, wants after a round. The stream goes on meanwhile.
    fn decide(&mut self) -> Result<Choice, Box<dyn Error>> {
        loop {
            if let Some(choice) = self.screen.choose(&self.session)? {
                return Ok(choice);
            }
            self.advance()?;
            self.screen.show(&self.session);
        }
    }

    /// Takes what the source brings next.
    fn advance(&mut self) -> Result<Vec<CalibrationEvent>, Box<dyn Error>> {
        if self.stop.load(Ordering::Relaxed) {
            return Err("stopped before the end".into());
        }
        let mut packet = EmgPacket::default();
        let Some(Heard { now, said }) = self.feed.poll(&mut packet)? else { return Ok(Vec::new()) };
        said.iter().for_each(|text| self.screen.say(text));
        // Without a packet `samples` is empty.
        Ok(self.session.step(now, &packet.samples)?)
    }

    /// `error` ended the calibration: where what was recorded is, and how to go on.
    fn stopped(&self, error: Box<dyn Error>) -> Box<dyn Error> {
        let Some(folder) = self.saved.as_ref().filter(|_| matches!(self.feed, Feed::Live { .. })) else {
            return error;
        };
        let (kept, dir) = (self.session.repetitions().len(), folder.path().display());
        if kept == 0 {
            self.clear();
            return format!("{error}; nothing was recorded").into();
        }
        format!(
            "{error}; no model was written, but {kept} repetitions are in {dir}: go on with --resume {dir}"
        )
        .into()
    }

    /// What nobody asked to keep goes when it is of no more use.
    fn clear(&self) {
        if let Some(folder) = self.saved.as_ref().filter(|_| !self.saving) {
            // A folder too many is no reason to fail.
            let _ = std::fs::remove_dir_all(folder.path());
        }
    }

    fn write(mut self, args: &TrainArgs, json: bool) -> Result<(), Box<dyn Error>> {
        let model = match self.session.finish() {
            Ok(model) => model,
            Err(error) => return Err(self.stopped(error.into())),
        };
        let live = args.window.live_config(self.info.rate_hz, self.info.channels, &self.info.imu)?;
        let asked = EmgConfig { rest: self.config.emg.rest, ..live };
        let (model, judged) = trained::decoded(&asked, model, self.session.repetitions())
            .map_err(|error| self.stopped(error))?;
        write_whole(&args.out, &model.to_json()?).map_err(|error| self.stopped(error.into()))?;
        let mut object = self.result(args, &model);
        if let Some(judged) = &judged {
            object["process"] = json!(judged);
        }
        let (kept, report) = (self.session.repetitions(), self.session.report());
        let figures = trained::draw(&args.out, &model, kept, report, judged.as_ref())
            .map_err(|error| self.stopped(error))?;
        object["plots"] = trained::plots(&args.out, &figures);
        self.screen.done(&trained::on_page(&object, &figures));
        if let Some(report) = self.session.report().filter(|_| !json) {
            answer(report_text(report) + &sites_text(&model) + &trained::process_text(judged.as_ref()))?;
        }
        trained::print(&object, json)?;
        match self.session.report() {
            Some(judged) if judged.good_enough => {
                self.clear();
                Ok(())
            }
            judged => {
                let reached = shortfall(judged, &self.config);
                let more = match &self.saved {
                    Some(folder) if matches!(self.feed, Feed::Live { .. }) => {
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
    fn result(&self, args: &TrainArgs, model: &EmgModel) -> Value {
        let judged = self.session.report();
        let of = |value: &dyn Fn(&CalibrationReport) -> Value| judged.map_or(Value::Null, value);
        json!({
            "model": args.out.display().to_string(),
            "accuracy": of(&|r| json!(r.accuracy)), "accuracy_without_imu": of(&|r| json!(r.accuracy_without_imu)),
            "positions": self.config.positions, "windows": of(&|r| json!(r.windows)),
            "classes": of(&|r| json!(r.classes)), "confusion": of(&|r| json!(r.confusion)),
            "recall": of(&|r| json!(r.recall)), "drives": of(&|r| json!(r.drives)), "sites": model.classifier.sites(), "repetitions": of(&|r| json!(r.repetitions)),
            "good_enough": judged.is_some_and(|r| r.good_enough), "rounds": self.session.rounds(),
            "refused": self.refused, "faults": self.faults, "centring": model.centring, "band": self.band,
            "recordings": args.resume.as_ref().or(args.save.as_ref()).map(|dir| dir.display().to_string()),
        })
    }
}
