//! How often the band check is right between sessions: per person a model of each session is checked with each repetition
//! of each other session, as the band sat, and turned by every number of channels.
//!
//! cargo run --release -p proact-devices --example band_check -- FOLDER-OF-SESSIONS
//!
//! Sessions are folders of recordings called PERSON-SESSION.
#![allow(clippy::disallowed_methods)] // It reads files.

use proact_devices::Recordings;
use proact_emg::{BandProposal, EmgConfig, EmgModel, FeatureVector, check_rotation, extract_features};
use proact_types::{Command, EmgSample, Gesture};
use std::{collections::BTreeMap, error::Error, path::Path};

/// What the check said.
#[derive(Debug, Default)]
pub struct Tally {
    /// Checks of a band that sat right.
    pub checks: usize,
    /// Those that said so.
    pub kept: usize,
    /// Those that asked for a calibration.
    pub false_alarms: usize,
    /// Checks of a turned band.
    pub turned: usize,
    /// Those that named the turn.
    pub found: usize,
    /// A turn, a swap or a band that sits right, where it was turned or sat right.
    pub wrong: usize,
    /// Checks with two electrodes swapped.
    pub swapped: usize,
    /// Those that named the two.
    pub named: usize,
    /// Those that took it for a turned band, or for another swap.
    pub mistaken: usize,
    /// Those that found nothing: the two are as strong.
    pub unseen: usize,
}

/// Checks all pairs of sessions in `dir`.
///
/// # Errors
/// Recordings that cannot be used.
pub fn judge(dir: &Path) -> Result<Tally, Box<dyn Error>> {
    let mut people: BTreeMap<String, Vec<Recordings>> = BTreeMap::new();
    for entry in std::fs::read_dir(dir)? {
        let (path, name) = {
            let entry = entry?;
            (entry.path(), entry.file_name())
        };
        let name = name.to_string_lossy().into_owned();
        if let (true, Some((person, _))) = (path.is_dir(), name.rsplit_once('-')) {
            people.entry(person.to_owned()).or_default().push(Recordings::open(&path, None)?);
        }
    }
    let mut counts = Tally::default();
    for sessions in people.values_mut() {
        sessions.sort_by(|a, b| a.path.cmp(&b.path));
        for (k, earlier) in sessions.iter().enumerate() {
            let model = model(earlier)?;
            for (_, today) in sessions.iter().enumerate().filter(|(other, _)| *other != k) {
                check(&model, today, &mut counts)?;
            }
        }
    }
    Ok(counts)
}

fn model(session: &Recordings) -> Result<EmgModel, Box<dyn Error>> {
    let (rate_hz, channels, rest) = (session.rate_hz, session.channels, session.rest);
    let config = EmgConfig { rate_hz, channels, rest, ..EmgConfig::default() };
    let samples: Vec<(Gesture, Vec<EmgSample>)> =
        session.items.iter().map(|r| (r.gesture, r.numbered_samples().collect())).collect();
    let slices: Vec<_> = samples.iter().map(|(gesture, s)| (*gesture, s.as_slice())).collect();
    Ok(EmgModel::train(&config, &vec![0.0; channels], &slices)?)
}

fn check(model: &EmgModel, today: &Recordings, counts: &mut Tally) -> Result<(), Box<dyn Error>> {
    let wrist = [Command::WristFlexion, Command::WristExtension].map(Gesture::from);
    let (layout, channels) = (model.config.layout(), today.channels);
    for first in today.items.iter().filter(|r| r.gesture == wrist[0]) {
        let Ok(second) = today.find(wrist[1], first.repetition) else { continue };
        let seen = |swap: Option<(usize, usize)>| -> Result<Vec<(Gesture, FeatureVector)>, Box<dyn Error>> {
            let mut windows = Vec::new();
            for recording in [first, second] {
                let mut samples: Vec<EmgSample> = recording.numbered_samples().collect();
                if let Some((a, b)) = swap {
                    samples.iter_mut().for_each(|sample| sample.channels.swap(a, b));
                }
                windows.extend(
                    extract_features(&model.config, &samples)?.into_iter().map(|w| (recording.gesture, w)),
                );
            }
            Ok(windows)
        };
        for (a, b) in (0..channels).flat_map(|a| (a + 1..channels).map(move |b| (a, b))) {
            counts.swapped += 1;
            match check_rotation(model, &seen(Some((a, b)))?)?.proposal {
                BandProposal::Swap(pair) if pair == [a, b] => counts.named += 1,
                BandProposal::Swap(_) | BandProposal::Roll(_) => counts.mistaken += 1,
                BandProposal::Keep => counts.unseen += 1,
                BandProposal::Recalibrate => {}
            }
        }
        let windows = seen(None)?;
        for turn in 0..channels {
            let turned: Vec<(Gesture, FeatureVector)> = windows
                .iter()
                .map(|(gesture, window)| {
                    let mut out = window.clone();
                    layout.roll(window, (channels - turn) % channels, &mut out);
                    (*gesture, out)
                })
                .collect();
            let proposal = check_rotation(model, &turned)?.proposal;
            let right = if turn == 0 { BandProposal::Keep } else { BandProposal::Roll(turn) };
            let (total, found) = if turn == 0 {
                (&mut counts.checks, &mut counts.kept)
            } else {
                (&mut counts.turned, &mut counts.found)
            };
            *total += 1;
            *found += usize::from(proposal == right);
            counts.false_alarms += usize::from(turn == 0 && proposal == BandProposal::Recalibrate);
            counts.wrong += usize::from(proposal != right && proposal != BandProposal::Recalibrate);
        }
    }
    Ok(())
}

fn main() -> Result<(), Box<dyn Error>> {
    let dir = std::env::args()
        .nth(1)
        .ok_or("name a folder of sessions, such as ../shared/data/emg/myo_readings")?;
    let counts = judge(Path::new(&dir))?;
    let share = |part: usize, whole: usize| 100.0 * part as f64 / whole.max(1) as f64;
    println!("{counts:?}");
    println!(
        "in place: {:.1} % kept, {:.1} % told to calibrate; turned: {:.1} % named; wrong {}",
        share(counts.kept, counts.checks),
        share(counts.false_alarms, counts.checks),
        share(counts.found, counts.turned),
        counts.wrong
    );
    println!(
        "two swapped: {:.1} % named, {:.1} % taken for something else, {:.1} % unseen, the others told to calibrate",
        share(counts.named, counts.swapped),
        share(counts.mistaken, counts.swapped),
        share(counts.unseen, counts.swapped)
    );
    Ok(())
}
