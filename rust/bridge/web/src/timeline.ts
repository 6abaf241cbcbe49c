// A recorded trial, to be looked at at any instant.

import { interpolateFrames, type InterpolatedFrame } from "./frameInterpolation";
import type { DisplayFrame, RecordedTrial, TrialEvent } from "./generated/types";

export class Timeline {
  readonly events: TrialEvent[];

  constructor(readonly record: RecordedTrial) {
    this.events = record.frames.flatMap((frame) => frame.events);
  }

  /** Length, ms. */
  get end(): number {
    return this.record.frames[this.record.frames.length - 1]?.time ?? 0;
  }

  /** The frame in force at `time`, and what to draw then; none for a trial without frames. */
  at(time: number): { frame: DisplayFrame; drawn: InterpolatedFrame } | null {
    const { frames } = this.record;
    if (frames.length === 0) return null;
    let [low, high] = [0, frames.length - 1];
    while (low < high) {
      const middle = Math.ceil((low + high) / 2);
      if ((frames[middle]?.time ?? Infinity) <= time) low = middle;
      else high = middle - 1;
    }
    const from = frames[low];
    const to = frames[Math.min(low + 1, frames.length - 1)];
    if (!from || !to) return null;
    const span = to.time - from.time;
    const share = span > 0 ? Math.min(Math.max((time - from.time) / span, 0), 1) : 0;
    return { frame: from, drawn: interpolateFrames(from, to, share) };
  }

  /** The last event up to `time`; changes of the gesture are on display anyway. */
  lastEvent(time: number): TrialEvent | null {
    const past = this.events.filter((event) => event.time <= time && event.event !== "gesture_changed");
    return past[past.length - 1] ?? null;
  }
}
