//! Settings and timing of direct control by two sites.

use crate::{EmgConfig, EmgError};
use proact_types::{Command, DegreeOfFreedom, Gesture, SimTime};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Direct control by two sites with switching by co-contraction, as in conventional myoelectric hands
/// ([`crate::ClassifierKind::TwoSite`]).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TwoSiteConfig {
    /// The gestures of the two muscles. Recordings of others than these and rest are left out. Default: the wrist's.
    pub pair: DegreeOfFreedom,
    /// The channel over the muscle of each gesture, from 0, for all or for none of the two; without it the one on which the
    /// gesture's mean absolute value stands out most.
    pub channels: BTreeMap<Gesture, usize>,
    /// Both sites have to be active within this time of each other for a co-contraction, milliseconds. Default 150 [assumed];
    /// 0 asks for the same window.
    pub cocontraction_window_ms: u64,
    /// The gesture that a co-contraction counts as. Default `hand_open`, which cycles through the modes of methods A and B.
    pub switch_gesture: Gesture,
}

impl Default for TwoSiteConfig {
    fn default() -> Self {
        TwoSiteConfig {
            pair: DegreeOfFreedom::wrist(),
            channels: BTreeMap::new(),
            cocontraction_window_ms: 150,
            switch_gesture: Command::HandOpen.into(),
        }
    }
}

impl TwoSiteConfig {
    pub(crate) fn is_default(&self) -> bool {
        *self == TwoSiteConfig::default()
    }

    pub(crate) fn gestures(&self) -> [Gesture; 2] {
        [self.pair.positive(), self.pair.negative()]
    }

    /// Checks every value that the settings `of` the stage have a say in.
    pub(crate) fn check(&self, of: &EmgConfig) -> Result<(), EmgError> {
        let refused = |reason: String| Err(EmgError::TwoSite { reason });
        let pair = self.gestures();
        if pair.contains(&of.rest) || self.switch_gesture == of.rest || pair.contains(&self.switch_gesture) {
            return refused(format!(
                "pair is {}, switch {}, the rest gesture {}: expected different gestures",
                self.pair, self.switch_gesture, of.rest
            ));
        }
        if self.cocontraction_window_ms > 1000 {
            return refused(format!(
                "cocontraction_window_ms is {}, expected at most 1000",
                self.cocontraction_window_ms
            ));
        }
        if of.layout().mean_absolute_values().is_none() {
            return refused(format!("the features are {}, expected MAV among them", of.features));
        }
        if self.channels.is_empty() {
            return Ok(());
        }
        let channels = pair.map(|gesture| self.channels.get(&gesture).copied());
        match channels {
            [Some(a), Some(b)] if self.channels.len() == 2 && a != b && a.max(b) < of.channels => Ok(()),
            _ => refused(format!(
                "channels is {:?}, expected a different one below {} for each of {} and {}",
                self.channels, of.channels, pair[0], pair[1]
            )),
        }
    }
}

/// Tells a co-contraction from one muscle that follows the other, and keeps still what is left of it.
#[derive(Clone, Debug)]
pub(crate) struct CocontractionDetector {
    window_ms: u64,
    /// Since when each site is active.
    since: [Option<SimTime>; 2],
    /// A co-contraction is not over yet.
    switching: bool,
}

/// What two sites ask for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum SiteDecision {
    /// Nothing.
    Rest,
    /// The gesture of the first, or of the second.
    Site(usize),
    /// A co-contraction.
    Switch,
}

impl CocontractionDetector {
    pub(crate) fn new(config: &TwoSiteConfig) -> Self {
        CocontractionDetector {
            window_ms: config.cocontraction_window_ms,
            since: [None; 2],
            switching: false,
        }
    }

    /// Takes the levels of a window that ended at `now`: 0 at a site's low threshold, 1 at its high one.
    pub(crate) fn step(&mut self, now: SimTime, levels: [f64; 2]) -> SiteDecision {
        for (since, level) in self.since.iter_mut().zip(levels) {
            *since = if level > 0.0 { since.or(Some(now)) } else { None };
        }
        let stronger = SiteDecision::Site(usize::from(levels[1] > levels[0]));
        match self.since {
            [None, None] => {
                self.switching = false;
                SiteDecision::Rest
            }
            // Until both have relaxed: one always does so first.
            _ if self.switching => SiteDecision::Switch,
            [Some(a), Some(b)] if a.0.abs_diff(b.0) <= self.window_ms => {
                self.switching = true;
                SiteDecision::Switch
            }
            _ => stronger,
        }
    }

    /// Forgets what was before a silence.
    pub(crate) fn clear(&mut self) {
        (self.since, self.switching) = ([None; 2], false);
    }
}
