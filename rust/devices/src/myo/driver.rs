use super::{
    numbering::RoundRobinNumbering,
    protocol::{
        CHANNELS, EMG_CHARACTERISTIC_ORDER, MyoCommand, MyoEmgMode, PACKET_BYTES, PACKET_SAMPLES, RATE_HZ,
        firmware_version, imu_values,
    },
};
use crate::{
    DeviceError, EmgPacket, SampleSource, SourceCounts, SourceEvent, SourceInfo,
    gforce::{Characteristic, GattConnector, GattLink, LinkError, LinkEvent, ReconnectingLink},
};
use proact_emg::ImuChannel;
use proact_types::{ChannelValues, EmgSample, Gesture};
use std::time::{Duration, Instant};

/// How long the armband may take to answer what is read, or to send its first samples.
const REPLY_TIMEOUT: Duration = Duration::from_secs(2);

/// A Myo armband: keeps it awake, switches its samples on, and reconnects with growing waits when it is lost. The sample counter
/// goes on across a loss and steps over it.
///
/// Everything happens within [`SampleSource::poll`]; connecting may take longer than its timeout.
pub struct Myo {
    link: ReconnectingLink,
    mode: MyoEmgMode,
    /// The newest values of the inertial measurement unit; none where it is switched off.
    imu: Option<[f64; 10]>,
    info: SourceInfo,
    numbering: RoundRobinNumbering,
    counts: SourceCounts,
    battery: Option<u8>,
    opened: Instant,
    notification: Vec<u8>,
}

impl Myo {
    /// Connects and switches samples on, filtered by the armband or as converted, with its inertial measurement unit if `imu`.
    ///
    /// # Errors
    /// It cannot be reached, or sends no samples.
    pub fn open(
        mut connector: Box<dyn GattConnector>,
        mode: MyoEmgMode,
        imu: bool,
    ) -> Result<Myo, LinkError> {
        let mut link = connector.connect()?;
        // For display only; an armband that does not tell is as good.
        let firmware =
            link.read(Characteristic::Firmware, REPLY_TIMEOUT)?.as_deref().and_then(firmware_version);
        let battery = battery(link.as_mut())?;
        start_streaming(link.as_mut(), mode, imu)?;
        // There are no replies: that samples come is the only answer.
        let mut notification = Vec::with_capacity(PACKET_BYTES);
        let deadline = Instant::now() + REPLY_TIMEOUT;
        let (mut samples, mut newest) = (false, None);
        loop {
            let left = deadline.saturating_duration_since(Instant::now());
            match link.next_notification(left, &mut notification)? {
                Some(characteristic) if EMG_CHARACTERISTIC_ORDER.contains(&characteristic) => samples = true,
                Some(Characteristic::Imu) => newest = imu_values(&notification).or(newest),
                _ if left.is_zero() => {
                    let secs = REPLY_TIMEOUT.as_secs();
                    let what =
                        if samples { "nothing of its inertial measurement unit" } else { "no samples" };
                    return Err(LinkError::Radio(format!(
                        "the Myo sent {what} within {secs} s; take it off, put it on its charger and try again"
                    )));
                }
                _ => {}
            }
            if samples && (newest.is_some() || !imu) {
                break;
            }
        }
        let name = match firmware {
            Some(firmware) => format!("Myo, firmware {firmware}, {}", connector.name()),
            None => format!("Myo, {}", connector.name()),
        };
        let info = SourceInfo {
            name,
            rate_hz: RATE_HZ.into(),
            channels: CHANNELS,
            packet_samples: PACKET_SAMPLES,
            zero_code: 0.0,
            rails: Some((-128.0, 127.0)),
            loss_is_counted: true,
            volts_per_code: None,
            imu: if imu { ImuChannel::armband_channels() } else { Vec::new() },
        };
        Ok(Myo {
            link: ReconnectingLink::new(connector, link),
            mode,
            imu: newest.filter(|_| imu),
            info,
            numbering: RoundRobinNumbering::default(),
            counts: SourceCounts::default(),
            battery,
            opened: Instant::now(),
            notification,
        })
    }

    /// Charge of the armband's battery when it was last connected, per cent.
    pub fn battery_percent(&self) -> Option<u8> {
        self.battery
    }

    /// Makes a packet of the newest notification; false if it is none of samples.
    fn fill(&mut self, characteristic: Characteristic, packet: &mut EmgPacket) -> bool {
        let received = self.opened.elapsed();
        if let (Characteristic::Imu, Some(newest)) = (characteristic, &mut self.imu) {
            match imu_values(&self.notification) {
                Some(values) => *newest = values,
                None => self.counts.malformed += 1,
            }
            return false;
        }
        if EMG_CHARACTERISTIC_ORDER.contains(&characteristic) && self.notification.len() != PACKET_BYTES {
            self.counts.malformed += 1;
            return false;
        }
        let Some((first, lost)) = self.numbering.number(characteristic, received) else { return false };
        packet.samples.clear();
        for (codes, counter) in self.notification.chunks_exact(CHANNELS).zip(first..) {
            let mut channels: ChannelValues =
                codes.iter().map(|code| f64::from(i8::from_le_bytes([*code]))).collect();
            channels.extend(self.imu.into_iter().flatten());
            packet.samples.push(EmgSample { counter, channels });
        }
        packet.lost_before = lost;
        packet.device_secs = (first + PACKET_SAMPLES as u64) as f64 / f64::from(RATE_HZ);
        packet.received = received;
        self.counts.packets += 1;
        self.counts.lost_samples += lost;
        true
    }
}

impl SampleSource for Myo {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn poll(&mut self, timeout: Duration, packet: &mut EmgPacket) -> Result<SourceEvent, DeviceError> {
        let deadline = Instant::now() + timeout;
        loop {
            let event = self.link.next_event(deadline, &mut self.notification, |link| {
                let battery = battery(link)?;
                start_streaming(link, self.mode, self.imu.is_some())?;
                Ok::<Option<u8>, LinkError>(battery)
            });
            match event {
                LinkEvent::Notification(characteristic) => {
                    self.link.note_samples();
                    if self.fill(characteristic, packet) {
                        return Ok(SourceEvent::Packet);
                    }
                }
                LinkEvent::Nothing => {}
                LinkEvent::Lost(reason) => {
                    self.counts.disconnects += 1;
                    self.numbering.restart();
                    // What it said before says nothing about the limb now.
                    self.imu = self.imu.map(|_| [f64::NAN; 10]);
                    return Ok(SourceEvent::Lost { reason });
                }
                LinkEvent::Restored(battery) => {
                    self.battery = battery;
                    return Ok(SourceEvent::Restored);
                }
            }
            if Instant::now() >= deadline {
                return Ok(SourceEvent::Nothing);
            }
        }
    }

    fn counts(&self) -> SourceCounts {
        self.counts
    }

    fn prompt(&mut self, gesture: Gesture) {
        if let Some(link) = self.link.link() {
            // A link that is lost is noticed by the next poll.
            let _ = link.prompt(gesture);
        }
    }
}

impl Drop for Myo {
    fn drop(&mut self) {
        // It goes on sending, and stays awake, until it is told, and drains its battery.
        if let Some(link) = self.link.link() {
            for command in
                [MyoCommand::SetMode { emg: MyoEmgMode::Off, imu: false }, MyoCommand::MaySleep(true)]
            {
                let _ = link.write(Characteristic::Command, &command.to_bytes());
            }
        }
    }
}

fn battery(link: &mut dyn GattLink) -> Result<Option<u8>, LinkError> {
    Ok(link.read(Characteristic::Battery, REPLY_TIMEOUT)?.and_then(|bytes| bytes.first().copied()))
}

fn start_streaming(link: &mut dyn GattLink, emg: MyoEmgMode, imu: bool) -> Result<(), LinkError> {
    for command in [MyoCommand::MaySleep(false), MyoCommand::SetMode { emg, imu }] {
        link.write(Characteristic::Command, &command.to_bytes())?;
    }
    Ok(())
}
