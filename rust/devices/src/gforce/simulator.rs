use super::{
    fragments::split_into_fragments,
    imu::imu_messages,
    protocol::{
        Characteristic, EMG_DATA, EmgCapability, EmgSetting, GForceCommand, GForceProtocolError,
        GForceReplyCode, SWITCH_EMG, SWITCH_IMU,
    },
};
use crate::{DeviceError, SimulatedImu, gforce::GattSimulator, random_stream};
use proact_types::{ChannelValues, Gesture};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use std::{
    sync::{Arc, Mutex, PoisonError},
    time::Duration,
};

/// What a simulated armband is and does wrong. Shares are of notifications, 0 to 1.
#[derive(Clone, Debug, PartialEq)]
pub struct GForceSimulatorOptions {
    /// The rate of the samples that it replays; it refuses every other.
    pub rate_hz: u16,
    /// Channels of the samples.
    pub channels: usize,
    /// It knows package ids.
    pub package_ids: bool,
    /// Most bytes of a notification: the MTU less 3. Longer packets are cut into fragments. 20 is the least that a
    /// radio does.
    pub notification_bytes: usize,
    /// Charge, per cent.
    pub battery_percent: u8,
    /// Share of notifications that are lost.
    pub loss_rate: f64,
    /// Share that come twice.
    pub duplicate_rate: f64,
    /// Share that come after the next one.
    pub reorder_rate: f64,
    /// Share whose end is missing.
    pub truncation_rate: f64,
    /// Longest delay of a packet; each has its own.
    pub jitter: Duration,
    /// Seeds every fault.
    pub seed: u64,
}

impl GForceSimulatorOptions {
    /// A flawless armband with the samples' `rate_hz` and `channels`, and notifications that hold whole packets.
    pub fn flawless(rate_hz: u16, channels: usize) -> GForceSimulatorOptions {
        GForceSimulatorOptions {
            rate_hz,
            channels,
            package_ids: true,
            notification_bytes: 244,
            battery_percent: 87,
            loss_rate: 0.0,
            duplicate_rate: 0.0,
            reorder_rate: 0.0,
            truncation_rate: 0.0,
            jitter: Duration::ZERO,
            seed: 0,
        }
    }

    /// Checks every value.
    ///
    /// # Errors
    /// The first impossible one.
    pub fn check(&self) -> Result<(), DeviceError> {
        let shares = [
            ("loss", self.loss_rate),
            ("dup", self.duplicate_rate),
            ("reorder", self.reorder_rate),
            ("truncate", self.truncation_rate),
        ];
        for (name, value) in shares {
            if !(0.0..=1.0).contains(&value) {
                return Err(DeviceError::Parameter { name, value, expected: "a share, 0 to 1" });
            }
        }
        let wrong = |name, value: f64, expected| Err(DeviceError::Parameter { name, value, expected });
        if !(1..=16).contains(&self.channels) {
            return wrong("channels of the simulator", self.channels as f64, "1 to 16");
        }
        if !(1..=1000).contains(&self.rate_hz) {
            return wrong("EMG rate of the simulator", self.rate_hz.into(), "1 to 1000 Hz");
        }
        if self.notification_bytes < 20 {
            return wrong("bytes of a notification", self.notification_bytes as f64, "at least 20");
        }
        Ok(())
    }
}

/// Where the samples come from, one call each: signed codes of 8 bit about zero. They are shifted to the zero level
/// and clipped, as the converter would; at 12 bit they are sixteen times finer in name only.
pub type CodeSource = Box<dyn FnMut() -> ChannelValues + Send>;

/// First byte of a write that tells the simulated person what is asked for; the gesture's name follows.
/// No command of the armband has this number, and no radio carries it.
pub(crate) const PROMPT_OPCODE: u8 = 0xF0;

/// What the simulated person was asked for last; clones share it.
#[derive(Clone, Debug, Default)]
pub struct SharedPrompt(Arc<Mutex<Option<Gesture>>>);

impl SharedPrompt {
    /// The gesture asked for; none before anybody asks, and after the connection ends.
    pub fn get(&self) -> Option<Gesture> {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(crate) fn set(&self, gesture: Option<Gesture>) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = gesture;
    }
}

/// A notification that is due.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Notification {
    /// When, since the simulator was made.
    pub due: Duration,
    /// On which characteristic.
    pub characteristic: Characteristic,
    /// Its bytes.
    pub bytes: Vec<u8>,
}

/// An armband without radio and without clock: takes commands, gives notifications with the times at which they are
/// due. Byte for byte that of the protocol, with faults if asked for.
pub struct GForceSimulator {
    options: GForceSimulatorOptions,
    codes: CodeSource,
    rng: ChaCha8Rng,
    setting: EmgSetting,
    package_ids: bool,
    imu: Option<SimulatedImu>,
    /// When samples were switched on, and the packets made since then.
    streaming: Option<(Duration, u64)>,
    motor_on: bool,
    prompted: SharedPrompt,
    sample_count: u64,
    /// Kept back to come after the next.
    delayed: Option<Notification>,
}

impl GForceSimulator {
    /// An armband that is switched on and sends nothing yet.
    ///
    /// # Errors
    /// Impossible options.
    pub fn new(options: GForceSimulatorOptions, codes: CodeSource) -> Result<GForceSimulator, DeviceError> {
        options.check()?;
        let mask = ((1_u32 << options.channels) - 1) as u16;
        let sample = options.channels;
        let setting = EmgSetting {
            rate_hz: options.rate_hz,
            channel_mask: mask,
            packet_bytes: (128 / sample * sample) as u8,
            bits: 8,
        };
        Ok(GForceSimulator {
            rng: random_stream(options.seed, "emg/simulator"),
            options,
            codes,
            setting,
            package_ids: false,
            imu: None,
            streaming: None,
            motor_on: false,
            prompted: SharedPrompt::default(),
            sample_count: 0,
            delayed: None,
        })
    }

    /// Hands what the person is asked for over the link to `prompted`, for the source of the codes to follow.
    pub fn with_prompts(mut self, prompted: SharedPrompt) -> GForceSimulator {
        self.prompted = prompted;
        self
    }

    /// The link is gone: samples and package ids go off, the settings stay, as on a device.
    pub fn disconnect(&mut self) {
        self.streaming = None;
        self.delayed = None;
        self.package_ids = false;
        self.prompted.set(None);
    }

    /// Samples sent or lost so far, over all connections.
    pub fn sample_count(&self) -> u64 {
        self.sample_count
    }

    /// The vibration motor runs.
    pub fn is_motor_on(&self) -> bool {
        self.motor_on
    }

    /// Executes what was written to the command characteristic at `now`; the reply's notifications.
    pub fn write(&mut self, bytes: &[u8], now: Duration) -> Vec<Notification> {
        let Some(&opcode) = bytes.first() else { return Vec::new() };
        if let Some(name) = bytes.strip_prefix(&[PROMPT_OPCODE]) {
            // What is no name is no prompt.
            self.prompted.set(std::str::from_utf8(name).ok().and_then(|name| name.parse().ok()));
            return Vec::new();
        }
        let (code, body) = match GForceCommand::from_bytes(bytes) {
            Err(GForceProtocolError::Opcode { .. }) => (GForceReplyCode::NotSupported, Vec::new()),
            Err(_) => (GForceReplyCode::BadParameter, Vec::new()),
            Ok(command) => self.execute(command, now),
        };
        let reply = [&[code.to_byte(), opcode], &body[..]].concat();
        let notification = |bytes| Notification { due: now, characteristic: Characteristic::Command, bytes };
        split_into_fragments(&reply, self.options.notification_bytes).into_iter().map(notification).collect()
    }

    fn execute(&mut self, command: GForceCommand, now: Duration) -> (GForceReplyCode, Vec<u8>) {
        let body = match command {
            GForceCommand::Firmware => b"ProACT-sim-1".to_vec(),
            GForceCommand::Battery => vec![self.options.battery_percent],
            GForceCommand::Motor(on) => {
                self.motor_on = on;
                Vec::new()
            }
            GForceCommand::Led(_) => Vec::new(),
            GForceCommand::PackageId(_) if !self.options.package_ids => {
                return (GForceReplyCode::NotSupported, Vec::new());
            }
            GForceCommand::PackageId(on) => {
                self.package_ids = on;
                Vec::new()
            }
            GForceCommand::EmgCapability => EmgCapability {
                max_rate_hz: self.options.rate_hz,
                channels: self.options.channels as u16,
                max_packet_bytes: 128,
            }
            .to_bytes()
            .to_vec(),
            GForceCommand::SetEmg(setting) => {
                let possible = setting.check().is_ok()
                    && setting.rate_hz == self.options.rate_hz
                    && setting.channel_mask == self.setting.channel_mask
                    && setting.packet_bytes <= 128;
                if !possible {
                    return (GForceReplyCode::BadParameter, Vec::new());
                }
                self.setting = setting;
                Vec::new()
            }
            GForceCommand::GetEmg => self.setting.to_bytes().to_vec(),
            GForceCommand::DataSwitch(flags) => {
                let on = flags & SWITCH_EMG != 0;
                let imu = on && flags & SWITCH_IMU == SWITCH_IMU;
                self.imu =
                    imu.then(|| self.imu.take().unwrap_or_else(|| SimulatedImu::new(self.options.seed)));
                // Switching on what is on changes nothing.
                self.streaming = if on { self.streaming.or(Some((now, 0))) } else { None };
                Vec::new()
            }
        };
        (GForceReplyCode::Ok, body)
    }

    /// When the next packet's last sample is converted.
    pub fn next_due(&self) -> Option<Duration> {
        self.streaming.map(|(since, packets)| since + self.time_of_packets(packets + 1))
    }

    /// The notifications of the packets complete at `now`, with the times at which they are due: not before their
    /// last sample, and later by their jitter.
    pub fn advance(&mut self, now: Duration) -> Vec<Notification> {
        let mut out = Vec::new();
        while let Some(due) = self.next_due().filter(|due| *due <= now) {
            let Some((since, packets)) = self.streaming else { break };
            self.streaming = Some((since, packets + 1));
            let mut messages = vec![self.packet(packets)];
            // After each packet: 62.5 times a second at the usual settings. The maker names no rate.
            if let Some(imu) = &mut self.imu {
                messages.extend(imu_messages(&imu.sample()));
            }
            let jitter = self.options.jitter.mul_f64(self.rng.random_range(0.0..=1.0));
            let max_bytes = self.options.notification_bytes;
            for bytes in messages.iter().flat_map(|message| split_into_fragments(message, max_bytes)) {
                self.send_with_faults(
                    Notification { due: due + jitter, characteristic: Characteristic::Data, bytes },
                    &mut out,
                );
            }
        }
        out
    }

    fn time_of_packets(&self, packets: u64) -> Duration {
        let samples = packets * self.setting.packet_samples() as u64;
        Duration::from_secs_f64(samples as f64 / f64::from(self.setting.rate_hz))
    }

    fn packet(&mut self, number: u64) -> Vec<u8> {
        let mut bytes = vec![EMG_DATA];
        if self.package_ids {
            bytes.push(number as u8);
        }
        let (zero, highest) = (self.setting.zero_code(), self.setting.max_code());
        let scale = if self.setting.bits > 8 { 16.0 } else { 1.0 };
        for _ in 0..self.setting.packet_samples() {
            let values = (self.codes)();
            self.sample_count += 1;
            for value in values.iter().take(self.options.channels) {
                let code = (value * scale + zero).round().clamp(0.0, highest) as u16;
                bytes.extend(&code.to_le_bytes()[..self.setting.code_bytes()]);
            }
        }
        bytes
    }

    /// Sends through the faulty air.
    fn send_with_faults(&mut self, mut notification: Notification, out: &mut Vec<Notification>) {
        // Each is drawn every time, so that one fault does not move the others.
        let [lost, twice, swapped, short] = [
            self.options.loss_rate,
            self.options.duplicate_rate,
            self.options.reorder_rate,
            self.options.truncation_rate,
        ]
        .map(|share| self.rng.random_bool(share));
        if lost {
            return;
        }
        if short {
            let length = self.rng.random_range(0..notification.bytes.len());
            notification.bytes.truncate(length);
        }
        if swapped && self.delayed.is_none() {
            self.delayed = Some(notification);
            return;
        }
        let due = notification.due;
        out.extend(twice.then(|| notification.clone()));
        out.push(notification);
        out.extend(self.delayed.take().map(|late| Notification { due: due.max(late.due), ..late }));
    }
}

impl GattSimulator for GForceSimulator {
    fn write(&mut self, characteristic: Characteristic, bytes: &[u8], now: Duration) -> Vec<Notification> {
        match characteristic {
            Characteristic::Command => GForceSimulator::write(self, bytes, now),
            _ => Vec::new(),
        }
    }

    fn next_due(&self) -> Option<Duration> {
        GForceSimulator::next_due(self)
    }

    fn advance(&mut self, now: Duration) -> Vec<Notification> {
        GForceSimulator::advance(self, now)
    }

    fn disconnect(&mut self) {
        GForceSimulator::disconnect(self);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn simulator(change: impl FnOnce(&mut GForceSimulatorOptions)) -> GForceSimulator {
        let mut options = GForceSimulatorOptions::flawless(1000, 8);
        change(&mut options);
        let mut next = 0.0;
        let codes = move || {
            next += 1.0;
            (0..8).map(|c| f64::from(c) * 100.0 - next).collect()
        };
        GForceSimulator::new(options, Box::new(codes)).unwrap()
    }

    fn reply(simulator: &mut GForceSimulator, bytes: &[u8]) -> Vec<u8> {
        let replies = simulator.write(bytes, Duration::ZERO);
        assert_eq!(replies.len(), 1);
        assert_eq!(replies[0].characteristic, Characteristic::Command);
        replies[0].bytes.clone()
    }

    #[test]
    fn commands_are_answered_byte_for_byte() {
        let mut simulator = simulator(|_| {});
        let mut reply_to = |bytes: &[u8]| reply(&mut simulator, bytes);
        assert_eq!(reply_to(&[0x3F, 0xE8, 0x03, 0xFF, 0x00, 0x80, 0x08]), [0x00, 0x3F]);
        assert_eq!(reply_to(&[0x46]), [0x00, 0x46, 0xE8, 0x03, 0xFF, 0x00, 0x80, 0x08]);
        assert_eq!(reply_to(&[0x3F, 0x8A, 0x02, 0xFF, 0x00, 0x80, 0x08]), [0x02, 0x3F], "650 Hz");
        assert_eq!(reply_to(&[0x3F, 0xE8]), [0x02, 0x3F], "cut short");
        assert_eq!(reply_to(&[0x08]), [0x00, 0x08, 87]);
        assert_eq!(reply_to(&[0x24, 0x01]), [0x00, 0x24]);
        assert_eq!(reply_to(&[0x26, 0x01]), [0x00, 0x26]);
        assert_eq!(reply_to(&[0x3E]), [0x00, 0x3E, 0xE8, 0x03, 0x08, 0x00, 0x80]);
        assert_eq!(reply_to(&[0x1D]), [0x01, 0x1D], "power off is not served");
        assert_eq!(reply_to(&[0x4F, 0x80, 0, 0, 0]), [0x00, 0x4F]);
        assert!(simulator.is_motor_on());
    }

    #[test]
    fn packets_come_by_the_clock_of_sixteen_samples_with_type_and_id_in_front() {
        let mut simulator = simulator(|_| {});
        simulator.write(&[0x26, 1], Duration::ZERO);
        simulator.write(&[0x4F, 0x80, 0, 0, 0], Duration::from_millis(5));
        assert_eq!(simulator.next_due(), Some(Duration::from_millis(21)));
        assert!(simulator.advance(Duration::from_millis(20)).is_empty());
        let packets = simulator.advance(Duration::from_millis(53));
        assert_eq!(packets.iter().map(|p| p.due.as_millis()).collect::<Vec<_>>(), [21, 37, 53]);
        assert_eq!(packets[2].bytes.len(), 130);
        assert_eq!(packets[2].bytes[..2], [0x08, 2]);
        // First sample: channel 0 is -1, channel 2 would be 327 and is cut off.
        assert_eq!(packets[0].bytes[2..6], [127, 227, 255, 255]);
        simulator.write(&[0x4F, 0, 0, 0, 0], Duration::from_millis(60));
        assert!(simulator.advance(Duration::from_secs(1)).is_empty());
    }

    #[test]
    fn without_ids_a_packet_is_129_bytes_and_at_the_smallest_mtu_eight_fragments() {
        let mut simulator = simulator(|o| (o.package_ids, o.notification_bytes) = (false, 20));
        assert_eq!(reply(&mut simulator, &[0x26, 1]), [0x01, 0x26]);
        simulator.write(&[0x4F, 0x80, 0, 0, 0], Duration::ZERO);
        let pieces = simulator.advance(Duration::from_millis(16));
        assert_eq!(pieces.iter().map(|p| p.bytes[1]).collect::<Vec<_>>(), [7, 6, 5, 4, 3, 2, 1, 0]);
        assert_eq!(pieces.iter().map(|p| p.bytes.len() - 2).sum::<usize>(), 129);
    }

    #[test]
    fn faults_come_as_often_as_asked_for_and_the_same_for_the_same_seed() {
        let ids = |change: fn(&mut GForceSimulatorOptions)| {
            let mut simulator = simulator(change);
            simulator.write(&[0x26, 1], Duration::ZERO);
            simulator.write(&[0x4F, 0x80, 0, 0, 0], Duration::ZERO);
            simulator.advance(Duration::from_secs(16)).into_iter().map(|p| p.bytes).collect::<Vec<_>>()
        };
        assert_eq!(ids(|_| {}).len(), 1000);
        let lossy = ids(|o| o.loss_rate = 0.1);
        assert!((850..950).contains(&lossy.len()), "{}", lossy.len());
        assert_eq!(lossy, ids(|o| o.loss_rate = 0.1));
        assert_ne!(lossy, ids(|o| (o.loss_rate, o.seed) = (0.1, 1)));
        assert!((1050..1150).contains(&ids(|o| o.duplicate_rate = 0.1).len()));
        assert!(ids(|o| o.reorder_rate = 0.1).windows(2).any(|w| w[1][1].wrapping_add(1) == w[0][1]));
        assert!(ids(|o| o.truncation_rate = 0.1).iter().any(|p| p.len() < 130));
    }

    #[test]
    fn impossible_options_are_refused() {
        let refused = |change: fn(&mut GForceSimulatorOptions)| {
            let mut options = GForceSimulatorOptions::flawless(1000, 8);
            change(&mut options);
            options.check().unwrap_err().to_string()
        };
        assert!(refused(|o| o.loss_rate = f64::NAN).contains("loss is NaN"));
        assert!(refused(|o| o.duplicate_rate = 1.5).contains("dup is 1.5"));
        assert!(refused(|o| o.channels = 0).contains("channels of the simulator is 0"));
        assert!(refused(|o| o.rate_hz = 0).contains("EMG rate of the simulator is 0"));
        assert!(refused(|o| o.notification_bytes = 19).contains("at least 20"));
    }
}
