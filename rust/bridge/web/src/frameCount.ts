// Frames that came and frames that were lost on the way: the server gives each client the latest only.

/** Pace of the display, frames a second. */
const FRAME_RATE_HZ = 60;

export class FrameCounter {
  received = 0;
  dropped = 0;
  private last: number | null = null;

  /** A frame of the instant `time`, ms. */
  countFrame(time: number): void {
    this.received += 1;
    if (this.last !== null && time > this.last) {
      // Frames lie 16 or 17 ms apart.
      this.dropped += Math.max(Math.round(((time - this.last) * FRAME_RATE_HZ) / 1000) - 1, 0);
    }
    this.last = time;
  }

  /** Another trial or connection: what lies between does not count. */
  restart(): void {
    this.last = null;
  }
}

/** Pictures over which times are taken: two seconds. */
const SAMPLE_COUNT = 120;

/** How long something took in the last pictures, ms. */
export class ScriptTime {
  private readonly times: number[] = [];

  take(ms: number): void {
    this.times.push(ms);
    if (this.times.length > SAMPLE_COUNT) this.times.shift();
  }

  get median(): number {
    return this.share(0.5);
  }

  /** What 19 of 20 pictures keep. */
  get most(): number {
    return this.share(0.95);
  }

  private share(part: number): number {
    const sorted = [...this.times].sort((a, b) => a - b);
    return sorted[Math.min(Math.floor(part * sorted.length), sorted.length - 1)] ?? 0;
  }
}
