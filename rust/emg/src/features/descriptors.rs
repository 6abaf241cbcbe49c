use super::sums::{lengths, squares};
use crate::lanes::{Lanes, ln, power};
use fearless_simd::prelude::*;

/// The time-dependent power spectrum descriptors of LibEMG.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Descriptors<S: Simd> {
    pub(crate) m0: Lanes<S>,
    pub(crate) m2: Lanes<S>,
    pub(crate) m4: Lanes<S>,
    pub(crate) sparsi: Lanes<S>,
    pub(crate) irf: Lanes<S>,
    pub(crate) wlf: Lanes<S>,
}

impl<S: Simd> Descriptors<S> {
    pub(crate) fn new(simd: S) -> Self {
        let zero = Lanes::splat(simd, 0.0);
        Descriptors { m0: zero, m2: zero, m4: zero, sparsi: zero, irf: zero, wlf: zero }
    }

    /// Of a signal; `logarithms` is filled with those of its squares.
    #[inline(always)]
    pub(crate) fn of(x: &[Lanes<S>], logarithms: &mut [Lanes<S>]) -> Self {
        for (to, value) in logarithms.iter_mut().zip(x) {
            *to = ln(*value * *value + f64::EPSILON);
        }
        let (a, b) = (Self::of_signal(x), Self::of_signal(logarithms));
        let both = |a: Lanes<S>, b: Lanes<S>| a * b * -2.0 / (a * a + b * b);
        Descriptors {
            m0: both(a.m0, b.m0),
            m2: both(a.m2, b.m2),
            m4: both(a.m4, b.m4),
            sparsi: both(a.sparsi, b.sparsi),
            irf: both(a.irf, b.irf),
            wlf: both(a.wlf, b.wlf),
        }
    }

    /// The quantity of one signal behind each descriptor.
    #[inline(always)]
    fn of_signal(x: &[Lanes<S>]) -> Self {
        let less = x.len() as f64 - 1.0;
        let ([square, square_1, square_2], [length_1, length_2]) = (squares(x), lengths(x));
        // The power of a tenth, divided by a tenth, is the normalisation of TDPSD.
        let normalized = |moment: Lanes<S>| power(moment, 0.1) / 0.1;
        let m0 = normalized(square.sqrt() / less);
        let m2 = normalized((square_1 / less).sqrt());
        let m4 = normalized((square_2 / less).sqrt());
        Descriptors {
            m0: ln(m0.abs()),
            m2: ln((m0 - m2).abs()),
            m4: ln((m0 - m4).abs()),
            sparsi: ln(((m0 - m2) * (m0 - m4)).abs().sqrt() / m0),
            irf: ln(m2 / (m0 * m4).sqrt()),
            wlf: ln((length_1 / length_2).sqrt()),
        }
    }
}
