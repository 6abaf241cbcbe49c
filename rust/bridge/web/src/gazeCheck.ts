// What a gaze source is worth, from samples taken while known points were looked at.

import type { DisplayFrame, GazeCheck } from "./generated/types";
import type { Triple } from "./protocol";
import { fixed } from "./numbers";

/** Gaps of this length are blinks, ms. */
const BLINK_MS = [70, 500] as const;
const DEGREES = 180 / Math.PI;
/** A calibration needs this many points with samples. */
const MIN_POINTS = 3;
/** The largest error that a calibration takes off, and what may be left of it at any point, degrees. */
const MAX_OFFSET_DEG = 15;
const MAX_RESIDUAL_DEG = 3;

export type PointResult = GazeCheck["points"][number];
/** One display frame's gaze. */
export interface GazeFrame {
  time: number;
  gaze: DisplayFrame["gaze"];
}

/** Judges one point at `target` from the frames that were drawn while it was looked at. */
export function scorePoint(looks: GazeFrame[], target: Triple): PointResult {
  const valid = looks.filter(({ gaze }) => gaze?.valid === true);
  const off = valid.map(({ gaze }) => angle(gaze!.direction, minus(target, gaze!.origin)));
  const offsets = valid.map(({ gaze }) => angularOffset(gaze!.direction, minus(target, gaze!.origin))).filter((pair) => pair.every(Number.isFinite));
  const steps: number[] = [];
  for (let k = 1; k < looks.length; k++) {
    const [before, now] = [looks[k - 1]?.gaze, looks[k]?.gaze];
    if (before?.valid && now?.valid) steps.push(angle(before.direction, now.direction));
  }
  const finite = off.filter(Number.isFinite);
  return {
    accuracy_deg: finite.length > 0 ? mean(finite) : null,
    offset_deg: offsets.length > 0 ? meanPair(offsets) : null,
    precision_deg: steps.length > 0 ? Math.sqrt(mean(steps.map((step) => step * step))) : null,
    lost_share: looks.length > 0 ? 1 - valid.length / looks.length : 1,
    blinks: countBlinks(looks),
    samples: looks.length,
  };
}

/** All points together: means of what is known. */
export function summarize(points: PointResult[]): { accuracy: number | null; precision: number | null; lost: number; blinks: number } {
  const known = (values: (number | null)[]) => {
    const numbers = values.filter((value): value is number => value !== null);
    return numbers.length > 0 ? mean(numbers) : null;
  };
  return {
    accuracy: known(points.map((point) => point.accuracy_deg)),
    precision: known(points.map((point) => point.precision_deg)),
    lost: points.length > 0 ? mean(points.map((point) => point.lost_share)) : 1,
    blinks: points.reduce((sum, point) => sum + point.blinks, 0),
  };
}

/** What a calibration takes off the gaze: the mean error, if the points agree on it. Otherwise why not. */
export function correction(points: PointResult[]): [number, number] | string {
  const known = points.flatMap((point) => (point.offset_deg ? [point.offset_deg] : []));
  if (known.length < MIN_POINTS) return `only ${known.length} of ${points.length} points were seen`;
  const error = meanPair(known);
  if (Math.hypot(...error) > MAX_OFFSET_DEG) return `the gaze is off by ${fixed(Math.hypot(...error), 1)}°, more than ${MAX_OFFSET_DEG}°`;
  const left = Math.max(...known.map((pair) => Math.hypot(pair[0] - error[0], pair[1] - error[1])));
  if (left > MAX_RESIDUAL_DEG) return `the points differ by ${fixed(left, 1)}° from one another, more than ${MAX_RESIDUAL_DEG}°`;
  return error;
}

function countBlinks(looks: GazeFrame[]): number {
  let count = 0;
  let since: number | null = null;
  for (const { time, gaze } of looks) {
    if (gaze?.valid) {
      const gap = since === null ? 0 : time - since;
      if (gap >= BLINK_MS[0] && gap <= BLINK_MS[1]) count += 1;
      since = null;
    } else {
      since ??= time;
    }
  }
  return count;
}

function mean(values: number[]): number {
  return values.reduce((sum, value) => sum + value, 0) / values.length;
}

function meanPair(pairs: [number, number][]): [number, number] {
  return [mean(pairs.map((pair) => pair[0])), mean(pairs.map((pair) => pair[1]))];
}

/** How far `gaze` points to the left of `point`, and above it, as seen along the line to the point, degrees. */
function angularOffset(gaze: Triple, point: Triple): [number, number] {
  const [x, y, z] = point;
  const [level, length] = [Math.hypot(x, y), Math.hypot(x, y, z)];
  const left: Triple = [-y / level, x / level, 0];
  const up: Triple = [(-x * z) / level / length, (-y * z) / level / length, level / length];
  const along = dot(gaze, point) / length;
  return [Math.atan2(dot(gaze, left), along) * DEGREES, Math.atan2(dot(gaze, up), along) * DEGREES];
}

function dot(a: Triple, b: Triple): number {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

function minus(a: Triple, b: Triple): Triple {
  return [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
}

/** Angle between two vectors, degrees; not-a-number if one has no length. */
function angle(a: Triple, b: Triple): number {
  const cross = Math.hypot(a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]);
  const along = dot(a, b);
  return cross === 0 && along === 0 ? NaN : Math.atan2(cross, along) * DEGREES;
}
