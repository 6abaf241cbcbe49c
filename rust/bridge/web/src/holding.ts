// The gestures that are held, and by what. Pure: the time is handed in.

import type { Gesture } from "./generated/types";

/**
 * What is read once per picture counts as read for this long after one, ms. Less, and a slow display would let go by
 * itself; more, and the arm would not be at rest a quarter of a second after the last reading.
 */
export const READ_FOR_MS = 120;

interface Held {
  source: string;
  gesture: Gesture;
  /** Read once per picture; keys and buttons come as events instead, and need no pictures. */
  polled: boolean;
}

export class Holding {
  /** The newest last: it is the one in force. */
  private held: Held[] = [];
  private readAt = -Infinity;

  get inForce(): Gesture {
    return this.held[this.held.length - 1]?.gesture ?? "no_motion";
  }

  press(source: string, gesture: Gesture, polled: boolean): void {
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
  read(nowMs: number): void {
    this.readAt = nowMs;
  }

  /** Lets go of what nobody has read for too long: a silent link. True if there was anything. */
  releaseUnread(nowMs: number): boolean {
    if (nowMs - this.readAt <= READ_FOR_MS) return false;
    const before = this.held.length;
    this.held = this.held.filter(({ polled }) => !polled);
    return this.held.length < before;
  }
}
