//! Streams of the lab streaming layer between processes on this machine, with our own program and with pylsl, which
//! brings another version of liblsl.
#![cfg(feature = "lsl")]
#![allow(clippy::unwrap_used, clippy::disallowed_methods)] // A test of programs starts programs.

mod common;

use common::{Running, event, proact, stream};
use proact_devices::{EmgPacket, LslSource, Recording, RecordingFolder, SampleSource, SourceEvent};
use proact_types::{Command, Gesture};
use serde_json::Value;
use std::{
    io::{BufRead, BufReader, Lines, Write},
    path::{Path, PathBuf},
    process::{self, ChildStdout, Stdio},
    time::{Duration, Instant},
};

/// A name that no other program on the network has.
fn name(of: &str) -> String {
    format!("proact-test-{of}-{}", std::process::id())
}

/// Publishes simulated EMG as `name` for at most two minutes.
fn simulator(name: &str, words: &[&str]) -> Running {
    let mut command = proact(&[&["simulate", "--lsl", name, "--seconds", "120"], words].concat());
    let mut child = command.stdout(Stdio::piped()).spawn().unwrap();
    let mut line = String::new();
    BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
    let opened: Value = serde_json::from_str(&line).unwrap_or_else(|e| panic!("{line:?}: {e}"));
    assert_eq!(opened["lsl"], name);
    Running(child)
}

/// Lines of a stream that still runs.
struct Live {
    _running: Running,
    lines: Lines<BufReader<ChildStdout>>,
}

impl Live {
    fn start(words: &[&str]) -> Live {
        let mut command = proact(&[&["stream", "--seconds", "120"], words].concat());
        let mut child = command.stdout(Stdio::piped()).spawn().unwrap();
        let lines = BufReader::new(child.stdout.take().unwrap()).lines();
        Live { _running: Running(child), lines }
    }

    /// The first line from now on that is as wanted.
    fn find(&mut self, wanted: impl Fn(&Value) -> bool) -> Value {
        let mut lines =
            self.lines.by_ref().map(|line| serde_json::from_str::<Value>(&line.unwrap()).unwrap());
        lines.find(wanted).expect("the stream ended before")
    }
}

fn decisions(lines: &[Value]) -> Vec<&Value> {
    lines.iter().filter(|l| l.get("event").is_none() && l["stale"] == false).collect()
}

/// Share of windows that were taken for `gesture`.
fn share(lines: &[Value], gesture: &str) -> f64 {
    let decisions = decisions(lines);
    let right = decisions.iter().filter(|l| l["window_class"] == gesture).count();
    right as f64 / decisions.len() as f64
}

#[test]
fn a_stream_goes_through_two_programs_and_its_classes_are_right() {
    let (first, second) = (name("first"), name("second"));
    let _simulator = simulator(&first, &["--gesture-sequence", "hand_close:1,wrist_flexion:1"]);
    let (from_first, from_second) = (format!("lsl:{first}"), format!("lsl:{second}"));
    let mut between = Live::start(&["--source", &from_first, "--lsl", &second]);
    between.find(|line| line["event"] == "open");
    let dir = tempfile::tempdir().unwrap();
    let record = dir.path().join("stream.csv");
    let lines = stream(&["--source", &from_second, "--seconds", "6", "--record", record.to_str().unwrap()]);

    let open = event(&lines, "open")[0];
    assert_eq!((&open["rate_hz"], &open["channels"]), (&1000.0.into(), &8.into()));
    let (close, flexion) = (share(&lines, "hand_close"), share(&lines, "wrist_flexion"));
    assert!(close > 0.3 && flexion > 0.3 && close + flexion > 0.95, "{close} and {flexion}");
    let end = event(&lines, "end")[0];
    assert_eq!((&end["link"]["lost_samples"], &end["link"]["resyncs"]), (&0.into(), &0.into()), "{end}");
    let recorded = proact_devices::read_recorded(&record).unwrap();
    assert!(recorded.samples.iter().zip(0..).all(|(sample, k)| sample.counter == k));
    assert_eq!(
        (recorded.rate_hz, Some(recorded.samples.len() as u64)),
        (1000.0, end["recorded_samples"].as_u64())
    );
    // Both programs run on this machine, thus on one clock. Samples are not from the future, but for the unsteadiness of
    // packets about the line that they are stamped by, and not older than their stream.
    let clock = |key: &str| end["clock"][key].as_f64().unwrap();
    assert!(clock("offset_secs").abs() <= clock("uncertainty_secs") + 1e-3, "{end}");
    assert!((-0.02..6.0).contains(&clock("mean_age_secs")), "{end}");
}

/// Processor time of a process, user and system, seconds.
fn processor_secs(pid: u32) -> f64 {
    /// What Linux counts in, whatever the machine (man 5 proc).
    const TICKS_A_SECOND: f64 = 100.0;
    let text = std::fs::read_to_string(format!("/proc/{pid}/stat")).unwrap();
    let fields: Vec<&str> = text.rsplit_once(')').unwrap().1.split_whitespace().collect();
    let ticks = |field: usize| fields[field].parse::<f64>().unwrap();
    (ticks(11) + ticks(12)) / TICKS_A_SECOND
}

/// From a grid's stream to decisions: recorded, trained on, recognised, all over the lab streaming layer. The share of a core that the
/// program takes is told, not judged: the machine is shared.
#[test]
fn a_grid_of_64_electrodes_at_4_khz_is_trained_on_and_recognised() {
    let held = [Command::NoMotion, Command::HandClose, Command::WristFlexion];
    let grid = |of: &str, schedule: &str| {
        let name = name(of);
        let words =
            ["--amplifier", "otb", "--emg-rate", "4000", "--seed", "3", "--gesture-sequence", schedule];
        (simulator(&name, &words), format!("lsl:{name}"))
    };
    let dir = tempfile::tempdir().unwrap();
    let names = held.map(Gesture::from);
    let folder = RecordingFolder::create(&dir.path().join("grid"), 4000.0, &names, names[0], &[]).unwrap();
    for gesture in held {
        let (_simulator, source) = grid(gesture.ros_name(), &format!("{}:100", gesture.ros_name()));
        let mut stream = LslSource::open(source.strip_prefix("lsl:"), false).unwrap();
        assert_eq!(
            (stream.info().channels, stream.info().rate_hz),
            (64, 4000.0),
            "auxiliary channels are left out"
        );
        let (mut packet, mut samples) = (EmgPacket::default(), Vec::new());
        // The hand is in its gesture from the second second on.
        while samples.len() < 36_000 {
            if stream.poll(Duration::from_secs(5), &mut packet).unwrap() == SourceEvent::Packet {
                samples.append(&mut packet.samples);
            }
        }
        for (repetition, part) in samples[4000..].chunks(16_000).enumerate() {
            folder.write_recording(&Recording::bridge_gaps(repetition as u32, gesture.into(), part)).unwrap();
        }
    }
    let model = dir.path().join("model.json");
    let recordings = format!("file:{}", folder.path().display());
    let words = ["train", "--source", &recordings, "--features", "MAV,WL", "--out", model.to_str().unwrap()];
    let trained = proact(&words).output().unwrap();
    assert!(trained.status.success(), "{}", String::from_utf8_lossy(&trained.stderr));

    let (_simulator, source) = grid("live", "no_motion:2,hand_close:2,wrist_flexion:2");
    let mut live = Live::start(&["--source", &source, "--model", model.to_str().unwrap()]);
    live.find(|line| line["stale"] == false);
    let (begin, before) = (Instant::now(), processor_secs(live._running.0.id()));
    for gesture in ["hand_close", "wrist_flexion", "no_motion", "hand_close"] {
        live.find(|line| line["gesture"] == gesture);
    }
    let share = (processor_secs(live._running.0.id()) - before) / begin.elapsed().as_secs_f64();
    println!("64 channels at 4 kHz over the lab streaming layer: {:.1} % of a core", 100.0 * share);
}

#[test]
fn lost_packets_are_gaps_of_their_length() {
    let name = name("lossy");
    let _simulator =
        simulator(&name, &["--gesture-sequence", "hand_open:1", "--loss-rate", "0.03", "--seed", "4"]);
    let lines = stream(&["--source", &format!("lsl:{name}"), "--seconds", "6"]);
    let gaps = event(&lines, "gap");
    assert!(!gaps.is_empty());
    assert!(gaps.iter().all(|gap| gap["lost_samples"].as_u64().unwrap() % 16 == 0), "{gaps:?}");
    let end = event(&lines, "end")[0];
    assert!(end["stream"]["rejected_windows"].as_u64() > Some(0), "{end}");
    assert!(share(&lines, "hand_open") > 0.95);
}

#[test]
fn a_sender_that_goes_away_stops_the_arm_and_is_found_again() {
    let name = name("absent");
    let first = simulator(&name, &["--gesture-sequence", "no_motion:1,hand_close:1"]);
    let mut live = Live::start(&["--source", &format!("lsl:{name}")]);
    live.find(|line| line["gesture"] == "hand_close");
    drop(first);
    let stale = live.find(|line| line["stale"] == true);
    assert_eq!(stale["gesture"], "no_motion");
    live.find(|line| line["event"] == "lost");
    // The hand was closed when the stream broke off, and still is: that alone must not start the arm.
    let second = simulator(&name, &["--gesture-sequence", "hand_close:60"]);
    live.find(|line| line["event"] == "restored");
    let gap = live.find(|line| line["event"] == "gap");
    assert!(gap["lost_samples"].as_u64() > Some(1000), "{gap}");
    for _ in 0..20 {
        let decision = live.find(|line| line["window_class"] == "hand_close" && line["stale"] == false);
        assert_eq!(decision["gesture"], "no_motion");
    }
    drop(second);
}

#[test]
fn streams_that_cannot_be_used_are_refused_with_the_reason() {
    let refused = |words: &[&str]| {
        let output = proact(words).output().unwrap();
        assert!(!output.status.success());
        String::from_utf8(output.stderr).unwrap()
    };
    let twice = name("twice");
    let _running = [simulator(&twice, &[]), simulator(&twice, &[])];
    let source = format!("lsl:{twice}");
    assert!(refused(&["stream", "--source", &source]).contains("several streams of this name"));
    let absent = format!("lsl:{}", name("nobody"));
    assert!(refused(&["stream", "--source", &absent]).contains("no stream of this name"));
    // Decisions are texts without a rate.
    let (chain, sender) = (name("chain"), name("sender"));
    let _simulator = simulator(&sender, &[]);
    let mut between = Live::start(&["--source", &format!("lsl:{sender}"), "--lsl", &chain]);
    between.find(|line| line["event"] == "open");
    let markers = format!("lsl:{chain}-decisions");
    assert!(refused(&["stream", "--source", &markers]).contains("nominal rate is 0"));
    assert!(refused(&["simulate", "--lsl", "it's"]).contains("quotation marks"));
    assert!(refused(&["simulate", "--lsl", "x", "--loss-rate", "NaN"]).contains("--loss-rate is NaN"));
}

#[test]
fn a_board_by_its_double_is_read_at_its_rate_with_its_electrodes_alone() {
    let name = name("board");
    let _board = simulator(&name, &["--amplifier", "brainflow"]);
    let lines = stream(&["--source", &format!("lsl:{name}"), "--seconds", "4"]);
    let open = event(&lines, "open")[0];
    assert_eq!((&open["rate_hz"], &open["channels"]), (&250.0.into(), &8.into()));
    assert_eq!(event(&lines, "end")[0]["link"]["lost_samples"], 0);
    let output = proact(&["simulate", "--lsl", "x", "--amplifier", "biosemi"]).output().unwrap();
    let error = String::from_utf8(output.stderr).unwrap();
    assert!(error.contains("expected one of delsys, otb, brainflow"), "{error}");
}

/// Python with pylsl, or none with a message.
fn peer() -> Option<PathBuf> {
    let checkout = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../build/peers");
    let python = std::env::var_os("PROACT_PEERS").map_or(checkout, PathBuf::from).join("bin/python3");
    let has = process::Command::new(&python).args(["-c", "import pylsl"]).output();
    if !has.is_ok_and(|output| output.status.success()) {
        println!("skipped: pylsl not found; ./proact peers gets it");
        return None;
    }
    Some(python)
}

fn peer_program(python: &Path, words: &[&str]) -> process::Command {
    let mut command = process::Command::new(python);
    let program = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/side_by_side/emg/lsl_peer.py");
    command.arg(program).args(words).stderr(Stdio::null());
    command
}

#[test]
fn what_pylsl_sends_arrives_whole_and_its_gap_is_found() {
    let Some(python) = peer() else { return };
    let name = name("pylsl");
    let _sender = Running(peer_program(&python, &["send", &name]).spawn().unwrap());
    let dir = tempfile::tempdir().unwrap();
    let record = dir.path().join("stream.csv");
    let source = format!("lsl:{name}");
    let lines = stream(&["--source", &source, "--seconds", "6", "--record", record.to_str().unwrap()]);
    let gaps = event(&lines, "gap");
    let found: Vec<_> =
        gaps.iter().map(|gap| (gap["lost_samples"].as_u64(), gap["next_sample"].as_u64())).collect();
    assert_eq!(found, [(Some(5), Some(3005))]);
    let recorded = proact_devices::read_recorded(&record).unwrap();
    assert!(recorded.samples.len() > 3500, "{}", recorded.samples.len());
    for sample in &recorded.samples {
        let sent: Vec<f64> = (0..8).map(|c| ((sample.counter + c) % 1000) as f64).collect();
        assert_eq!(sample.channels.as_slice(), sent);
    }
}

#[test]
fn pylsl_receives_samples_and_decisions() {
    let Some(python) = peer() else { return };
    let (sender, ours) = (name("sender-of-pylsl"), name("ours"));
    let _simulator = simulator(&sender, &["--gesture-sequence", "no_motion:1,hand_close:1"]);
    let mut live = Live::start(&["--source", &format!("lsl:{sender}"), "--lsl", &ours]);
    live.find(|line| line["gesture"] == "hand_close");
    let output = peer_program(&python, &["receive", &ours, "3000"]).output().unwrap();
    let got: Value = serde_json::from_slice(&output.stdout).unwrap_or_else(|e| panic!("{output:?}: {e}"));
    assert_eq!((&got["type"], &got["rate_hz"], &got["channels"]), (&"EMG".into(), &1000.0.into(), &8.into()));
    assert_eq!((&got["labels"][7], &got["widths"]), (&"EMG7".into(), &serde_json::json!([8])));
    // Stamps are even although samples leave in packets.
    let number = |key: &str| got[key].as_f64().unwrap();
    assert!(number("least_step") > 0.0004 && number("most_step") < 0.0016, "{got}");
    let gestures = got["gestures"].as_array().unwrap();
    for gesture in ["no_motion", "hand_close"] {
        assert!(gestures.iter().filter(|decision| decision[0] == gesture).count() > 5, "{got}");
    }
    for decision in gestures {
        let at = decision[1].as_f64().unwrap();
        assert!(at > number("first") - 1.0 && at <= number("last") + 1.0, "{at} in {got}");
    }
}

/// One number moves one joint, what is not finite stops it, and so does silence.
#[test]
fn the_method_of_one_number_follows_a_stream_and_stops_with_it() {
    let Some(python) = peer() else { return };
    let name = name("float");
    let outlet = format!(
        "import pylsl, sys\nout = pylsl.StreamOutlet(pylsl.StreamInfo('{name}', 'Command', 1, 0, 'float32'))\n\
         out.wait_for_consumers(30)\nfor line in sys.stdin:\n    out.push_sample([float(line)])\n"
    );
    let mut sender = process::Command::new(&python);
    let mut sender =
        sender.args(["-c", &outlet]).stdin(Stdio::piped()).stderr(Stdio::null()).spawn().unwrap();
    let mut numbers = sender.stdin.take().unwrap();
    let _sender = Running(sender);
    let program = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/methods/lsl_float.py");
    let mut method = process::Command::new(&python);
    method
        .arg(program)
        .args([&name, "3", "0.5"])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::null());
    let mut method = method.spawn().unwrap();
    let (mut steps, answers) = (method.stdin.take().unwrap(), method.stdout.take().unwrap());
    let mut answers = BufReader::new(answers).lines();
    let _method = Running(method);
    let mut time = 0;
    // Steps at their pace until the answer is as wanted; the last one.
    let mut until = |number: Option<&str>, wanted: &dyn Fn(&Value) -> bool| {
        let mut motion = Value::Null;
        for _ in 0..3000 {
            if let Some(number) = number {
                writeln!(numbers, "{number}").unwrap();
            }
            time += 10;
            writeln!(
                steps,
                "{}",
                serde_json::json!({ "time": time, "gesture": "no_motion", "commanded": vec![0.0; 7] })
            )
            .unwrap();
            let answer: Value = serde_json::from_str(&answers.next().unwrap().unwrap()).unwrap();
            assert_eq!(answer["time"], time);
            motion = answer["motion"].clone();
            if wanted(&motion) {
                return motion;
            }
            std::thread::sleep(std::time::Duration::from_millis(10));
        }
        panic!("the last answer was {motion}")
    };
    let elbow = |speed: f64| move |motion: &Value| motion["velocity"][3] == speed;
    let motion = until(Some("0.5"), &elbow(0.25));
    assert_eq!(motion["velocity"].as_array().unwrap().iter().filter(|speed| **speed != 0.0).count(), 1);
    until(Some("-7"), &elbow(-0.5));
    until(Some("nan"), &|motion| motion == "hold");
    until(Some("1"), &elbow(0.5));
    until(None, &|motion| motion == "hold");
}

/// Trials of a person send the markers of an experiment; a program that is told to end says so too.
#[test]
fn a_trial_begins_and_ends_with_markers_that_another_program_reads() {
    let Some(python) = peer() else { return };
    let name = name("markers");
    let reader = format!(
        "import pylsl, sys\ninlet = pylsl.StreamInlet(pylsl.resolve_byprop('name', '{name}', 1, 60)[0])\n\
         inlet.open_stream()\nwhile True:\n    sample, stamp = inlet.pull_sample(60)\n    print(sample[0], stamp, flush=True)\n"
    );
    let mut command = process::Command::new(&python);
    let mut read =
        command.args(["-c", &reader]).stdout(Stdio::piped()).stderr(Stdio::null()).spawn().unwrap();
    let mut markers = BufReader::new(read.stdout.take().unwrap()).lines();
    let _read = Running(read);
    // An eye tracker's port, so that time does not wait for the page.
    let words =
        ["serve", "--no-browser", "--no-record", "--port", "0", "--gaze-udp", "0", "--time-limit", "8"];
    let mut serve = process::Command::new(env!("CARGO_BIN_EXE_proact"));
    let serve = serve.args(words).args(["--markers-lsl", &name]).stdin(Stdio::null()).stderr(Stdio::null());
    let serve = Running(serve.stdout(Stdio::null()).spawn().unwrap());
    let mut next = || {
        let line = markers.next().unwrap().unwrap();
        let (marker, stamp) = line.split_once(' ').unwrap();
        (marker.to_owned(), stamp.parse::<f64>().unwrap())
    };
    // The first two may go out before the reader is connected.
    let mut received = vec![next()];
    while received.last().unwrap().0 != "2" {
        received.push(next());
    }
    if let [.., (one, began), (_, ended)] = received.as_slice() {
        assert_eq!(one, "1");
        assert!((7.9..9.0).contains(&(ended - began)), "{received:?}");
    }
    assert!(
        process::Command::new("sh")
            .args(["-c", &format!("kill -INT {}", serve.0.id())])
            .status()
            .unwrap()
            .success()
    );
    assert_eq!(next().0, "3");
}
