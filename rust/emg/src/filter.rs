use crate::EmgError;
use nalgebra::Complex;
use proact_types::{EmgSample, format_number};
use serde::{Deserialize, Deserializer, Serialize, Serializer, de};
use std::{f64::consts::PI, fmt, str::FromStr};

/// A filter of the stream, before windows are cut: what LibEMG's `Filter` has, but causal, so that recordings and live streams are
/// filtered alike. (LibEMG filters forwards and backwards, live over its whole buffer at each poll: the newest samples, which
/// decide, then carry the transients of the edge, and training data do not.)
///
/// Written as `bandpass:20-450`, `bandstop:45-55`, `highpass:20`, `lowpass:450` (Butterworth, of fourth order unless `:2` or the like
/// follows) and `notch:50` (3 Hz wide unless `:5` or the like follows). Coefficients are SciPy's `butter` and `iirnotch`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum EmgFilter {
    /// Lets through what is below.
    Lowpass {
        /// Where power is halved, hertz.
        hz: f64,
        /// Order of the prototype.
        order: usize,
    },
    /// Lets through what is above.
    Highpass {
        /// Where power is halved, hertz.
        hz: f64,
        /// Order of the prototype.
        order: usize,
    },
    /// Lets through what is between.
    Bandpass {
        /// Where power is halved, hertz.
        hz: [f64; 2],
        /// Order of the prototype; the filter has twice as many poles.
        order: usize,
    },
    /// Takes out what is between.
    Bandstop {
        /// Where power is halved, hertz.
        hz: [f64; 2],
        /// Order of the prototype; the filter has twice as many poles.
        order: usize,
    },
    /// Takes out one frequency, as that of the mains.
    Notch {
        /// The frequency, hertz.
        hz: f64,
        /// Between the frequencies where power is halved, hertz.
        width_hz: f64,
    },
}

/// LibEMG's order of its common band pass.
const DEFAULT_ORDER: usize = 4;
/// Beyond this the poles of narrow bands lie too close together for doubles.
const MAX_ORDER: usize = 8;
/// Lowest frequency of a filter, Hz; slower than any recording is long.
const MIN_FREQUENCY_HZ: f64 = 0.001;
/// LibEMG's width of its common notch.
const DEFAULT_WIDTH_HZ: f64 = 3.0;
/// Most filters of a stream.
const MAX_FILTERS: usize = 8;

impl EmgFilter {
    /// The frequencies, and what must be above zero besides.
    fn numbers(&self) -> Vec<f64> {
        match *self {
            EmgFilter::Lowpass { hz, .. } | EmgFilter::Highpass { hz, .. } => vec![hz],
            EmgFilter::Bandpass { hz, .. } | EmgFilter::Bandstop { hz, .. } => hz.to_vec(),
            EmgFilter::Notch { hz, width_hz } => vec![hz, width_hz],
        }
    }

    fn check(&self, rate_hz: f64) -> Result<(), EmgError> {
        let refused = |reason: String| Err(EmgError::Filter { filter: self.to_string(), reason });
        let half = rate_hz / 2.0;
        if let Some(bad) = self.numbers().into_iter().find(|hz| !(MIN_FREQUENCY_HZ..half).contains(hz)) {
            let bad = format_number(bad);
            return refused(format!(
                "{bad} Hz does not lie between {MIN_FREQUENCY_HZ} Hz and half the rate, {half} Hz"
            ));
        }
        match *self {
            EmgFilter::Bandpass { hz: [low, high], .. } | EmgFilter::Bandstop { hz: [low, high], .. }
                if low >= high =>
            {
                refused("the lower frequency must come first".to_owned())
            }
            EmgFilter::Lowpass { order, .. }
            | EmgFilter::Highpass { order, .. }
            | EmgFilter::Bandpass { order, .. }
            | EmgFilter::Bandstop { order, .. }
                if !(1..=MAX_ORDER).contains(&order) =>
            {
                refused(format!("order {order}, expected 1 to {MAX_ORDER}"))
            }
            _ => Ok(()),
        }
    }

    /// The filter at a rate, as sections of second order.
    fn sections(&self, rate_hz: f64) -> Vec<SecondOrderSection> {
        let warp = |hz: f64| 4.0 * (PI * hz / rate_hz).tan();
        let real = |value: f64| Complex::new(value, 0.0);
        // Poles of the analogue prototype, in the left half plane.
        let prototype = |order: usize| {
            (0..order)
                .map(move |k| Complex::from_polar(1.0, PI * (2 * k + order + 1) as f64 / (2 * order) as f64))
        };
        let band = |[low, high]: [f64; 2]| (warp(high) - warp(low), (warp(low) * warp(high)).sqrt());
        let split = |middle: Complex<f64>, center: f64| {
            let root = (middle * middle - real(center * center)).sqrt();
            [middle + root, middle - root]
        };
        match *self {
            EmgFilter::Lowpass { hz, order } => {
                let poles: Vec<_> = prototype(order).map(|p| p * warp(hz)).collect();
                butterworth(&poles, [1.0, 2.0, 1.0], [1.0, 1.0], 0.0)
            }
            EmgFilter::Highpass { hz, order } => {
                let poles: Vec<_> = prototype(order).map(|p| real(warp(hz)) / p).collect();
                butterworth(&poles, [1.0, -2.0, 1.0], [1.0, -1.0], PI)
            }
            EmgFilter::Bandpass { hz, order } => {
                let (width, center) = band(hz);
                let poles: Vec<_> = prototype(order).flat_map(|p| split(p * (width / 2.0), center)).collect();
                butterworth(&poles, [1.0, 0.0, -1.0], [1.0, 0.0], 2.0 * (center / 4.0).atan())
            }
            EmgFilter::Bandstop { hz, order } => {
                let (width, center) = band(hz);
                let poles: Vec<_> =
                    prototype(order).flat_map(|p| split(real(width / 2.0) / p, center)).collect();
                let stopped = 2.0 * (center / 4.0).atan();
                butterworth(&poles, [1.0, -2.0 * stopped.cos(), 1.0], [1.0, 0.0], 0.0)
            }
            EmgFilter::Notch { hz, width_hz } => {
                let gain = 1.0 / (1.0 + (PI * width_hz / rate_hz).tan());
                let cosine = (2.0 * PI * hz / rate_hz).cos();
                let numerator = [gain, -2.0 * gain * cosine, gain];
                vec![SecondOrderSection { numerator, denominator: [-2.0 * gain * cosine, 2.0 * gain - 1.0] }]
            }
        }
    }
}

/// `(b0 + b1 / z + b2 / z^2) / (1 + a1 / z + a2 / z^2)`.
#[derive(Clone, Copy, Debug, PartialEq)]
struct SecondOrderSection {
    numerator: [f64; 3],
    denominator: [f64; 2],
}

/// Digital sections of analogue poles by the bilinear transform. Each section has the zeros of `numerator`, one of a single
/// pole those of `single`; the whole has gain one at `unity`, radians a sample.
fn butterworth(
    analog: &[Complex<f64>],
    numerator: [f64; 3],
    single: [f64; 2],
    unity: f64,
) -> Vec<SecondOrderSection> {
    let four = Complex::new(4.0, 0.0);
    let poles = analog.iter().map(|p| (four + p) / (four - p));
    let (mut sections, mut singles) = (Vec::new(), Vec::new());
    for pole in poles {
        if pole.im.abs() < 1e-12 {
            singles.push(pole.re);
        } else if pole.im > 0.0 {
            sections.push(SecondOrderSection { numerator, denominator: [-2.0 * pole.re, pole.norm_sqr()] });
        }
    }
    singles.sort_by(f64::total_cmp);
    for pair in singles.chunks(2) {
        sections.push(match *pair {
            [a, b] => SecondOrderSection { numerator, denominator: [-a - b, a * b] },
            _ => SecondOrderSection { numerator: [single[0], single[1], 0.0], denominator: [-pair[0], 0.0] },
        });
    }
    let at = Complex::from_polar(1.0, -unity);
    let gain = |s: &SecondOrderSection| {
        let [b0, b1, b2] = s.numerator;
        let [a1, a2] = s.denominator;
        ((at * b2 + b1) * at + b0).norm() / ((at * a2 + a1) * at + 1.0).norm()
    };
    for section in &mut sections {
        let gain = gain(section);
        section.numerator.iter_mut().for_each(|b| *b /= gain);
    }
    sections
}

/// The filters of a stream at work. Begins as if the first sample had stood for ever, so that there is no step at the start.
#[derive(Clone, Debug)]
pub(crate) struct FilterBank {
    sections: Vec<SecondOrderSection>,
    /// Two numbers a section and channel, channel by channel.
    states: Vec<[f64; 2]>,
    newest: Option<u64>,
}

impl FilterBank {
    pub(crate) fn new(filters: &[EmgFilter], rate_hz: f64, channels: usize) -> Result<FilterBank, EmgError> {
        if filters.len() > MAX_FILTERS {
            let reason = format!("{} filters, expected at most {MAX_FILTERS}", filters.len());
            return Err(EmgError::Filter { filter: "emg.filters".to_owned(), reason });
        }
        filters.iter().try_for_each(|filter| filter.check(rate_hz))?;
        let sections: Vec<SecondOrderSection> =
            filters.iter().flat_map(|filter| filter.sections(rate_hz)).collect();
        let states = vec![[0.0; 2]; sections.len() * channels];
        Ok(FilterBank { sections, states, newest: None })
    }

    /// Whether there is nothing to do.
    pub(crate) fn is_empty(&self) -> bool {
        self.sections.is_empty()
    }

    /// Filters a sample in place. One that the window will refuse (another number of channels, values that are not finite, a
    /// repeated counter) is left as it is and changes nothing; lost samples change nothing either; a counter that went back
    /// begins anew.
    pub(crate) fn apply(&mut self, sample: &mut EmgSample) {
        // What follows the electrodes is no EMG.
        let electrodes = self.states.len() / self.sections.len();
        let whole = sample.channels.len() >= electrodes;
        if !whole
            || sample.channels[..electrodes].iter().any(|v| !v.is_finite())
            || self.newest == Some(sample.counter)
        {
            return;
        }
        let begins = self.newest.is_none_or(|newest| sample.counter < newest);
        self.newest = Some(sample.counter);
        for (value, states) in
            sample.channels.iter_mut().zip(self.states.chunks_exact_mut(self.sections.len()))
        {
            for (section, state) in self.sections.iter().zip(states) {
                if begins {
                    *state = section.steady_state(*value);
                }
                *value = section.step(*value, state);
            }
        }
    }
}

impl SecondOrderSection {
    /// Direct form II, transposed.
    fn step(&self, x: f64, state: &mut [f64; 2]) -> f64 {
        let ([b0, b1, b2], [a1, a2]) = (self.numerator, self.denominator);
        let y = b0 * x + state[0];
        *state = [b1 * x - a1 * y + state[1], b2 * x - a2 * y];
        y
    }

    /// The state after an endless `x`.
    fn steady_state(&self, x: f64) -> [f64; 2] {
        let ([b0, b1, b2], [a1, a2]) = (self.numerator, self.denominator);
        let y = x * (b0 + b1 + b2) / (1.0 + a1 + a2);
        let second = b2 * x - a2 * y;
        [b1 * x - a1 * y + second, second]
    }
}

impl fmt::Display for EmgFilter {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let order = |order: usize| if order == DEFAULT_ORDER { String::new() } else { format!(":{order}") };
        match *self {
            EmgFilter::Lowpass { hz, order: n } => write!(f, "lowpass:{hz}{}", order(n)),
            EmgFilter::Highpass { hz, order: n } => write!(f, "highpass:{hz}{}", order(n)),
            EmgFilter::Bandpass { hz: [low, high], order: n } => {
                write!(f, "bandpass:{low}-{high}{}", order(n))
            }
            EmgFilter::Bandstop { hz: [low, high], order: n } => {
                write!(f, "bandstop:{low}-{high}{}", order(n))
            }
            EmgFilter::Notch { hz, width_hz: DEFAULT_WIDTH_HZ } => write!(f, "notch:{hz}"),
            EmgFilter::Notch { hz, width_hz } => write!(f, "notch:{hz}:{width_hz}"),
        }
    }
}

impl FromStr for EmgFilter {
    type Err = EmgError;

    fn from_str(text: &str) -> Result<EmgFilter, EmgError> {
        let bad = || {
            EmgError::Filter {
            filter: text.to_owned(),
            reason: "expected bandpass:20-450, bandstop:45-55, highpass:20, lowpass:450 or notch:50, with :ORDER (or :WIDTH of a \
                     notch) after it"
                .to_owned(),
        }
        };
        let mut parts = text.split(':');
        let (kind, hz, option) = (parts.next().ok_or_else(bad)?, parts.next().ok_or_else(bad)?, parts.next());
        let number = |text: &str| text.trim().parse::<f64>().map_err(|_| bad());
        let order = || option.map_or(Ok(DEFAULT_ORDER), |o| o.trim().parse().map_err(|_| bad()));
        let both = || -> Result<[f64; 2], EmgError> {
            let (low, high) = hz.split_once('-').ok_or_else(bad)?;
            Ok([number(low)?, number(high)?])
        };
        if parts.next().is_some() {
            return Err(bad());
        }
        match kind.trim() {
            "lowpass" => Ok(EmgFilter::Lowpass { hz: number(hz)?, order: order()? }),
            "highpass" => Ok(EmgFilter::Highpass { hz: number(hz)?, order: order()? }),
            "bandpass" => Ok(EmgFilter::Bandpass { hz: both()?, order: order()? }),
            "bandstop" => Ok(EmgFilter::Bandstop { hz: both()?, order: order()? }),
            "notch" => {
                let width_hz = option.map_or(Ok(DEFAULT_WIDTH_HZ), number)?;
                Ok(EmgFilter::Notch { hz: number(hz)?, width_hz })
            }
            _ => Err(bad()),
        }
    }
}

impl Serialize for EmgFilter {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

impl<'de> Deserialize<'de> for EmgFilter {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        String::deserialize(deserializer)?.parse().map_err(de::Error::custom)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What SciPy gives, from `tests/make_filter_vectors.py`.
    #[derive(Deserialize)]
    struct Case {
        filter: EmgFilter,
        rate_hz: f64,
        input: Vec<f64>,
        output: Vec<f64>,
    }

    fn run(bank: &mut FilterBank, values: impl IntoIterator<Item = f64>) -> Vec<f64> {
        let sample = |(counter, value): (u64, f64)| {
            let mut sample = EmgSample { counter, channels: [value].into_iter().collect() };
            bank.apply(&mut sample);
            sample.channels[0]
        };
        (0..).zip(values).map(sample).collect()
    }

    #[test]
    fn every_filter_is_scipys() {
        let cases: Vec<Case> =
            serde_json::from_str(include_str!("../tests/filter_vectors.json")).expect("the vectors are JSON");
        for case in cases {
            let mut bank = FilterBank::new(&[case.filter], case.rate_hz, 1).expect("it can be");
            let scale = case.input.iter().fold(0.0_f64, |max, v| max.max(v.abs()));
            let got = run(&mut bank, case.input.iter().copied());
            let worst = got.iter().zip(&case.output).map(|(a, b)| (a - b).abs() / scale).fold(0.0, f64::max);
            assert!(worst < 1e-9, "{}: {worst:e}", case.filter);
            println!("{} at {} Hz: {worst:.1e}", case.filter, case.rate_hz);
        }
    }

    #[test]
    fn the_mains_go_and_the_muscle_stays() {
        let filters = ["bandpass:20-450".parse(), "notch:50".parse()].map(|f| f.expect("written right"));
        let mut bank = FilterBank::new(&filters, 1000.0, 1).expect("they can be");
        let wave = |hz: f64| (0..4000).map(move |k| (2.0 * PI * hz * f64::from(k) / 1000.0).sin() + 120.0);
        let strength = |values: &[f64]| values[2000..].iter().fold(0.0_f64, |max, v| max.max(v.abs()));
        assert!(strength(&run(&mut bank.clone(), wave(50.0))) < 1e-3);
        assert!((strength(&run(&mut bank.clone(), wave(120.0))) - 1.0).abs() < 0.02);
        // An endless level makes no step at the start.
        assert!(run(&mut bank, std::iter::repeat_n(120.0, 100)).iter().all(|v| v.abs() < 1e-9));
    }

    #[test]
    fn what_the_window_will_refuse_changes_nothing_and_a_new_start_begins_anew() {
        let filter = "highpass:20:2".parse().expect("written right");
        let mut bank = FilterBank::new(&[filter], 1000.0, 2).expect("it can be");
        let sample =
            |counter, channels: &[f64]| EmgSample { counter, channels: channels.iter().copied().collect() };
        let mut pass = |counter, channels: &[f64]| {
            let mut sample = sample(counter, channels);
            bank.apply(&mut sample);
            sample.channels.to_vec()
        };
        assert_eq!(pass(7, &[3.0, -2.0]).iter().map(|v| v.abs() < 1e-12).collect::<Vec<_>>(), [true, true]);
        assert!(pass(8, &[f64::NAN, 1.0])[0].is_nan());
        assert_eq!(pass(8, &[1.0]), [1.0]);
        assert_eq!(pass(7, &[5.0, 5.0]), [5.0, 5.0], "a repeated counter");
        assert!(pass(9, &[3.0, -2.0]).iter().all(|v| v.abs() < 1e-12), "nothing has moved");
        assert!(pass(2, &[50.0, 60.0]).iter().all(|v| v.abs() < 1e-12), "a new start");
    }

    #[test]
    fn filters_are_written_as_they_are_read_and_bad_ones_are_refused() {
        for text in
            ["bandpass:20-450", "bandstop:45-55:2", "highpass:20:2", "lowpass:450", "notch:60", "notch:50:5"]
        {
            assert_eq!(text.parse::<EmgFilter>().expect("written right").to_string(), text);
        }
        let bad = ["bandpass:20", "notch", "comb:50", "highpass:x", "lowpass:5:1:2", "notch:50:wide"];
        for text in bad {
            let message = text.parse::<EmgFilter>().expect_err("must be refused").to_string();
            assert!(message.contains("expected bandpass:20-450"), "{message}");
        }
        let refused = |text: &str| {
            let filter = text.parse().expect("written right");
            FilterBank::new(&[filter], 1000.0, 1).expect_err("must be refused").to_string()
        };
        assert!(
            refused("lowpass:500").contains("500 Hz does not lie between 0.001 Hz and half the rate, 500 Hz")
        );
        assert!(refused("bandpass:90-20").contains("the lower frequency must come first"));
        assert!(refused("highpass:20:9").contains("order 9, expected 1 to 8"));
        assert!(refused("notch:-50").contains("-50 Hz"));
        assert!(refused("notch:NaN").contains("NaN Hz"));
        let many = vec![EmgFilter::Notch { hz: 50.0, width_hz: 3.0 }; 9];
        assert!(FilterBank::new(&many, 1000.0, 1).is_err_and(|e| e.to_string().contains("9 filters")));
    }
}
