//! The Myo driver against the simulator, over real sockets.
#![allow(clippy::unwrap_used, clippy::disallowed_methods)] // A test of links needs threads and sockets.

use proact_devices::{
    EmgPacket, SampleSource, SourceEvent, SourceOptions, SourceRegistry,
    gforce::{TcpConnector, serve},
    myo::{Myo, MyoEmgMode, MyoSimulator, MyoSimulatorOptions},
};
use proact_emg::ImuChannel;
use proact_types::EmgSample;
use std::{
    net::{SocketAddr, TcpListener},
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    thread::JoinHandle,
    time::{Duration, Instant},
};

/// Longest wait for anything; only a failing test waits so long.
const WAIT: Duration = Duration::from_secs(5);

/// A simulator on a thread of its own until it is dropped.
struct Served {
    address: SocketAddr,
    stop: Arc<AtomicBool>,
    disconnected: Arc<AtomicBool>,
    thread: Option<JoinHandle<MyoSimulator>>,
}

impl Served {
    fn new(port: u16, loss: f64) -> Served {
        let listener = TcpListener::bind(("127.0.0.1", port)).unwrap();
        let address = listener.local_addr().unwrap();
        let options =
            MyoSimulatorOptions { battery_percent: 64, loss_rate: loss, ..MyoSimulatorOptions::default() };
        // Each sample tells its own number, modulo 256.
        let mut next = 0_u8;
        let codes = move || {
            next = next.wrapping_add(1);
            [f64::from(i8::from_le_bytes([next])); 8].into_iter().collect()
        };
        let mut simulator = MyoSimulator::new(options, Box::new(codes)).unwrap();
        let stop = Arc::new(AtomicBool::new(false));
        let disconnected = Arc::new(AtomicBool::new(false));
        let (stop_server, gone) = (stop.clone(), disconnected.clone());
        let thread = std::thread::spawn(move || {
            let report = |event: &str| gone.store(event.starts_with("disconnected"), Ordering::Relaxed);
            serve(&listener, &mut simulator, &stop_server, report).unwrap();
            simulator
        });
        Served { address, stop, disconnected, thread: Some(thread) }
    }

    fn end(mut self) -> MyoSimulator {
        self.stop.store(true, Ordering::Relaxed);
        self.thread.take().unwrap().join().unwrap()
    }
}

impl Drop for Served {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
    }
}

fn open(served: &Served) -> Myo {
    Myo::open(Box::new(TcpConnector::new(served.address.to_string())), MyoEmgMode::Filtered, false).unwrap()
}

/// The next `packets` packets' samples.
fn samples(source: &mut dyn SampleSource, packets: usize) -> Vec<EmgSample> {
    let (mut packet, mut all) = (EmgPacket::default(), Vec::new());
    for _ in 0..packets {
        assert_eq!(source.poll(WAIT, &mut packet).unwrap(), SourceEvent::Packet);
        all.append(&mut packet.samples);
    }
    all
}

/// The counter goes on as the numbers within the samples do.
fn counted(samples: &[EmgSample]) -> bool {
    samples.windows(2).all(|pair| {
        let step = (pair[1].channels[0] - pair[0].channels[0]).rem_euclid(256.0);
        (pair[1].counter - pair[0].counter) as f64 == step
    })
}

#[test]
fn a_myo_streams_two_hundred_samples_a_second_of_eight_channels() {
    let served = Served::new(0, 0.0);
    let mut myo = open(&served);
    let info = myo.info().clone();
    assert!(info.name.starts_with("Myo, firmware 1.5.1970, simulator at"), "{}", info.name);
    assert_eq!((info.rate_hz, info.channels, info.packet_samples), (200.0, 8, 2));
    assert_eq!((info.rails, myo.battery_percent()), (Some((-128.0, 127.0)), Some(64)));
    let all = samples(&mut myo, 100);
    assert!(all.len() == 200 && counted(&all));
    assert_eq!((myo.counts().packets, myo.counts().lost_samples), (100, 0));
    drop(myo);
    let begin = Instant::now();
    while !served.disconnected.load(Ordering::Relaxed) && begin.elapsed() < WAIT {
        std::thread::yield_now();
    }
    let simulator = served.end();
    assert_eq!((simulator.mode(), simulator.may_sleep()), (MyoEmgMode::Off, true), "it may rest");
}

#[test]
fn lost_notifications_are_steps_of_the_counter() {
    let served = Served::new(0, 0.05);
    let mut myo = open(&served);
    let all = samples(&mut myo, 200);
    assert!(counted(&all));
    let lost = all[399].counter - all[0].counter - 399;
    assert!(lost > 0 && myo.counts().lost_samples >= lost, "{lost}");
}

#[test]
fn a_myo_that_goes_away_is_found_again_and_the_counter_steps_over_its_absence() {
    let served = Served::new(0, 0.0);
    let port = served.address.port();
    let mut myo = open(&served);
    let before = samples(&mut myo, 10);
    drop(served.end());
    let mut packet = EmgPacket::default();
    let mut event = || loop {
        match myo.poll(WAIT, &mut packet).unwrap() {
            SourceEvent::Packet | SourceEvent::Nothing => {}
            event => return event,
        }
    };
    assert!(matches!(event(), SourceEvent::Lost { .. }));
    let _again = Served::new(port, 0.0);
    assert_eq!(event(), SourceEvent::Restored);
    let after = samples(&mut myo, 1);
    assert!(after[0].counter > before[19].counter + 2, "{} after {}", after[0].counter, before[19].counter);
    assert_eq!(myo.counts().disconnects, 1);
}

#[test]
fn the_registry_opens_it_at_its_one_rate_only() {
    let served = Served::new(0, 0.0);
    let Ok(name) = format!("myo-sim://{}", served.address).parse();
    let registry = SourceRegistry::standard();
    let at = |rate_hz| SourceOptions { rate_hz, ..SourceOptions::default() };
    let error = registry.open(&name, &at(Some(1000))).err().unwrap().to_string();
    assert!(error.contains("200 Hz, the one rate of a Myo"), "{error}");
    assert_eq!(registry.open(&name, &at(Some(200))).unwrap().info().channels, 8);
}

#[test]
fn the_inertial_measurement_unit_follows_the_electrodes_in_every_sample() {
    let served = Served::new(0, 0.0);
    let address = TcpConnector::new(served.address.to_string());
    let mut myo = Myo::open(Box::new(address), MyoEmgMode::Filtered, true).unwrap();
    assert_eq!((myo.info().channels, &myo.info().imu), (8, &ImuChannel::armband_channels()));
    let all = samples(&mut myo, 100);
    assert!(counted(&all), "its notifications are no samples of the electrodes");
    assert!(all.iter().all(|sample| sample.channels.len() == 18));
    let acceleration = |sample: &EmgSample| sample.channels[12..15].to_vec();
    let length = |a: &[f64]| a.iter().map(|v| v * v).sum::<f64>().sqrt();
    assert!(all.iter().all(|sample| (length(&acceleration(sample)) - 1.0).abs() < 0.2), "gravity");
    // A value every four samples.
    let changes = all.windows(2).filter(|pair| acceleration(&pair[0]) != acceleration(&pair[1])).count();
    assert!((45..=50).contains(&changes), "{changes}");
    assert_eq!((myo.counts().lost_samples, myo.counts().malformed), (0, 0));
}

#[test]
fn a_source_without_an_inertial_measurement_unit_is_refused_where_one_is_asked_for() {
    let options = SourceOptions { imu: true, ..SourceOptions::default() };
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("stream.csv");
    std::fs::write(&path, "counter,device_s,received_s,ch0\n0,0,0,1\n1,0.005,0,2\n").unwrap();
    let Ok(name) = format!("file:{}", path.display()).parse();
    let error = SourceRegistry::standard().open(&name, &options).err().unwrap().to_string();
    assert!(error.contains("it has no inertial measurement unit, which --imu"), "{error}");
    let Ok(name) = "synthetic".parse();
    assert_eq!(SourceRegistry::standard().open(&name, &options).unwrap().info().imu.len(), 10);
}
