//! The gForce driver with its simulator at the other end of a TCP connection.

use super::{Death, Device, Outcome, PATIENCE, wait_for};
use proact_app::{Arm, LiveArmband, trial};
use proact_control::MethodRegistry;
use proact_devices::{
    SyntheticEmg, SyntheticModel,
    gforce::{
        Characteristic, GForce, GForceOptions, GattLink, Notification, Simulator, SimulatorOptions,
        SocketLink, TcpConnector,
    },
    stream,
};
use proact_emg::{EmgConfig, EmgModel};
use proact_testbed::{Session, Setup, TrialConfig};
use proact_types::{EmgSample, Gesture};
use std::{
    net::{TcpListener, TcpStream},
    sync::{
        Arc,
        atomic::{AtomicUsize, Ordering},
        mpsc::{Receiver, Sender, channel},
    },
    time::Duration,
};

const RATE_HZ: u16 = 1000;
const CHANNELS: usize = 8;
/// Samples in a packet of 128 bytes, which is as many milliseconds.
const PACKET: u64 = 16;
/// The code of zero volts.
const ZERO: f64 = 128.0;
/// Samples of each gesture that the model is trained on.
const TRAINING: u64 = 3000;

/// A trial of method A by a model of the simulator's own signal, and the simulator.
pub(super) fn device(death: Death) -> Outcome<(Session, Box<dyn Device>)> {
    let listener = TcpListener::bind("127.0.0.1:0")?;
    let address = listener.local_addr()?.to_string();
    let gesture = Arc::new(AtomicUsize::new(Gesture::NoMotion.index()));
    let mut generator = generator("emg/synthetic/feed")?;
    let made = gesture.clone();
    let codes = move || generator.next(Gesture::ALL[made.load(Ordering::Relaxed)]);
    let simulator = Simulator::new(SimulatorOptions::flawless(RATE_HZ, CHANNELS), Box::new(codes))?;
    let (orders, taken) = channel();
    let (sent, answers) = channel();
    std::thread::spawn(move || {
        // An end that fails is noticed by the other.
        let _ = Far { listener, simulator, death, frozen: None, packets: 0 }.serve(&taken, &sent);
    });
    let source = GForce::open(Box::new(TcpConnector::new(address)), GForceOptions::default())?;
    let armband = LiveArmband::start(Box::new(source), model()?);
    let config = TrialConfig::new("A", 1, Setup::named("still")?);
    let commands = config.gesture_commands(EmgConfig::default().rest, &armband.model().classifier)?;
    let worn = trial::Armband { trained: armband.model(), samples: armband.port(commands) };
    let session =
        trial::live_with(&MethodRegistry::standard(), &Arm::of(&config)?, config, Some(worn))?.session;
    let near = Near { orders, answers, armband, gesture, expected: 0, first_bad: None };
    Ok((session, Box::new(near)))
}

fn generator(name: &str) -> Outcome<SyntheticEmg> {
    Ok(SyntheticEmg::new(&SyntheticModel::shipped()?, f64::from(RATE_HZ), CHANNELS, 1.0, stream(1, name))?)
}

/// Trained on the codes that the simulator sends.
fn model() -> Outcome<EmgModel> {
    let mut generator = generator("emg/synthetic/train")?;
    let mut recording = |gesture| -> Vec<EmgSample> {
        (0..TRAINING)
            .map(|counter| {
                let codes =
                    generator.next(gesture).iter().map(|v| (v + ZERO).round().clamp(0.0, 255.0)).collect();
                EmgSample { counter, channels: codes }
            })
            .collect()
    };
    let recordings = Gesture::ALL.map(|gesture| (gesture, recording(gesture)));
    let slices: Vec<(Gesture, &[EmgSample])> = recordings.iter().map(|(g, s)| (*g, s.as_slice())).collect();
    Ok(EmgModel::train(&EmgConfig::default(), &[ZERO; CHANNELS], &slices)?)
}

/// What the armband is told: to send all that is due at this time, alive or not.
struct Order {
    at: Duration,
    lives: bool,
}

/// This end: tells the other what time it is, and waits for what it sent.
struct Near {
    orders: Sender<Order>,
    /// Samples sent, for each order.
    answers: Receiver<u64>,
    armband: LiveArmband,
    gesture: Arc<AtomicUsize>,
    /// Samples that must have arrived.
    expected: u64,
    first_bad: Option<u64>,
}

impl Device for Near {
    fn feed(&mut self, _session: &mut Session, tick: u64, gesture: Gesture, lives: bool) -> Outcome<()> {
        self.gesture.store(gesture.index(), Ordering::Relaxed);
        if !tick.is_multiple_of(PACKET) {
            return Ok(());
        }
        if !lives {
            // The packet that ends with this tick is the first that is bad.
            self.first_bad.get_or_insert(tick + 1 - PACKET);
            // The driver judges by the clock how much was lost in a silence, so it must last.
            std::thread::sleep(Duration::from_millis(PACKET));
        }
        self.orders.send(Order { at: Duration::from_millis(tick), lives })?;
        self.expected += self.answers.recv()?;
        wait_for("a packet of the armband", || Ok(self.armband.received() >= self.expected))
    }

    fn first_bad(&self) -> Option<u64> {
        self.first_bad
    }
}

/// The armband's end, in a thread of its own.
struct Far {
    listener: TcpListener,
    simulator: Simulator,
    death: Death,
    /// The payload that is sent over and over.
    frozen: Option<Vec<u8>>,
    packets: u64,
}

impl Far {
    fn serve(mut self, orders: &Receiver<Order>, sent: &Sender<u64>) -> Outcome<()> {
        let mut link = Some(self.connected(Duration::ZERO)?);
        while let Ok(order) = orders.recv() {
            let now = order.at;
            if !order.lives && matches!(self.death, Death::Closed | Death::Killed) {
                // A frame that was begun and never ends is what a killed program leaves behind.
                if let (Death::Killed, Some(open)) = (self.death, &mut link) {
                    let _ = open.write(Characteristic::Data, &[]);
                }
                link = None;
                self.simulator.disconnect();
            }
            if order.lives && link.is_none() {
                // It is switched on again, and the driver finds it.
                link = Some(self.connected(now)?);
            }
            let mut samples = 0;
            for notification in self.simulator.advance(now) {
                if let (Some(bytes), Some(open)) = (self.spoil(notification, order.lives), &mut link) {
                    open.write(Characteristic::Data, &bytes)?;
                    samples += if bytes[0] == EMG { PACKET } else { 0 };
                }
            }
            sent.send(samples)?;
        }
        Ok(())
    }

    /// A connection on which samples have been switched on, at `now`.
    fn connected(&mut self, now: Duration) -> Outcome<SocketLink<TcpStream>> {
        let (socket, _) = self.listener.accept()?;
        socket.set_nodelay(true)?;
        let mut link = SocketLink::new(socket);
        let mut bytes = Vec::new();
        while self.simulator.next_due().is_none() {
            if link.next_notification(PATIENCE, &mut bytes)? == Some(Characteristic::Command) {
                for reply in self.simulator.write(&bytes, now) {
                    link.write(reply.characteristic, &reply.bytes)?;
                }
            }
        }
        Ok(link)
    }

    /// The packet as this death has it; none if it is not sent.
    fn spoil(&mut self, notification: Notification, lives: bool) -> Option<Vec<u8>> {
        let mut bytes = notification.bytes;
        let payload = bytes.len().checked_sub(PAYLOAD)?;
        if lives {
            self.frozen = Some(bytes[payload..].to_vec());
            return Some(bytes);
        }
        self.packets += 1;
        let last = self.frozen.clone()?;
        match self.death {
            Death::Silent | Death::Closed | Death::Killed => return None,
            // Every second one of those that are due: the others are lost, or were never made.
            Death::HalfLost if self.packets % 2 == 1 => return None,
            Death::HalfRate => return self.half_rate(bytes),
            Death::Garbage => {
                for (k, byte) in bytes.iter_mut().enumerate() {
                    *byte = (k as u8).wrapping_mul(151) ^ 0x5a;
                }
            }
            Death::Constant => {
                let sample = &last[PAYLOAD - CHANNELS..];
                bytes[payload..].chunks_mut(CHANNELS).for_each(|codes| codes.copy_from_slice(sample));
            }
            Death::Repeated => bytes[payload..].copy_from_slice(&last),
            Death::Zeros => bytes[payload..].fill(0),
            Death::Flat => {
                bytes[payload..].chunks_mut(CHANNELS).for_each(|codes| codes[SICK] = ZERO as u8);
            }
            Death::Railed => {
                // Without a period: the channel above says which end.
                bytes[payload..]
                    .chunks_mut(CHANNELS)
                    .for_each(|codes| codes[SICK] = 255 * (codes[SICK + 1] & 1));
            }
            Death::HalfLost | Death::Blank => {}
        }
        Some(bytes)
    }

    /// Every second packet, numbered as if there were no others between.
    fn half_rate(&mut self, mut bytes: Vec<u8>) -> Option<Vec<u8>> {
        if self.packets % 2 == 1 {
            return None;
        }
        let skipped = (self.packets / 2) as u8;
        bytes[ID] = bytes[ID].wrapping_sub(skipped);
        Some(bytes)
    }
}

/// The channel that dies alone.
const SICK: usize = 2;
/// First byte of a message with samples, and the place of the package id.
const EMG: u8 = 0x08;
const ID: usize = 1;
/// Bytes of the codes of a packet.
const PAYLOAD: usize = PACKET as usize * CHANNELS;
