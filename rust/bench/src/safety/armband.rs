//! The gForce driver with its simulator at the other end of a TCP connection.

use super::{DELIVERY_TIMEOUT, FailingSource, FailureMode, Outcome, wait_for};
use proact_app::{Arm, LiveArmband, trial};
use proact_control::MethodRegistry;
use proact_devices::{
    SyntheticEmg, SyntheticModel,
    gforce::{
        Characteristic, GForce, GForceOptions, GForceSimulator, GForceSimulatorOptions, GattLink,
        Notification, SocketLink, TcpConnector,
    },
    random_stream,
};
use proact_emg::{EmgConfig, EmgModel};
use proact_testbed::{RunningTrial, Setup, TrialConfig};
use proact_types::{Command, EmgSample};
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
const PACKET_SAMPLES: u64 = 16;
/// The code of zero volts.
const ZERO_VOLT_CODE: f64 = 128.0;
/// Samples of each gesture that the model is trained on.
const TRAINING_SAMPLES: u64 = 3000;

/// A trial of method A by a model of the simulator's own signal, and the simulator.
pub(super) fn device(death: FailureMode) -> Outcome<(RunningTrial, Box<dyn FailingSource>)> {
    let listener = TcpListener::bind("127.0.0.1:0")?;
    let address = listener.local_addr()?.to_string();
    let gesture = Arc::new(AtomicUsize::new(Command::NoMotion.index()));
    let mut generator = generator("emg/synthetic/feed")?;
    let made = gesture.clone();
    let codes = move || generator.next(Command::ALL[made.load(Ordering::Relaxed)]);
    let simulator =
        GForceSimulator::new(GForceSimulatorOptions::flawless(RATE_HZ, CHANNELS), Box::new(codes))?;
    let (orders, taken) = channel();
    let (sent, answers) = channel();
    std::thread::spawn(move || {
        // An end that fails is noticed by the other.
        let _ = ArmbandSimulator { listener, simulator, failure: death, frozen: None, packets: 0 }
            .serve(&taken, &sent);
    });
    let source = GForce::open(Box::new(TcpConnector::new(address)), GForceOptions::default())?;
    let armband = LiveArmband::start(Box::new(source), model()?);
    let config = TrialConfig::new("A", 1, Setup::named("still")?);
    let commands = config.command_map(EmgConfig::default().rest, &armband.model().classifier)?;
    let worn = trial::TrainedArmband { trained: armband.model(), samples: armband.new_port(commands) };
    let trial = trial::live_trial_with_armband(
        &MethodRegistry::standard(),
        &Arm::from_config(&config)?,
        config,
        Some(worn),
    )?
    .trial;
    let near = ArmbandSource {
        commands: orders,
        sent_counts: answers,
        armband,
        gesture,
        expected: 0,
        first_bad_tick: None,
    };
    Ok((trial, Box::new(near)))
}

fn generator(name: &str) -> Outcome<SyntheticEmg> {
    Ok(SyntheticEmg::new(
        &SyntheticModel::shipped()?,
        f64::from(RATE_HZ),
        CHANNELS,
        1.0,
        random_stream(1, name),
    )?)
}

/// Trained on the codes that the simulator sends.
fn model() -> Outcome<EmgModel> {
    let mut generator = generator("emg/synthetic/train")?;
    let mut recording = |gesture| -> Vec<EmgSample> {
        (0..TRAINING_SAMPLES)
            .map(|counter| {
                let codes = generator
                    .next(gesture)
                    .iter()
                    .map(|v| (v + ZERO_VOLT_CODE).round().clamp(0.0, 255.0))
                    .collect();
                EmgSample { counter, channels: codes }
            })
            .collect()
    };
    let recordings = Command::ALL.map(|gesture| (gesture, recording(gesture)));
    let slices: Vec<(Command, &[EmgSample])> = recordings.iter().map(|(g, s)| (*g, s.as_slice())).collect();
    Ok(EmgModel::train(&EmgConfig::default(), &[ZERO_VOLT_CODE; CHANNELS], &slices)?)
}

/// What the armband is told: to send all that is due at this time, alive or not.
struct SimulatorCommand {
    at: Duration,
    alive: bool,
}

/// This end: tells the other what time it is, and waits for what it sent.
struct ArmbandSource {
    commands: Sender<SimulatorCommand>,
    /// Samples sent, for each order.
    sent_counts: Receiver<u64>,
    armband: LiveArmband,
    gesture: Arc<AtomicUsize>,
    /// Samples that must have arrived.
    expected: u64,
    first_bad_tick: Option<u64>,
}

impl FailingSource for ArmbandSource {
    fn send_tick(
        &mut self,
        _trial: &mut RunningTrial,
        tick: u64,
        command: Command,
        lives: bool,
    ) -> Outcome<()> {
        self.gesture.store(command.index(), Ordering::Relaxed);
        if !tick.is_multiple_of(PACKET_SAMPLES) {
            return Ok(());
        }
        if !lives {
            // The packet that ends with this tick is the first that is bad.
            self.first_bad_tick.get_or_insert(tick + 1 - PACKET_SAMPLES);
            // The driver judges by the clock how much was lost in a silence, so it must last.
            std::thread::sleep(Duration::from_millis(PACKET_SAMPLES));
        }
        self.commands.send(SimulatorCommand { at: Duration::from_millis(tick), alive: lives })?;
        self.expected += self.sent_counts.recv()?;
        wait_for("a packet of the armband", || Ok(self.armband.received() >= self.expected))
    }

    fn first_bad_tick(&self) -> Option<u64> {
        self.first_bad_tick
    }
}

/// The armband's end, in a thread of its own.
struct ArmbandSimulator {
    listener: TcpListener,
    simulator: GForceSimulator,
    failure: FailureMode,
    /// The payload that is sent over and over.
    frozen: Option<Vec<u8>>,
    packets: u64,
}

impl ArmbandSimulator {
    fn serve(mut self, orders: &Receiver<SimulatorCommand>, sent: &Sender<u64>) -> Outcome<()> {
        let mut link = Some(self.accept_connection(Duration::ZERO)?);
        while let Ok(order) = orders.recv() {
            let now = order.at;
            if !order.alive && matches!(self.failure, FailureMode::Closed | FailureMode::Killed) {
                // A frame that was begun and never ends is what a killed program leaves behind.
                if let (FailureMode::Killed, Some(open)) = (self.failure, &mut link) {
                    let _ = open.write(Characteristic::Data, &[]);
                }
                link = None;
                self.simulator.disconnect();
            }
            if order.alive && link.is_none() {
                // It is switched on again, and the driver finds it.
                link = Some(self.accept_connection(now)?);
            }
            let mut samples = 0;
            for notification in self.simulator.advance(now) {
                if let (Some(bytes), Some(open)) = (self.corrupt(notification, order.alive), &mut link) {
                    open.write(Characteristic::Data, &bytes)?;
                    samples += if bytes[0] == EMG_MESSAGE { PACKET_SAMPLES } else { 0 };
                }
            }
            sent.send(samples)?;
        }
        Ok(())
    }

    /// A connection on which samples have been switched on, at `now`.
    fn accept_connection(&mut self, now: Duration) -> Outcome<SocketLink<TcpStream>> {
        let (socket, _) = self.listener.accept()?;
        socket.set_nodelay(true)?;
        let mut link = SocketLink::new(socket);
        let mut bytes = Vec::new();
        while self.simulator.next_due().is_none() {
            if link.next_notification(DELIVERY_TIMEOUT, &mut bytes)? == Some(Characteristic::Command) {
                for reply in self.simulator.write(&bytes, now) {
                    link.write(reply.characteristic, &reply.bytes)?;
                }
            }
        }
        Ok(link)
    }

    /// The packet as this death has it; none if it is not sent.
    fn corrupt(&mut self, notification: Notification, lives: bool) -> Option<Vec<u8>> {
        let mut bytes = notification.bytes;
        let payload = bytes.len().checked_sub(PAYLOAD_BYTES)?;
        if lives {
            self.frozen = Some(bytes[payload..].to_vec());
            return Some(bytes);
        }
        self.packets += 1;
        let last = self.frozen.clone()?;
        match self.failure {
            FailureMode::Silent | FailureMode::Closed | FailureMode::Killed => return None,
            // Every second one of those that are due: the others are lost, or were never made.
            FailureMode::HalfLost if self.packets % 2 == 1 => return None,
            FailureMode::HalfRate => return self.half_rate(bytes),
            FailureMode::Garbage => {
                for (k, byte) in bytes.iter_mut().enumerate() {
                    *byte = (k as u8).wrapping_mul(151) ^ 0x5a;
                }
            }
            FailureMode::Constant => {
                let sample = &last[PAYLOAD_BYTES - CHANNELS..];
                bytes[payload..].chunks_mut(CHANNELS).for_each(|codes| codes.copy_from_slice(sample));
            }
            FailureMode::Repeated => bytes[payload..].copy_from_slice(&last),
            FailureMode::Zeros => bytes[payload..].fill(0),
            FailureMode::Flat => {
                bytes[payload..]
                    .chunks_mut(CHANNELS)
                    .for_each(|codes| codes[FAULTY_CHANNEL] = ZERO_VOLT_CODE as u8);
            }
            FailureMode::Railed => {
                // Without a period: the channel above says which end.
                bytes[payload..]
                    .chunks_mut(CHANNELS)
                    .for_each(|codes| codes[FAULTY_CHANNEL] = 255 * (codes[FAULTY_CHANNEL + 1] & 1));
            }
            FailureMode::HalfLost | FailureMode::Blank => {}
        }
        Some(bytes)
    }

    /// Every second packet, numbered as if there were no others between.
    fn half_rate(&mut self, mut bytes: Vec<u8>) -> Option<Vec<u8>> {
        if self.packets % 2 == 1 {
            return None;
        }
        let skipped = (self.packets / 2) as u8;
        bytes[PACKAGE_ID_INDEX] = bytes[PACKAGE_ID_INDEX].wrapping_sub(skipped);
        Some(bytes)
    }
}

/// The channel that dies alone.
const FAULTY_CHANNEL: usize = 2;
/// First byte of a message with samples, and the place of the package id.
const EMG_MESSAGE: u8 = 0x08;
const PACKAGE_ID_INDEX: usize = 1;
/// Bytes of the codes of a packet.
const PAYLOAD_BYTES: usize = PACKET_SAMPLES as usize * CHANNELS;
