mod autoregression;
mod descriptors;
mod entropy;
mod kernels;
mod phasors;
mod spectral;
mod sums;
mod wavelets;

use crate::{EmgConfig, EmgError, FeatureLayout, WindowView};
use fearless_simd::{Level, dispatch};
use kernels::{Kernels, SimdKernels};

/// Features of one window in the order of its [`FeatureLayout`].
pub type FeatureVector = Vec<f64>;

/// Computes the features of windows of one length, with the vectors that the processor has. Buffers are allocated at
/// construction only.
///
/// Agrees with LibEMG 2.0.3 to 1e-9 (HTD to 1e-12, counts exactly) wherever LibEMG gives a finite number. The same bits on
/// every processor.
#[derive(Debug)]
pub struct FeatureExtractor {
    layout: FeatureLayout,
    length: usize,
    channels: usize,
    /// Of the newest window.
    vector: FeatureVector,
    kernels: Box<dyn Kernels>,
}

/// Settings of the stream that features depend on.
#[derive(Clone, Copy, Debug)]
pub(crate) struct FeatureParameters {
    pub(crate) ssc_threshold: f64,
    pub(crate) wamp_threshold: f64,
}

impl FeatureExtractor {
    /// For the features and windows of `config`.
    ///
    /// # Errors
    /// Settings that cannot work.
    pub fn new(config: &EmgConfig) -> Result<Self, EmgError> {
        FeatureExtractor::with_level(config, Level::new())
    }

    /// With the vectors of `level`.
    fn with_level(config: &EmgConfig, level: Level) -> Result<Self, EmgError> {
        config.check()?;
        let (layout, length) = (config.layout(), config.window_samples()?);
        let kernels = dispatch!(level, simd => {
            let kernels: Box<dyn Kernels> = Box::new(SimdKernels::new(simd, config, length));
            kernels
        });
        let vector = vec![0.0; layout.count()];
        Ok(FeatureExtractor { layout, length, channels: config.channels, vector, kernels })
    }

    /// The features of one window. Does not allocate. A value is not finite only if the samples are so large that
    /// sums overflow.
    ///
    /// # Panics
    /// If the window is of another length or number of channels than the settings said.
    pub fn compute(&mut self, window: &WindowView<'_>) -> &[f64] {
        assert_eq!(
            (window.length(), window.channels()),
            (self.length, self.channels),
            "samples and channels of the window"
        );
        self.kernels.compute(window, &self.layout, &mut self.vector);
        let imu = self.layout.emg_count();
        for (out, mean) in self.vector[imu..].iter_mut().zip(window.imu_means()) {
            *out = mean;
        }
        &self.vector
    }
}

impl Clone for FeatureExtractor {
    fn clone(&self) -> Self {
        FeatureExtractor { vector: self.vector.clone(), kernels: self.kernels.boxed_clone(), ..*self }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Feature, FeatureSet, SlidingWindow};
    use fearless_simd::Simd;
    use proact_types::EmgSample;

    /// All features of windows of a signal with `channels` channels, by the vectors of `level`, as bits.
    fn bits(level: Level, channels: usize) -> Vec<u64> {
        let names: Vec<&str> = Feature::all().map(Feature::name).collect();
        let features: FeatureSet = names.join(",").parse().expect("all features");
        let config = EmgConfig { channels, features, ..EmgConfig::default() };
        let mut window = SlidingWindow::new(&config).expect("valid settings");
        let mut extractor = FeatureExtractor::with_level(&config, level).expect("valid settings");
        let mut bits = Vec::new();
        for counter in 0..400_u64 {
            // Weyl's sequences: evenly spread, about zero; every fifth channel is dead, every seventh of whole numbers.
            let value = |channel: u64| {
                let value = ((counter * counter * (channel + 3)) as f64 * 0.618_034).fract() * 200.0 - 100.0;
                match channel {
                    c if c % 5 == 4 => 0.0,
                    c if c % 7 == 6 => value.round(),
                    _ => value,
                }
            };
            let sample = EmgSample { counter, channels: (0..channels as u64).map(value).collect() };
            if let Some(view) = window.push(&sample) {
                bits.extend(extractor.compute(&view).iter().map(|v| v.to_bits()));
            }
        }
        bits
    }

    #[test]
    fn every_processor_gives_the_same_bits() {
        let level = Level::new();
        for channels in [2, 8, 13] {
            let expected = bits(Level::baseline(), channels);
            assert!(expected.len() > 1000, "windows: {}", expected.len());
            assert_eq!(bits(level, channels), expected, "{level:?} and the least that is compiled for");
            #[cfg(target_arch = "x86_64")]
            for lower in
                [level.as_sse4_2().map(Simd::level), level.as_avx2().map(Simd::level)].into_iter().flatten()
            {
                assert_eq!(bits(lower, channels), expected, "{lower:?}, {channels} channels");
            }
        }
    }
}
