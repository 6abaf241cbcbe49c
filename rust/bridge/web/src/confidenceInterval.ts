// Mean and 95 % interval of a few numbers.

/** Student's t for 95 %, two-sided, by degrees of freedom from one. */
const T95 = [12.706, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365, 2.306, 2.262, 2.228, 2.201, 2.179, 2.16, 2.145, 2.131, 2.12, 2.11, 2.101, 2.093, 2.086, 2.08, 2.074, 2.069, 2.064, 2.06, 2.056, 2.052, 2.048, 2.045, 2.042];

export interface ConfidenceInterval {
  count: number;
  mean: number;
  /** Ends of the interval; none of a single number. */
  bounds: [number, number] | null;
}

/** By Student's t, whose ends stay within `least` and `most`, which the numbers cannot leave. None of no numbers. */
export function confidenceInterval(values: number[], least = 0, most = Infinity): ConfidenceInterval | null {
  const count = values.length;
  if (count === 0) return null;
  const mean = values.reduce((sum, value) => sum + value, 0) / count;
  if (count === 1) return { count, mean, bounds: null };
  const variance = values.reduce((sum, value) => sum + (value - mean) ** 2, 0) / (count - 1);
  // Beyond the table by the first term of its expansion in 1 / n.
  const t = T95[count - 2] ?? 1.96 + 2.37 / (count - 1);
  const half = t * Math.sqrt(variance / count);
  return { count, mean, bounds: [Math.max(mean - half, least), Math.min(mean + half, most)] };
}
