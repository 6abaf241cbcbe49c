use std::f64::consts::TAU;
use std::ops::{Add, Mul, Sub};

/// What a transform is made of: a number, or the same quantity of several channels.
pub(crate) trait Real:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Mul<f64, Output = Self>
{
}

impl<T> Real for T where T: Copy + Add<Output = T> + Sub<Output = T> + Mul<Output = T> + Mul<f64, Output = T> {}

/// Powers of the lower half of the Fourier transform of a signal, padded with zeros to a power of two. Buffers are
/// allocated once.
#[derive(Clone, Debug)]
pub(crate) struct PowerSpectrum<T> {
    /// Real and imaginary parts of a transform of half the length: even samples are its real parts, odd ones its
    /// imaginary parts.
    values: Vec<(T, T)>,
    /// Which of them stands at each place at first: the place with its bits reversed.
    reversed: Vec<usize>,
    /// Roots of unity of the whole length.
    roots: Vec<(f64, f64)>,
    powers: Vec<T>,
    zero: T,
}

impl<T: Real> PowerSpectrum<T> {
    /// For signals of `length` samples, at least three; `zero` is what they are padded with.
    pub(crate) fn new(length: usize, zero: T) -> Self {
        let size = length.next_power_of_two().max(4);
        let root = |k: usize| (-TAU * k as f64 / size as f64).sin_cos();
        let half = size / 2;
        let reversed = |k: usize| k.reverse_bits() >> (usize::BITS - half.trailing_zeros());
        PowerSpectrum {
            reversed: (0..half).map(reversed).collect(),
            values: vec![(zero, zero); half],
            roots: (0..half).map(root).map(|(sin, cos)| (cos, sin)).collect(),
            powers: vec![zero; half],
            zero,
        }
    }

    /// Length of the transform.
    pub(crate) fn size(&self) -> usize {
        2 * self.values.len()
    }

    /// Transforms `signal`, which is no longer than the transform.
    #[inline(always)]
    pub(crate) fn transform(&mut self, signal: &[T]) {
        let half = self.values.len();
        // Cooley and Tukey's transform in place.
        self.first_butterflies(signal);
        let mut width = 4;
        while 2 * width < half {
            self.two_levels(width);
            width *= 4;
        }
        if width < half {
            self.one_level(width);
        }
        self.combine_even_and_odd();
    }

    /// The powers of bins 0 .. size/2 - 1 of what was transformed, not scaled.
    pub(crate) fn powers(&self) -> &[T] {
        &self.powers
    }

    /// The two first levels, whose roots are 1 and -i, of what comes in the order of reversed bits.
    #[inline(always)]
    fn first_butterflies(&mut self, signal: &[T]) {
        let zero = self.zero;
        let pair = |k: usize| {
            if 2 * k + 1 < signal.len() {
                (signal[2 * k], signal[2 * k + 1])
            } else if 2 * k < signal.len() {
                (signal[2 * k], zero)
            } else {
                (zero, zero)
            }
        };
        for (to, from) in self.values.chunks_mut(4).zip(self.reversed.chunks(4)) {
            if let ([a, b, c, d], &[first, second, third, fourth]) = (&mut *to, from) {
                let (one, other) = (pair(first), pair(second));
                let (sum, difference) = (plus(one, other), minus(one, other));
                let (one, other) = (pair(third), pair(fourth));
                let (sum_2, (re, im)) = (plus(one, other), minus(one, other));
                (*a, *c) = (plus(sum, sum_2), minus(sum, sum_2));
                *b = (difference.0 + im, difference.1 - re);
                *d = (difference.0 - im, difference.1 + re);
            } else if let ([a, b], &[first, second]) = (to, from) {
                (*a, *b) = (plus(pair(first), pair(second)), minus(pair(first), pair(second)));
            }
        }
    }

    /// The level whose butterflies are `width` values wide.
    #[inline(always)]
    fn one_level(&mut self, width: usize) {
        let roots = self.roots.iter().step_by(self.values.len() / width);
        for block in self.values.chunks_exact_mut(2 * width) {
            let (low, high) = block.split_at_mut(width);
            for ((a, b), root) in low.iter_mut().zip(high).zip(roots.clone()) {
                let turned = times(*b, *root);
                (*a, *b) = (plus(*a, turned), minus(*a, turned));
            }
        }
    }

    /// That level and the next, whose butterflies are twice as wide: each value is read and written once for both.
    #[inline(always)]
    fn two_levels(&mut self, width: usize) {
        let step = self.values.len() / width;
        let roots = self.roots.iter().step_by(step).zip(self.roots.iter().step_by(step / 2));
        for block in self.values.chunks_exact_mut(4 * width) {
            let (low, high) = block.split_at_mut(2 * width);
            let ((first, second), (third, fourth)) = (low.split_at_mut(width), high.split_at_mut(width));
            let values = first.iter_mut().zip(second).zip(third.iter_mut().zip(fourth));
            for (((a, b), (c, d)), (root, next_root)) in values.zip(roots.clone()) {
                let (turned_b, turned_d) = (times(*b, *root), times(*d, *root));
                let (even, odd) = (plus(*a, turned_b), minus(*a, turned_b));
                let turned_even = times(plus(*c, turned_d), *next_root);
                // The root of the second half is that of the first, turned by -i.
                let (re, im) = times(minus(*c, turned_d), *next_root);
                (*a, *c) = (plus(even, turned_even), minus(even, turned_even));
                *b = (odd.0 + im, odd.1 - re);
                *d = (odd.0 - im, odd.1 + re);
            }
        }
    }

    /// Takes the transforms of even and odd samples apart and puts that of all samples together: its powers.
    #[inline(always)]
    fn combine_even_and_odd(&mut self) {
        let half = self.values.len();
        let (zero_even, zero_odd) = self.values[0];
        self.powers[0] = (zero_even + zero_odd) * (zero_even + zero_odd);
        for k in 1..=half / 2 {
            let ((re, im), (re_2, im_2)) = (self.values[k], self.values[half - k]);
            // Both twice what they are; the powers are divided by four.
            let even = (re + re_2, im - im_2);
            let odd = times((im + im_2, re_2 - re), self.roots[k]);
            let power = |(re, im): (T, T)| (re * re + im * im) * 0.25;
            self.powers[half - k] = power(minus(even, odd));
            self.powers[k] = power(plus(even, odd));
        }
    }
}

#[inline(always)]
fn plus<T: Real>(a: (T, T), b: (T, T)) -> (T, T) {
    (a.0 + b.0, a.1 + b.1)
}

#[inline(always)]
fn minus<T: Real>(a: (T, T), b: (T, T)) -> (T, T) {
    (a.0 - b.0, a.1 - b.1)
}

#[inline(always)]
fn times<T: Real>(a: (T, T), root: (f64, f64)) -> (T, T) {
    (a.0 * root.0 - a.1 * root.1, a.0 * root.1 + a.1 * root.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sine_has_its_power_in_its_bin() {
        let mut spectrum = PowerSpectrum::new(60, 0.0);
        assert_eq!(spectrum.size(), 64);
        let signal: Vec<f64> = (0..64).map(|k| (TAU * 5.0 * f64::from(k) / 64.0).cos()).collect();
        spectrum.transform(&signal);
        for (k, power) in spectrum.powers().iter().enumerate() {
            let expected = if k == 5 { 1024.0 } else { 0.0 };
            assert!((power - expected).abs() < 1e-9, "bin {k}: {power}");
        }
    }

    #[test]
    fn every_length_gives_the_sums_of_the_definition() {
        for length in [3, 4, 5, 8, 11, 16, 30, 60, 100, 129, 500] {
            let signal: Vec<f64> = (0..length).map(|k| ((k * k) as f64 * 0.7).sin() * 5.0 + 1.0).collect();
            let mut spectrum = PowerSpectrum::new(length, 0.0);
            let size = spectrum.size();
            spectrum.transform(&signal);
            for (bin, power) in spectrum.powers().iter().enumerate() {
                let angle = |k: usize| TAU * ((bin * k) % size) as f64 / size as f64;
                let part = |of: fn(f64) -> f64| -> f64 {
                    signal.iter().enumerate().map(|(k, v)| v * of(angle(k))).sum()
                };
                let expected = part(f64::cos).powi(2) + part(f64::sin).powi(2);
                assert!((power - expected).abs() < 1e-9, "{length} samples, bin {bin}: {power}, {expected}");
            }
        }
    }
}
