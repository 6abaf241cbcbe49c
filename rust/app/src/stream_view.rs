//! What `proact emg stream` shows on a terminal.

use proact_devices::{SourceCounts, SourceInfo};
use proact_emg::{ChannelFault, ChannelQuality, ChannelStatus, EmgOutput, StreamQuality};
use proact_types::EmgSample;
use std::{
    io::{self, IsTerminal, Write},
    time::{Duration, Instant},
};

/// Time constant of the amplitudes shown, seconds.
const SMOOTHING_SECS: f64 = 0.15;
/// Columns of a bar.
const BAR_COLUMNS: usize = 40;
/// Characters of a finding that a terminal has room for.
const MAX_FINDING_CHARS: usize = 118;
/// Lines of channels.
const MAX_CHANNEL_LINES: usize = 16;

/// What the stream is doing now.
pub struct StreamSummary {
    info: SourceInfo,
    label: String,
    /// Smoothed mean square per channel, and the largest amplitude seen, which scales the bars.
    power: Vec<f64>,
    max_amplitude: f64,
    /// Verdicts per channel.
    pub quality: Vec<ChannelQuality>,
    /// Verdict on the stream.
    pub stream_quality: StreamQuality,
    received: u64,
    since: Instant,
    rate_hz: f64,
    /// The newest decision.
    pub output: Option<EmgOutput>,
    /// What came and what was lost.
    pub counts: SourceCounts,
    /// What the source complains of.
    pub source_warning: Option<String>,
    /// What is wrong with the newest seconds, one sentence each.
    pub findings: Vec<String>,
}

impl StreamSummary {
    /// Nothing seen yet of the source called `label`.
    pub fn new(info: &SourceInfo, label: &str) -> StreamSummary {
        StreamSummary {
            info: info.clone(),
            label: label.to_owned(),
            power: vec![0.0; info.channels],
            max_amplitude: 1.0,
            quality: vec![ChannelQuality::default(); info.channels],
            stream_quality: StreamQuality::default(),
            received: 0,
            since: Instant::now(),
            rate_hz: 0.0,
            output: None,
            counts: SourceCounts::default(),
            source_warning: None,
            findings: Vec::new(),
        }
    }

    /// Takes a centred sample.
    pub fn sample(&mut self, sample: &EmgSample) {
        let share = 1.0 - (-1.0 / (SMOOTHING_SECS * self.info.rate_hz)).exp();
        for (channel, value) in sample.channels.iter().enumerate() {
            self.power[channel] += share * (value * value - self.power[channel]);
            self.max_amplitude = self.max_amplitude.max(self.power[channel].sqrt());
        }
        self.received += 1;
        let elapsed = self.since.elapsed().as_secs_f64();
        if elapsed >= 1.0 {
            self.rate_hz = self.received as f64 / elapsed;
            (self.received, self.since) = (0, Instant::now());
        }
    }

    fn text(&self) -> String {
        let mut text =
            format!("{}  ({} Hz nominal, trained on {})\n", self.info.name, self.info.rate_hz, self.label);
        // A screen has room for so many lines: of grids several channels share one.
        let columns = self.info.channels.div_ceil(MAX_CHANNEL_LINES);
        let bar = BAR_COLUMNS / columns;
        for line in 0..self.info.channels.div_ceil(columns) {
            let channels = line * columns..((line + 1) * columns).min(self.info.channels);
            let cell = |channel: usize| {
                let rms = self.power[channel].sqrt();
                let filled = ((rms / self.max_amplitude * bar as f64).round() as usize).min(bar);
                let state = if columns == 1 {
                    channel_finding(&self.quality[channel])
                } else {
                    format!("{:<4}", status_word(self.quality[channel].status))
                };
                format!("ch{channel:<3} {:<bar$} {rms:7.1}  {state}", "#".repeat(filled))
            };
            text += &channels.map(cell).collect::<Vec<_>>().join("  ");
            text.push('\n');
        }
        text += &match &self.output {
            Some(output) if output.stale => "no motion: no usable samples\n".to_owned(),
            Some(output) => format!(
                "{:<16} newest window {:<16} confidence {:3.0} %  effort {:3.0} %\n",
                output.gesture,
                output.window_class,
                100.0 * output.confidence,
                100.0 * output.effort
            ),
            None => "waiting for the first window\n".to_owned(),
        };
        let SourceCounts { lost_samples, duplicates, late, malformed, broken_fragments, .. } = self.counts;
        text += &format!(
            "{:<5} {:.0} samples/s  lost {lost_samples}  twice {duplicates}  late {late}  damaged {}\n",
            status_word(self.stream_quality.status),
            self.rate_hz,
            malformed + broken_fragments
        );
        text += &match &self.source_warning {
            Some(reason) => format!("armband lost ({reason}); looking for it\n"),
            None => "\n".to_owned(),
        };
        // One line: what is drawn over must not get longer.
        text += &self.finding().chars().take(MAX_FINDING_CHARS).collect::<String>();
        text.push('\n');
        text
    }

    /// The first finding, and how many more there are; empty if there is none.
    fn finding(&self) -> String {
        match self.findings.as_slice() {
            [] => String::new(),
            [only] => only.clone(),
            [first, more @ ..] => format!("({} more) {first}", more.len()),
        }
    }
}

/// The light as a word, and what is wrong.
fn channel_finding(quality: &ChannelQuality) -> String {
    let fault = quality.fault.map_or("", ChannelFault::text);
    format!("{:<5} {fault}", status_word(quality.status)).trim_end().to_owned()
}

fn status_word(light: ChannelStatus) -> &'static str {
    match light {
        ChannelStatus::Green => "good",
        ChannelStatus::Amber => "look",
        ChannelStatus::Red => "BAD",
    }
}

/// Draws glances: over each other on a terminal, one line a second elsewhere.
pub struct StreamView {
    last_drawn: Option<Instant>,
    lines: usize,
    terminal: bool,
}

impl StreamView {
    /// Nothing drawn yet.
    #[allow(clippy::new_without_default)] // It looks at the terminal.
    pub fn new() -> StreamView {
        StreamView { last_drawn: None, lines: 0, terminal: io::stdout().is_terminal() }
    }

    /// Draws over what was drawn before.
    ///
    /// # Errors
    /// Standard output that is gone.
    pub fn show(&mut self, glance: &StreamSummary) -> io::Result<()> {
        let period = Duration::from_millis(if self.terminal { 100 } else { 1000 });
        if self.last_drawn.is_some_and(|at| at.elapsed() < period) {
            return Ok(());
        }
        self.last_drawn = Some(Instant::now());
        let mut out = io::stdout().lock();
        if !self.terminal {
            let gesture = glance.output.as_ref().map_or("waiting", |o| o.gesture.as_str());
            return writeln!(
                out,
                "{}",
                format_args!(
                    "{gesture}  {:.0} samples/s  lost {}  {}",
                    glance.rate_hz,
                    glance.counts.lost_samples,
                    glance.finding()
                )
                .to_string()
                .trim_end()
            );
        }
        let text = glance.text();
        if self.lines > 0 {
            write!(out, "\x1b[{}A", self.lines)?;
        }
        self.lines = text.lines().count();
        for line in text.lines() {
            writeln!(out, "{line}\x1b[K")?;
        }
        out.flush()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn amplitude_verdict_and_gesture_are_shown() {
        let info = SourceInfo {
            name: "test".to_owned(),
            rate_hz: 1000.0,
            channels: 2,
            packet_samples: 16,
            zero_code: 128.0,
            rails: Some((0.0, 255.0)),
            loss_is_counted: true,
            volts_per_code: None,
            imu: Vec::new(),
        };
        let mut glance = StreamSummary::new(&info, "recordings");
        for counter in 0..2000_u64 {
            let swing: f64 = if counter % 2 == 0 { 1.0 } else { -1.0 };
            glance.sample(&EmgSample { counter, channels: [0.0, 40.0 * swing].into_iter().collect() });
        }
        glance.quality[0] = ChannelQuality {
            status: ChannelStatus::Red,
            fault: Some(ChannelFault::Flat),
            ..ChannelQuality::default()
        };
        let text = glance.text();
        let lines: Vec<&str> = text.lines().collect();
        assert!(lines[1].ends_with("0.0  BAD   flat: a dead channel"), "{text}");
        assert!(lines[2].ends_with("40.0  good") && lines[2].contains(&"#".repeat(BAR_COLUMNS)), "{text}");
        assert_eq!(lines[3], "waiting for the first window");

        let grid = SourceInfo { channels: 64, ..info };
        let text = StreamSummary::new(&grid, "recordings").text();
        let lines: Vec<&str> = text.lines().collect();
        assert!(lines[16].contains("ch60 ") && lines[16].contains("ch63 "), "{text}");
        assert_eq!(lines[17], "waiting for the first window");
    }
}
