// The power spectrum of a short piece of signal.

/** Length of a segment, seconds: a line every 2 to 4 Hz tells mains hum from muscle. */
const SEGMENT_SECS = 0.5;
const MIN_SEGMENT_SAMPLES = 32;

export interface Spectrum {
  /** From line to line, hertz; the first is at zero. */
  stepHz: number;
  /** Power a hertz, the signal's unit squared; without the mean. */
  density: number[];
}

/** Welch's estimate: segments of half a second under a Hann window that overlap by half. None of too few values. */
export function powerSpectrum(values: number[], rateHz: number): Spectrum | null {
  const size = 2 ** Math.floor(Math.log2(Math.max(SEGMENT_SECS * rateHz, MIN_SEGMENT_SAMPLES)));
  if (values.length < size) return null;
  const mean = values.reduce((sum, value) => sum + value, 0) / values.length;
  const window = Array.from({ length: size }, (_, k) => 0.5 - 0.5 * Math.cos((2 * Math.PI * k) / size));
  const power = window.reduce((sum, weight) => sum + weight * weight, 0);
  const density = new Array<number>(size / 2).fill(0);
  let segments = 0;
  for (let end = values.length; end >= size; end -= size / 2) {
    const real = window.map((weight, k) => weight * ((values[end - size + k] ?? mean) - mean));
    const imaginary = new Array<number>(size).fill(0);
    fft(real, imaginary);
    // Twice: the half with negative frequencies is not kept.
    for (let k = 1; k < size / 2; k++) {
      density[k] = (density[k] ?? 0) + (2 * ((real[k] ?? 0) ** 2 + (imaginary[k] ?? 0) ** 2)) / (power * rateHz);
    }
    segments += 1;
  }
  return { stepHz: rateHz / size, density: density.map((value) => value / segments) };
}

/** The frequency below which half of the power lies, hertz; none without power. */
export function medianFrequency({ stepHz, density }: Spectrum): number | null {
  const half = density.reduce((sum, value) => sum + value, 0) / 2;
  if (!(half > 0)) return null;
  let sum = 0;
  const at = density.findIndex((value) => (sum += value) >= half);
  return at * stepHz;
}

/** Fast Fourier transform in place, radix 2 (Cooley and Tukey 1965); the length is a power of two. */
function fft(real: number[], imaginary: number[]): void {
  const size = real.length;
  for (let k = 0, reversed = 0; k < size; k++) {
    if (k < reversed) {
      [real[k], real[reversed]] = [real[reversed] as number, real[k] as number];
      [imaginary[k], imaginary[reversed]] = [imaginary[reversed] as number, imaginary[k] as number];
    }
    let bit = size >> 1;
    for (; bit > 0 && reversed & bit; bit >>= 1) reversed ^= bit;
    reversed |= bit;
  }
  for (let length = 2; length <= size; length *= 2) {
    for (let k = 0; k < length / 2; k++) {
      const angle = (-2 * Math.PI * k) / length;
      const [cosine, sine] = [Math.cos(angle), Math.sin(angle)];
      for (let even = k; even < size; even += length) {
        const odd = even + length / 2;
        const [a, b] = [real[odd] as number, imaginary[odd] as number];
        const [turned, other] = [a * cosine - b * sine, a * sine + b * cosine];
        [real[odd], imaginary[odd]] = [(real[even] as number) - turned, (imaginary[even] as number) - other];
        [real[even], imaginary[even]] = [(real[even] as number) + turned, (imaginary[even] as number) + other];
      }
    }
  }
}
