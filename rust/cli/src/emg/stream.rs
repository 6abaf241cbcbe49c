//! `proact emg stream`: a live source, recognised and shown.

use super::source_args::SourceArgs;
use crate::{
    emg::{FaultArgs, WindowArgs},
    interrupt::interrupt_flag,
};
use clap::Args;
use proact_app::{
    OffsetCorrectedStream,
    emg_model_file::{model_uses_imu, read_model},
    lab_streaming::LslStreamOutlet,
    print_result,
    stream_view::{StreamSummary, StreamView},
};
use proact_devices::{
    EmgRecorder, LibEmgEndpoint, LibEmgOutput, LibEmgReceiver, LibEmgSender, Recording, Recordings,
    SampleSource, SourceEvent, SourceInfo, SourceRegistry, SyntheticEmg, SyntheticModel,
    accepted_fault_texts, findings_json, open_pipeline, random_stream, read_class_map,
};
use proact_emg::{
    ChannelStatus, DecisionRule, EmgConfig, EmgError, EmgModel, EmgOutput, LiveCheck, QualityConfig,
    QualityMonitor,
};
use proact_types::{Command, Drives, EmgSample, Gesture, MAX_GESTURES, SimTime, format_number};
use serde_json::json;
use std::{
    error::Error,
    io::Write,
    path::PathBuf,
    sync::atomic::{AtomicBool, Ordering},
    time::{Duration, Instant},
};

/// Options of `proact emg stream`.
#[derive(Debug, Args)]
pub struct StreamArgs {
    #[command(flatten)]
    source: SourceArgs,
    /// Model file, as training writes it.
    #[arg(long, conflicts_with_all = ["data", "window", "increment", "features", "classifier", "filters"])]
    model: Option<PathBuf>,
    /// Folder of recordings to train on. Without it and without a model synthetic EMG is trained on, which fits the simulator alone.
    #[arg(long)]
    data: Option<PathBuf>,
    /// Repetitions to train on.
    #[arg(long, value_name = "REPS", value_delimiter = ',', default_value = "0,1")]
    train_repetitions: Vec<u32>,
    /// Gestures of the classes that libemg-udp or libemg-tcp sends, in the order of their numbers.
    #[arg(
        long,
        value_delimiter = ',',
        value_name = "NAMES",
        default_value = "hand_close,hand_open,no_motion,wrist_extension,wrist_flexion"
    )]
    classes: Vec<Gesture>,
    /// File in which LibEMG keeps the names of its classes, such as collection_details.json, in place of --classes.
    #[arg(long, value_name = "FILE", conflicts_with = "classes")]
    class_map: Option<PathBuf>,
    /// Which of --classes is the relaxed hand, that stops the arm.
    #[arg(long, value_name = "NAME", default_value = "no_motion")]
    rest: Gesture,
    /// Keep the raw codes with the device's time: a new .csv or .edf file.
    #[arg(long)]
    record: Option<PathBuf>,
    /// Send each decision as LibEMG does, such as 127.0.0.1:12346.
    #[arg(long)]
    udp: Option<String>,
    /// Send the effort too, as LibEMG's velocity: "class velocity".
    #[arg(long, requires = "udp")]
    velocity: bool,
    /// Publish the samples as NAME (type EMG) and the gesture of each decision as NAME-decisions (type Markers) on the
    /// lab streaming layer; needs --features lsl.
    #[arg(long, value_name = "NAME")]
    lsl: Option<String>,
    /// Stop after so many seconds.
    #[arg(long)]
    seconds: Option<f64>,
    #[command(flatten)]
    faults: FaultArgs,
    #[command(flatten)]
    window: WindowArgs,
}

/// Streams until the source ends, the time is over, or the process is told to stop.
///
/// # Errors
/// A source that cannot be opened, a model that does not fit it, or a file that cannot be written.
pub(super) fn run(sources: &SourceRegistry, args: &StreamArgs, json: bool) -> Result<(), Box<dyn Error>> {
    if let Some(seconds) = args.seconds.filter(|seconds| !(0.001..=1e9).contains(seconds)) {
        return Err(format!("--seconds is {}, expected 0.001 to 1000000000", format_number(seconds)).into());
    }
    // So that a recording ends well.
    let stop = interrupt_flag()?;
    let mut out = StreamOutput {
        json,
        view: StreamView::new(),
        sender: None,
        published: None,
        velocity: args.velocity,
    };
    if let Some(target) = &args.udp {
        out.sender = Some(LibEmgSender::connect(target)?);
    }
    if let Some(from) = args.source.source.libemg_endpoint() {
        return stream_classes(args, &from, &mut out, &stop);
    }
    let imu = match &args.model {
        Some(path) => model_uses_imu(path)?,
        None => args.window.wants_imu(),
    };
    let source = args.source.open(sources, args.window.rate_hz, imu, args.faults.policy())?;
    stream_samples(args, source, &mut out, &stop)
}

/// A model for the stream, and what it was trained on.
fn load_or_train_model(args: &StreamArgs, info: &SourceInfo) -> Result<(EmgModel, String), Box<dyn Error>> {
    if let Some(path) = &args.model {
        return Ok((read_model(path, info)?, path.display().to_string()));
    }
    let mut config = args.window.live_config(info.rate_hz, info.channels, &info.imu)?;
    let (recordings, reps, label) = match &args.data {
        Some(dir) => (args.window.open(dir)?, args.train_repetitions.clone(), dir.display().to_string()),
        None => (
            synthetic_recordings(info.rate_hz)?,
            vec![0],
            "synthetic EMG; name recordings with --data".to_owned(),
        ),
    };
    check_stream_matches(info, recordings.rate_hz, recordings.channels, &label)?;
    if recordings.imu != info.imu {
        return Err(format!(
            "the inertial measurement unit of the stream is not that of {label}; leave --imu out"
        )
        .into());
    }
    let findings =
        if args.data.is_some() { args.faults.check_recordings(&recordings, &reps)? } else { Vec::new() };
    if reps.is_empty() {
        return Err("no repetitions to train on were named, expected at least one, such as 0".into());
    }
    config.rest = recordings.rest;
    let mut samples: Vec<(Gesture, Vec<EmgSample>)> = Vec::new();
    for &rep in &reps {
        for gesture in recordings.gestures() {
            samples.push((gesture, recordings.find(gesture, rep)?.numbered_samples().collect()));
        }
    }
    let slices: Vec<(Gesture, &[EmgSample])> = samples.iter().map(|(g, s)| (*g, s.as_slice())).collect();
    let model = EmgModel::train(&config, &vec![0.0; config.channels], &slices)?;
    Ok((EmgModel { accepted_faults: accepted_fault_texts(&findings), ..model }, label))
}

/// Recordings of the generator that the simulator uses, from another random stream, at the rate of an armband; of another rate the
/// check of the fit tells.
fn synthetic_recordings(rate_hz: f64) -> Result<Recordings, Box<dyn Error>> {
    let rate_hz = if (200.0..=1000.0).contains(&rate_hz) { rate_hz } else { 1000.0 };
    let (model, secs) = (SyntheticModel::shipped()?, 6.0);
    let channels = model.channels();
    let mut generator =
        SyntheticEmg::new(&model, rate_hz, channels, 1.0, random_stream(0, "emg/synthetic/train"))?;
    let mut record = |gesture: Command| Recording {
        repetition: 0,
        gesture: gesture.into(),
        samples: (0..(secs * rate_hz) as usize).map(|_| generator.next(gesture)).collect(),
        bridged: Vec::new(),
        path: "synthetic".into(),
    };
    let items = Command::ALL.map(&mut record).into();
    let (expected, rest) = (Command::ALL.map(Gesture::from).into(), Gesture::default());
    let (path, imu) = ("synthetic".into(), Vec::new());
    Ok(Recordings {
        path,
        rate_hz,
        channels,
        imu,
        expected,
        rest,
        items,
        notes: Vec::new(),
        unknown_rate_keys: Vec::new(),
    })
}

fn check_stream_matches(
    info: &SourceInfo,
    rate_hz: f64,
    channels: usize,
    trained_on: &str,
) -> Result<(), String> {
    if (rate_hz, channels) == (info.rate_hz, info.channels) {
        return Ok(());
    }
    Err(format!(
        "the stream has {} channels at {} Hz, the model {channels} at {rate_hz} Hz, trained on {trained_on}",
        info.channels, info.rate_hz
    ))
}

struct StreamOutput {
    json: bool,
    view: StreamView,
    sender: Option<LibEmgSender>,
    published: Option<LslStreamOutlet>,
    velocity: bool,
}

impl StreamOutput {
    fn print_line(&self, object: &serde_json::Value) -> Result<bool, Box<dyn Error>> {
        if !self.json {
            return Ok(true);
        }
        let mut out = std::io::stdout().lock();
        match writeln!(out, "{object}").and_then(|()| out.flush()) {
            // A reader such as `head` has seen enough.
            Err(error) if error.kind() == std::io::ErrorKind::BrokenPipe => Ok(false),
            result => Ok(result.map(|()| true)?),
        }
    }

    fn decision(
        &mut self,
        at: SimTime,
        counter: Option<u64>,
        out: &EmgOutput,
    ) -> Result<bool, Box<dyn Error>> {
        if let Some(sender) = &mut self.sender {
            // The effort is that of the newest class; the gesture in force may be another.
            let effort = if out.class == Some(out.gesture) { out.effort } else { 0.0 };
            let velocity = self.velocity.then_some(effort);
            sender.send(LibEmgOutput { class: Some(out.class_index), velocity, probability: None })?;
        }
        if let Some(published) = &mut self.published {
            published.decision(out.gesture, counter)?;
        }
        self.print_line(&json!({
            "t_s": at.as_secs(), "sample": counter, "gesture": out.gesture, "window_class": out.window_class, "class": out.class,
            "confidence": out.confidence, "posterior": out.posterior, "effort": out.effort, "drives": out.drives,
            "published": out.published, "stale": out.stale,
        }))
    }
}

fn stream_samples(
    args: &StreamArgs,
    source: Box<dyn SampleSource>,
    out: &mut StreamOutput,
    stop: &AtomicBool,
) -> Result<(), Box<dyn Error>> {
    let info = source.info().clone();
    let (model, label) = load_or_train_model(args, &info)?;
    let mut stream = OffsetCorrectedStream::new(source, args.source.adc_zero, &model);
    let mut pipeline = open_pipeline(&model, args.source.no_realtime)?;
    // Rails are those of all channels: the narrowest range after centring.
    let rails = info.rails.map(|(low, high)| {
        let (min, max) =
            stream.dc_offsets.iter().fold((f64::MAX, f64::MIN), |(a, b), z| (a.min(*z), b.max(*z)));
        [low - min, high - max]
    });
    let quality_config = QualityConfig { rails, ..QualityConfig::default() };
    let mut quality = QualityMonitor::new(quality_config, info.rate_hz, info.channels, &model.channels);
    let mut light = ChannelStatus::Green;
    let mut check = LiveCheck::new(info.rate_hz, info.channels, &model.channels);
    let mut recorder = args.record.as_ref().map(|path| EmgRecorder::create(path, &info)).transpose()?;
    out.published = args.lsl.as_ref().map(|name| LslStreamOutlet::open(name, &info, None)).transpose()?;
    let mut glance = StreamSummary::new(&info, &label);
    out.print_line(
        &json!({ "event": "open", "source": info.name, "rate_hz": info.rate_hz, "channels": info.channels,
        "imu": info.imu, "trained_on": label, "zero": stream.dc_offsets, "loss_is_counted": info.loss_is_counted,
        "findings": findings_json(stream.source.findings()), "accepted_faults": model.accepted_faults }),
    )?;
    let mut going = true;
    while going && !stop.load(Ordering::Relaxed) {
        if args.seconds.is_some_and(|s| stream.elapsed_secs() >= s) {
            break;
        }
        let event = stream.next(|packet| {
            recorder.as_mut().map_or(Ok(()), |recorder| recorder.packet(packet))?;
            Ok(out.published.as_mut().map_or(Ok(()), |published| published.packet(packet))?)
        })?;
        let now = stream.now;
        match event {
            SourceEvent::Packet => {
                let packet = &stream.packet;
                if packet.lost_before > 0 {
                    let next = packet.samples.first().map(|s| s.counter);
                    going &= out.print_line(&json!({ "event": "gap", "t_s": now.as_secs(),
                        "lost_samples": packet.lost_before, "next_sample": next }))?;
                }
                for sample in &packet.samples {
                    let electrodes = model.config.electrode_sample(sample);
                    glance.sample(&electrodes);
                    if quality.push(now, &electrodes) {
                        glance.quality.copy_from_slice(quality.channels());
                        glance.stream_quality = *quality.stream();
                        if quality.status() != light {
                            light = quality.status();
                            going &= out.print_line(
                                &json!({ "event": "quality", "t_s": now.as_secs(), "light": light,
                                "channels": quality.channels(), "stream": quality.stream() }),
                            )?;
                        }
                    }
                    if let Some(findings) = check.push(now, &electrodes, quality.stream()) {
                        glance.findings = findings.iter().map(ToString::to_string).collect();
                        going &= out.print_line(&json!({ "event": "findings", "t_s": now.as_secs(),
                                "findings": findings_json(findings) }))?;
                    }
                    if let Some(output) = pipeline.step(now, std::slice::from_ref(sample)) {
                        going &= out.decision(now, Some(sample.counter), &output)?;
                        glance.output = Some(output);
                    }
                }
            }
            SourceEvent::Ended => break,
            event => {
                match event {
                    SourceEvent::Lost { reason } => {
                        glance.source_warning = Some(reason.clone());
                        going &= out.print_line(
                            &json!({ "event": "lost", "t_s": now.as_secs(), "reason": reason }),
                        )?;
                    }
                    SourceEvent::Restored => {
                        glance.source_warning = None;
                        going &= out.print_line(&json!({ "event": "restored", "t_s": now.as_secs() }))?;
                    }
                    _ => {}
                }
                if let Some(output) = pipeline.step(now, &[]) {
                    going &= out.decision(now, None, &output)?;
                    glance.output = Some(output);
                }
            }
        }
        if !out.json {
            glance.counts = stream.source.counts();
            out.view.show(&glance)?;
        }
    }
    let recorded = recorder.map(EmgRecorder::finish).transpose()?;
    let (link, clock, counts) = (stream.source.counts(), stream.source.clock(), pipeline.counts());
    out.print_line(&json!({ "event": "end", "recorded_samples": recorded, "link": link, "clock": clock,
        "stream": counts }))?;
    if !out.json {
        print_result(format_args!(
            "{} packets, {} windows, {} samples lost",
            link.packets, counts.windows, link.lost_samples
        ))?;
        if let Some(clock) = clock {
            print_result(format_args!(
                "sender's clock {:+.6} s to this one (within {:.6}); samples arrive {:.1} ms old, at most {:.1}",
                clock.offset_secs,
                clock.uncertainty_secs,
                1e3 * clock.mean_age_secs,
                1e3 * clock.worst_age_secs
            ))?;
        }
    }
    Ok(())
}

/// Classes of another program instead of samples.
fn stream_classes(
    args: &StreamArgs,
    from: &LibEmgEndpoint,
    out: &mut StreamOutput,
    stop: &AtomicBool,
) -> Result<(), Box<dyn Error>> {
    if args.record.is_some() || args.lsl.is_some() {
        return Err("LibEMG sends classes, not samples: there is nothing to --record or to publish".into());
    }
    let mapped = args.class_map.as_deref().map(read_class_map).transpose()?;
    let (gestures, rest) = (mapped.as_ref().unwrap_or(&args.classes), args.rest);
    if !gestures.contains(&rest) {
        return Err(EmgError::NoRest { rest, known: gestures.clone() }.into());
    }
    if gestures.len() > MAX_GESTURES {
        return Err(EmgError::TooManyClasses { got: gestures.len() }.into());
    }
    let mut receiver = match from {
        LibEmgEndpoint::Udp(port) => LibEmgReceiver::bind(*port, gestures.len())?,
        LibEmgEndpoint::Tcp(address) => LibEmgReceiver::connect(address, gestures.len())?,
    };
    let address = receiver.address()?.to_string();
    out.print_line(&json!({ "event": "open", "source": format!("LibEMG at {address}") }))?;
    let mut rule = DecisionRule::new(&EmgConfig { rest, ..EmgConfig::default() });
    let begin = Instant::now();
    let mut going = true;
    while going && !stop.load(Ordering::Relaxed) {
        if args.seconds.is_some_and(|s| begin.elapsed().as_secs_f64() >= s) {
            break;
        }
        let received = match receiver.poll(Duration::from_millis(20)) {
            Ok(received) => received,
            // One bad datagram, from whomever, must not end the stream; it counts as none.
            Err(error @ proact_devices::DeviceError::LibEmgMessage { .. }) => {
                going &= out.print_line(&json!({ "event": "refused", "reason": error.to_string() }))?;
                None
            }
            Err(error) => return Err(error.into()),
        };
        let now = SimTime(begin.elapsed().as_millis() as u64);
        // What LibEMG rejects breaks a run of equal classes, and a full run of rejections stops the arm.
        let class = received.and_then(|r| r.class).map(|class| gestures[class]);
        let decided = match (received, class) {
            (Some(_), None) => Some(rule.reject(now)),
            _ => rule.step(now, class),
        };
        let Some(decision) = decided else { continue };
        let window_class = class.unwrap_or(rest);
        let output = EmgOutput {
            gesture: decision.gesture,
            class_index: gestures.iter().position(|g| *g == decision.gesture).unwrap_or_default(),
            published: decision.published,
            window_class,
            posterior: gestures.iter().map(|_| 0.0).collect(),
            confidence: received.and_then(|r| r.probability).unwrap_or(0.0),
            class,
            effort: received.and_then(|r| r.velocity).unwrap_or(0.0),
            drives: Drives::new(),
            stale: decision.stale,
        };
        going &= out.decision(now, None, &output)?;
        if !out.json {
            print_result(format_args!(
                "{:8.2} s  {}",
                now.as_secs(),
                if decision.stale { "stale" } else { decision.gesture.as_str() }
            ))?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_model_of_another_band_is_refused_with_both_bands() {
        let info = SourceInfo {
            name: "test".to_owned(),
            rate_hz: 1000.0,
            channels: 8,
            packet_samples: 16,
            zero_code: 128.0,
            rails: None,
            loss_is_counted: true,
            volts_per_code: None,
            imu: Vec::new(),
        };
        let error = check_stream_matches(&info, 200.0, 8, "recordings/").unwrap_err();
        assert_eq!(
            error,
            "the stream has 8 channels at 1000 Hz, the model 8 at 200 Hz, trained on recordings/"
        );
        assert_eq!(check_stream_matches(&info, 1000.0, 8, ""), Ok(()));
    }
}
