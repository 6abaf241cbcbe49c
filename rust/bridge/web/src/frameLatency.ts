// When frames came and when they were on the screen, for the table of latencies. What the browser's compositor and the screen add
// after the page has drawn is not seen from here.

import type { ClientMessage } from "./generated/types";

type DisplayedFrame = Extract<ClientMessage, { type: "seen" }>["frames"][number];

/** Frames that are waited for: more than come while a message waits. */
const MAX_FRAMES = 128;

export class FrameTimes {
  /** Came, and are on no picture yet. */
  private waiting: { time: number; came: number }[] = [];
  /** On the picture that was drawn last, which is on the screen with the browser's next turn. */
  private drawn: { time: number; came: number }[] = [];
  private displayed: DisplayedFrame[] = [];
  /** Instant of the frame that came last; none at first. */
  private latest: number | null = null;

  /**
   * A frame of the instant `time`, ms, came now. The first one of a connection or trial says nothing of the line: the server may have
   * had it for long. Nor does one that is shown again while time stands still.
   */
  recordReceived(time: number, now: number): void {
    const [before, first] = [this.latest, this.latest === null || time < this.latest];
    if (first) this.clear();
    this.latest = time;
    if (first || time === before) return;
    if (this.waiting.length === MAX_FRAMES) this.waiting.shift();
    this.waiting.push({ time, came: now });
  }

  /** A picture was drawn, of the instant `time`. */
  recordDrawn(time: number): void {
    const next = this.waiting.findIndex((frame) => frame.time > time);
    this.drawn.push(...this.waiting.splice(0, next < 0 ? this.waiting.length : next));
  }

  /** The browser's next turn: what was drawn in the one before is on the screen. */
  recordDisplayed(now: number): void {
    for (const { time, came } of this.drawn) this.displayed.push({ time, came_ms: came, shown_ms: now });
    this.drawn = [];
    if (this.displayed.length > MAX_FRAMES) this.displayed.splice(0, this.displayed.length - MAX_FRAMES);
  }

  /** What was seen since the last call, on a clock that is `ahead` of the page's, ms. */
  drain(ahead: number): DisplayedFrame[] {
    const seen = this.displayed.map(({ time, came_ms, shown_ms }) => ({ time, came_ms: came_ms + ahead, shown_ms: shown_ms + ahead }));
    this.displayed = [];
    return seen;
  }

  clear(): void {
    this.waiting = [];
    this.drawn = [];
    this.displayed = [];
    this.latest = null;
  }
}

/** Round trips from which the shortest is taken. */
const ROUND_TRIP_COUNT = 10;

/** How far another clock is ahead of the page's. */
export class ClockOffset {
  private roundTrips: { took: number; ahead: number }[] = [];

  /** Asked at `asked`, answered at `answered` with the other clock's time, all ms. */
  addRoundTrip(asked: number, answered: number, other: number): void {
    if (this.roundTrips.length === ROUND_TRIP_COUNT) this.roundTrips.shift();
    this.roundTrips.push({ took: answered - asked, ahead: other - (asked + answered) / 2 });
  }

  /** By the shortest round trip, ms; none before the first. */
  get offsetMs(): number | null {
    let best: { took: number; ahead: number } | null = null;
    for (const trip of this.roundTrips) if (!best || trip.took < best.took) best = trip;
    return best?.ahead ?? null;
  }

  clear(): void {
    this.roundTrips = [];
  }
}
