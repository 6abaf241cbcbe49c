//! What is said about recordings before anything is trained on them.

use proact_app::stream_view::fault_text;
use proact_devices::{Recording, Recordings};
use proact_emg::{CalibrationConfig, Light, RecordedFault, RecordedRepetition, check_recordings};
use proact_types::{EmgSample, GestureName};

/// Recordings that a sentence names.
const NAMED: usize = 4;

/// What is wrong with the recordings, worst first.
pub(super) fn faults(recordings: &Recordings, config: &CalibrationConfig) -> Vec<RecordedFault> {
    let electrodes = |r: &Recording| r.numbered().map(|sample| config.emg.electrodes(&sample)).collect();
    let numbered: Vec<Vec<EmgSample>> = recordings.items.iter().map(electrodes).collect();
    let repetitions: Vec<RecordedRepetition<'_>> = recordings
        .items
        .iter()
        .zip(&numbered)
        .map(|(r, samples)| RecordedRepetition { gesture: r.gesture, repetition: r.repetition, samples })
        .collect();
    let (rate_hz, channels) = (recordings.rate_hz, recordings.channels);
    check_recordings(&config.quality, rate_hz, channels, config.emg.rest, &repetitions)
}

/// The red ones as an error, if there are any.
pub(super) fn refusal(faults: &[RecordedFault]) -> Option<String> {
    let red: Vec<String> = faults.iter().filter(|f| f.light() == Light::Red).map(text).collect();
    (!red.is_empty()).then(|| {
        format!(
            "the recordings are not fit for training: {}; record them again, leave repetitions out with --reps, or train \
             on them all the same with --accept-faults",
            red.join("; ")
        )
    })
}

/// One sentence for the person.
pub(super) fn text(fault: &RecordedFault) -> String {
    match fault {
        RecordedFault::Channel { channel, light, finding, recordings, of } => {
            let light = if *light == Light::Red { "red" } else { "amber" };
            let named =
                recordings.iter().take(NAMED).map(|(gesture, repetition)| format!("{gesture} {repetition}"));
            let more = if recordings.len() > NAMED { ", ..." } else { "" };
            format!(
                "channel {channel} is {light} ({}) in {} of {of} recordings: {}{more}",
                fault_text(*finding),
                recordings.len(),
                named.collect::<Vec<_>>().join(", ")
            )
        }
        RecordedFault::Noisy { channel, times } => format!(
            "channel {channel} is noisy: {times:.1} times as loud at rest as the others, and no louder in any gesture"
        ),
        RecordedFault::TimeStamps { channel } => {
            format!("channel {channel} only rises: a column of time stamps or counters, not a muscle")
        }
        RecordedFault::Shared { first, second, samples, of } => format!(
            "repetition {} of {} has {samples} of its {of} samples in common with repetition {} of {}: training and test \
             would overlap",
            second.1, second.0, first.1, first.0
        ),
    }
}

/// What the folder lacks: gestures that it should have, and repetitions that other gestures have. One sentence each.
pub(super) fn lacking(recordings: &Recordings) -> Vec<String> {
    let mut sentences: Vec<String> = recordings
        .missing()
        .iter()
        .map(|gesture| format!("there is no recording of {gesture}: the model will never recognise it"))
        .collect();
    let count = |gesture: &GestureName| recordings.items.iter().filter(|r| r.gesture == *gesture).count();
    let gestures = recordings.gestures();
    let most = gestures.iter().map(count).max().unwrap_or(0);
    for gesture in gestures.iter().filter(|gesture| count(gesture) < most) {
        sentences.push(format!("{gesture} has {} repetitions, other gestures have {most}", count(gesture)));
    }
    sentences
}

/// In the order of the prompts, so that saved recordings give the model of their session to the last digit.
pub(super) fn in_order_of_prompts(recordings: &mut Recordings, rest: GestureName) {
    let order = CalibrationConfig::round(&recordings.gestures(), rest);
    recordings.items.sort_by_key(|r| (r.repetition, order.iter().position(|g| *g == r.gesture)));
}
