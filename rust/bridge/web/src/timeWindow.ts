// The part of time that all signals show: it goes along with the trial, stands still, or lies some way back.

/** Length of what is shown, seconds. */
export const WINDOW_SECS = 10;
/** How far back one may look, seconds. */
export const MAX_BACK_SECS = 30;

export class TimeWindow {
  /** Where it stands; none while it goes along. */
  private frozenEdge: number | null = null;
  private latest = 0;

  get live(): boolean {
    return this.frozenEdge === null;
  }

  /** The time at the right edge, seconds. */
  get edge(): number {
    return this.frozenEdge ?? this.latest;
  }

  /** How far the right edge lies behind the newest, seconds. */
  get lagSecs(): number {
    return this.latest - this.edge;
  }

  get from(): number {
    return this.edge - WINDOW_SECS;
  }

  /** Another trial. */
  clear(): void {
    this.frozenEdge = null;
    this.latest = 0;
  }

  /** The newest instant. What stands still too long is carried along: no more is kept. */
  advance(latest: number): void {
    this.latest = latest;
    if (this.frozenEdge !== null) this.frozenEdge = Math.max(this.frozenEdge, latest - MAX_BACK_SECS);
  }

  pause(): void {
    this.frozenEdge = this.edge;
  }

  goLive(): void {
    this.frozenEdge = null;
  }

  /** Puts the right edge so many seconds back; there it stays. Zero goes along again. */
  lookBack(seconds: number): void {
    const back = Math.min(Math.max(seconds, 0), Math.min(MAX_BACK_SECS, this.latest));
    this.frozenEdge = back === 0 ? null : this.latest - back;
  }
}
