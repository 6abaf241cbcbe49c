use crate::feature::FeatureShape;
use crate::{Feature, FeatureSet};
use std::ops::Range;

/// Where the values of a set of features stand in the vector of a window of a stream.
///
/// Feature-major: all values of the first feature, then all of the second. Within a feature the channels follow each other;
/// `AR4` and `CC` have four values of channel 0, then of channel 1; bands (`DFTR` and the wavelets) have band 0 of all
/// channels, then band 1; phasors have the pairs of channels (0, 1), (0, 2) .. (1, 2) and so on, first the distances, then
/// the ratios. All as LibEMG lays them out. Means of an inertial measurement unit ([`crate::ImuConfig`]) follow all features.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FeatureLayout {
    set: FeatureSet,
    channels: usize,
    rate_hz: f64,
    /// Means of channels of an inertial measurement unit, at the end.
    imu: usize,
}

impl FeatureLayout {
    pub(crate) fn new(set: FeatureSet, channels: usize, rate_hz: f64) -> FeatureLayout {
        FeatureLayout { set, channels, rate_hz, imu: 0 }
    }

    /// The same with `imu` values at the end.
    pub(crate) fn with_imu(self, imu: usize) -> FeatureLayout {
        FeatureLayout { imu, ..self }
    }

    /// Number of values of the EMG alone, which come first.
    pub(crate) fn emg_count(&self) -> usize {
        self.feature_ranges().last().map_or(0, |(_, _, range)| range.end)
    }

    /// The features and where the values of each stand.
    pub(crate) fn feature_ranges(&self) -> impl Iterator<Item = (Feature, FeatureShape, Range<usize>)> {
        let mut start = 0;
        self.set.features().iter().map(move |feature| {
            let shape = feature.shape(self.rate_hz);
            let range = start..start + shape.count(self.channels);
            start = range.end;
            (*feature, shape, range)
        })
    }

    /// Where the mean absolute values of the channels stand; none without MAV.
    pub(crate) fn mean_absolute_values(&self) -> Option<Range<usize>> {
        self.range_of(Feature::Mav)
    }

    /// Number of values of a window.
    pub fn count(&self) -> usize {
        self.emg_count() + self.imu
    }

    /// The first feature without a value: bands above half the rate, or pairs of a single channel.
    pub(crate) fn first_empty_feature(&self) -> Option<Feature> {
        self.feature_ranges().find(|(_, _, range)| range.is_empty()).map(|(feature, _, _)| feature)
    }

    /// `MAV_ch0` and so on, in the order of the vector; `AR4_1_ch0` .. `AR4_4_ch0` for coefficients, `DFTR_1_ch0` for bands,
    /// `RMSPHASOR_1_ch0_ch1` for pairs; `MEAN_imu0` for the means of an inertial measurement unit.
    pub fn column_names(&self) -> Vec<String> {
        let mut names = Vec::with_capacity(self.count());
        let channels = self.channels;
        for (feature, shape, _) in self.feature_ranges() {
            let name = feature.name();
            match shape {
                FeatureShape::Channels { values: 1 } => {
                    names.extend((0..channels).map(|c| format!("{name}_ch{c}")))
                }
                FeatureShape::Channels { values } => names.extend(
                    (0..channels).flat_map(|c| (1..=values).map(move |k| format!("{name}_{k}_ch{c}"))),
                ),
                FeatureShape::Bands { bands } => names.extend(
                    (1..=bands).flat_map(|k| (0..channels).map(move |c| format!("{name}_{k}_ch{c}"))),
                ),
                FeatureShape::Pairs => names.extend(
                    (1..=2)
                        .flat_map(|k| pairs(channels).map(move |(a, b)| format!("{name}_{k}_ch{a}_ch{b}"))),
                ),
            }
        }
        names.extend((0..self.imu).map(|k| format!("MEAN_imu{k}")));
        names
    }

    /// Writes to `out` the vector that the band would have given if it sat `shift` channels further: channel c of the
    /// result is channel `(c + shift) mod channels` of `vector`. Means of an inertial measurement unit stay.
    ///
    /// # Panics
    /// If a length differs from [`FeatureLayout::adc_step`]; the caller owns both.
    pub fn roll(&self, vector: &[f64], shift: usize, out: &mut [f64]) {
        let (count, channels) = (self.count(), self.channels);
        assert_eq!((vector.len(), out.len()), (count, count), "lengths of the feature vectors");
        let shift = shift % channels;
        let imu = count - self.imu..;
        out[imu.clone()].copy_from_slice(&vector[imu]);
        for (_, shape, range) in self.feature_ranges() {
            let (from, to) = (&vector[range.clone()], &mut out[range]);
            to.copy_from_slice(from);
            match shape {
                FeatureShape::Channels { values } => to.rotate_left(shift * values),
                FeatureShape::Bands { .. } => {
                    to.chunks_exact_mut(channels).for_each(|band| band.rotate_left(shift))
                }
                FeatureShape::Pairs => {
                    let half = from.len() / 2;
                    for (k, (a, b)) in pairs(channels).enumerate() {
                        let index = pair_index(channels, (a + shift) % channels, (b + shift) % channels);
                        (to[k], to[half + k]) = (from[index], from[half + index]);
                    }
                }
            }
        }
    }

    /// Where the values of a feature stand; none if the set does not have it.
    pub(crate) fn range_of(&self, feature: Feature) -> Option<Range<usize>> {
        self.feature_ranges().find(|(of, _, _)| *of == feature).map(|(_, _, range)| range)
    }

    /// Sum of MAV over channels in a feature vector, if the set has MAV.
    pub fn amplitude(&self, vector: &[f64]) -> Option<f64> {
        Some(vector[self.range_of(Feature::Mav)?].iter().sum())
    }
}

/// Pairs of channels, the lower one first, in the order of the vector.
pub(crate) fn pairs(channels: usize) -> impl Iterator<Item = (usize, usize)> {
    (0..channels).flat_map(move |a| (a + 1..channels).map(move |b| (a, b)))
}

/// Place of a pair in [`pairs`].
fn pair_index(channels: usize, one: usize, other: usize) -> usize {
    let (a, b) = (one.min(other), one.max(other));
    a * channels - a * (a + 1) / 2 + b - a - 1
}

#[cfg(test)]
mod tests {
    use super::*;

    fn layout(names: &str, channels: usize) -> FeatureLayout {
        names.parse::<FeatureSet>().expect("known names").layout(channels, 1000.0)
    }

    #[test]
    fn columns_amplitude_and_roll_follow_the_layout() {
        let layout = layout("AR4,MAV", 2);
        let names = layout.column_names();
        assert_eq!(names.len(), layout.count());
        assert_eq!((&names[0][..], &names[4][..], &names[9][..]), ("AR4_1_ch0", "AR4_1_ch1", "MAV_ch1"));
        let vector = [0.0, 1.0, 2.0, 3.0, 10.0, 11.0, 12.0, 13.0, 5.0, 6.0];
        assert_eq!(layout.amplitude(&vector), Some(11.0));
        assert_eq!(self::layout("LS4", 2).amplitude(&[0.0; 8]), None);
        let mut rolled = [0.0; 10];
        layout.roll(&vector, 1, &mut rolled);
        assert_eq!(rolled, [10.0, 11.0, 12.0, 13.0, 0.0, 1.0, 2.0, 3.0, 6.0, 5.0]);
        layout.roll(&vector, 2, &mut rolled);
        assert_eq!(rolled, vector);
    }

    /// Each value is named after its channels; the rolled one must be named after those that are `shift` further.
    #[test]
    fn bands_and_pairs_roll_with_their_channels() {
        let channels = 5;
        let layout = layout("WENG,RMSPHASOR,CC,DFTR", channels);
        let names = layout.column_names();
        let vector: Vec<f64> = (0..names.len()).map(|k| k as f64).collect();
        for shift in 0..channels {
            let mut out = vec![0.0; vector.len()];
            layout.roll(&vector, shift, &mut out);
            for (name, value) in names.iter().zip(out) {
                let mut parts = name.split("_ch");
                let feature = parts.next().expect("a name");
                let mut at: Vec<usize> =
                    parts.map(|c| (c.parse::<usize>().expect("a number") + shift) % channels).collect();
                at.sort_unstable();
                let from: String = at.iter().fold(feature.to_owned(), |name, c| format!("{name}_ch{c}"));
                assert_eq!(names[value as usize], from, "{name}, shift {shift}");
            }
        }
    }

    #[test]
    fn bands_follow_the_rate_and_a_feature_without_values_is_named() {
        let set: FeatureSet = "DFTR,WENG".parse().expect("known");
        let counts = [200.0, 1000.0, 4000.0].map(|rate| set.layout(3, rate).count());
        assert_eq!(counts, [3 * (1 + 6), 3 * (6 + 8), 3 * (6 + 10)]);
        assert_eq!(set.layout(3, 150.0).first_empty_feature(), Some(Feature::Dftr));
        assert_eq!(layout("MAV,WLPHASOR", 1).first_empty_feature(), Some(Feature::Wlphasor));
        assert_eq!(layout("MAV,WLPHASOR", 2).first_empty_feature(), None);
    }
}
