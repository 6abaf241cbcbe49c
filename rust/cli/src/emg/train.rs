//! `proact emg train`: a guided calibration, from whatever source, to a model file.

use super::{
    band,
    screen::{Choice, Screen, open_screen},
    source_args::SourceArgs,
    write_whole,
};
use crate::{access_args::AccessArgs, emg::WindowArgs, interrupt::interrupt_flag};
use clap::Args;
use proact_app::{answer, source::read_model};
use proact_devices::{
    EmgPacket, Recording, RecordingFolder, Recordings, SampleSource, SourceEvent, SourceInfo, SourceRegistry,
};
use proact_emg::{
    Calibration, CalibrationConfig, CalibrationEvent, CalibrationReport, EmgConfig, EmgError, EmgModel,
    Phase, QualityConfig, Refusal, RotationReport, ZeroLevel, check_rotation, extract,
};
use proact_types::{EmgSample, Gesture, GestureName, SimTime};
use serde_json::{Value, json};
use std::{
    error::Error,
    net::IpAddr,
    path::{Path, PathBuf},
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    time::{Duration, Instant},
};

/// Options of `proact emg train`.
#[derive(Debug, Args)]
pub struct TrainArgs {
    #[command(flatten)]
    pub(super) source: SourceArgs,
    /// Where the model goes. An existing file is replaced only with --replace.
    #[arg(long, default_value = "emg_model.json")]
    out: PathBuf,
    /// Replace the model file if there is one.
    #[arg(long)]
    replace: bool,
    /// Folder for the recordings, in LibEMG's layout; a new or empty one.
    #[arg(long, value_name = "DIR")]
    save: Option<PathBuf>,
    /// Gestures to train, by any names; a folder of recordings says itself which it has. Default: the five of the paper.
    #[arg(long, value_delimiter = ',', value_name = "NAMES")]
    gestures: Vec<GestureName>,
    /// Which of them is the relaxed hand, that stops the arm. Default: no_motion, or what the folder says.
    #[arg(long, value_name = "NAME")]
    rest: Option<GestureName>,
    /// Repetitions of file:FOLDER to use. Default: all.
    #[arg(long, value_delimiter = ',')]
    reps: Vec<u32>,
    /// Most rounds; training stops earlier when it is good enough.
    #[arg(long, default_value_t = 8, value_parser = clap::value_parser!(u8).range(2..=100))]
    rounds: u8,
    /// Rounds before it can be good enough.
    #[arg(long, default_value_t = 2, value_parser = clap::value_parser!(u8).range(2..=100))]
    least_rounds: u8,
    /// Share of windows to be recognised, leaving one repetition out, that is good enough.
    #[arg(long, default_value_t = 0.9)]
    target: f64,
    /// Length of a repetition, seconds.
    #[arg(long, default_value_t = 3.0)]
    secs: f64,
    /// Seconds from the prompt to the recording.
    #[arg(long, default_value_t = 2.0)]
    prepare: f64,
    /// Model of an earlier session: two gestures tell first whether the band sits as it did then.
    #[arg(long, value_name = "MODEL")]
    check: Option<PathBuf>,
    /// If the band check finds the band turned, write the model for the band as it sits, and be done.
    #[arg(long, requires = "check")]
    accept_roll: bool,
    /// Give up when nothing could be recorded for so many seconds.
    #[arg(long, default_value_t = 60.0)]
    patience: f64,
    #[command(flatten)]
    pub(super) page: PageArgs,
    #[command(flatten)]
    pub(super) window: WindowArgs,
}

/// Options of a page.
#[derive(Clone, Debug, Args)]
pub struct PageArgs {
    /// Guide on a page in the browser instead of in the terminal.
    #[arg(long)]
    pub(super) page: bool,
    /// Port of the page, or the next free one.
    #[arg(long, default_value_t = 8090, requires = "page")]
    pub(super) port: u16,
    /// Address to listen on; where other machines can connect, everybody needs the token that is printed then.
    #[arg(long, default_value = "127.0.0.1", requires = "page")]
    pub(super) bind: IpAddr,
    /// Print the address of the page, open nothing.
    #[arg(long, requires = "page")]
    pub(super) no_browser: bool,
    #[command(flatten)]
    pub(super) access: AccessArgs,
}

/// Repetitions refused in a row after which somebody has to look at the band.
const MOST_REFUSALS: usize = 6;
/// The two gestures of the band check by `model`: where it knows them those of the wrist, which use opposite sides of the
/// forearm, else its first two.
fn check_gestures(model: &EmgModel) -> Vec<GestureName> {
    let known = model.classifier.gestures();
    let wrist = [Gesture::WristFlexion, Gesture::WristExtension].map(GestureName::from);
    if wrist.iter().all(|gesture| known.contains(gesture)) {
        return wrist.into();
    }
    known.iter().copied().filter(|gesture| *gesture != model.config.rest).take(2).collect()
}

/// Guides, trains, writes.
///
/// # Errors
/// A source or a place that cannot be used, a band that is red or turned, an accuracy that is not reached: the model is
/// written all the same then, and so are the recordings.
pub(super) fn run(sources: &SourceRegistry, args: &TrainArgs, json: bool) -> Result<(), Box<dyn Error>> {
    if !(args.patience.is_finite() && args.patience > 0.0) {
        return Err(format!("--patience is {}, expected seconds above zero", args.patience).into());
    }
    // Asked before anybody holds a gesture.
    if args.out.exists() && !args.replace {
        return Err(format!(
            "{} is there already; name another file with --out, or --replace it",
            args.out.display()
        )
        .into());
    }
    if let Some(dir) = &args.save {
        check_empty(dir)?;
    }
    let stop = interrupt_flag()?;
    sources.find(&args.source.source)?;
    let mut training = match (args.source.source.scheme(), args.source.source.file()) {
        (_, Some(dir)) if dir.is_dir() => Training::of_recordings(args, dir)?,
        (_, Some(path)) => {
            return Err(format!(
                "{} does not say which gesture is made when; name a folder of recordings",
                path.display()
            )
            .into());
        }
        ("keys", _) => return Err("keys are no person: train on --source synthetic instead".into()),
        ("libemg-udp", _) => {
            return Err("LibEMG sends classes, not samples: there is nothing to train on".into());
        }
        _ => Training::live(sources, args, json, stop)?,
    };
    training.wait_until_ready()?;
    training.check_band(args)?;
    if let (Some(report), Some(earlier)) = (&training.band, &training.earlier) {
        training.screen.say(&band::text(report));
        if let Some(done) = band::verdict(report, earlier, &args.out, args.accept_roll)? {
            training.screen.done(&done);
            return print(&done, json);
        }
    }
    training.calibrate(args)?;
    training.write(args, json)
}

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
    earlier: Option<EmgModel>,
    /// Where repetitions go as soon as they are kept.
    saved: Option<RecordingFolder>,
}

/// Where the repetitions come from.
enum Feed {
    Live { source: Box<dyn SampleSource>, begin: Instant, now: SimTime },
    Recorded(Recordings),
}

impl Training {
    fn live(
        sources: &SourceRegistry,
        args: &TrainArgs,
        json: bool,
        stop: Arc<AtomicBool>,
    ) -> Result<Training, Box<dyn Error>> {
        let source = args.source.open(sources, args.window.rate)?;
        let info = source.info().clone();
        let five = Gesture::ALL.map(GestureName::from);
        let gestures = if args.gestures.is_empty() { &five[..] } else { &args.gestures };
        let config = calibration(args, &info, gestures, args.rest.unwrap_or_default())?;
        let screen = open_screen(&args.page, json, &info.name)?;
        let feed = Feed::Live { source, begin: Instant::now(), now: SimTime(0) };
        Training::new(args, info, config, feed, screen, stop)
    }

    fn of_recordings(args: &TrainArgs, dir: &Path) -> Result<Training, Box<dyn Error>> {
        if !args.gestures.is_empty() {
            return Err(
                "a folder of recordings says itself which gestures it has; leave --gestures out".into()
            );
        }
        let mut recordings = Recordings::open(dir, args.window.rate)?;
        let rest = args.rest.unwrap_or(recordings.rest);
        for &rep in &args.reps {
            for gesture in recordings.gestures() {
                recordings.find(gesture, rep)?;
            }
        }
        recordings.items.retain(|r| args.reps.is_empty() || args.reps.contains(&r.repetition));
        // In the order of the prompts, so that saved recordings give the model of their session to the last digit.
        let order = CalibrationConfig::round(&recordings.gestures(), rest);
        recordings.items.sort_by_key(|r| (r.repetition, order.iter().position(|g| *g == r.gesture)));
        let info = SourceInfo {
            name: dir.display().to_string(),
            rate_hz: recordings.rate_hz,
            channels: recordings.channels,
            packet_samples: 1,
            zero: 0.0,
            rails: None,
            loss_is_counted: true,
        };
        let config = calibration(args, &info, &recordings.gestures(), rest)?;
        let screen = open_screen(&PageArgs { page: false, ..args.page.clone() }, true, &info.name)?;
        Training::new(args, info, config, Feed::Recorded(recordings), screen, Arc::default())
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
            earlier: None,
            saved: None,
        })
    }

    /// Compares the band's place with that of an earlier model, if there is one.
    fn check_band(&mut self, args: &TrainArgs) -> Result<(), Box<dyn Error>> {
        let Some(path) = &args.check else { return Ok(()) };
        let model = read_model(path, &self.info)?;
        let asked = check_gestures(&model);
        let config = CalibrationConfig {
            emg: model.config.clone(),
            gestures: asked.clone(),
            most_rounds: 1,
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
        let mut windows = Vec::new();
        for repetition in self.session.repetitions() {
            let centred: Vec<EmgSample> = repetition.samples.iter().map(|s| model.centred(s)).collect();
            let vectors = extract(&model.config, &centred)?;
            windows.extend(vectors.into_iter().map(|v| (repetition.gesture, v)));
        }
        self.band = Some(check_rotation(&model.classifier, model.config.rest, &windows)?);
        self.earlier = Some(model);
        self.session = Calibration::new(self.config.clone())?;
        Ok(())
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
        if let Some(dir) = &args.save {
            self.saved = Some(RecordingFolder::create(
                dir,
                self.config.emg.rate_hz,
                &self.config.gestures,
                self.config.emg.rest,
            )?);
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
                    self.session.record_again(gesture, None);
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
                    CalibrationEvent::Prompted(prompt) => self.prompt(prompt.gesture),
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
                        self.save_last()?;
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
        self.prompt(self.config.emg.rest);
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

    fn prompt(&mut self, gesture: GestureName) {
        if let Feed::Live { source, .. } = &mut self.feed {
            source.prompt(gesture);
        }
    }

    /// Takes what the source brings next.
    fn advance(&mut self) -> Result<Vec<CalibrationEvent>, Box<dyn Error>> {
        if self.stop.load(Ordering::Relaxed) {
            return Err(match &self.saved {
                Some(folder) => format!(
                    "stopped before the end; no model was written, but {} repetitions are in {}",
                    self.session.repetitions().len(),
                    folder.path().display()
                ),
                None => "stopped before the end; nothing was written".to_owned(),
            }
            .into());
        }
        let Feed::Live { source, begin, now } = &mut self.feed else { return Ok(Vec::new()) };
        let mut packet = EmgPacket::default();
        let event = source.poll(Duration::from_millis(20), &mut packet)?;
        // The stream's clock must not go back, whichever clock it is read from.
        *now = (*now).max(SimTime(match event {
            SourceEvent::Packet => packet.received.as_millis() as u64,
            _ => begin.elapsed().as_millis() as u64,
        }));
        match event {
            SourceEvent::Ended => return Err("the source ended before the calibration did".into()),
            SourceEvent::Lost { reason } => self.screen.say(&format!("armband lost: {reason}")),
            SourceEvent::Restored => self.screen.say("armband found again"),
            _ => {}
        }
        // Without a packet `samples` is empty.
        Ok(self.session.step(*now, &packet.samples)?)
    }

    fn write(mut self, args: &TrainArgs, json: bool) -> Result<(), Box<dyn Error>> {
        let model = self.session.finish()?;
        write_whole(&args.out, &model.to_json()?)?;
        let object = self.result(args, &model);
        self.screen.done(&object);
        print(&object, json)?;
        match self.session.report() {
            Some(judged) if judged.good_enough => Ok(()),
            judged => {
                let accuracy = judged.map_or("was not judged".to_owned(), |r| {
                    format!("{:.1} % of windows recognised", 100.0 * r.accuracy)
                });
                Err(format!(
                    "not good enough: {accuracy}, expected {:.0} % and {:.0} % of each gesture; the model is in {}; \
                     record more rounds, or the worst gesture again",
                    100.0 * self.config.target_accuracy,
                    100.0 * self.config.target_recall,
                    args.out.display()
                )
                .into())
            }
        }
    }

    /// Writes the repetition that was kept last, if it is to be saved. One that is recorded again has the number of the one
    /// that it replaces.
    fn save_last(&self) -> Result<(), Box<dyn Error>> {
        let (Some(folder), Some((last, before))) = (&self.saved, self.session.repetitions().split_last())
        else {
            return Ok(());
        };
        let repetition = u32::try_from(before.iter().filter(|r| r.gesture == last.gesture).count())?;
        let samples = last.samples.iter().map(|s| s.channels.clone()).collect();
        Ok(folder.keep(&Recording { repetition, gesture: last.gesture, samples, path: PathBuf::new() })?)
    }

    fn result(&self, args: &TrainArgs, model: &EmgModel) -> Value {
        let judged = self.session.report();
        let of = |value: &dyn Fn(&CalibrationReport) -> Value| judged.map_or(Value::Null, value);
        json!({
            "model": args.out.display().to_string(),
            "accuracy": of(&|r| json!(r.accuracy)), "windows": of(&|r| json!(r.windows)),
            "classes": of(&|r| json!(r.classes)), "confusion": of(&|r| json!(r.confusion)),
            "recall": of(&|r| json!(r.recall)), "repetitions": of(&|r| json!(r.repetitions)),
            "good_enough": judged.is_some_and(|r| r.good_enough), "rounds": self.session.rounds(),
            "refused": self.refused, "centring": model.centring, "band": self.band,
            "recordings": args.save.as_ref().map(|dir| dir.display().to_string()),
        })
    }
}

/// One sentence for the person.
pub(super) fn refusal_text(refusal: &Refusal) -> String {
    match refusal {
        Refusal::Gap { lost: 0 } => "a sample was unusable".to_owned(),
        Refusal::Gap { lost } => format!("{lost} samples were lost"),
        Refusal::Silence => "no samples came".to_owned(),
        Refusal::Red { channels, stream } => {
            let mut parts: Vec<String> = channels
                .iter()
                .map(|(channel, fault)| match fault {
                    Some(fault) => {
                        format!("channel {channel} is red ({})", proact_app::stream_view::fault_text(*fault))
                    }
                    None => format!("channel {channel} is red"),
                })
                .collect();
            if *stream {
                parts.push("the stream loses samples or has a wrong rate".to_owned());
            }
            parts.join(", ")
        }
    }
}

fn calibration(
    args: &TrainArgs,
    info: &SourceInfo,
    gestures: &[GestureName],
    rest: GestureName,
) -> Result<CalibrationConfig, Box<dyn Error>> {
    if !gestures.contains(&rest) {
        return Err(EmgError::NoRest { rest, known: gestures.to_vec() }.into());
    }
    let emg = EmgConfig { rest, ..args.window.live_config(info.rate_hz, info.channels)? };
    let nominal_zero = args.source.zero.unwrap_or(info.zero);
    let rails = info.rails.map(|(low, high)| [low - nominal_zero, high - nominal_zero]);
    let config = CalibrationConfig {
        emg,
        gestures: CalibrationConfig::round(gestures, rest),
        repetition_secs: args.secs,
        prepare_secs: args.prepare,
        least_rounds: args.least_rounds.into(),
        most_rounds: args.rounds.into(),
        target_accuracy: args.target,
        zero: args.source.zero.map_or(ZeroLevel::RestMedian, ZeroLevel::Fixed),
        nominal_zero,
        quality: QualityConfig { rails, ..QualityConfig::default() },
        ..CalibrationConfig::default()
    };
    config.check()?;
    Ok(config)
}

fn check_empty(dir: &Path) -> Result<(), String> {
    match std::fs::read_dir(dir).map(|mut entries| entries.next().is_none()) {
        Ok(true) => Ok(()),
        Ok(false) => Err(format!("{} is not empty; name a new folder with --save", dir.display())),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(()),
        Err(error) => Err(format!("cannot use {}: {error}", dir.display())),
    }
}

fn print(object: &Value, json: bool) -> Result<(), Box<dyn Error>> {
    if json {
        answer(object)?;
    } else if let Some(text) = object["verdict"].as_str() {
        answer(format_args!("{text}; it is in {}", object["model"].as_str().unwrap_or_default()))?;
    } else {
        answer(format_args!("the model is in {}", object["model"].as_str().unwrap_or_default()))?;
    }
    Ok(())
}
