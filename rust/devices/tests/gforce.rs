//! The gForce driver against the simulator, over real sockets.
#![allow(clippy::unwrap_used, clippy::disallowed_methods)] // A test of links needs threads.

use proact_devices::{
    EmgPacket, SampleSource, SourceEvent,
    gforce::{
        GForce, GForceOptions, GForceSimulator, GForceSimulatorOptions, GattConnector, GattLink, LinkError,
        SocketLink, serve_connection,
    },
};
use std::{
    os::unix::net::UnixStream,
    sync::{
        Arc, Mutex,
        atomic::{AtomicBool, Ordering},
    },
    thread::JoinHandle,
    time::Duration,
};

/// Longest wait for anything; only a failing test waits so long.
const WAIT: Duration = Duration::from_secs(5);

/// Codes that tell which sample they are.
fn code(sample: u64) -> f64 {
    f64::from((sample.wrapping_mul(2_654_435_761) >> 8) as u8) - 128.0
}

fn simulator(options: GForceSimulatorOptions) -> GForceSimulator {
    let mut next = 0;
    let codes = move || {
        next += 1;
        [code(next - 1); 8].into_iter().collect()
    };
    GForceSimulator::new(options, Box::new(codes)).unwrap()
}

fn flawless() -> GForceSimulatorOptions {
    GForceSimulatorOptions::flawless(1000, 8)
}

/// Connects over a socket pair to a simulator on a thread of its own.
struct SimulatedConnector {
    simulator: Arc<Mutex<GForceSimulator>>,
    /// Ends the connection under way.
    disconnect: Arc<Mutex<Arc<AtomicBool>>>,
    thread: Option<JoinHandle<()>>,
    /// Attempts that fail before one succeeds again.
    failing_attempts: Arc<Mutex<u32>>,
}

#[derive(Clone)]
struct ConnectionHandle {
    disconnect: Arc<Mutex<Arc<AtomicBool>>>,
    failing_attempts: Arc<Mutex<u32>>,
}

impl ConnectionHandle {
    fn disconnect_and_fail(&self, failures: u32) {
        *self.failing_attempts.lock().unwrap() = failures;
        self.disconnect.lock().unwrap().store(true, Ordering::Relaxed);
    }
}

fn pair(options: GForceSimulatorOptions) -> (Box<SimulatedConnector>, ConnectionHandle) {
    let cut = Arc::new(Mutex::new(Arc::new(AtomicBool::new(false))));
    let deaf = Arc::new(Mutex::new(0));
    let handle = ConnectionHandle { disconnect: cut.clone(), failing_attempts: deaf.clone() };
    let simulator = Arc::new(Mutex::new(simulator(options)));
    (
        Box::new(SimulatedConnector { simulator, disconnect: cut, thread: None, failing_attempts: deaf }),
        handle,
    )
}

impl GattConnector for SimulatedConnector {
    fn connect(&mut self) -> Result<Box<dyn GattLink>, LinkError> {
        let mut deaf = self.failing_attempts.lock().unwrap();
        if *deaf > 0 {
            *deaf -= 1;
            return Err(LinkError::Radio("out of reach".to_owned()));
        }
        if let Some(thread) = self.thread.take() {
            thread.join().unwrap();
        }
        let (ours, theirs) = UnixStream::pair().unwrap();
        let stop = Arc::new(AtomicBool::new(false));
        *self.disconnect.lock().unwrap() = stop.clone();
        let simulator = self.simulator.clone();
        self.thread = Some(std::thread::spawn(move || {
            serve_connection(&mut SocketLink::new(theirs), &mut *simulator.lock().unwrap(), &stop);
        }));
        Ok(Box::new(SocketLink::new(ours)))
    }

    fn name(&self) -> String {
        "socket pair".to_owned()
    }
}

/// Polls until `count` packets came; every sample must be the one that its counter names.
/// Gaps and events.
fn collect(source: &mut GForce, count: usize) -> (Vec<(u64, u64)>, Vec<SourceEvent>) {
    let (mut packets, mut events) = (Vec::new(), Vec::new());
    let mut packet = EmgPacket::default();
    while packets.len() < count {
        match source.poll(WAIT, &mut packet).unwrap() {
            SourceEvent::Packet => {
                for sample in &packet.samples {
                    let expected = code(sample.counter) + 128.0;
                    assert!(
                        sample.channels.iter().all(|v| *v == expected),
                        "{sample:?}, expected {expected}"
                    );
                }
                packets.push((packet.samples[0].counter, packet.lost_before));
            }
            SourceEvent::Nothing => {}
            other => events.push(other),
        }
    }
    (packets, events)
}

#[test]
fn a_clean_stream_arrives_whole_with_the_settings_read_back() {
    let (pair, _) = pair(flawless());
    let mut source = GForce::open(pair, GForceOptions::default()).unwrap();
    let info = source.info().clone();
    assert_eq!((info.rate_hz, info.channels, info.packet_samples), (1000.0, 8, 16));
    assert_eq!((info.zero_code, info.rails, info.loss_is_counted), (128.0, Some((0.0, 255.0)), true));
    assert!(info.name.contains("firmware ProACT-sim-1"), "{}", info.name);
    assert_eq!(source.battery_percent(), Some(87));
    let (packets, events) = collect(&mut source, 20);
    assert_eq!(packets, (0..20).map(|n| (16 * n, 0)).collect::<Vec<_>>());
    assert!(events.is_empty());
}

#[test]
fn losses_doubles_swaps_and_cut_packets_become_gaps_and_nothing_else() {
    for notification_bytes in [244, 20] {
        let mut options = flawless();
        (options.loss_rate, options.duplicate_rate, options.reorder_rate, options.truncation_rate) =
            (0.01, 0.02, 0.01, 0.01);
        (options.notification_bytes, options.seed) = (notification_bytes, 4);
        // Smaller packets, so that there are many within a second.
        let small = GForceOptions { packet_bytes: 64, ..GForceOptions::default() };
        // With this seed the very first packet comes through, so that the counters are the simulator's.
        let (pair, _) = pair(options);
        let mut source = GForce::open(pair, small).unwrap();
        let (packets, _) = collect(&mut source, 150);
        let counts = source.counts();
        assert!(packets.iter().any(|(_, lost)| *lost > 0), "{counts:?}");
        assert_eq!(packets.iter().map(|(_, lost)| lost).sum::<u64>(), counts.lost_samples);
        assert!(counts.malformed + counts.broken_fragments > 0, "{counts:?}");
    }
}

#[test]
fn a_rate_that_the_armband_refuses_is_an_error_that_says_so() {
    let (pair, _) = pair(flawless());
    let options = GForceOptions { rate_hz: Some(650), ..GForceOptions::default() };
    let error = GForce::open(pair, options).err().unwrap().to_string();
    assert!(error.contains("refuses command 0x3f: bad parameter; ask for another rate"), "{error}");
    let (pair, _) = self::pair(flawless());
    let options = GForceOptions { rate_hz: Some(1000), bits: 12, ..GForceOptions::default() };
    let error = GForce::open(pair, options).err().unwrap().to_string();
    assert!(error.contains("EMG rate is 1000, expected 1 to 500 Hz at 12 bit"), "{error}");
}

#[test]
fn an_armband_without_ids_still_streams_and_says_that_losses_are_not_counted() {
    let (pair, _) = pair(GForceSimulatorOptions { package_ids: false, ..flawless() });
    let mut source = GForce::open(pair, GForceOptions::default()).unwrap();
    assert!(!source.info().loss_is_counted);
    assert_eq!(collect(&mut source, 5).0.len(), 5);
}

#[test]
fn a_lost_armband_is_reported_found_again_and_leaves_a_gap() {
    let (pair, handle) = pair(flawless());
    let simulator = pair.simulator.clone();
    let mut source = GForce::open(pair, GForceOptions::default()).unwrap();
    collect(&mut source, 5);
    handle.disconnect_and_fail(1);
    let mut packet = EmgPacket::default();
    let mut events = Vec::new();
    let mut before = 80;
    while !events.contains(&SourceEvent::Restored) {
        match source.poll(WAIT, &mut packet).unwrap() {
            SourceEvent::Packet => before = packet.samples.last().unwrap().counter + 1,
            event => events.push(event),
        }
    }
    assert!(matches!(&events[0], SourceEvent::Lost { reason } if reason.contains("closed")), "{events:?}");
    assert_eq!(source.poll(WAIT, &mut packet).unwrap(), SourceEvent::Packet);
    // The first attempt after 0.25 s fails, the second follows 0.5 s later: about 750 samples are missing.
    assert!((600..3000).contains(&packet.lost_before), "{}", packet.lost_before);
    assert_eq!(packet.samples[0].counter, before + packet.lost_before);
    assert_eq!(source.counts().disconnects, 1);
    drop(source);
    assert!(simulator.lock().unwrap().sample_count() > 0);
}

#[test]
fn nobody_at_the_address_is_an_error_with_the_address() {
    let connector = proact_devices::gforce::TcpConnector::new("127.0.0.1:1");
    let error = GForce::open(Box::new(connector), GForceOptions::default()).err().unwrap().to_string();
    assert!(error.contains("nothing answers at 127.0.0.1:1"), "{error}");
}

/// Bytes of the messages by the maker's protocol: 1 g along z, 2 deg/s about y, no turn.
#[test]
fn an_inertial_measurement_unit_has_messages_of_its_own_beside_those_of_the_electrodes() {
    use proact_devices::gforce::imu::{imu_messages, read_imu};
    let sent = [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, -2.0, 0.0];
    let [orientation, acceleration, velocity] = imu_messages(&sent);
    assert_eq!((orientation.len(), acceleration.len(), velocity.len()), (17, 13, 13));
    assert_eq!(orientation[..5], [0x05, 0x00, 0x00, 0x80, 0x3F]);
    assert_eq!((acceleration[0], &acceleration[9..]), (0x01, &[0x00, 0x00, 0x01, 0x00][..]));
    assert_eq!((velocity[0], &velocity[5..9]), (0x02, &[0x00, 0x00, 0xFE, 0xFF][..]));
    let mut read = [f64::NAN; 10];
    assert!([orientation, acceleration, velocity].iter().all(|message| read_imu(message, &mut read)));
    assert_eq!(read, sent);
    assert!(
        !read_imu(&[0x01, 0, 0], &mut read) && !read_imu(&[0x08; 13], &mut read) && !read_imu(&[], &mut read)
    );

    let (pair, _) = pair(flawless());
    let mut source = GForce::open(pair, GForceOptions { imu: true, ..GForceOptions::default() }).unwrap();
    assert_eq!((source.info().channels, source.info().imu.len()), (8, 10));
    assert!(!source.info().loss_is_counted, "nobody says how kinds of data share the numbers");
    let mut packet = EmgPacket::default();
    let mut all = Vec::new();
    while all.len() < 800 {
        if source.poll(Duration::from_secs(5), &mut packet).unwrap() == SourceEvent::Packet {
            all.append(&mut packet.samples);
        }
    }
    assert!(
        all.iter().zip(0..).all(|(sample, counter)| sample.counter == counter && sample.channels.len() == 18)
    );
    // Nothing is said before the first packet is over.
    assert!(all[0].channels[8..].iter().all(|value| value.is_nan()));
    let length = |k: usize| all[k].channels[12..15].iter().map(|v| v * v).sum::<f64>().sqrt();
    assert!((32..800).all(|k| (length(k) - 1.0).abs() < 0.2), "gravity");
    assert_eq!(source.counts().malformed, 0);
}
