use std::f64::consts::PI;

/// Powers of the lower half of the Fourier transform of a signal, padded with zeros to a power of two. Buffers are
/// allocated once.
#[derive(Clone, Debug)]
pub(crate) struct PowerSpectrum {
    /// Real and imaginary parts.
    values: Vec<(f64, f64)>,
    /// Roots of unity.
    roots: Vec<(f64, f64)>,
}

impl PowerSpectrum {
    /// For signals of `length` samples.
    pub(crate) fn new(length: usize) -> Self {
        let size = length.next_power_of_two();
        let root = |k: usize| (-2.0 * PI * k as f64 / size as f64).sin_cos();
        let roots = (0..size / 2).map(root).map(|(sin, cos)| (cos, sin)).collect();
        PowerSpectrum { values: vec![(0.0, 0.0); size], roots }
    }

    /// Length of the transform.
    pub(crate) fn size(&self) -> usize {
        self.values.len()
    }

    /// Transforms `signal`, which is no longer than the transform; gives the powers of bins 0 .. size/2 - 1, not
    /// scaled.
    pub(crate) fn powers(&mut self, signal: &[f64]) -> impl Iterator<Item = f64> + Clone {
        let size = self.size();
        let bits = size.trailing_zeros();
        for (k, value) in self.values.iter_mut().enumerate() {
            *value = (signal.get(k).copied().unwrap_or(0.0), 0.0);
        }
        // Cooley and Tukey's transform in place: first the order of reversed bits, then butterflies.
        for k in 1..size {
            let other = k.reverse_bits() >> (usize::BITS - bits);
            if k < other {
                self.values.swap(k, other);
            }
        }
        let mut half = 1;
        while half < size {
            let stride = size / (2 * half);
            for block in self.values.chunks_exact_mut(2 * half) {
                let (low, high) = block.split_at_mut(half);
                for ((a, b), root) in low.iter_mut().zip(high).zip(self.roots.iter().step_by(stride)) {
                    let turned = (b.0 * root.0 - b.1 * root.1, b.0 * root.1 + b.1 * root.0);
                    *b = (a.0 - turned.0, a.1 - turned.1);
                    *a = (a.0 + turned.0, a.1 + turned.1);
                }
            }
            half *= 2;
        }
        self.values[..size / 2].iter().map(|(re, im)| re * re + im * im)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sine_has_its_power_in_its_bin() {
        let mut spectrum = PowerSpectrum::new(60);
        assert_eq!(spectrum.size(), 64);
        let signal: Vec<f64> = (0..64).map(|k| (2.0 * PI * 5.0 * f64::from(k) / 64.0).cos()).collect();
        for (k, power) in spectrum.powers(&signal).enumerate() {
            let expected = if k == 5 { 1024.0 } else { 0.0 };
            assert!((power - expected).abs() < 1e-9, "bin {k}: {power}");
        }
    }
}
