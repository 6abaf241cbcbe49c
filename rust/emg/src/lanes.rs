//! Four channels side by side in one value, so that the processor's vectors do the arithmetic of four channels at once. Each
//! lane computes what a number alone would, operation by operation: a channel's features do not depend on its neighbours.

/// Channels in one value.
pub(crate) const LANES: usize = 4;

/// The same quantity of four channels.
pub(crate) type Lanes = wide::f64x4;

/// Up to four values side by side; zeros behind them.
pub(crate) fn lanes_of(values: &[f64]) -> Lanes {
    match <[f64; LANES]>::try_from(values) {
        Ok(four) => four.into(),
        Err(_) => {
            let mut four = [0.0; LANES];
            four[..values.len()].copy_from_slice(values);
            four.into()
        }
    }
}

/// A function of numbers, lane by lane: what the vectors of the processor do not have.
pub(crate) fn each(values: Lanes, of: impl Fn(f64) -> f64) -> Lanes {
    values.to_array().map(of).into()
}

/// One where a comparison holds, else zero.
pub(crate) fn ones(holds: Lanes) -> Lanes {
    holds & Lanes::ONE
}

/// Mean.
pub(crate) fn mean(x: &[Lanes]) -> Lanes {
    x.iter().sum::<Lanes>() / x.len() as f64
}

/// Mean magnitude.
pub(crate) fn mean_absolute(x: &[Lanes]) -> Lanes {
    x.iter().map(|v| v.abs()).sum::<Lanes>() / x.len() as f64
}
