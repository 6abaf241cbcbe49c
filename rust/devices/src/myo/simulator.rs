use super::protocol::{
    CHANNELS, EMG_CHARACTERISTIC_ORDER, IMU_RATE_HZ, MyoCommand, MyoEmgMode, MyoVibration, PACKET_SAMPLES,
    RATE_HZ, imu_bytes,
};
use crate::{
    DeviceError, SimulatedImu,
    gforce::{Characteristic, CodeSource, GattSimulator, Notification, PROMPT_OPCODE, SharedPrompt},
    random_stream,
};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use std::time::Duration;

/// What a simulated Myo is and does wrong.
#[derive(Clone, Debug, PartialEq)]
pub struct MyoSimulatorOptions {
    /// Charge, per cent.
    pub battery_percent: u8,
    /// Share of notifications that are lost, 0 to 1.
    pub loss_rate: f64,
    /// Longest delay of a notification; each has its own.
    pub jitter: Duration,
    /// Seeds the faults.
    pub seed: u64,
}

impl Default for MyoSimulatorOptions {
    fn default() -> Self {
        MyoSimulatorOptions { battery_percent: 87, loss_rate: 0.0, jitter: Duration::ZERO, seed: 0 }
    }
}

/// Notifications of samples for one of the inertial measurement unit.
const PACKETS_PER_IMU_SAMPLE: u64 = (RATE_HZ / IMU_RATE_HZ) as u64 / PACKET_SAMPLES as u64;

/// A Myo without radio and without clock, byte for byte that of the published protocol.
pub struct MyoSimulator {
    options: MyoSimulatorOptions,
    codes: CodeSource,
    rng: ChaCha8Rng,
    mode: MyoEmgMode,
    imu: Option<SimulatedImu>,
    may_sleep: bool,
    vibration: Option<MyoVibration>,
    /// When samples were switched on, and the notifications made since then.
    streaming: Option<(Duration, u64)>,
    prompted: SharedPrompt,
}

impl MyoSimulator {
    /// A Myo that is switched on and sends nothing yet. `codes` gives samples of eight channels at 200 Hz.
    ///
    /// # Errors
    /// A loss that is no share.
    pub fn new(options: MyoSimulatorOptions, codes: CodeSource) -> Result<MyoSimulator, DeviceError> {
        let value = options.loss_rate;
        if !(0.0..=1.0).contains(&value) {
            return Err(DeviceError::Parameter { name: "loss", value, expected: "a share, 0 to 1" });
        }
        Ok(MyoSimulator {
            rng: random_stream(options.seed, "emg/simulator/myo"),
            imu: None,
            options,
            codes,
            mode: MyoEmgMode::Off,
            may_sleep: true,
            vibration: None,
            streaming: None,
            prompted: SharedPrompt::default(),
        })
    }

    /// Hands what the person is asked for over the link to `prompted`, for the source of the codes to follow.
    pub fn with_prompts(mut self, prompted: SharedPrompt) -> MyoSimulator {
        self.prompted = prompted;
        self
    }

    /// What it was asked to send.
    pub fn mode(&self) -> MyoEmgMode {
        self.mode
    }

    /// It may fall asleep when nobody moves.
    pub fn may_sleep(&self) -> bool {
        self.may_sleep
    }

    /// The vibration asked for last.
    pub fn vibration(&self) -> Option<MyoVibration> {
        self.vibration
    }

    fn execute(&mut self, command: MyoCommand, now: Duration) {
        match command {
            MyoCommand::SetMode { emg: mode, imu } => {
                self.mode = mode;
                // Of an armband that does not move from where it is; its noise goes on where it was switched off.
                self.imu =
                    imu.then(|| self.imu.take().unwrap_or_else(|| SimulatedImu::new(self.options.seed)));
                // Switching on what is on changes nothing.
                self.streaming =
                    if mode == MyoEmgMode::Off { None } else { self.streaming.or(Some((now, 0))) };
            }
            MyoCommand::Vibrate(kind) => self.vibration = Some(kind),
            MyoCommand::MaySleep(may) => self.may_sleep = may,
            MyoCommand::UserAction => self.vibration = Some(MyoVibration::Short),
        }
    }

    fn packet(&mut self) -> Vec<u8> {
        let mut bytes = Vec::with_capacity(PACKET_SAMPLES * CHANNELS);
        for _ in 0..PACKET_SAMPLES {
            let values = (self.codes)();
            let code =
                |channel: usize| values.get(channel).copied().unwrap_or(0.0).round().clamp(-128.0, 127.0);
            bytes.extend((0..CHANNELS).map(|channel| (code(channel) as i8).to_le_bytes()[0]));
        }
        bytes
    }
}

impl GattSimulator for MyoSimulator {
    fn write(&mut self, characteristic: Characteristic, bytes: &[u8], now: Duration) -> Vec<Notification> {
        let answer = |bytes: &[u8]| vec![Notification { due: now, characteristic, bytes: bytes.to_vec() }];
        match characteristic {
            // What is read is asked for by an empty write; the radio has a request of its own for it.
            Characteristic::Firmware => answer(&[1, 0, 5, 0, 0xB2, 0x07, 2, 0]),
            Characteristic::Battery => answer(&[self.options.battery_percent]),
            Characteristic::Command => {
                if let Some(name) = bytes.strip_prefix(&[PROMPT_OPCODE]) {
                    // What is no name is no prompt.
                    self.prompted.set(std::str::from_utf8(name).ok().and_then(|name| name.parse().ok()));
                } else if let Some(command) = MyoCommand::from_bytes(bytes) {
                    self.execute(command, now);
                }
                Vec::new()
            }
            _ => Vec::new(),
        }
    }

    fn next_due(&self) -> Option<Duration> {
        let (since, sent) = self.streaming?;
        let samples = (sent + 1) * PACKET_SAMPLES as u64;
        Some(since + Duration::from_secs_f64(samples as f64 / f64::from(RATE_HZ)))
    }

    fn advance(&mut self, now: Duration) -> Vec<Notification> {
        let mut out = Vec::new();
        while let Some(due) = self.next_due().filter(|due| *due <= now) {
            let Some((since, sent)) = self.streaming else { break };
            self.streaming = Some((since, sent + 1));
            let bytes = self.packet();
            // Each is drawn every time, so that one fault does not move the other.
            let late = self.options.jitter.mul_f64(self.rng.random_range(0.0..=1.0));
            if !self.rng.random_bool(self.options.loss_rate) {
                let characteristic =
                    EMG_CHARACTERISTIC_ORDER[(sent % EMG_CHARACTERISTIC_ORDER.len() as u64) as usize];
                out.push(Notification { due: due + late, characteristic, bytes });
            }
            if let Some(imu) = self.imu.as_mut().filter(|_| sent.is_multiple_of(PACKETS_PER_IMU_SAMPLE)) {
                let bytes = imu_bytes(&imu.sample()).to_vec();
                out.push(Notification { due: due + late, characteristic: Characteristic::Imu, bytes });
            }
        }
        out
    }

    fn disconnect(&mut self) {
        // The settings stay, as on a device.
        self.streaming = None;
        self.prompted.set(None);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn simulator(change: impl FnOnce(&mut MyoSimulatorOptions)) -> MyoSimulator {
        let mut options = MyoSimulatorOptions::default();
        change(&mut options);
        let mut next = 0.0;
        let codes = move || {
            next += 1.0;
            (0..8).map(|c| f64::from(c) * 50.0 - next).collect()
        };
        MyoSimulator::new(options, Box::new(codes)).unwrap()
    }

    #[test]
    fn two_samples_of_eight_signed_bytes_come_on_the_four_characteristics_in_turn() {
        let mut myo = simulator(|_| {});
        assert!(myo.write(Characteristic::Command, &[0x09, 1, 1], Duration::ZERO).is_empty());
        myo.write(Characteristic::Command, &[0x01, 3, 2, 0, 0], Duration::from_millis(5));
        assert_eq!((myo.mode(), myo.may_sleep()), (MyoEmgMode::Filtered, false));
        assert!(myo.advance(Duration::from_millis(14)).is_empty());
        let sent = myo.advance(Duration::from_millis(65));
        assert_eq!(sent.iter().map(|n| n.due.as_millis()).collect::<Vec<_>>(), [15, 25, 35, 45, 55, 65]);
        let turn: Vec<Characteristic> = sent.iter().map(|n| n.characteristic).collect();
        assert_eq!(
            turn,
            [
                EMG_CHARACTERISTIC_ORDER[0],
                EMG_CHARACTERISTIC_ORDER[1],
                EMG_CHARACTERISTIC_ORDER[2],
                EMG_CHARACTERISTIC_ORDER[3],
                EMG_CHARACTERISTIC_ORDER[0],
                EMG_CHARACTERISTIC_ORDER[1]
            ]
        );
        // -1, 49, 99, 149 cut off, ..; then one less.
        assert_eq!(sent[0].bytes[..4], [0xFF, 49, 99, 127]);
        assert_eq!(sent[0].bytes[8..11], [0xFE, 48, 98]);
        assert!(sent.iter().all(|n| n.bytes.len() == 16));
        myo.write(Characteristic::Command, &[0x01, 3, 0, 0, 0], Duration::from_millis(70));
        assert!(myo.advance(Duration::from_secs(1)).is_empty());
    }

    #[test]
    fn the_inertial_measurement_unit_sends_fifty_times_a_second_once_it_is_switched_on() {
        let mut myo = simulator(|_| {});
        myo.write(Characteristic::Command, &[0x01, 3, 2, 1, 0], Duration::ZERO);
        let imu = |sent: &[Notification]| {
            let of_unit = sent.iter().filter(|n| n.characteristic == Characteristic::Imu);
            of_unit.map(|n| n.bytes.len()).collect::<Vec<_>>()
        };
        let sent = myo.advance(Duration::from_secs(2));
        assert_eq!(imu(&sent), [20; 100]);
        assert_eq!(sent.len(), 300, "samples come as without it");
        myo.write(Characteristic::Command, &[0x01, 3, 2, 0, 0], Duration::from_secs(2));
        assert_eq!(imu(&myo.advance(Duration::from_secs(3))), [0; 0]);
    }

    #[test]
    fn version_and_charge_are_read_and_the_motor_runs() {
        let mut myo = simulator(|o| o.battery_percent = 42);
        let mut read = |characteristic| myo.write(characteristic, &[], Duration::ZERO)[0].bytes.clone();
        assert_eq!(read(Characteristic::Battery), [42]);
        assert_eq!(read(Characteristic::Firmware).len(), 8);
        myo.write(Characteristic::Command, &[0x03, 1, 3], Duration::ZERO);
        assert_eq!(myo.vibration(), Some(MyoVibration::Long));
        myo.write(Characteristic::Command, &[0x0B, 1, 0], Duration::ZERO);
        assert_eq!(myo.vibration(), Some(MyoVibration::Short));
    }

    #[test]
    fn notifications_are_lost_as_often_as_asked_for() {
        let mut myo = simulator(|o| o.loss_rate = 0.1);
        myo.write(Characteristic::Command, &[0x01, 3, 3, 0, 0], Duration::ZERO);
        let sent = myo.advance(Duration::from_secs(10)).len();
        assert!((850..950).contains(&sent), "{sent}");
        let wrong = MyoSimulatorOptions { loss_rate: 1.5, ..MyoSimulatorOptions::default() };
        let error = MyoSimulator::new(wrong, Box::new(|| [0.0; CHANNELS].into_iter().collect()))
            .err()
            .unwrap()
            .to_string();
        assert!(error.contains("loss is 1.5"), "{error}");
    }
}
