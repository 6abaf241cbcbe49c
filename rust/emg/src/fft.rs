//! The Fourier transform of complex values.

use std::f64::consts::TAU;

/// A complex number: real and imaginary part.
pub(crate) type Complex = (f64, f64);

/// Cooley and Tukey's transform of one length, a power of two, in place.
#[derive(Clone, Debug)]
pub(crate) struct Fft {
    /// Roots of unity of the lower half.
    roots: Vec<Complex>,
}

impl Fft {
    /// For at least `length` values: of the next power of two, and at least two.
    pub(crate) fn new(length: usize) -> Fft {
        let size = length.next_power_of_two().max(2);
        let root = |k: usize| (-TAU * k as f64 / size as f64).sin_cos();
        Fft { roots: (0..size / 2).map(root).map(|(sin, cos)| (cos, sin)).collect() }
    }

    /// Values of a transform.
    pub(crate) fn size(&self) -> usize {
        2 * self.roots.len()
    }

    /// Transforms `values`, of that size; not scaled. The inverse is that of the values with both parts exchanged, exchanged again.
    pub(crate) fn transform(&self, values: &mut [Complex]) {
        let size = self.size();
        debug_assert_eq!(values.len(), size, "values of a transform");
        for k in 0..size {
            let reversed = k.reverse_bits() >> (usize::BITS - size.trailing_zeros());
            if k < reversed {
                values.swap(k, reversed);
            }
        }
        let mut width = 1;
        while width < size {
            let roots = self.roots.iter().step_by(self.roots.len() / width);
            for block in values.chunks_exact_mut(2 * width) {
                let (low, high) = block.split_at_mut(width);
                for ((a, b), root) in low.iter_mut().zip(high).zip(roots.clone()) {
                    let turned = times(*b, *root);
                    (*a, *b) = ((a.0 + turned.0, a.1 + turned.1), (a.0 - turned.0, a.1 - turned.1));
                }
            }
            width *= 2;
        }
    }
}

/// The product of two complex numbers.
#[inline(always)]
fn times(a: Complex, b: Complex) -> Complex {
    (a.0 * b.0 - a.1 * b.1, a.0 * b.1 + a.1 * b.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_size_gives_the_sums_of_the_definition() {
        for length in [2, 3, 8, 60, 128] {
            let fourier = Fft::new(length);
            let size = fourier.size();
            let signal: Vec<f64> = (0..length).map(|k| ((k * k) as f64 * 0.7).sin() + 0.5).collect();
            let mut bins: Vec<Complex> = signal.iter().map(|value| (*value, 0.0)).collect();
            bins.resize(size, (0.0, 0.0));
            fourier.transform(&mut bins);
            for (bin, found) in bins.iter().enumerate() {
                let angle = |k: usize| -TAU * ((bin * k) % size) as f64 / size as f64;
                let sum = |of: fn(f64) -> f64| -> f64 {
                    signal.iter().enumerate().map(|(k, v)| v * of(angle(k))).sum()
                };
                let expected = (sum(f64::cos), sum(f64::sin));
                assert!(
                    (found.0 - expected.0).abs() < 1e-9 && (found.1 - expected.1).abs() < 1e-9,
                    "{length}, {bin}"
                );
            }
        }
    }
}
