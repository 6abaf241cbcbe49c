use super::{
    fragments::{AssemblyOutcome, FragmentAssembler},
    link::{GattConnector, GattLink, LinkError},
    parser::GForceParser,
    protocol::{
        Characteristic, EmgCapability, EmgSetting, GForceCommand, GForceProtocolError, GForceReply,
        GForceReplyCode, SWITCH_EMG, SWITCH_IMU,
    },
    reconnecting_link::{LinkEvent, ReconnectingLink},
};
use crate::{DeviceError, EmgPacket, SampleSource, SourceCounts, SourceEvent, SourceInfo};
use proact_emg::ImuChannel;
use proact_types::Gesture;
use std::time::{Duration, Instant};

/// Why an armband cannot be used although it is connected.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum GForceError {
    /// The link failed while the armband was being set up.
    #[error(transparent)]
    Link(#[from] LinkError),
    /// A setting that cannot work, or a reply that is none.
    #[error(transparent)]
    Protocol(#[from] GForceProtocolError),
    /// A command was refused.
    #[error("the armband refuses command {opcode:#04x}: {code}{hint}")]
    Refused {
        /// Which operation.
        opcode: u8,
        /// Its verdict.
        code: GForceReplyCode,
        /// What to do, if anything.
        hint: &'static str,
    },
    /// No reply came.
    #[error("the armband did not answer command {opcode:#04x} within {} s; switch it off and on", REPLY_TIMEOUT.as_secs())]
    NoReply {
        /// Which operation.
        opcode: u8,
    },
    /// What is read back is not what was set.
    #[error("the armband was set to {asked:?} and reads back {got:?}; ask for what it can do, or update it")]
    ReadBack {
        /// As set.
        asked: EmgSetting,
        /// As read.
        got: EmgSetting,
    },
}

/// How the armband is to be set.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct GForceOptions {
    /// Samples per second; none for the highest that the armband says it can do at this resolution.
    pub rate_hz: Option<u16>,
    /// 8, up to 1000 Hz, or 12, up to 500 Hz.
    pub bits: u8,
    /// A bit per channel.
    pub channel_mask: u16,
    /// The inertial measurement unit too. Packets are not numbered then: no source says whether all kinds of data share one
    /// numbering.
    pub imu: bool,
    /// Bytes of a packet. Smaller ones wait less and cost more radio: 128 is 16 ms at 1000 Hz, 32 is 4 ms.
    pub packet_bytes: u8,
}

impl Default for GForceOptions {
    fn default() -> Self {
        let EmgSetting { channel_mask, packet_bytes, bits, .. } = EmgSetting::PROACT_DEFAULT;
        GForceOptions { rate_hz: None, bits, channel_mask, imu: false, packet_bytes }
    }
}

/// How long a reply may take (one to five seconds in the maker's programs).
const REPLY_TIMEOUT: Duration = Duration::from_secs(2);

/// A gForce Pro or Pro+ armband: sets it up, reads its settings back, switches package ids and samples on, and
/// reconnects with growing waits when it is lost. The sample counter goes on across a loss and steps over it.
///
/// Everything happens within [`SampleSource::poll`]; connecting may take longer than its timeout.
pub struct GForce {
    link: ReconnectingLink,
    options: GForceOptions,
    info: SourceInfo,
    parser: GForceParser,
    opened: Instant,
    notification: Vec<u8>,
    battery: Option<u8>,
}

/// What setting up finds out.
struct GForceSetup {
    setting: EmgSetting,
    package_ids: bool,
    firmware: Option<String>,
    battery: Option<u8>,
}

impl GForce {
    /// Connects and sets the armband up. Samples begin to come.
    ///
    /// # Errors
    /// It cannot be reached, refuses the settings, does not answer, or reads back other settings.
    pub fn open(
        mut connector: Box<dyn GattConnector>,
        options: GForceOptions,
    ) -> Result<GForce, GForceError> {
        let mut link = connector.connect()?;
        let ready = configure(link.as_mut(), &options)?;
        let name = match &ready.firmware {
            Some(firmware) => format!("gForce, firmware {firmware}, {}", connector.name()),
            None => format!("gForce, {}", connector.name()),
        };
        let setting = ready.setting;
        let info = SourceInfo {
            name,
            rate_hz: setting.rate_hz.into(),
            channels: setting.channels(),
            packet_samples: setting.packet_samples(),
            zero_code: setting.zero_code(),
            rails: Some((0.0, setting.max_code())),
            loss_is_counted: ready.package_ids,
            volts_per_code: Some(setting.volts_per_code()),
            imu: if options.imu { ImuChannel::armband_channels() } else { Vec::new() },
        };
        let parser = GForceParser::new(setting, ready.package_ids)?;
        Ok(GForce {
            link: ReconnectingLink::new(connector, link),
            // After a loss the same stream is asked for again.
            options: GForceOptions { rate_hz: Some(setting.rate_hz), ..options },
            info,
            parser: if options.imu { parser.with_imu() } else { parser },
            opened: Instant::now(),
            notification: Vec::with_capacity(1024),
            battery: ready.battery,
        })
    }

    /// Charge of the armband's battery when it was last connected, per cent.
    pub fn battery_percent(&self) -> Option<u8> {
        self.battery
    }

    /// Bits of a code.
    pub fn bits(&self) -> u8 {
        self.options.bits
    }
}

impl SampleSource for GForce {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn poll(&mut self, timeout: Duration, packet: &mut EmgPacket) -> Result<SourceEvent, DeviceError> {
        let deadline = Instant::now() + timeout;
        loop {
            let event = self.link.next_event(deadline, &mut self.notification, |link| {
                let ready = configure(link, &self.options)?;
                self.parser.restart(ready.setting, ready.package_ids)?;
                Ok::<GForceSetup, GForceError>(ready)
            });
            match event {
                LinkEvent::Notification(Characteristic::Data) => {
                    self.link.note_samples();
                    if self.parser.push(&self.notification, self.opened.elapsed(), packet) {
                        return Ok(SourceEvent::Packet);
                    }
                }
                // Replies that nobody waits for any more; the characteristics of a Myo, which this armband does not have.
                LinkEvent::Notification(_) | LinkEvent::Nothing => {}
                LinkEvent::Lost(reason) => return Ok(SourceEvent::Lost { reason }),
                LinkEvent::Restored(ready) => {
                    self.battery = ready.battery;
                    self.info.loss_is_counted = ready.package_ids;
                    return Ok(SourceEvent::Restored);
                }
            }
            if Instant::now() >= deadline {
                return Ok(SourceEvent::Nothing);
            }
        }
    }

    fn counts(&self) -> SourceCounts {
        self.parser.counts()
    }

    fn prompt(&mut self, gesture: Gesture) {
        if let Some(link) = self.link.link() {
            // A link that is lost is noticed by the next poll.
            let _ = link.prompt(gesture);
        }
    }
}

impl Drop for GForce {
    fn drop(&mut self) {
        // The armband goes on sending until it is told, and drains its battery. If it cannot be told it has
        // noticed the end of the connection.
        if let Some(link) = self.link.link() {
            let _ = link.write(Characteristic::Command, &GForceCommand::DataSwitch(0).to_bytes());
        }
    }
}

fn configure(link: &mut dyn GattLink, options: &GForceOptions) -> Result<GForceSetup, GForceError> {
    // Both are for display; an armband that does not tell is as good.
    let firmware = send_optional_command(link, GForceCommand::Firmware)?.map(|body| firmware_name(&body));
    let battery = send_optional_command(link, GForceCommand::Battery)?.and_then(|body| body.first().copied());
    let rate_hz = match options.rate_hz {
        Some(rate_hz) => rate_hz,
        None => {
            let fastest = if options.bits == 8 { 1000 } else { 500 };
            match send_optional_command(link, GForceCommand::EmgCapability)? {
                Some(body) => EmgCapability::from_bytes(&body)?.max_rate_hz.min(fastest),
                None => fastest,
            }
        }
    };
    let GForceOptions { channel_mask, packet_bytes, bits, .. } = *options;
    let setting = EmgSetting { rate_hz, channel_mask, packet_bytes, bits };
    setting.check()?;
    send_command(link, GForceCommand::SetEmg(setting), "; ask for another rate or resolution")?;
    // Devices have been seen to accept a rate and keep another.
    let got = EmgSetting::from_bytes(&send_command(link, GForceCommand::GetEmg, "")?)?;
    if got != setting {
        return Err(GForceError::ReadBack { asked: setting, got });
    }
    let ids = send_optional_command(link, GForceCommand::PackageId(!options.imu))?.is_some() && !options.imu;
    let kinds = if options.imu { SWITCH_EMG | SWITCH_IMU } else { SWITCH_EMG };
    send_command(link, GForceCommand::DataSwitch(kinds), "")?;
    Ok(GForceSetup { setting, package_ids: ids, firmware, battery })
}

/// Sends a command and waits for its reply. The body of the reply.
fn send_command(
    link: &mut dyn GattLink,
    command: GForceCommand,
    hint: &'static str,
) -> Result<Vec<u8>, GForceError> {
    link.write(Characteristic::Command, &command.to_bytes())?;
    let deadline = Instant::now() + REPLY_TIMEOUT;
    let mut fragments = FragmentAssembler::default();
    let mut bytes = Vec::new();
    loop {
        let left = deadline.saturating_duration_since(Instant::now());
        match link.next_notification(left, &mut bytes)? {
            Some(Characteristic::Command) => {
                let message = match fragments.push(&bytes) {
                    AssemblyOutcome::Incomplete => continue,
                    AssemblyOutcome::Unfragmented(message) | AssemblyOutcome::Reassembled(message) => message,
                };
                let Ok(reply) = GForceReply::from_bytes(message) else { continue };
                if reply.opcode != command.opcode() {
                    continue;
                }
                return match reply.code {
                    GForceReplyCode::Ok => Ok(reply.body.to_vec()),
                    code => Err(GForceError::Refused { opcode: reply.opcode, code, hint }),
                };
            }
            // Samples of a stream that was left running; the characteristics of a Myo, which this armband does not have.
            Some(_) => {}
            None if left.is_zero() => return Err(GForceError::NoReply { opcode: command.opcode() }),
            None => {}
        }
        if left.is_zero() {
            return Err(GForceError::NoReply { opcode: command.opcode() });
        }
    }
}

/// As [`send_command`], for what an armband need not know: none if it refuses.
fn send_optional_command(
    link: &mut dyn GattLink,
    what: GForceCommand,
) -> Result<Option<Vec<u8>>, GForceError> {
    match send_command(link, what, "") {
        Ok(body) => Ok(Some(body)),
        Err(GForceError::Refused { .. }) => Ok(None),
        Err(error) => Err(error),
    }
}

/// Text, or up to four numbers.
fn firmware_name(body: &[u8]) -> String {
    if body.len() > 4 || body.iter().all(|b| b.is_ascii_graphic()) {
        String::from_utf8_lossy(body).trim_end_matches('\0').to_owned()
    } else {
        body.iter().map(u8::to_string).collect::<Vec<_>>().join(".")
    }
}
