//! What decodes the windows: a classifier, a regressor, or two sites.

use clap::Args;
use proact_devices::read_process_file;
use proact_emg::{ClassifierKind, DecoderProcessConfig, EmgConfig, RegressionConfig, TwoSiteConfig};
use proact_types::{DegreeOfFreedom, Gesture};
use std::{collections::BTreeMap, path::Path};

/// Options of what decodes the windows.
#[derive(Clone, Debug, Args)]
pub struct DecoderArgs {
    /// What decodes the windows. Classifiers tell gestures apart: lda, qda, nb (Gaussian naive Bayes), knn, svm (linear) or rf
    /// (random forest). Regressors drive degrees of freedom in proportion and at the same time: linear or ridge. Direct control by
    /// two muscles: two_site. A program of any language: process or process_regressor, with --decoder-process.
    #[arg(long, visible_alias = "decoder", default_value_t = ClassifierKind::Lda)]
    classifier: ClassifierKind,
    /// The program that decodes, with --classifier process or process_regressor: its file (TOML, docs/emg.md).
    #[arg(long, value_name = "FILE", value_parser = parse_process)]
    decoder_process: Option<DecoderProcessConfig>,
    /// Degrees of freedom of linear and ridge, each by its positive and its negative gesture. Default:
    /// wrist_extension/wrist_flexion,hand_open/hand_close.
    #[arg(long, value_delimiter = ',', value_name = "POSITIVE/NEGATIVE")]
    drives: Vec<DegreeOfFreedom>,
    /// Penalty of ridge on the squared coefficients of standardised features. Default: 1.
    #[arg(long, value_name = "X")]
    ridge_penalty: Option<f64>,
    /// Drives up to this are zero, 0 to 1. Default: 0.3.
    #[arg(long)]
    dead_band: Option<f64>,
    /// Time constant over which drives are smoothed, ms. Default: 0, not at all.
    #[arg(long, value_name = "MS")]
    smoothing: Option<f64>,
    /// The gestures of the two muscles of two_site. Default: wrist_extension/wrist_flexion.
    #[arg(long, value_name = "ONE/OTHER")]
    site_gestures: Option<DegreeOfFreedom>,
    /// The channel, from 0, of each of them, as wrist_extension=3,wrist_flexion=6. Default: where each stands out most.
    #[arg(long, value_delimiter = ',', value_parser = parse_site, value_name = "GESTURE=CHANNEL")]
    site_channels: Vec<(Gesture, usize)>,
    /// Time within which both muscles have to be active for a co-contraction, ms. Default: 150.
    #[arg(long, value_name = "MS")]
    cocontraction_window: Option<u64>,
    /// The gesture that a co-contraction counts as. Default: hand_open.
    #[arg(long, value_name = "GESTURE")]
    cocontraction_gesture: Option<Gesture>,
}

fn parse_process(path: &str) -> Result<DecoderProcessConfig, String> {
    read_process_file(Path::new(path)).map_err(|error| error.to_string())
}

fn parse_site(text: &str) -> Result<(Gesture, usize), String> {
    let parsed =
        text.rsplit_once('=').and_then(|(name, channel)| Some((name.parse().ok()?, channel.parse().ok()?)));
    parsed.ok_or_else(|| format!("{text:?}, expected a gesture and its channel, as wrist_extension=3"))
}

impl DecoderArgs {
    /// The settings `of` with what was asked for.
    pub(super) fn apply_to(&self, of: EmgConfig) -> EmgConfig {
        let (regression, two_site) = (RegressionConfig::default(), TwoSiteConfig::default());
        EmgConfig {
            classifier: self.classifier,
            process: self.decoder_process.clone(),
            regression: RegressionConfig {
                drives: if self.drives.is_empty() { regression.drives } else { self.drives.clone() },
                ridge_alpha: self.ridge_penalty.unwrap_or(regression.ridge_alpha),
                dead_band: self.dead_band.unwrap_or(regression.dead_band),
                smoothing_time_constant_ms: self.smoothing.unwrap_or(regression.smoothing_time_constant_ms),
            },
            two_site: TwoSiteConfig {
                pair: self.site_gestures.unwrap_or(two_site.pair),
                channels: self.site_channels.iter().copied().collect::<BTreeMap<_, _>>(),
                cocontraction_window_ms: self
                    .cocontraction_window
                    .unwrap_or(two_site.cocontraction_window_ms),
                switch_gesture: self.cocontraction_gesture.unwrap_or(two_site.switch_gesture),
            },
            ..of
        }
    }

    /// The gestures to ask for where none are named: those that the decoder learns from.
    pub(super) fn required_gestures(&self, all: &[Gesture], rest: Gesture) -> Vec<Gesture> {
        let settings = self.apply_to(EmgConfig::default());
        let pairs = |drives: &[DegreeOfFreedom]| {
            let both = drives.iter().flat_map(|drive| [drive.positive(), drive.negative()]);
            std::iter::once(rest).chain(both).collect()
        };
        match self.classifier {
            ClassifierKind::TwoSite => pairs(&[settings.two_site.pair]),
            kind if kind.is_regression() => pairs(&settings.regression.drives),
            _ => all.to_vec(),
        }
    }
}
