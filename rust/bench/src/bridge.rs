//! `proact bench bridge`: the page's stream and rosbridge under load, with their clients in the same process.
//!
//! A client's clock is the server's clock, so lateness is measured directly. The server's share of a core is the
//! processor time of its own thread and of the thread that publishes; the clients' is left out.

mod load;

use crate::{BenchFigure, BenchReport, quantile};
pub(crate) use load::WebSocketClient;
pub(crate) use load::cpu_of_all_threads;
use load::{MessageLatencies, cpu_of_this_thread, cpu_of_threads, spawn_reader};
use proact_bridge::{PageContent, PageOptions, PageServer};
use proact_rosbridge::{HeadsetTopics, LocalBus, RosbridgeOptions, RosbridgeServer, TopicBus};
use proact_types::{DisplayFrame, SimTime};
use serde_json::json;
use std::{
    error::Error,
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    time::{Duration, Instant},
};

/// Clients of a scene.
const CLIENTS: usize = 10;
/// Frames of a scene: eight seconds at 60 Hz.
const FRAMES: usize = 480;
/// Length of the text in a message, bytes.
const TEXT_BYTES: usize = 100;
/// How long an offered rate must be kept up.
const LOAD_SECS: f64 = 2.0;
/// Rates offered, messages a second, until one is not delivered whole with 99 % below [`MAX_LATENCY_MS`].
const RATES_TO_ONE: [f64; 8] = [10e3, 20e3, 30e3, 40e3, 50e3, 60e3, 70e3, 80e3];
const RATES_TO_BOTH: [f64; 4] = [10e3, 20e3, 30e3, 40e3];
const RATES_TO_TEN: [f64; 8] = [1e3, 2e3, 3e3, 5e3, 7e3, 10e3, 15e3, 20e3];
const MAX_LATENCY_MS: f64 = 100.0;
/// Messages there and back, at 100 Hz.
const ROUND_TRIPS: usize = 500;

const PEER: &str = "rosbridge_suite";
const PEER_NOTE: &str = "peer measured separately on a 2-core machine, not in this run";

type Outcome<T> = Result<T, Box<dyn Error>>;

/// Scene to ten clients by page and by rosbridge, throughput, round trip, and a client that stops reading. About
/// a minute.
pub(crate) fn bridge() -> Outcome<BenchReport> {
    let mut figures = Vec::new();
    let (late, core) = page_scene(CLIENTS)?;
    scene_figures(&mut figures, "page, 60 Hz to 10 clients", &late, core);
    let (late, core) = app_scene(CLIENTS, 0)?;
    scene_figures(&mut figures, "rosbridge, all app topics at 60 Hz to 10 clients", &late, core);

    let (late, _) = app_scene(CLIENTS - 1, 1)?;
    let name = "rosbridge, worst lateness beside a client that stops reading";
    let note = format!("9 clients of 10, {} frames lost; {PEER_NOTE}", late.lost());
    figures.push(
        BenchFigure::without_peer(name, quantile(&late.ms, 1.0), "ms", &note).with_peer(PEER, 13_000.0),
    );

    for (readers, rates, goal, peer) in
        [(1, RATES_TO_ONE, 40_000, 4_000.0), (10, RATES_TO_TEN, 50_000, 5_000.0)]
    {
        let (rate, latency) = max_sustained_rate(&MessageLoad::strings(readers), &rates)?;
        let name = format!("rosbridge, delivered to {readers}, 100-byte strings");
        let note = format!(
            "all delivered, 99 % within {latency:.1} ms; goal: at least {goal}; highest rate offered: {:.0}; {PEER_NOTE}",
            rates[rates.len() - 1] * readers as f64
        );
        figures.push(
            BenchFigure::without_peer(&name, rate * readers as f64, "msg/s", &note).with_peer(PEER, peer),
        );
    }

    let (rate, latency) = max_sustained_rate(&MessageLoad::headers_to_both(), &RATES_TO_BOTH)?;
    let note = format!(
        "all delivered, 99 % within {latency:.1} ms; each message is written in both forms; highest rate offered: {:.0}",
        RATES_TO_BOTH[RATES_TO_BOTH.len() - 1] * 2.0
    );
    let name = "rosbridge, headers of 100 bytes delivered to a client of ROS 1 and one of ROS 2";
    figures.push(BenchFigure::without_peer(name, rate * 2.0, "msg/s", &note));

    let trips = round_trips()?;
    for (name, share) in [("median", 0.5), ("99 %", 0.99), ("worst", 1.0)] {
        let note = if share == 0.99 { format!("goal: below 1; {PEER_NOTE}") } else { String::new() };
        let figure = BenchFigure::without_peer(
            &format!("rosbridge, round trip at 100 Hz, {name}"),
            quantile(&trips, share),
            "ms",
            &note,
        );
        figures.push(if share == 0.99 { figure.with_peer(PEER, 3.0) } else { figure });
    }
    Ok(BenchReport::new("bridge", figures))
}

fn scene_figures(figures: &mut Vec<BenchFigure>, name: &str, late: &MessageLatencies, core: f64) {
    let in_time = late.ms.iter().filter(|ms| **ms < 5.0).count() as f64 / late.expected as f64;
    let note = format!("goal: at least 0.99; {} of {} frames lost", late.lost(), late.expected);
    figures.push(BenchFigure::without_peer(&format!("{name}, share below 5 ms late"), in_time, "1", &note));
    let figure = |what: &str, share, note| {
        BenchFigure::without_peer(&format!("{name}, lateness {what}"), quantile(&late.ms, share), "ms", note)
    };
    figures.push(figure("median", 0.5, ""));
    figures.push(figure("99 %", 0.99, ""));
    let note = "server and publishing threads; goal: below 0.25";
    figures.push(BenchFigure::without_peer(&format!("{name}, share of a core"), core, "1", note));
}

/// A frame of a real trial's start.
fn first_frame() -> Outcome<(DisplayFrame, PageContent)> {
    use proact_testbed::{Setup, TrialConfig};
    let config = TrialConfig::new("D", 1, Setup::named("still")?);
    let assembly = proact_app::trial::live_trial(config)?;
    let mut trial = assembly.trial;
    let frame = loop {
        if let Some(frame) = trial.step(false)?.frame {
            break *frame;
        }
    };
    let scene = trial.testbed().task().scene().clone();
    let briefing = trial.testbed().task().briefing().clone();
    let arm = assembly.arm.model().as_ref().clone();
    let (title, setup) = ("bench".to_owned(), "still".to_owned());
    Ok((
        frame,
        PageContent {
            title,
            setup,
            arm,
            meshes: Vec::new(),
            scene,
            briefing,
            interactive: false,
            lean: false,
            method: Default::default(),
            methods: vec![],
        },
    ))
}

/// Publishes [`FRAMES`] frames at 60 Hz; when each was, by its number.
fn publish_at_60_hz(frame: &mut DisplayFrame, mut publish: impl FnMut(&DisplayFrame)) -> Vec<Instant> {
    let start = Instant::now();
    let mut sent = Vec::with_capacity(FRAMES);
    for n in 0..FRAMES {
        let due = start + Duration::from_secs_f64(n as f64 / 60.0);
        std::thread::sleep(due.saturating_duration_since(Instant::now()));
        frame.time = SimTime(n as u64);
        sent.push(Instant::now());
        publish(frame);
    }
    sent
}

/// The page's stream to so many clients: how late each frame was, and the share of a core.
pub(crate) fn page_scene(clients: usize) -> Outcome<(MessageLatencies, f64)> {
    let (mut frame, content) = first_frame()?;
    let server = PageServer::start(PageOptions { port: 0, ..PageOptions::default() }, content)?;
    let address = server.url().replacen("http", "ws", 1) + "live";
    let links = (0..clients).map(|_| WebSocketClient::open(&address)).collect::<Result<Vec<_>, _>>()?;
    let ended = Arc::new(AtomicBool::new(false));
    let readers: Vec<_> = links.into_iter().map(|link| spawn_reader(link, "\"time\":", &ended)).collect();
    let (start, before) = (Instant::now(), cpu_of_threads("page-server")? + cpu_of_this_thread()?);
    let sent = publish_at_60_hz(&mut frame, |frame| server.publish(frame));
    let core =
        (cpu_of_threads("page-server")? + cpu_of_this_thread()? - before) / start.elapsed().as_secs_f64();
    Ok((MessageLatencies::collect(readers, &sent, &ended)?, core))
}

/// The app's topics to `readers` clients, beside `stuck` ones that subscribe and read nothing.
fn app_scene(readers: usize, stuck: usize) -> Outcome<(MessageLatencies, f64)> {
    let (mut frame, content) = first_frame()?;
    let (server, bus) = serve()?;
    let topics = HeadsetTopics::new(Arc::clone(&bus), &content.arm, &content.scene, frame.world_from_head)?;
    let address = format!("ws://{}/", server.address());
    let subscribed = || -> Outcome<WebSocketClient> {
        let mut link = WebSocketClient::open(&address)?;
        for topic in bus.graph().topics.keys() {
            link.send(&json!({"op": "subscribe", "topic": topic, "queue_length": 1}))?;
        }
        link.wait_until_handled()?;
        Ok(link)
    };
    let links = (0..readers).map(|_| subscribed()).collect::<Result<Vec<_>, _>>()?;
    let _silent = (0..stuck).map(|_| subscribed()).collect::<Result<Vec<_>, _>>()?;
    let ended = Arc::new(AtomicBool::new(false));
    // The joint states close to the end of a frame stand for all of it.
    let readers: Vec<_> =
        links.into_iter().map(|link| spawn_reader(link, "wrapped_joint_states", &ended)).collect();
    let (start, before) = (Instant::now(), cpu_of_threads("rosbridge")? + cpu_of_this_thread()?);
    let sent = publish_at_60_hz(&mut frame, |frame| topics.publish(frame));
    let core =
        (cpu_of_threads("rosbridge")? + cpu_of_this_thread()? - before) / start.elapsed().as_secs_f64();
    Ok((MessageLatencies::collect(readers, &sent, &ended)?, core))
}

fn serve() -> Outcome<(RosbridgeServer, Arc<dyn TopicBus>)> {
    let bus: Arc<dyn TopicBus> = LocalBus::new();
    let options = RosbridgeOptions { port: 0, ..RosbridgeOptions::default() };
    Ok((RosbridgeServer::start(options, Arc::clone(&bus))?, bus))
}

/// The highest of `rates` that reaches all readers whole, and its 99 % latency in milliseconds; zero if none does.
fn max_sustained_rate(load: &MessageLoad, rates: &[f64]) -> Outcome<(f64, f64)> {
    let mut best = (0.0, 0.0);
    for &rate in rates {
        let Some(latency) = throughput(load, rate)? else { break };
        best = (rate, latency);
    }
    Ok(best)
}

/// What is sent to whom.
struct MessageLoad {
    /// Type of the messages, with a text in the field `field`.
    type_name: &'static str,
    field: &'static str,
    /// What stands before the text as it arrives.
    prefix: &'static str,
    /// The type as each reader names it.
    readers: Vec<&'static str>,
}

impl MessageLoad {
    fn strings(readers: usize) -> Self {
        let type_name = "std_msgs/String";
        Self { type_name, field: "data", prefix: "\"data\":\"", readers: vec![type_name; readers] }
    }

    /// Headers differ between the two ROS.
    fn headers_to_both() -> Self {
        let readers = vec!["std_msgs/Header", "std_msgs/msg/Header"];
        Self { type_name: "std_msgs/Header", field: "frame_id", prefix: "\"frame_id\":\"", readers }
    }
}

/// One client publishes at `rate`, the others read: the 99 % latency, or none if not all arrived in time.
fn throughput(load: &MessageLoad, rate: f64) -> Outcome<Option<f64>> {
    let (server, _bus) = serve()?;
    let address = format!("ws://{}/", server.address());
    let mut writer = WebSocketClient::open(&address)?;
    writer.send(&json!({"op": "advertise", "topic": "/load", "type": load.type_name}))?;
    writer.wait_until_handled()?;
    let subscribed = |type_name: &&str| -> Outcome<WebSocketClient> {
        let mut link = WebSocketClient::open(&address)?;
        link.send(&json!({"op": "subscribe", "topic": "/load", "type": type_name}))?;
        link.wait_until_handled()?;
        Ok(link)
    };
    let links = load.readers.iter().map(subscribed).collect::<Result<Vec<_>, _>>()?;
    let ended = Arc::new(AtomicBool::new(false));
    let readers: Vec<_> = links.into_iter().map(|link| spawn_reader(link, load.prefix, &ended)).collect();
    let count = (rate * LOAD_SECS) as usize;
    let mut sent = Vec::with_capacity(count);
    let start = Instant::now();
    let filler = "x".repeat(TEXT_BYTES - 9);
    while sent.len() < count {
        std::thread::sleep(Duration::from_millis(2));
        let due = ((start.elapsed().as_secs_f64() * rate) as usize).min(count);
        while sent.len() < due {
            let text = format!("{:08} {filler}", sent.len());
            let field = load.field;
            writer.enqueue(format!(r#"{{"op":"publish","topic":"/load","msg":{{"{field}":"{text}"}}}}"#))?;
            sent.push(Instant::now());
        }
        writer.flush()?;
    }
    // A server that cannot keep up holds the writer back; then the rate was not kept.
    let kept = start.elapsed().as_secs_f64() < LOAD_SECS * 1.05;
    let late = MessageLatencies::collect(readers, &sent, &ended)?;
    let latency = if late.ms.is_empty() { f64::INFINITY } else { quantile(&late.ms, 0.99) };
    Ok((kept && late.lost() == 0 && latency < MAX_LATENCY_MS).then_some(latency))
}

/// Milliseconds that a message takes to the server and back to the client that sent it.
fn round_trips() -> Outcome<Vec<f64>> {
    let (server, _bus) = serve()?;
    let mut link = WebSocketClient::open(&format!("ws://{}/", server.address()))?;
    link.send(&json!({"op": "advertise", "topic": "/echo", "type": "std_msgs/String"}))?;
    link.send(&json!({"op": "subscribe", "topic": "/echo"}))?;
    link.wait_until_handled()?;
    let start = Instant::now();
    let mut times = Vec::with_capacity(ROUND_TRIPS);
    for n in 0..ROUND_TRIPS {
        let due = start + Duration::from_millis(10 * n as u64);
        std::thread::sleep(due.saturating_duration_since(Instant::now()));
        let begin = Instant::now();
        link.send(&json!({"op": "publish", "topic": "/echo", "msg": {"data": "x".repeat(TEXT_BYTES)}}))?;
        link.read()?;
        times.push(begin.elapsed().as_secs_f64() * 1e3);
    }
    Ok(times)
}

/// Tells the readers that nothing more comes.
fn stop_readers(ended: &AtomicBool) {
    ended.store(true, Ordering::Relaxed);
}
