// Frames that came and frames that were lost on the way: the server gives each client the latest only.

/** Pace of the display, frames a second. */
const RATE_HZ = 60;

export class FrameCount {
  received = 0;
  dropped = 0;
  private last: number | null = null;

  /** A frame of the instant `time`, ms. */
  take(time: number): void {
    this.received += 1;
    if (this.last !== null && time > this.last) {
      // Frames lie 16 or 17 ms apart.
      this.dropped += Math.max(Math.round(((time - this.last) * RATE_HZ) / 1000) - 1, 0);
    }
    this.last = time;
  }

  /** Another trial or connection: what lies between does not count. */
  restart(): void {
    this.last = null;
  }
}
