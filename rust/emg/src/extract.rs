use crate::filter::FilterBank;
use crate::{
    DecodeRequest, EmgConfig, EmgError, FeatureExtractor, FeatureVector, GapInterpolationConfig,
    SlidingWindow, WindowView,
};
use fearless_simd::{Level, dispatch};
use proact_types::{EmgSample, SimTime};

/// Features of every window of a recording, by the same code as live. Windows that a gap spoils are left out; a
/// recording shorter than a window gives none.
///
/// # Errors
/// Settings that cannot work, or a sample with another number of channels or a value that is not finite.
pub fn extract_features(config: &EmgConfig, samples: &[EmgSample]) -> Result<Vec<FeatureVector>, EmgError> {
    let mut features = Vec::new();
    each_window(config, samples, &mut |_, vector| features.push(vector))?;
    Ok(features)
}

/// [`extract_features`], with [`WindowView::amplitude`] of each window beside its features.
///
/// # Errors
/// As [`extract_features`].
pub fn extract_features_with_amplitudes(
    config: &EmgConfig,
    samples: &[EmgSample],
) -> Result<(Vec<FeatureVector>, Vec<f64>), EmgError> {
    let (mut features, mut amplitudes) = (Vec::new(), Vec::new());
    each_window(config, samples, &mut |window, vector| {
        features.push(vector);
        amplitudes.push(window.amplitude());
    })?;
    Ok((features, amplitudes))
}

/// What a decoder is told of one window of a recording.
#[derive(Clone, Debug, PartialEq)]
pub struct DecoderInput {
    /// Its features.
    pub features: FeatureVector,
    /// The line to a process; none where the settings name no process. Its number is 0 and its time that of the recording.
    pub request: Option<DecodeRequest>,
}

/// What a decoder is told of every window of a recording; as [`extract_features`], for a decoder in another process too.
///
/// # Errors
/// As [`extract_features`].
pub fn extract_decoder_inputs(
    config: &EmgConfig,
    samples: &[EmgSample],
) -> Result<Vec<DecoderInput>, EmgError> {
    let input = config.process.as_ref().map(|process| process.input);
    let (mut windows, mut time) = (Vec::new(), config.window.samples(config.rate_hz)? as f64);
    let step = config.increment_samples()? as f64;
    each_window(config, samples, &mut |view, features| {
        let end = SimTime((1000.0 * time / config.rate_hz) as u64);
        time += step;
        let line = input.map(|input| DecodeRequest::new(input, 0, end, view, &features));
        windows.push(DecoderInput { features, request: line });
    })?;
    Ok(windows)
}

/// Cuts windows and computes their features. Reading is most of what a small set takes: it is compiled for the processor's
/// vectors, too.
fn each_window(
    config: &EmgConfig,
    samples: &[EmgSample],
    take: &mut dyn FnMut(&WindowView<'_>, FeatureVector),
) -> Result<(), EmgError> {
    dispatch!(Level::new(), _simd => read(config, samples, take))
}

#[inline(always)]
fn read(
    config: &EmgConfig,
    samples: &[EmgSample],
    take: &mut dyn FnMut(&WindowView<'_>, FeatureVector),
) -> Result<(), EmgError> {
    // Nothing is trained on, or tested with, samples that nobody measured.
    let whole = GapInterpolationConfig { max_gap_ms: 0, ..config.gap_interpolation };
    let mut window = SlidingWindow::new(&EmgConfig { gap_interpolation: whole, ..config.clone() })?;
    let mut extractor = FeatureExtractor::new(config)?;
    let mut filters = FilterBank::new(&config.filters, config.rate_hz, config.channels)?;
    for sample in samples {
        if !window.is_usable(&sample.channels) {
            return Err(EmgError::BadSample {
                counter: sample.counter,
                channels: sample.channels.len(),
                expected: config.sample_channels(),
            });
        }
        let view = if filters.is_empty() {
            window.push_checked(sample, true)
        } else {
            let mut filtered = sample.clone();
            filters.apply(&mut filtered);
            window.push(&filtered)
        };
        if let Some(view) = view {
            take(&view, extractor.compute(&view).to_vec());
        }
    }
    Ok(())
}
