use crate::feature::{AR_ORDER, GROUPS};
use crate::{EmgError, Feature, FeatureLayout};
use serde::{Deserialize, Deserializer, Serialize, Serializer, de};
use std::{fmt, str::FromStr};

/// Most features in a set: each one once.
const MAX_SET: usize = 51;

/// Which features are computed from a window, in order, each at most once.
///
/// Written as names of features and groups, `HTD` or `MAV,RMS,AR4` or `HTD,RMS,TDPSD`; a feature named twice keeps its
/// first place, as in LibEMG. An unknown name is an error. Groups: HTD (MAV ZC SSC WL), TDAR (HTD AR4), LS4 (LS MFL
/// MSR WAMP), LS9 (LS4 ZC RMS IAV DASDV VAR), TDPSD (M0 M2 M4 SPARSI IRF WLF), HJORTH (ACT MOB COMP) and, corrected,
/// HJORTHC (ACT MOB COMPC), which recognises less, see [`Feature::Compc`]; ITD (ISD COR MDIFF MLK), TSTD (MAVFD DASDV WAMP
/// ZC MFL SAMPEN TDPSD), DFTR, MSWT (WENG WV WWL WENT) and COMB (WL SSC LD; LibEMG names a fourth that it does not have).
///
/// [`FeatureLayout`] says where each value stands in the vector of a window.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct FeatureSet {
    /// Filled up with the first feature, so that equal sets are equal values.
    list: [Feature; MAX_SET],
    len: usize,
}

impl FeatureSet {
    /// Hudgins' time-domain set, the default.
    pub const HTD: FeatureSet = {
        let mut list = [Feature::Mav; MAX_SET];
        (list[1], list[2], list[3]) = (Feature::Zc, Feature::Ssc, Feature::Wl);
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
        self.features().iter().any(|feature| feature.depends_on_rate())
    }

    /// The features in order.
    pub fn features(&self) -> &[Feature] {
        &self.list[..self.len]
    }

    /// Whether a feature is in the set.
    pub fn contains(&self, feature: Feature) -> bool {
        self.features().contains(&feature)
    }

    /// Where the values stand in the vector of a window.
    pub fn layout(&self, channels: usize, rate_hz: f64) -> FeatureLayout {
        FeatureLayout::new(*self, channels, rate_hz)
    }

    /// Samples that a window needs: slope sign changes look at three samples, the entropies at five, Burg's method at six.
    pub fn min_window_samples(&self) -> usize {
        let needed = |feature: &Feature| match feature {
            Feature::Ar4 | Feature::Cc => AR_ORDER + 2,
            Feature::Sampen | Feature::Fuzzyen => 5,
            _ => 3,
        };
        self.features().iter().map(needed).max().unwrap_or(3)
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
        assert_eq!(all.features().len(), MAX_SET);
        assert_eq!(set(&all.to_string()), all);
        let error = |names: &str| names.parse::<FeatureSet>().expect_err("unknown").to_string();
        assert!(error("HTD,AR9").starts_with("\"AR9\" is no EMG feature or group; known are HTD TDAR"));
        assert!(error("").starts_with("\"\" is no EMG feature"));
        assert!(error("mav").contains("\"mav\""));
        assert_eq!(FeatureSet::new([]), Err(EmgError::NoFeatures));
    }
}
