//! `proact emg simulate`: an armband without an armband.

use super::FaultArgs;
use clap::Args;
use proact_app::{
    TimedGesture,
    lab_streaming::{self, LslStreamOutlet},
    wearer_code_source,
};
use proact_devices::{
    AmplifierLayout, EmgFeed, Recordings, SourceInfo, SyntheticEmg, SyntheticModel,
    gforce::{GForceSimulator, GForceSimulatorOptions, GattSimulator, SharedPrompt, serve},
    myo::{
        MyoSimulator, MyoSimulatorOptions,
        protocol::{CHANNELS as MYO_CHANNELS, RATE_HZ as MYO_HZ},
    },
    random_stream,
};
use proact_types::{Command, Gesture, format_number};
use std::{
    error::Error,
    io::Write,
    net::TcpListener,
    path::PathBuf,
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    time::Duration,
};

/// Options of `proact emg simulate`.
#[derive(Debug, Args)]
pub struct SimulateArmbandArgs {
    /// Folder with recordings to replay; without it a generator at 1000 Hz, 200 Hz for a Myo.
    #[arg(long)]
    data: Option<PathBuf>,
    /// Samples per second of the recordings, if no file in the folder says so; of an amplifier, if not its usual ones.
    #[arg(long = "emg-rate")]
    rate_hz: Option<f64>,
    /// Repetitions to replay.
    #[arg(long, value_name = "REPS", value_delimiter = ',', default_value = "2")]
    repetitions: Vec<u32>,
    /// Gestures and how many seconds each is held. Counted from the moment samples are switched on.
    #[arg(
        long,
        value_name = "NAME:S,..",
        value_delimiter = ',',
        value_parser = parse_gesture_hold,
        default_value = "no_motion:2,hand_close:2,no_motion:1,hand_open:2,no_motion:1,wrist_extension:2,no_motion:1,wrist_flexion:2"
    )]
    gesture_sequence: Vec<TimedGesture>,
    #[command(flatten)]
    faults: FaultArgs,
    /// Publish a stream of this name on the lab streaming layer instead of serving an armband; needs --features lsl.
    #[arg(long, value_name = "NAME", conflicts_with_all = ["port", "duplicate_rate", "reorder_rate", "truncation_rate", "jitter_ms",
        "notification_bytes", "no_sequence_numbers", "battery_percent"])]
    lsl: Option<String>,
    /// With --lsl: the channels, units and rate of an amplifier, delsys, otb or brainflow (docs/amplifiers.md).
    #[arg(long, value_name = "NAME", requires = "lsl", conflicts_with = "data", value_parser = parse_layout)]
    amplifier: Option<AmplifierLayout>,
    /// A Myo armband instead of a gForce: 8 channels at 200 Hz.
    #[arg(long, conflicts_with_all = ["lsl", "duplicate_rate", "reorder_rate", "truncation_rate", "notification_bytes", "no_sequence_numbers"])]
    myo: bool,
    /// Port on this machine; 0 for any that is free. It is printed.
    #[arg(long, default_value_t = 7410)]
    port: u16,
    /// Share of notifications that are lost, 0 to 1.
    #[arg(long, value_name = "P", default_value_t = 0.0)]
    loss_rate: f64,
    /// Share that come twice.
    #[arg(long, value_name = "P", default_value_t = 0.0)]
    duplicate_rate: f64,
    /// Share that come after the next one.
    #[arg(long, value_name = "P", default_value_t = 0.0)]
    reorder_rate: f64,
    /// Share whose end is missing.
    #[arg(long, value_name = "P", default_value_t = 0.0)]
    truncation_rate: f64,
    /// Longest delay of a packet.
    #[arg(long, value_name = "MS", default_value_t = 0)]
    jitter_ms: u64,
    /// Most bytes of a notification; 20 cuts packets into fragments as the smallest radios do.
    #[arg(long, value_name = "BYTES", default_value_t = 244)]
    notification_bytes: usize,
    /// An armband that does not number its packets.
    #[arg(long)]
    no_sequence_numbers: bool,
    /// Charge, per cent.
    #[arg(long, value_name = "N", default_value_t = 87, value_parser = clap::value_parser!(u8).range(0..=100))]
    battery_percent: u8,
    /// Seed of the faults and of the places in the recordings.
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Stop after so many seconds.
    #[arg(long)]
    seconds: Option<f64>,
}

fn parse_layout(text: &str) -> Result<AmplifierLayout, String> {
    let known = AmplifierLayout::all().map(|layout| layout.key).join(", ");
    AmplifierLayout::find(text).ok_or_else(|| format!("{text:?}, expected one of {known}"))
}

/// `hand_close:2`.
fn parse_gesture_hold(text: &str) -> Result<TimedGesture, String> {
    let (name, secs) = text.split_once(':').unwrap_or((text, "2"));
    let gesture = name.parse::<Gesture>().map_err(|e| e.to_string())?;
    match secs.parse::<f64>() {
        Ok(secs) if (0.001..=1e6).contains(&secs) => Ok(TimedGesture { gesture, secs }),
        _ => Err(format!(
            "{text:?} holds {name} for {secs:?}, expected 0.001 to 1000000 seconds, as in {name}:2"
        )),
    }
}

/// Serves until the time is over or the process is stopped.
///
/// # Errors
/// Recordings that cannot be replayed, impossible options, or a port that is taken.
pub(super) fn run(args: &SimulateArmbandArgs, json: bool) -> Result<(), Box<dyn Error>> {
    if let Some(seconds) = args.seconds.filter(|seconds| !(0.001..=1e9).contains(seconds)) {
        return Err(format!("--seconds is {}, expected 0.001 to 1000000000", format_number(seconds)).into());
    }
    let (feed, rate_hz, channels) = open_feed(args)?;
    if let Some(name) = &args.lsl {
        return publish_lsl(args, name, feed, channels, json);
    }
    if rate_hz.fract() != 0.0 || !(1.0..=1000.0).contains(&rate_hz) {
        return Err(
            format!("the recordings have {rate_hz} Hz, an armband has a whole number up to 1000").into()
        );
    }
    let prompted = SharedPrompt::default();
    let codes = wearer_code_source(feed, rate_hz, args.gesture_sequence.clone(), prompted.clone());
    if args.myo {
        if (rate_hz, channels) != (f64::from(MYO_HZ), MYO_CHANNELS) {
            return Err(format!(
                "the recordings have {channels} channels at {rate_hz} Hz, a Myo has 8 at 200 Hz"
            )
            .into());
        }
        let options = MyoSimulatorOptions {
            battery_percent: args.battery_percent,
            loss_rate: args.loss_rate,
            jitter: Duration::from_millis(args.jitter_ms),
            seed: args.seed,
        };
        let myo = MyoSimulator::new(options, codes)?.with_prompts(prompted);
        return serve_armband(args, "myo-sim", myo, (rate_hz, channels), json);
    }
    let options = GForceSimulatorOptions {
        package_ids: !args.no_sequence_numbers,
        notification_bytes: args.notification_bytes,
        battery_percent: args.battery_percent,
        loss_rate: args.loss_rate,
        duplicate_rate: args.duplicate_rate,
        reorder_rate: args.reorder_rate,
        truncation_rate: args.truncation_rate,
        jitter: Duration::from_millis(args.jitter_ms),
        seed: args.seed,
        ..GForceSimulatorOptions::flawless(rate_hz as u16, channels)
    };
    let simulator = GForceSimulator::new(options, codes)?.with_prompts(prompted);
    serve_armband(args, "gforce-sim", simulator, (rate_hz, channels), json)
}

/// Serves an armband over TCP, as the source `scheme`.
fn serve_armband(
    args: &SimulateArmbandArgs,
    scheme: &str,
    mut double: impl GattSimulator,
    (rate_hz, channels): (f64, usize),
    json: bool,
) -> Result<(), Box<dyn Error>> {
    let listener = TcpListener::bind(("127.0.0.1", args.port))
        .map_err(|e| format!("port {} cannot be used: {e}; --port 0 takes a free one", args.port))?;
    let address = listener.local_addr()?;
    print_event(
        json,
        &serde_json::json!({ "address": address.to_string(), "rate_hz": rate_hz, "channels": channels }),
        &format!(
            "an armband with {channels} channels at {rate_hz} Hz listens at {address}\nproact emg stream --source {scheme}://{address}"
        ),
    )?;
    serve(&listener, &mut double, &stop_after(args.seconds), |event| {
        // That nobody reads it is no reason to stop.
        let _ = print_event(json, &serde_json::json!({ "event": event }), event);
    })?;
    Ok(())
}

/// A flag that is set after so many seconds.
fn stop_after(seconds: Option<f64>) -> Arc<AtomicBool> {
    let stop = Arc::new(AtomicBool::new(false));
    if let Some(seconds) = seconds {
        let stop = stop.clone();
        std::thread::spawn(move || {
            std::thread::sleep(Duration::from_secs_f64(seconds));
            stop.store(true, Ordering::Relaxed);
        });
    }
    stop
}

/// The same person on the lab streaming layer instead of an armband.
fn publish_lsl(
    args: &SimulateArmbandArgs,
    name: &str,
    feed: EmgFeed,
    channels: usize,
    json: bool,
) -> Result<(), Box<dyn Error>> {
    let rate_hz = feed.rate_hz();
    let layout = args.amplifier.as_ref();
    let channels = layout.map_or(channels, |layout| layout.channels.len());
    let device = layout.map_or("armband", |layout| layout.device);
    let info = SourceInfo {
        name: format!("simulated {device}"),
        rate_hz,
        channels,
        packet_samples: 1,
        zero_code: 0.0,
        rails: None,
        loss_is_counted: true,
        volts_per_code: None,
        imu: Vec::new(),
    };
    let mut published = LslStreamOutlet::open(name, &info, layout)?;
    print_event(
        json,
        &serde_json::json!({ "lsl": name, "rate_hz": rate_hz, "channels": channels }),
        &format!(
            "{channels} channels at {rate_hz} Hz are the stream {name:?} of the lab streaming layer\nproact emg stream --source lsl:{name}"
        ),
    )?;
    let mut codes = wearer_code_source(feed, rate_hz, args.gesture_sequence.clone(), SharedPrompt::default());
    if let Some(layout) = layout {
        codes = layout.simulated_samples(codes, args.seed);
    }
    let stop = stop_after(args.seconds);
    lab_streaming::serve_simulated(&mut published, &mut codes, rate_hz, (args.loss_rate, args.seed), &stop)
}

fn print_event(json: bool, object: &serde_json::Value, text: &str) -> std::io::Result<()> {
    let mut out = std::io::stdout().lock();
    if json {
        writeln!(out, "{object}")?
    } else {
        writeln!(out, "{text}")?
    }
    out.flush()
}

fn open_feed(args: &SimulateArmbandArgs) -> Result<(EmgFeed, f64, usize), Box<dyn Error>> {
    let Some(dir) = &args.data else {
        let usual = args.amplifier.as_ref().map_or(1000.0, |layout| layout.rate_hz);
        let rate_hz = if args.myo { f64::from(MYO_HZ) } else { args.rate_hz.unwrap_or(usual) };
        let model = SyntheticModel::shipped()?;
        let channels = model.channels();
        let generator = SyntheticEmg::new(
            &model,
            rate_hz,
            channels,
            1.0,
            random_stream(args.seed, "emg/synthetic/feed"),
        )?;
        if let Some(held) =
            args.gesture_sequence.iter().find(|held| held.gesture.same_named_command().is_none())
        {
            let five = Command::ALL.map(Command::ros_name).join(", ");
            return Err(format!(
                "synthetic EMG makes no {}, only {five}; name recordings of it with --data",
                held.gesture
            )
            .into());
        }
        let (expected, rest) = (Command::ALL.map(Gesture::from).into(), Gesture::default());
        let none = Recordings {
            path: PathBuf::new(),
            rate_hz,
            channels,
            imu: Vec::new(),
            expected,
            rest,
            items: Vec::new(),
            notes: Vec::new(),
            unknown_rate_keys: Vec::new(),
        };
        return Ok((EmgFeed::new(&none, &[], Some(generator), args.seed)?, rate_hz, channels));
    };
    let recordings = Recordings::open(dir, args.rate_hz)?;
    args.faults.check_recordings(&recordings, &args.repetitions)?;
    for held in &args.gesture_sequence {
        for &rep in &args.repetitions {
            recordings.find(held.gesture, rep)?;
        }
    }
    // Gestures that are not asked for need not be there; the feed wants each, so they are left out of its sight.
    let mut needed = recordings.clone();
    needed.items.retain(|item| args.gesture_sequence.iter().any(|h| h.gesture == item.gesture));
    needed.expected.retain(|name| {
        name.same_named_command().is_some() || needed.items.iter().any(|i| i.gesture == *name)
    });
    let filling = SyntheticEmg::new(
        &SyntheticModel::shipped()?,
        recordings.rate_hz,
        recordings.channels,
        1.0,
        random_stream(args.seed, "emg/synthetic/feed"),
    )?;
    let feed = EmgFeed::new(&needed, &args.repetitions, Some(filling), args.seed)?;
    Ok((feed, recordings.rate_hz, recordings.channels))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gestures_without_a_name_or_a_time_are_refused() {
        assert_eq!(
            parse_gesture_hold("hand_open"),
            Ok(TimedGesture { gesture: Command::HandOpen.into(), secs: 2.0 })
        );
        assert!(parse_gesture_hold(":2").unwrap_err().contains("name of a gesture"));
        assert!(parse_gesture_hold("hand_close:0").unwrap_err().contains("0.001 to 1000000 seconds"));
        assert!(parse_gesture_hold("hand_close:NaN").unwrap_err().contains("0.001 to 1000000 seconds"));
    }
}
