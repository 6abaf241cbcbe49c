// The last seconds of some numbers that come together: kept so that any part of them is one piece of memory, as charts want it.

/** Times in seconds, and for each of them a value of every series. */
export interface TimeSeries {
  times: Float64Array;
  series: Float32Array[];
}

export class SignalHistory {
  private times: Float64Array;
  private series: Float32Array[] = [];
  /** Entries lie from `first` to `end`. */
  private first = 0;
  private end = 0;

  /** Keeps the last `capacity` entries. */
  constructor(private readonly capacity: number) {
    this.times = new Float64Array(2 * capacity);
  }

  get latest(): number | null {
    return this.end > this.first ? (this.times[this.end - 1] ?? null) : null;
  }

  get oldest(): number | null {
    return this.end > this.first ? (this.times[this.first] ?? null) : null;
  }

  clear(): void {
    this.first = this.end = 0;
  }

  /** Another number of values, or a time that goes back, begins anew. */
  push(time: number, values: ArrayLike<number>): void {
    if (values.length !== this.series.length) {
      this.series = Array.from({ length: values.length }, () => new Float32Array(2 * this.capacity));
      this.clear();
    }
    if (this.latest !== null && time < this.latest) this.clear();
    // The same instant again takes the place of the one before.
    if (this.latest === time) this.end -= 1;
    if (this.end === 2 * this.capacity) this.moveToFront();
    this.times[this.end] = time;
    this.series.forEach((line, k) => (line[this.end] = values[k] ?? 0));
    this.end += 1;
    this.first = Math.max(this.first, this.end - this.capacity);
  }

  /** What lies between two times, and an entry more at both ends, so that lines go on to the edges. */
  between(from: number, to: number): TimeSeries {
    const begin = Math.max(this.place(from) - 1, this.first);
    const end = Math.min(this.place(to) + 1, this.end);
    return { times: this.times.subarray(begin, end), series: this.series.map((line) => line.subarray(begin, end)) };
  }

  /** The values in force at a time: those of the last entry that is not later. Empty before the first. */
  at(time: number): number[] {
    const place = this.place(time);
    const entry = this.times[place] === time && place < this.end ? place : place - 1;
    return entry < this.first ? [] : this.series.map((line) => line[entry] ?? 0);
  }

  /** The first entry that is not before `time`. */
  private place(time: number): number {
    let [low, high] = [this.first, this.end];
    while (low < high) {
      const middle = (low + high) >> 1;
      if ((this.times[middle] ?? 0) < time) low = middle + 1;
      else high = middle;
    }
    return low;
  }

  private moveToFront(): void {
    const { first, end } = this;
    this.times.copyWithin(0, first, end);
    for (const line of this.series) line.copyWithin(0, first, end);
    [this.first, this.end] = [0, end - first];
  }
}
