// The gestures that are held, and by what. Pure: the time is handed in.

import type { Command } from "./generated/types";

/**
 * What is read once per picture counts as read for this long after one, ms. Less, and a slow display would let go by
 * itself; more, and the arm would not be at rest a quarter of a second after the last reading.
 */
export const POLL_TIMEOUT_MS = 120;

interface HeldGesture {
  source: string;
  gesture: Command;
  /** Read once per picture; keys and buttons come as events instead, and need no pictures. */
  polled: boolean;
}

export class HeldGestures {
  /** The newest last: it is the one in force. */
  private held: HeldGesture[] = [];
  private polledAt = -Infinity;

  get inForce(): Command {
    return this.held[this.held.length - 1]?.gesture ?? "no_motion";
  }

  press(source: string, gesture: Command, polled: boolean): void {
    this.release(source);
    this.held.push({ source, gesture, polled });
  }

  release(source: string): void {
    this.held = this.held.filter((held) => held.source !== source);
  }

  releaseAll(): void {
    this.held = [];
  }

  /** A picture is made, and what is polled is read. */
  markPolled(nowMs: number): void {
    this.polledAt = nowMs;
  }

  /** Lets go of what nobody has read for too long: a silent link. True if there was anything. */
  releaseUnpolled(nowMs: number): boolean {
    if (nowMs - this.polledAt <= POLL_TIMEOUT_MS) return false;
    const before = this.held.length;
    this.held = this.held.filter(({ polled }) => !polled);
    return this.held.length < before;
  }
}
