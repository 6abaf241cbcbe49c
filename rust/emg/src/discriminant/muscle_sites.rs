use super::TrainingSet;
use crate::{EmgConfig, EmgError};
use proact_types::Gesture;
use serde::{Deserialize, Serialize};

/// Share of the windows of rest and of the other gesture that a site's low threshold lies above, at least.
const LOW_THRESHOLD_QUANTILE: f64 = 0.95;
/// Part of the way from there to the middle of the gesture's own windows at which the low threshold lies [assumed].
const LOW_THRESHOLD_FRACTION: f64 = 0.25;
/// Part of the range of the gesture's own windows at which the high threshold lies, as LibEMG's velocity control.
const HIGH_THRESHOLD_FRACTION: f64 = 0.7;

/// A muscle site of direct control.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct MuscleSite {
    /// The gesture that it gives.
    pub gesture: Gesture,
    /// Its channel, from 0.
    pub channel: usize,
    /// Mean absolute value over which it is active, in the stream's unit.
    pub low: f64,
    /// Mean absolute value of full effort.
    pub high: f64,
}

/// Direct control by two sites: which is active, and how much, by the mean absolute value of one channel each.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct MuscleSites {
    sites: [MuscleSite; 2],
    /// Class of the gesture of each site, of a co-contraction, and of rest.
    #[serde(rename = "places")]
    class_indices: [usize; 2],
    switch: usize,
    rest: usize,
    /// Place of the mean absolute value of channel 0 among the features.
    #[serde(rename = "first")]
    first_mav_index: usize,
    features: usize,
}

impl MuscleSites {
    /// Learns channels and thresholds from the windows of `set`.
    ///
    /// # Errors
    /// A gesture of the pair, or rest, without windows; a site that does not stand out.
    pub(crate) fn fit(set: &TrainingSet<'_>, config: &EmgConfig) -> Result<MuscleSites, EmgError> {
        let (settings, known) = (&config.two_site, set.gestures);
        let refused = |reason: String| EmgError::TwoSite { reason };
        let gesture_index = |gesture: Gesture| known.iter().position(|name| *name == gesture);
        let pair = settings.gestures();
        let mut windows = Vec::new();
        for gesture in [pair[0], pair[1], config.rest] {
            let class = gesture_index(gesture).map_or_else(Vec::new, |class| set.of_class(class).collect());
            if class.is_empty() {
                return Err(refused(format!(
                    "the training data has no {gesture}: record {}, {} and {}, or name other gestures with --site-gestures or \
                     emg.two_site.pair",
                    pair[0], pair[1], config.rest
                )));
            }
            windows.push(class);
        }
        let layout = config.layout();
        let range = layout.mean_absolute_values();
        let first = range.ok_or_else(|| refused("the features lack MAV".to_owned()))?.start;
        for (window, row) in set.samples.row_iter().enumerate() {
            if let Some((index, &value)) = row.iter().enumerate().find(|(_, v)| !v.is_finite()) {
                return Err(EmgError::NotFinite { window, index, value });
            }
        }
        // Sorted values of a channel over the windows of one of the three.
        let values = |of: usize, channel: usize| {
            let mut values: Vec<f64> =
                windows[of].iter().map(|row| set.samples[(*row, first + channel)]).collect();
            values.sort_unstable_by(f64::total_cmp);
            values
        };
        let quantile =
            |sorted: &[f64], share: f64| sorted[(share * (sorted.len() - 1) as f64).round() as usize];
        let mean = |values: Vec<f64>| values.iter().sum::<f64>() / values.len() as f64;
        // By how much a channel stands out: beside rest, or beside the other gesture where that is stronger.
        let ratio = |own: usize, channel: usize| {
            let beside = mean(values(2, channel)).max(mean(values(1 - own, channel)));
            mean(values(own, channel)) / beside.max(f64::MIN_POSITIVE)
        };
        let site = |own: usize| {
            let gesture = pair[own];
            let best = |a: usize, b: usize| if ratio(own, b) > ratio(own, a) { b } else { a };
            let channel = settings.channels.get(&gesture).copied();
            let channel = channel.unwrap_or_else(|| (1..config.channels).fold(0, best));
            let others = [values(2, channel), values(1 - own, channel)];
            let beside =
                others.iter().map(|sorted| quantile(sorted, LOW_THRESHOLD_QUANTILE)).fold(0.0, f64::max);
            let own = values(own, channel);
            let (min, middle, max) = (own[0], quantile(&own, 0.5), own[own.len() - 1]);
            let low = beside + LOW_THRESHOLD_FRACTION * (middle - beside);
            let high = (min + HIGH_THRESHOLD_FRACTION * (max - min)).max(middle);
            if middle > beside && high > low && high.is_finite() {
                return Ok(MuscleSite { gesture, channel, low, high });
            }
            Err(refused(format!(
                "channel {channel} has a mean absolute value of {middle:.3} in the middle of {gesture}, and up to {beside:.3} in \
                 rest and the other gesture: expected more; name another channel with --site-channels or emg.two_site.channels, move \
                 the electrode, or record again"
            )))
        };
        let sites = [site(0)?, site(1)?];
        if sites[0].channel == sites[1].channel {
            return Err(refused(format!(
                "{} and {} both stand out most on channel {}: expected two; name the channels with --site-channels or \
                 emg.two_site.channels",
                pair[0], pair[1], sites[0].channel
            )));
        }
        let at = |gesture| gesture_index(gesture).ok_or(EmgError::NotTrained(gesture));
        Ok(MuscleSites {
            sites,
            class_indices: [at(pair[0])?, at(pair[1])?],
            switch: at(settings.switch_gesture)?,
            rest: at(config.rest)?,
            first_mav_index: first,
            features: set.samples.ncols(),
        })
    }

    pub(crate) fn sites(&self) -> &[MuscleSite; 2] {
        &self.sites
    }

    pub(crate) fn class_index_of(&self, site: usize) -> usize {
        self.class_indices[site]
    }

    pub(crate) fn rest(&self) -> usize {
        self.rest
    }

    pub(crate) fn switch(&self) -> usize {
        self.switch
    }

    /// The two gestures, rest and the switching command.
    pub(crate) fn classes(&self) -> usize {
        4
    }

    pub(crate) fn features(&self) -> usize {
        self.features
    }

    pub(crate) fn is_sound(&self) -> bool {
        let mut classes = [self.class_indices[0], self.class_indices[1], self.switch, self.rest];
        classes.sort_unstable();
        let site = |site: &MuscleSite| {
            self.first_mav_index.checked_add(site.channel).is_some_and(|at| at < self.features)
                && site.low >= 0.0
                && site.high > site.low
                && site.high.is_finite()
        };
        classes == [0, 1, 2, 3]
            && self.sites.iter().all(site)
            && self.sites[0].channel != self.sites[1].channel
    }

    /// Whether the classes are those of `gestures`.
    pub(crate) fn matches_gestures(&self, gestures: &[Gesture]) -> bool {
        let sites = self.sites.iter().zip(self.class_indices);
        sites.into_iter().all(|(site, class_index)| gestures.get(class_index) == Some(&site.gesture))
    }

    pub(crate) fn map_features(&self, order: &dyn Fn(&[f64]) -> Vec<f64>) -> MuscleSites {
        let moved = order(&(0..self.features).map(|k| k as f64).collect::<Vec<_>>());
        let mut mapped = self.clone();
        for site in &mut mapped.sites {
            let from = (self.first_mav_index + site.channel) as f64;
            let to = moved.iter().position(|k| *k == from);
            site.channel = to.and_then(|to| to.checked_sub(self.first_mav_index)).unwrap_or(site.channel);
        }
        mapped
    }

    /// How far each site is between its thresholds: 0 at the low one, 1 at the high one.
    pub(crate) fn levels(&self, features: &[f64]) -> [f64; 2] {
        let level = |site: &MuscleSite| {
            (features[self.first_mav_index + site.channel] - site.low) / (site.high - site.low)
        };
        [level(&self.sites[0]), level(&self.sites[1])]
    }

    /// One for what the window alone says, zero for the others.
    pub(crate) fn scores(&self, features: &[f64], out: &mut [f64]) {
        out.fill(0.0);
        let class_index = match self.levels(features) {
            [a, b] if !(a.is_finite() && b.is_finite()) => return out.fill(f64::NAN),
            [a, b] if a > 0.0 && b > 0.0 => self.switch,
            [a, b] if a > 0.0 || b > 0.0 => self.class_indices[usize::from(b > a)],
            _ => self.rest,
        };
        out[class_index] = 1.0;
    }
}
