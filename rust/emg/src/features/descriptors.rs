use super::sums::{lengths, squares};
use crate::lanes::Lanes;

/// The time-dependent power spectrum descriptors of LibEMG.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Descriptors {
    pub(crate) m0: Lanes,
    pub(crate) m2: Lanes,
    pub(crate) m4: Lanes,
    pub(crate) sparsi: Lanes,
    pub(crate) irf: Lanes,
    pub(crate) wlf: Lanes,
}

impl Descriptors {
    /// Of a signal; `logarithms` is filled with those of its squares.
    pub(crate) fn of(x: &[Lanes], logarithms: &mut [Lanes]) -> Descriptors {
        for (to, value) in logarithms.iter_mut().zip(x) {
            *to = (*value * *value + Lanes::splat(f64::EPSILON)).ln();
        }
        let (a, b) = (Descriptors::of_signal(x), Descriptors::of_signal(logarithms));
        let both = |of: fn(&Descriptors) -> Lanes| {
            let (a, b) = (of(&a), of(&b));
            a * b * -2.0 / (a * a + b * b)
        };
        Descriptors {
            m0: both(|d| d.m0),
            m2: both(|d| d.m2),
            m4: both(|d| d.m4),
            sparsi: both(|d| d.sparsi),
            irf: both(|d| d.irf),
            wlf: both(|d| d.wlf),
        }
    }

    /// The quantity of one signal behind each descriptor.
    fn of_signal(x: &[Lanes]) -> Descriptors {
        let less = x.len() as f64 - 1.0;
        let ([square, square_1, square_2], [length_1, length_2]) = (squares(x), lengths(x));
        // The power of a tenth, divided by a tenth, is the normalisation of TDPSD.
        let normalised = |moment: Lanes| moment.powf_simd(Lanes::splat(0.1)) / 0.1;
        let m0 = normalised(square.sqrt() / less);
        let m2 = normalised((square_1 / less).sqrt());
        let m4 = normalised((square_2 / less).sqrt());
        Descriptors {
            m0: m0.abs().ln(),
            m2: (m0 - m2).abs().ln(),
            m4: (m0 - m4).abs().ln(),
            sparsi: (((m0 - m2) * (m0 - m4)).abs().sqrt() / m0).ln(),
            irf: (m2 / (m0 * m4).sqrt()).ln(),
            wlf: (length_1 / length_2).sqrt().ln(),
        }
    }
}
