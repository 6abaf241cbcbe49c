use crate::EmgError;
use serde::{Deserialize, Deserializer, Serialize, Serializer, de};
use std::{fmt, str::FromStr};

/// Coefficients of [`Feature::Ar4`].
pub(crate) const AR_ORDER: usize = 4;

/// One feature of a channel of a window of L samples x_0 .. x_{L-1}, by LibEMG's name and definition (2.0.3).
///
/// `dx` is the first difference, `ddx` the second. Where LibEMG gives NaN, an infinity or an exception (a channel
/// that is zero, constant or a straight line), the value here is 0, as with its option `fix_feature_errors`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Feature {
    /// `MAV`: mean absolute value, `sum |x| / L`.
    Mav,
    /// `ZC`: neighbours of opposite sign; no dead zone, a sample that is exactly zero hides a crossing.
    Zc,
    /// `SSC`: slope sign changes, `(x_i - x_{i-1}) (x_i - x_{i+1}) >= ssc_threshold`. Because equality counts, each
    /// point of a plateau counts, and a dead channel shows the largest value possible, L - 2. Textbooks use `>`.
    Ssc,
    /// `WL`: waveform length, `sum |dx|`.
    Wl,
    /// `LS`: L-score, the second L-moment, half the mean distance of two samples.
    Ls,
    /// `MFL`: maximum fractal length, `log10(sum |dx|)`; 0 for a constant channel.
    Mfl,
    /// `MSR`: mean square root, `|sum sqrt(x)| / L` with imaginary roots of negative samples.
    Msr,
    /// `WAMP`: Willison amplitude, count of `|dx| > wamp_threshold`.
    Wamp,
    /// `RMS`: root mean square.
    Rms,
    /// `IAV`: integrated absolute value, `sum |x|`.
    Iav,
    /// `DASDV`: `sqrt(mean dx^2)`.
    Dasdv,
    /// `VAR`: population variance.
    Var,
    /// `M0`: zero-order moment of the time-dependent power spectrum descriptors (TDPSD). Each of the six descriptors
    /// is a quantity a of x and b of `ln(x^2 + eps)`, as `-2ab / (a^2 + b^2)`; the roots of the moments before the
    /// power of 0.1 belong to LibEMG's definition.
    M0,
    /// `M2`: second-order moment (TDPSD).
    M2,
    /// `M4`: fourth-order moment (TDPSD).
    M4,
    /// `SPARSI`: sparseness (TDPSD).
    Sparsi,
    /// `IRF`: irregularity factor (TDPSD).
    Irf,
    /// `WLF`: ratio of the waveform lengths of x and dx (TDPSD).
    Wlf,
    /// `AR4`, also `AR`: four autoregressive coefficients by Burg's method, channel by channel.
    Ar4,
    /// `MDF`: median frequency, hertz, to the next bin; 0 for a zero channel, on which LibEMG stops.
    Mdf,
    /// `MNF`: mean frequency, hertz.
    Mnf,
    /// `SKEW`: skewness, not corrected for bias.
    Skew,
    /// `KURT`: kurtosis, 3 for a normal distribution, not corrected for bias.
    Kurt,
    /// `ACT`: Hjorth's activity as LibEMG has it, `mean x^2`.
    Act,
    /// `MOB`: Hjorth's mobility, `sqrt(mean dx^2 / mean x^2)`, both means over L.
    Mob,
    /// `COMP`: what LibEMG computes online. An axis is missing there, so `sum ddx^2` runs over all channels (and
    /// offline over all windows handed in, so that its value depends on their number; that is not copied).
    Comp,
    /// `COMPC`: Hjorth's complexity (1970), the mobility of dx over the mobility of x, per channel. The corrected
    /// form of `COMP`. Correct is not better here: on 22 people (3DC, five gestures, LDA) HJORTHC recognises 89.2 % of
    /// windows, HJORTH with `COMP` as LibEMG has it 93.2 %.
    Compc,
}

use Feature::*;

const FEATURES: [(&str, Feature); 28] = [
    ("MAV", Mav),
    ("ZC", Zc),
    ("SSC", Ssc),
    ("WL", Wl),
    ("LS", Ls),
    ("MFL", Mfl),
    ("MSR", Msr),
    ("WAMP", Wamp),
    ("RMS", Rms),
    ("IAV", Iav),
    ("DASDV", Dasdv),
    ("VAR", Var),
    ("M0", M0),
    ("M2", M2),
    ("M4", M4),
    ("SPARSI", Sparsi),
    ("IRF", Irf),
    ("WLF", Wlf),
    ("AR4", Ar4),
    ("AR", Ar4),
    ("MDF", Mdf),
    ("MNF", Mnf),
    ("SKEW", Skew),
    ("KURT", Kurt),
    ("ACT", Act),
    ("MOB", Mob),
    ("COMP", Comp),
    ("COMPC", Compc),
];

const GROUPS: [(&str, &[Feature]); 7] = [
    ("HTD", &[Mav, Zc, Ssc, Wl]),
    ("TDAR", &[Mav, Zc, Ssc, Wl, Ar4]),
    ("LS4", &[Ls, Mfl, Msr, Wamp]),
    ("LS9", &[Ls, Mfl, Msr, Wamp, Zc, Rms, Iav, Dasdv, Var]),
    ("TDPSD", &[M0, M2, M4, Sparsi, Irf, Wlf]),
    ("HJORTH", &[Act, Mob, Comp]),
    ("HJORTHC", &[Act, Mob, Compc]),
];

impl Feature {
    /// Every feature, in the order of LibEMG's list.
    pub fn all() -> impl Iterator<Item = Feature> {
        FEATURES.iter().filter(|(name, _)| *name != "AR").map(|(_, feature)| *feature)
    }

    /// LibEMG's name.
    pub fn name(self) -> &'static str {
        FEATURES.iter().find(|(_, feature)| *feature == self).map_or("", |(name, _)| name)
    }

    /// Values per channel: 4 for `AR4`, else 1.
    pub fn per_channel(self) -> usize {
        if self == Ar4 { AR_ORDER } else { 1 }
    }
}

impl FromStr for Feature {
    type Err = EmgError;

    fn from_str(name: &str) -> Result<Feature, EmgError> {
        let found = FEATURES.iter().find(|(known, _)| *known == name);
        found.map(|(_, feature)| *feature).ok_or_else(|| EmgError::UnknownFeature { name: name.to_owned() })
    }
}

/// Most features in a set: each one once.
const MAX_SET: usize = 27;

/// So many features of a window need no memory of their own: every one of them, `AR4` with its four values, of 16 channels
/// and more.
pub(crate) const INLINE_FEATURES: usize = 512;

/// Which features are computed from a window, in order, each at most once.
///
/// Written as names of features and groups, `HTD` or `MAV,RMS,AR4` or `HTD,RMS,TDPSD`; a feature named twice keeps its
/// first place, as in LibEMG. An unknown name is an error. Groups: HTD (MAV ZC SSC WL), TDAR (HTD AR4), LS4 (LS MFL
/// MSR WAMP), LS9 (LS4 ZC RMS IAV DASDV VAR), TDPSD (M0 M2 M4 SPARSI IRF WLF), HJORTH (ACT MOB COMP) and, corrected,
/// HJORTHC (ACT MOB COMPC), which recognises less, see [`Feature::Compc`].
///
/// The vector of a window is feature-major: all channels of the first feature, then all of the second; within `AR4`
/// the four coefficients of channel 0, then of channel 1.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct FeatureSet {
    /// Filled up with the first feature, so that equal sets are equal values.
    list: [Feature; MAX_SET],
    len: usize,
}

impl FeatureSet {
    /// Hudgins' time-domain set, the default.
    pub const HTD: FeatureSet = {
        let mut list = [Mav; MAX_SET];
        (list[1], list[2], list[3]) = (Zc, Ssc, Wl);
        FeatureSet { list, len: 4 }
    };

    /// A set of these features; repeated ones keep their first place.
    ///
    /// # Errors
    /// If there are none.
    pub fn new(features: impl IntoIterator<Item = Feature>) -> Result<FeatureSet, EmgError> {
        let mut features = features.into_iter();
        let first = features.next().ok_or(EmgError::NoFeatures)?;
        let mut set = FeatureSet { list: [first; MAX_SET], len: 1 };
        for feature in features {
            if !set.contains(feature) {
                set.list[set.len] = feature;
                set.len += 1;
            }
        }
        Ok(set)
    }

    /// Whether the same samples have other features at another rate: frequencies in hertz.
    pub fn depends_on_rate(&self) -> bool {
        self.contains(Mdf) || self.contains(Mnf)
    }

    /// The features in order.
    pub fn features(&self) -> &[Feature] {
        &self.list[..self.len]
    }

    /// Whether a feature is in the set.
    pub fn contains(&self, feature: Feature) -> bool {
        self.features().contains(&feature)
    }

    /// Number of values of a window of `channels` channels.
    pub fn count(&self, channels: usize) -> usize {
        channels * self.features().iter().map(|f| f.per_channel()).sum::<usize>()
    }

    /// Samples that a window needs: slope sign changes look at three samples, Burg's method at six.
    pub fn shortest_window(&self) -> usize {
        if self.contains(Ar4) { AR_ORDER + 2 } else { 3 }
    }

    /// `MAV_ch0` and so on, in the order of the vector; `AR4_1_ch0` .. `AR4_4_ch0` for the coefficients.
    pub fn column_names(&self, channels: usize) -> Vec<String> {
        let mut names = Vec::with_capacity(self.count(channels));
        for feature in self.features() {
            for channel in 0..channels {
                match feature.per_channel() {
                    1 => names.push(format!("{}_ch{channel}", feature.name())),
                    values => {
                        names.extend((1..=values).map(|k| format!("{}_{k}_ch{channel}", feature.name())));
                    }
                }
            }
        }
        names
    }

    /// Writes to `out` the vector that the band would have given if it sat `shift` channels further: channel c of the
    /// result is channel `(c + shift) mod channels` of `vector`.
    ///
    /// # Panics
    /// If a length differs from [`FeatureSet::count`]; the caller owns both.
    pub fn roll(&self, vector: &[f64], channels: usize, shift: usize, out: &mut [f64]) {
        let count = self.count(channels);
        assert_eq!((vector.len(), out.len()), (count, count), "lengths of the feature vectors");
        let mut start = 0;
        for feature in self.features() {
            let (width, length) = (feature.per_channel(), channels * feature.per_channel());
            let (from, to) = (&vector[start..start + length], &mut out[start..start + length]);
            to.copy_from_slice(from);
            to.rotate_left(shift % channels * width);
            start += length;
        }
    }

    /// Where the values of a feature begin in a vector; none if the set does not have it.
    pub(crate) fn start_of(&self, feature: Feature, channels: usize) -> Option<usize> {
        let before = self.features().iter().take_while(|f| **f != feature);
        self.contains(feature).then(|| channels * before.map(|f| f.per_channel()).sum::<usize>())
    }

    /// Sum of MAV over channels in a feature vector, if the set has MAV.
    pub fn amplitude(&self, vector: &[f64], channels: usize) -> Option<f64> {
        let start = self.start_of(Mav, channels)?;
        Some(vector[start..start + channels].iter().sum())
    }
}

impl Default for FeatureSet {
    fn default() -> Self {
        FeatureSet::HTD
    }
}

impl FromStr for FeatureSet {
    type Err = EmgError;

    fn from_str(names: &str) -> Result<FeatureSet, EmgError> {
        let mut features = Vec::new();
        for name in names.split(',').map(str::trim) {
            match GROUPS.iter().find(|(group, _)| *group == name) {
                Some((_, members)) => features.extend_from_slice(members),
                None => features.push(name.parse()?),
            }
        }
        FeatureSet::new(features)
    }
}

/// The group's name, or the features' names.
impl fmt::Display for FeatureSet {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some((group, _)) = GROUPS.iter().find(|(_, members)| *members == self.features()) {
            return f.write_str(group);
        }
        for (k, feature) in self.features().iter().enumerate() {
            write!(f, "{}{}", if k == 0 { "" } else { "," }, feature.name())?;
        }
        Ok(())
    }
}

impl fmt::Debug for FeatureSet {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "FeatureSet({self})")
    }
}

impl Serialize for FeatureSet {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

impl<'de> Deserialize<'de> for FeatureSet {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        String::deserialize(deserializer)?.parse().map_err(de::Error::custom)
    }
}

/// Names of all features and groups, for messages.
pub(crate) fn known_names() -> String {
    let groups = GROUPS.iter().map(|(name, _)| *name);
    groups.chain(Feature::all().map(Feature::name)).collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn set(names: &str) -> FeatureSet {
        names.parse().expect("known names")
    }

    #[test]
    fn names_are_read_and_written_and_an_unknown_one_is_an_error() {
        assert_eq!(set("MAV,ZC,SSC,WL"), FeatureSet::HTD);
        assert_eq!(set("HTD, AR").to_string(), "TDAR");
        assert_eq!(set("RMS,LS4").to_string(), "RMS,LS,MFL,MSR,WAMP");
        assert_eq!(set("ZC,HTD").to_string(), "ZC,MAV,SSC,WL", "the first place is kept");
        let all = FeatureSet::new(Feature::all()).expect("not empty");
        assert_eq!((all.features().len(), all.count(16)), (MAX_SET, (MAX_SET - 1 + AR_ORDER) * 16));
        assert!(all.count(16) <= INLINE_FEATURES, "armbands need no memory for features");
        assert_eq!(set(&all.to_string()), all);
        let error = |names: &str| names.parse::<FeatureSet>().expect_err("unknown").to_string();
        assert!(error("HTD,AR9").starts_with("\"AR9\" is no EMG feature or group; known are HTD TDAR"));
        assert!(error("").starts_with("\"\" is no EMG feature"));
        assert!(error("mav").contains("\"mav\""));
        assert_eq!(FeatureSet::new([]), Err(EmgError::NoFeatures));
    }

    #[test]
    fn columns_amplitude_and_roll_follow_the_layout() {
        let set = set("AR4,MAV");
        let names = set.column_names(2);
        assert_eq!(names.len(), set.count(2));
        assert_eq!((&names[0][..], &names[4][..], &names[9][..]), ("AR4_1_ch0", "AR4_1_ch1", "MAV_ch1"));
        let vector = [0.0, 1.0, 2.0, 3.0, 10.0, 11.0, 12.0, 13.0, 5.0, 6.0];
        assert_eq!(set.amplitude(&vector, 2), Some(11.0));
        assert_eq!("LS4".parse::<FeatureSet>().expect("known").amplitude(&[0.0; 8], 2), None);
        let mut rolled = [0.0; 10];
        set.roll(&vector, 2, 1, &mut rolled);
        assert_eq!(rolled, [10.0, 11.0, 12.0, 13.0, 0.0, 1.0, 2.0, 3.0, 6.0, 5.0]);
        set.roll(&vector, 2, 2, &mut rolled);
        assert_eq!(rolled, vector);
    }
}
