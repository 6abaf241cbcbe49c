//! Which unknown keys of the metadata may say the rate or the sampling interval, by the words of their names.

use serde_json::Value;

/// Words that say a rate or an interval.
const RATE_WORDS: [&str; 25] = [
    "rate",
    "rates",
    "fs",
    "f",
    "sr",
    "sps",
    "fsamp",
    "fsample",
    "freq",
    "frequency",
    "frequence",
    "frequenz",
    "hz",
    "khz",
    "hertz",
    "sampling",
    "sampled",
    "abtast",
    "dt",
    "period",
    "interval",
    "delta",
    "acq",
    "acquisition",
    "acquired",
];
/// Words that say that a name is that of another signal or of a filter, also for all that is within it.
const OTHER_SIGNAL_WORDS: [&str; 32] = [
    "mains",
    "powerline",
    "notch",
    "pass",
    "highpass",
    "lowpass",
    "bandpass",
    "filter",
    "filters",
    "cutoff",
    "heart",
    "ecg",
    "pulse",
    "breathing",
    "respiration",
    "imu",
    "acc",
    "accel",
    "accelerometer",
    "acceleration",
    "gyro",
    "gyroscope",
    "mag",
    "magnetometer",
    "gaze",
    "video",
    "camera",
    "frame",
    "screen",
    "display",
    "stimulus",
    "stimulation",
];
/// Words that say that a name is that of another figure.
const OTHER_QUANTITY_WORDS: [&str; 47] = [
    "line",
    "power",
    "cut",
    "corner",
    "high",
    "low",
    "band",
    "bandwidth",
    "nyquist",
    "count",
    "n",
    "num",
    "number",
    "samples",
    "id",
    "gain",
    "adc",
    "resolution",
    "levels",
    "bits",
    "bit",
    "baud",
    "channel",
    "channels",
    "date",
    "day",
    "year",
    "version",
    "duration",
    "refresh",
    "learning",
    "error",
    "success",
    "rest",
    "trial",
    "trials",
    "cue",
    "prompt",
    "pause",
    "break",
    "window",
    "step",
    "increment",
    "median",
    "mean",
    "min",
    "max",
];
/// Words that are written together with these.
const COMPOUND_WORDS: [&str; 7] = ["sample", "emg", "semg", "data", "scan", "signal", "device"];

/// Bytes of the longest word that may be several: a name can be as long as its file.
const MAX_COMPOUND_BYTES: usize = 40;

/// The unknown key `key`, or those within its value, that may say the rate.
pub(super) fn rate_names(key: &str, value: &Value) -> Vec<String> {
    let mut names = Vec::new();
    collect(key, key, value, &mut names);
    names.dedup();
    names
}

fn collect(path: &str, key: &str, value: &Value, names: &mut Vec<String>) {
    let number = match value {
        Value::Object(_) if contains_any(&words(key), &OTHER_SIGNAL_WORDS) => return,
        Value::Object(inside) => {
            return inside
                .iter()
                .for_each(|(key, value)| collect(&format!("{path}.{key}"), key, value, names));
        }
        Value::Array(items) => return items.iter().for_each(|item| collect(path, key, item, names)),
        Value::Number(number) => number.as_f64(),
        Value::String(text) => text.trim().trim_end_matches(|c: char| !c.is_ascii_digit()).parse().ok(),
        _ => None,
    };
    if number.is_some_and(|number: f64| number > 0.0) && may_be_rate(key) {
        names.push(path.to_owned());
    }
}

/// Whether a name has a word for a rate or an interval, and none that says that it is another's.
fn may_be_rate(key: &str) -> bool {
    let words = words(key);
    // `f_s` and `dT` are one word that is written as two.
    let joined = super::normalize_key(key);
    (contains_any(&words, &RATE_WORDS) || RATE_WORDS.contains(&joined.as_str()))
        && !contains_any(&words, &OTHER_SIGNAL_WORDS)
        && !contains_any(&words, &OTHER_QUANTITY_WORDS)
}

fn contains_any(words: &[String], list: &[&str]) -> bool {
    words.iter().any(|word| list.contains(&word.as_str()))
}

/// The words of a name in small letters: they end at signs, digits and changes of case; known words that are written
/// together, such as `heartrate`, are told apart.
fn words(key: &str) -> Vec<String> {
    let letters: Vec<char> = key.chars().collect();
    let mut words = vec![String::new()];
    for (k, letter) in letters.iter().enumerate() {
        let after_small = k > 0 && letters[k - 1].is_lowercase();
        // The last capital of `EMGRate` begins a word.
        let before_small =
            k > 0 && letters[k - 1].is_uppercase() && letters.get(k + 1).is_some_and(|c| c.is_lowercase());
        if !letter.is_alphabetic() || letter.is_uppercase() && (after_small || before_small) {
            words.push(String::new());
        }
        if letter.is_alphabetic() {
            words.last_mut().into_iter().for_each(|word| word.extend(letter.to_lowercase()));
        }
    }
    words.into_iter().flat_map(|word| split_compound(&word).unwrap_or(vec![word])).collect()
}

/// A word as known words written together; none if it is not wholly made of them.
fn split_compound(word: &str) -> Option<Vec<String>> {
    if word.is_empty() {
        return Some(Vec::new());
    }
    if word.len() > MAX_COMPOUND_BYTES {
        return None;
    }
    [&RATE_WORDS[..], &OTHER_SIGNAL_WORDS, &OTHER_QUANTITY_WORDS, &COMPOUND_WORDS]
        .concat()
        .into_iter()
        .find_map(|known| {
            let mut rest = split_compound(word.strip_prefix(known)?)?;
            rest.insert(0, known.to_owned());
            Some(rest)
        })
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    /// Any key with "rate", "hz" or "sampl" in it, or with a usual rate as its number, was refused; an interval was not seen.
    #[test]
    fn a_rate_and_an_interval_are_told_from_other_figures_by_the_words_of_their_names() {
        let rates = [
            json!({"dt": 0.001}),
            json!({"dT": 0.001}),
            json!({"delta_t_us": 1000}),
            json!({"sampling_period": 0.001}),
            json!({"sampling_period_s": 0.001}),
            json!({"sampling_interval_ms": 1}),
            json!({"sample_interval": 0.005}),
            json!({"sampleInterval": "5 ms"}),
            json!({"sampling_time": 0.001}),
            json!({"period_ms": 1}),
            json!({"interval_ms": 1}),
            json!({"fs_khz": 1}),
            json!({"rate_khz": 1.0}),
            json!({"sampling_rate_per_ms": 1}),
            json!({"acquisition_freq": 1000}),
            json!({"acqrate": 1000}),
            json!({"EMGSampleRateInHz": 1000}),
            json!({"SampelRate": "1000 Hz"}),
            json!({"abtastrate": 1000}),
            json!({"frequence": 1000}),
            json!({"f": 2048}),
            json!({"f_s": 1000}),
            json!({"sr": 1000}),
            json!({"sps": 1000}),
            json!({"fsamp": 1000}),
            json!({"EMG data": {"sampling frequency (Hz)": 1000}}),
            json!({"high_density_emg": {"fs": 2048}}),
            json!({"streams": [{"name": "x", "rate": 1000}]}),
            json!({"sampling_rates": [1000, 1000]}),
        ];
        let others = [
            json!({"gain": 1000}),
            json!({"mains_hz": 50}),
            json!({"highpass_hz": 20}),
            json!({"high_pass_hz": 20}),
            json!({"cutoff_hz": 20}),
            json!({"cut_off_freq": 20}),
            json!({"notch": 50, "bandpass_hz": [20, 450]}),
            json!({"filter": {"freq": 500}}),
            json!({"PowerLineFrequency": 50}),
            json!({"power_line_frequency": 50}),
            json!({"imu_rate_hz": 50}),
            json!({"IMURate": 50}),
            json!({"accelerometer": {"sampling": 148}}),
            json!({"gyro_fs": 2000}),
            json!({"heart_rate": 70}),
            json!({"heartrate": 70}),
            json!({"frame_rate": 30}),
            json!({"framerate": 30}),
            json!({"baud_rate": 115_200}),
            json!({"n_samples": 600}),
            json!({"nSamples": 1000}),
            json!({"sample_count": 600}),
            json!({"samples": 1000}),
            json!({"nyquist": 500}),
            json!({"nyquist_hz": 500}),
            json!({"adc_levels": 256}),
            json!({"resolution": 1024}),
            json!({"adc_max": 4096}),
            json!({"subject_id": 1000}),
            json!({"emg": 8}),
            json!({"emg_channels": 24}),
            json!({"generated": "2024"}),
            json!({"rating": 7}),
            json!({"narrated": 1}),
            json!({"frequent_user": true}),
            json!({"temperature_hz": "n/a"}),
            json!({"device": "Delsys 2000", "note": "recorded 2000"}),
            json!({"rest_period_s": 3}),
            json!({"acquisition_date": "2024-05-01"}),
        ];
        for (examples, expected) in [(&rates[..], true), (&others[..], false)] {
            for example in examples {
                let names =
                    example.as_object().unwrap().iter().flat_map(|(key, value)| rate_names(key, value));
                let names: Vec<String> = names.collect();
                assert_eq!(!names.is_empty(), expected, "{example}: {names:?}");
            }
        }
        assert_eq!(rate_names(&("lowpass".repeat(100_000) + "x"), &json!(1000)), Vec::<String>::new());
        let nested = json!({"name": "x", "rates": [{"fs": 1000}, {"fs": 1000}]});
        assert_eq!(rate_names("device", &nested), ["device.rates.fs"]);
    }
}
