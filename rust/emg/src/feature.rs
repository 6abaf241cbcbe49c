use crate::EmgError;
use std::str::FromStr;

/// Coefficients of [`Feature::Ar4`] and [`Feature::Cc`].
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
    /// `CC`: cepstral coefficients from those of [`Feature::Ar4`], by LibEMG's recursion: its terms weigh the coefficient
    /// of the order that is computed, where textbooks weigh each lower one.
    Cc,
    /// `LD`: log detector, `exp(mean ln(|x| + 1))`.
    Ld,
    /// `MAVFD`: mean absolute value of the first difference.
    Mavfd,
    /// `MAVSLP`: slope of the mean absolute value, that of the second half less that of the first.
    Mavslp,
    /// `MNP`: mean power of the bins of the spectrum.
    Mnp,
    /// `MPK`: largest sample.
    Mpk,
    /// `RMSPHASOR`: for each pair of channels, root mean squares as phasors at the electrodes' angles around the arm:
    /// the logarithm of their distance, and of that distance over the one of their first differences.
    Rmsphasor,
    /// `PAP`: peak average power, `m0 / (m4 / m2)` of the roots of the sums of `x^2`, `dx^2`, `ddx^2`.
    Pap,
    /// `WLPHASOR`: as `RMSPHASOR`, of waveform lengths.
    Wlphasor,
    /// `MZP`: multiplication of power and peaks, `sqrt(sum dx^2 / L)`.
    Mzp,
    /// `TM`: absolute temporal moment of third order, `mean |x^3|`.
    Tm,
    /// `SM`: spectral moment of second order, `sum P f^2`.
    Sm,
    /// `SAMPEN`: sample entropy of the standardised window, dimension 2, tolerance 0.3.
    Sampen,
    /// `FUZZYEN`: fuzzy entropy, dimension 2, tolerance 0.3 standard deviations, exponent 2.
    Fuzzyen,
    /// `DFTR`: discrete Fourier transform representation, mean amplitude in bands with the upper edges 92, 163, 235, 305,
    /// 378 and 450 Hz, to the power of two thirds; only bands below half the rate.
    Dftr,
    /// `ISD`: integral square descriptor, `sum x^2`.
    Isd,
    /// `COR`: normalised root-square coefficient, `sum dx^2 / (sum ddx^2 sum x^2)`.
    Cor,
    /// `MDIFF`: mean difference derivative, `sum dx^2 / L`.
    Mdiff,
    /// `MLK`: mean logarithm of the kernel, `ln(sum |x| + eps) / L`.
    Mlk,
    /// `WENG`: logarithm of the energy of each band of a wavelet decomposition (symlet 8, mirrored edges). The rate says how
    /// deep it goes: each band is half as wide as the one above it, down to an approximation of the lowest 2 to 4 Hz.
    Weng,
    /// `WV`: logarithm of the variance of the squared coefficients of each band.
    Wv,
    /// `WWL`: logarithm of the waveform length of the squared coefficients of each band.
    Wwl,
    /// `WENT`: Shannon entropy of the squared coefficients of each band.
    Went,
    /// `MEAN`: mean of the window; a centred stream has next to none.
    Mean,
}

use Feature::*;

const FEATURES: [(&str, Feature); 52] = [
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
    ("CC", Cc),
    ("LD", Ld),
    ("MAVFD", Mavfd),
    ("MAVSLP", Mavslp),
    ("MNP", Mnp),
    ("MPK", Mpk),
    ("RMSPHASOR", Rmsphasor),
    ("PAP", Pap),
    ("WLPHASOR", Wlphasor),
    ("MZP", Mzp),
    ("TM", Tm),
    ("SM", Sm),
    ("SAMPEN", Sampen),
    ("FUZZYEN", Fuzzyen),
    ("DFTR", Dftr),
    ("ISD", Isd),
    ("COR", Cor),
    ("MDIFF", Mdiff),
    ("MLK", Mlk),
    ("WENG", Weng),
    ("WV", Wv),
    ("WWL", Wwl),
    ("WENT", Went),
    ("MEAN", Mean),
];

/// Groups by LibEMG's names, and HJORTHC.
pub(crate) const GROUPS: [(&str, &[Feature]); 12] = [
    ("HTD", &[Mav, Zc, Ssc, Wl]),
    ("TDAR", &[Mav, Zc, Ssc, Wl, Ar4]),
    ("LS4", &[Ls, Mfl, Msr, Wamp]),
    ("LS9", &[Ls, Mfl, Msr, Wamp, Zc, Rms, Iav, Dasdv, Var]),
    ("TDPSD", &[M0, M2, M4, Sparsi, Irf, Wlf]),
    ("HJORTH", &[Act, Mob, Comp]),
    ("HJORTHC", &[Act, Mob, Compc]),
    ("ITD", &[Isd, Cor, Mdiff, Mlk]),
    ("TSTD", &[Mavfd, Dasdv, Wamp, Zc, Mfl, Sampen, M0, M2, M4, Sparsi, Irf, Wlf]),
    ("DFTR", &[Dftr]),
    ("COMB", &[Wl, Ssc, Ld]),
    ("MSWT", &[Weng, Wv, Wwl, Went]),
];

impl Feature {
    /// Every feature.
    pub fn all() -> impl Iterator<Item = Feature> {
        FEATURES.iter().filter(|(name, _)| *name != "AR").map(|(_, feature)| *feature)
    }

    /// LibEMG's name.
    pub fn name(self) -> &'static str {
        FEATURES.iter().find(|(_, feature)| *feature == self).map_or("", |(name, _)| name)
    }

    /// How many values it has, and in which order.
    pub(crate) fn shape(self, rate_hz: f64) -> FeatureShape {
        match self {
            Ar4 | Cc => FeatureShape::Channels { values: AR_ORDER },
            Dftr => FeatureShape::Bands { bands: fourier_bands(rate_hz).count() },
            Weng | Wv | Wwl | Went => FeatureShape::Bands { bands: wavelet_bands(rate_hz) },
            Rmsphasor | Wlphasor => FeatureShape::Pairs,
            _ => FeatureShape::Channels { values: 1 },
        }
    }

    /// Whether its values depend on the rate of the stream.
    pub(crate) fn depends_on_rate(self) -> bool {
        matches!(self, Mdf | Mnf | Sm | Dftr | Weng | Wv | Wwl | Went)
    }
}

/// Order of the values of a feature of a window.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum FeatureShape {
    /// So many values of channel 0, then of channel 1.
    Channels { values: usize },
    /// Band 0 of all channels, then band 1.
    Bands { bands: usize },
    /// Pairs of channels (0, 1), (0, 2) .. (1, 2) and so on, twice.
    Pairs,
}

impl FeatureShape {
    pub(crate) fn count(self, channels: usize) -> usize {
        match self {
            FeatureShape::Channels { values } => channels * values,
            FeatureShape::Bands { bands } => channels * bands,
            FeatureShape::Pairs => channels * (channels - 1),
        }
    }
}

/// Upper edges of the bands of [`Feature::Dftr`], hertz; the first begins at [`FOURIER_BANDS_FROM_HZ`].
const FOURIER_BANDS_HZ: [f64; 6] = [92.0, 163.0, 235.0, 305.0, 378.0, 450.0];
/// Lower edge of the first band.
pub(crate) const FOURIER_BANDS_FROM_HZ: f64 = 20.0;

/// Upper edges of the bands that lie below half the rate.
pub(crate) fn fourier_bands(rate_hz: f64) -> impl Iterator<Item = f64> {
    FOURIER_BANDS_HZ.into_iter().filter(move |upper| *upper < rate_hz / 2.0)
}

/// Bands of the wavelet decomposition, the approximation included: LibEMG's depth and one.
pub(crate) fn wavelet_bands(rate_hz: f64) -> usize {
    1 + ((rate_hz / 2.0).ln() / std::f64::consts::LN_2 - 1.0).floor().max(0.0) as usize
}

impl FromStr for Feature {
    type Err = EmgError;

    fn from_str(name: &str) -> Result<Feature, EmgError> {
        let found = FEATURES.iter().find(|(known, _)| *known == name);
        found.map(|(_, feature)| *feature).ok_or_else(|| EmgError::UnknownFeature { name: name.to_owned() })
    }
}

/// Names of all features and groups, for messages.
pub(crate) fn known_names() -> String {
    let groups = GROUPS.iter().map(|(name, _)| *name);
    groups.chain(Feature::all().map(Feature::name)).collect::<Vec<_>>().join(" ")
}
