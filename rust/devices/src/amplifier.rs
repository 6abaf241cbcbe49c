//! What amplifiers publish on the lab streaming layer, and doubles of them.

use crate::{gforce::CodeSource, random_stream};
use proact_types::ChannelValues;
use rand_distr::{Distribution, StandardNormal};

/// Microvolts of one code of simulated people: that of a gForce at 8 bit, nominal.
const CODE_MICROVOLTS: f64 = 2.5e6 / 1200.0 / 127.0;
/// Noise of each electrode by itself, microvolts.
const NOISE_MICROVOLTS: f64 = 0.8;
/// A counter of 16 bits begins anew here.
const COUNTER_MODULUS: u64 = 1 << 16;

/// One channel as its stream describes it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AmplifierChannel {
    /// Its name.
    pub label: String,
    /// Such as `microvolts`.
    pub unit: &'static str,
    /// Such as `EMG`; `AUX` and `MISC` are no EMG.
    pub kind: &'static str,
}

/// How the stream of an amplifier looks: names, units, rate.
#[derive(Clone, Debug, PartialEq)]
pub struct AmplifierLayout {
    /// By which it is asked for, such as `delsys`.
    pub key: &'static str,
    /// For display.
    pub device: &'static str,
    /// Samples per second.
    pub rate_hz: f64,
    /// In the order of the stream.
    pub channels: Vec<AmplifierChannel>,
}

impl AmplifierLayout {
    /// Delsys Trigno, OT Bioelettronica Sessantaquattro, and a Cyton board through BrainFlow; docs/amplifiers.md says how each
    /// comes to the lab streaming layer, and from where the layouts are.
    pub fn all() -> [AmplifierLayout; 3] {
        let several = |name: &str, count: usize, unit, kind| -> Vec<AmplifierChannel> {
            (1..=count).map(|k| AmplifierChannel { label: format!("{name}{k}"), unit, kind }).collect()
        };
        let grid = [
            several("EMG", 64, "microvolts", "EMG"),
            several("AUX", 2, "microvolts", "AUX"),
            several("COUNTER", 2, "counts", "MISC"),
        ];
        [
            AmplifierLayout {
                key: "delsys",
                device: "Delsys Trigno",
                rate_hz: 2000.0,
                channels: several("EMG", 16, "volts", "EMG"),
            },
            AmplifierLayout {
                key: "otb",
                device: "OT Bioelettronica Sessantaquattro",
                rate_hz: 2000.0,
                channels: grid.concat(),
            },
            AmplifierLayout {
                key: "brainflow",
                device: "OpenBCI Cyton through BrainFlow",
                rate_hz: 250.0,
                channels: several("EXG", 8, "microvolts", "EXG"),
            },
        ]
    }

    /// The one of this key.
    pub fn find(key: &str) -> Option<AmplifierLayout> {
        AmplifierLayout::all().into_iter().find(|layout| layout.key == key)
    }

    /// The double's samples in the units of the layout, for a person whose armband gives `codes`. Electrodes lie around the arm at
    /// even distances, and each hears the two nearest of the armband's and a noise of its own.
    pub fn simulated_samples(&self, mut codes: CodeSource, seed: u64) -> CodeSource {
        let channels = self.channels.clone();
        let electrodes = channels.iter().filter(|channel| is_emg(channel.kind)).count();
        let mut rng = random_stream(seed, "emg/simulate/amplifier");
        let mut counter = 0_u64;
        Box::new(move || {
            let around = codes();
            counter += 1;
            let mut electrode = 0;
            let mut value = |channel: &AmplifierChannel| match channel.kind {
                kind if is_emg(kind) => {
                    let angle_index = electrode as f64 * around.len() as f64 / electrodes as f64;
                    electrode += 1;
                    let (first, share) = (angle_index as usize, angle_index.fract());
                    let code = |k: usize| around.get(k % around.len().max(1)).copied().unwrap_or(0.0);
                    let interpolated = (1.0 - share) * code(first) + share * code(first + 1);
                    let noise: f64 = StandardNormal.sample(&mut rng);
                    let microvolts = CODE_MICROVOLTS * interpolated + NOISE_MICROVOLTS * noise;
                    microvolts / microvolts_per_unit(channel.unit).unwrap_or(1.0)
                }
                "MISC" => (counter % COUNTER_MODULUS) as f64,
                _ => 0.0,
            };
            channels.iter().map(&mut value).collect::<ChannelValues>()
        })
    }
}

/// EMG, or what a board for all biosignals calls its electrodes.
pub(crate) fn is_emg(kind: &str) -> bool {
    kind.eq_ignore_ascii_case("EMG") || kind.eq_ignore_ascii_case("EXG")
}

/// A sensor of an inertial measurement unit, as programs call them.
#[cfg_attr(not(feature = "lsl"), allow(dead_code))] // Only streams say what their channels are.
pub(crate) fn is_imu(kind: &str) -> bool {
    let known = [
        "ACC",
        "ACCELEROMETER",
        "ACCELERATION",
        "GYR",
        "GYRO",
        "GYROSCOPE",
        "ORIENTATION",
        "QUATERNION",
        "IMU",
    ];
    known.iter().any(|known| kind.eq_ignore_ascii_case(known))
}

/// Microvolts of one of this unit; none if it is no voltage.
pub(crate) fn microvolts_per_unit(unit: &str) -> Option<f64> {
    let unit = unit.trim().to_lowercase();
    Some(match unit.as_str() {
        "v" | "volt" | "volts" => 1e6,
        "mv" | "millivolt" | "millivolts" => 1e3,
        // Both the micro sign and the Greek letter are in use.
        "uv" | "\u{b5}v" | "\u{3bc}v" | "microvolt" | "microvolts" => 1.0,
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Channel c of the armband gives 10 c.
    fn person() -> CodeSource {
        Box::new(|| (0..8).map(|c| 10.0 * f64::from(c)).collect())
    }

    #[test]
    fn each_double_has_the_channels_and_units_of_its_layout() {
        let [delsys, otb, brainflow] = AmplifierLayout::all();
        assert_eq!(delsys.simulated_samples(person(), 0)().len(), 16);
        assert!(
            delsys.simulated_samples(person(), 0)().iter().all(|volts| volts.abs() < 0.011),
            "the range of a Trigno"
        );
        let sample = otb.simulated_samples(person(), 0)();
        assert_eq!((sample.len(), &sample[64..]), (68, &[0.0, 0.0, 1.0, 1.0][..]));
        assert_eq!(brainflow.simulated_samples(person(), 0)().len(), 8);
        assert!(AmplifierLayout::find("gforce").is_none());
    }

    #[test]
    fn electrodes_between_two_of_the_armband_hear_both() {
        let mut double = AmplifierLayout::find("otb").unwrap().simulated_samples(person(), 3);
        let sample = double();
        // Eight electrodes of the grid for one of the armband.
        for (electrode, code) in [(8, 10.0), (12, 15.0), (40, 50.0)] {
            let off = sample[electrode] - CODE_MICROVOLTS * code;
            assert!(off.abs() < 6.0 * NOISE_MICROVOLTS, "{electrode}: {off}");
        }
    }

    #[test]
    fn units_are_known_by_their_usual_spellings() {
        for (unit, microvolts) in [
            ("volts", Some(1e6)),
            ("mV", Some(1e3)),
            ("uV", Some(1.0)),
            ("\u{b5}V", Some(1.0)),
            ("counts", None),
        ] {
            assert_eq!(microvolts_per_unit(unit), microvolts, "{unit}");
        }
        assert!(is_emg("emg") && is_emg("EXG") && !is_emg("AUX"));
    }
}
