// EMG of the last seconds as columns of a picture: of each channel the lowest and the highest value in each column. Pictures of
// 8 and of 512 channels are drawn from the same columns, and nothing is lost of streams with many samples a pixel.

/** Length of what is shown, seconds. */
export const SPAN_SECS = 4;
/** Most columns; slow streams have one for two rows, since of dense streams rows are in turn lowest and highest values. */
const MAX_COLUMNS = 600;
/** Kept beyond the span, seconds: a picture may run a little behind. */
const SPARE_SECS = 0.6;

export class EmgColumns {
  /** Columns of the whole span. */
  count = 0;
  channels = 0;
  /** Columns since the start; the newest is `columnCount - 1` and may still grow. */
  columnCount = 0;
  /** Columns that are kept. */
  private capacity = 0;
  private minima = new Float64Array(0);
  private maxima = new Float64Array(0);
  private rowHz = 0;
  private rows = 0;

  /** Columns of a picture of `spanSecs`, and of `spareSecs` before it. */
  constructor(
    readonly spanSecs = SPAN_SECS,
    private readonly spareSecs = SPARE_SECS,
  ) {}

  clear(): void {
    this.columnCount = this.rows = 0;
  }

  /** Takes rows `[n_rows][n_channels]` of a stream of `rowHz`. Another stream begins anew. */
  push(rows: number[][], rowHz: number): void {
    const channels = rows[0]?.length ?? 0;
    if (channels === 0) return;
    if (channels !== this.channels || rowHz !== this.rowHz) {
      this.count = Math.max(Math.min(MAX_COLUMNS, Math.floor((this.spanSecs * rowHz) / 2)), 2);
      this.capacity = Math.ceil((1 + this.spareSecs / this.spanSecs) * this.count);
      [this.channels, this.rowHz] = [channels, rowHz];
      this.minima = new Float64Array(this.capacity * channels);
      this.maxima = new Float64Array(this.capacity * channels);
      this.clear();
    }
    for (const row of rows) {
      const column = Math.floor((this.rows * this.count) / (this.spanSecs * rowHz));
      const first = (column % this.capacity) * channels;
      this.rows += 1;
      const fresh = column >= this.columnCount;
      this.columnCount = column + 1;
      for (let c = 0; c < channels; c++) {
        // What is no number is sent as null.
        const value = row[c] ?? 0;
        this.minima[first + c] = fresh ? value : Math.min(this.minimum(column, c), value);
        this.maxima[first + c] = fresh ? value : Math.max(this.maximum(column, c), value);
      }
    }
  }

  /** The oldest column that is still known. */
  get oldest(): number {
    return Math.max(this.columnCount - this.capacity, 0);
  }

  minimum(column: number, channel: number): number {
    return this.minima[(column % this.capacity) * this.channels + channel] ?? 0;
  }

  maximum(column: number, channel: number): number {
    return this.maxima[(column % this.capacity) * this.channels + channel] ?? 0;
  }

  /** The level about which a channel swings: raw codes are not centred. */
  baseline(channel: number): number {
    let sum = 0;
    for (let column = this.oldest; column < this.columnCount; column++) sum += this.minimum(column, channel) + this.maximum(column, channel);
    return sum / Math.max(2 * (this.columnCount - this.oldest), 1);
  }

  /** The largest distance from `level` in all columns. */
  peak(channel: number, level: number): number {
    let most = 0;
    for (let column = this.oldest; column < this.columnCount; column++) most = Math.max(most, this.distance(column, channel, level));
    return most;
  }

  /** The largest distance from `level` in one column. */
  distance(column: number, channel: number, level: number): number {
    return Math.max(this.maximum(column, channel) - level, level - this.minimum(column, channel));
  }
}
