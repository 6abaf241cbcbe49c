use super::{
    fragments::{AssemblyOutcome, FragmentAssembler},
    imu::read_imu,
    protocol::{EMG_DATA, EmgSetting, GForceProtocolError},
};
use crate::{EmgPacket, SourceCounts};
use proact_types::{ChannelValues, EmgSample};
use std::time::Duration;

/// From data notifications to numbered packets of samples. Pure: the time comes in with each notification.
///
/// With package ids every packet carries a counter that wraps after 256. The parser unwraps it with the help of the
/// time since the last packet, drops what comes twice or late, and steps the sample counter over what is lost.
/// Packets of any other length than the one agreed on are dropped. Packets joined from fragments are handed out
/// when the number of the next one shows that no fragment of another packet got between.
///
/// Known weaknesses: without package ids a loss shows only as a silence, and a packet that comes twice, or that is
/// wrongly joined from two, cannot be told. With them, a stall of the host of more than 200 packets, 3 s, after which
/// all arrive at once, is taken for a loss.
#[derive(Clone, Debug)]
pub struct GForceParser {
    setting: EmgSetting,
    package_ids: bool,
    /// The newest values of the inertial measurement unit; none where it is switched off.
    imu: Option<[f64; 10]>,
    fragments: FragmentAssembler,
    /// Joined from fragments, waiting for the next.
    pending: Option<PendingPacket>,
    pending_codes: Vec<u8>,
    /// Id and arrival of the newest packet accepted.
    last_packet: Option<(u8, Duration)>,
    /// The numbering begins anew with the next packet.
    restarted: bool,
    /// Counter of the first sample of the next packet, if none is lost.
    next_counter: u64,
    /// Counter after the last sample handed out; where the stream began before that.
    delivered: u64,
    /// Id that continues a run of packets judged late, and the length of that run.
    late_run: (u8, u32),
    /// Packets in a row that are as long as packets without an id.
    packets_without_id: u32,
    counts: SourceCounts,
}

#[derive(Clone, Copy, Debug)]
struct PendingPacket {
    counter: u64,
    received: Duration,
}

/// So many packets in a row, each the successor of the one before, are no late ones: the numbering began anew.
const RESTART_AFTER: u32 = 4;
/// An armband that accepts the order to send ids and sends so many packets in a row without is believed to have
/// none: no source describes the layout beyond doubt.
const WITHOUT_ID_AFTER: u32 = 16;
/// A packet may be this share of 256 packets ahead of the time, and almost 256 behind, before it is misjudged.
const WRAP_MARGIN: f64 = 0.2;
/// Without ids a silence of this many packets, and of [`SILENCE_SECS`], is a gap.
const SILENT_PACKETS: f64 = 4.0;
const SILENCE_SECS: f64 = 0.1;

impl GForceParser {
    /// A parser at the start of a stream. `ids` if the armband agreed to send package ids.
    ///
    /// # Errors
    /// Settings that cannot work.
    pub fn new(setting: EmgSetting, ids: bool) -> Result<GForceParser, GForceProtocolError> {
        setting.check()?;
        Ok(GForceParser {
            setting,
            package_ids: ids,
            imu: None,
            fragments: FragmentAssembler::default(),
            pending: None,
            pending_codes: Vec::new(),
            last_packet: None,
            restarted: false,
            next_counter: 0,
            delivered: 0,
            late_run: (0, 0),
            packets_without_id: 0,
            counts: SourceCounts::default(),
        })
    }

    /// The same for a stream with the inertial measurement unit, whose newest values follow those of the electrodes in every sample:
    /// no numbers before the first.
    pub fn with_imu(mut self) -> GForceParser {
        self.imu = Some([f64::NAN; 10]);
        self
    }

    /// What was met so far.
    pub fn counts(&self) -> SourceCounts {
        SourceCounts { broken_fragments: self.fragments.dropped(), ..self.counts }
    }

    /// Losses are counted by the armband's own numbers.
    pub fn has_ids(&self) -> bool {
        self.package_ids
    }

    /// Settings and ids of the stream from now on, after the armband was configured anew at the end of a loss.
    /// The sample counter goes on and steps over at least one packet: how many samples are missing is estimated
    /// from the time.
    ///
    /// # Errors
    /// Settings that cannot work; the old ones stay.
    pub fn restart(&mut self, setting: EmgSetting, ids: bool) -> Result<(), GForceProtocolError> {
        setting.check()?;
        (self.setting, self.package_ids) = (setting, ids);
        self.fragments.clear();
        self.pending = None;
        self.restarted = true;
        self.packets_without_id = 0;
        // What it said before says nothing about the limb now.
        self.imu = self.imu.map(|_| [f64::NAN; 10]);
        self.counts.disconnects += 1;
        Ok(())
    }

    /// Takes a notification that arrived at `now`, and fills `packet` if one is ready. Notifications that are no
    /// EMG are left alone.
    pub fn push(&mut self, notification: &[u8], now: Duration, packet: &mut EmgPacket) -> bool {
        // Taken out so that its message can be read while the rest of this changes; costs no allocation.
        let mut fragments = std::mem::take(&mut self.fragments);
        let ready = match fragments.push(notification) {
            AssemblyOutcome::Incomplete => false,
            AssemblyOutcome::Unfragmented(message) => self.accept_message(message, false, now, packet),
            AssemblyOutcome::Reassembled(message) => self.accept_message(message, true, now, packet),
        };
        self.fragments = fragments;
        ready
    }

    fn accept_message(
        &mut self,
        message: &[u8],
        joined: bool,
        now: Duration,
        packet: &mut EmgPacket,
    ) -> bool {
        if let Some(values) = &mut self.imu
            && read_imu(message, values)
        {
            return false;
        }
        let Some((&EMG_DATA, rest)) = message.split_first() else {
            // Another kind of data, or nothing at all. A joined message without its head begins with a code.
            self.counts.malformed += u64::from(message.is_empty() || joined);
            return false;
        };
        let codes = usize::from(self.setting.packet_bytes);
        self.packets_without_id =
            if self.package_ids && rest.len() == codes { self.packets_without_id + 1 } else { 0 };
        if self.packets_without_id == WITHOUT_ID_AFTER {
            self.package_ids = false;
            self.restarted = true;
        }
        let (id, codes) = match rest.split_first() {
            Some((&id, body)) if self.package_ids && body.len() == codes => (Some(id), body),
            _ if !self.package_ids && rest.len() == codes => (None, rest),
            _ => {
                self.counts.malformed += 1;
                return false;
            }
        };
        if self.setting.bits > 8 && codes.chunks_exact(2).any(|code| code[1] > 0x0F) {
            // Beyond twelve bits: whatever it is, it is not a code.
            self.counts.malformed += 1;
            return false;
        }
        let Some(advance) = self.advance(id, now) else { return false };
        let counter = self.next_counter + (advance - 1) * self.setting.packet_samples() as u64;
        self.next_counter = counter + self.setting.packet_samples() as u64;
        self.last_packet = Some((id.unwrap_or(0), now));
        self.late_run = (0, 0);
        if !(joined && self.package_ids) {
            // A packet that came whole is proof against mixing, but not one that is still held from before.
            self.drop_pending();
            self.fill(packet, codes, PendingPacket { counter, received: now });
            return true;
        }
        let held = self.pending.replace(PendingPacket { counter, received: now });
        let ready = match held {
            Some(held) if advance == 1 => {
                let before = std::mem::take(&mut self.pending_codes);
                self.fill(packet, &before, held);
                self.pending_codes = before;
                true
            }
            Some(_) => {
                self.counts.malformed += 1;
                false
            }
            None => false,
        };
        self.pending_codes.clear();
        self.pending_codes.extend_from_slice(codes);
        ready
    }

    /// By how many packets the stream has advanced with this one: 1 if none is lost. None if it is to be dropped.
    fn advance(&mut self, id: Option<u8>, now: Duration) -> Option<u64> {
        let Some((last_id, last_at)) = self.last_packet else {
            self.restarted = false;
            return Some(1);
        };
        let elapsed = now.saturating_sub(last_at).as_secs_f64() / self.setting.packet_secs();
        if std::mem::take(&mut self.restarted) {
            // At least one is missing, so that no window joins before and after.
            return Some((elapsed.round() as u64).max(2));
        }
        let Some(id) = id else {
            let silent = elapsed > SILENT_PACKETS && now.saturating_sub(last_at).as_secs_f64() > SILENCE_SECS;
            return Some(if silent { elapsed.round() as u64 } else { 1 });
        };
        // The advance is known but for multiples of 256; the time since the last packet decides.
        let wrapped = i64::from(id.wrapping_sub(last_id));
        // Rather a stall of the host than a loss: packets that were late come in a burst, ahead of the time.
        let wraps = ((elapsed - wrapped as f64) / 256.0 + WRAP_MARGIN).floor();
        let advance = wrapped + 256 * wraps as i64;
        if let Ok(advance @ 1..) = u64::try_from(advance) {
            return Some(advance);
        }
        self.counts.duplicates += u64::from(advance == 0);
        self.counts.late += u64::from(advance < 0);
        let (expected, run) = self.late_run;
        let run = if run > 0 && id == expected { run + 1 } else { 1 };
        self.late_run = (id.wrapping_add(1), run);
        if run < RESTART_AFTER {
            return None;
        }
        self.counts.resyncs += 1;
        Some((elapsed.round() as u64).max(2))
    }

    fn drop_pending(&mut self) {
        if self.pending.take().is_some() {
            self.counts.malformed += 1;
        }
    }

    fn fill(&mut self, packet: &mut EmgPacket, codes: &[u8], held: PendingPacket) {
        let channels = self.setting.channels();
        packet.samples.clear();
        for (sample, counter) in codes.chunks_exact(channels * self.setting.code_bytes()).zip(held.counter..)
        {
            let mut channels: ChannelValues = match self.setting.code_bytes() {
                1 => sample.iter().map(|code| f64::from(*code)).collect(),
                _ => sample.chunks_exact(2).map(|c| f64::from(u16::from_le_bytes([c[0], c[1]]))).collect(),
            };
            channels.extend(self.imu.into_iter().flatten());
            packet.samples.push(EmgSample { counter, channels });
        }
        packet.lost_before = held.counter - self.delivered;
        self.delivered = held.counter + packet.samples.len() as u64;
        packet.device_secs = self.delivered as f64 / f64::from(self.setting.rate_hz);
        packet.received = held.received;
        self.counts.packets += 1;
        self.counts.lost_samples += packet.lost_before;
    }
}

#[cfg(test)]
mod tests;
