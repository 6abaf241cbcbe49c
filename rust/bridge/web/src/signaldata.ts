// Signals as data for a plot, and where their values are in it. Times are seconds.

/** A strip of the plot, as high as its values go. */
export interface SignalRow {
  label: string;
  /** Values at its lower and upper edge. */
  low: number;
  high: number;
  /** The edges mean something, such as the limits of a joint: they are drawn and named. */
  edges?: boolean;
}

/** Values over the times of its plot; null where there is none. */
export interface SignalLine {
  label: string;
  unit: string;
  /** Decimals of a value. */
  digits: number;
  colour: string;
  row: number;
  values: (number | null)[];
  dashed?: boolean;
  /** A value holds until the next one. */
  stepped?: boolean;
}

/** A state that held for a while, from the bottom to the top of the plot. */
export interface SignalSpan {
  from: number;
  to: number;
  label: string;
  colour: string;
}

export interface SignalData {
  /** Ascending. */
  times: number[];
  rows: SignalRow[];
  lines: SignalLine[];
  spans: SignalSpan[];
  /** Height of a row, CSS pixels. */
  rowHeight: number;
}

/** A row's values leave so much of it free at either end. */
export const MARGIN = 0.07;
/** How strongly a span is painted. */
export const SPAN_ALPHA = 0.28;

/** Where a value is, in rows from the bottom: the first row is the topmost. */
export function placed({ rows }: SignalData, { row }: SignalLine, value: number): number {
  const { low, high } = rows[row] ?? { low: 0, high: 1 };
  const share = high > low ? (value - low) / (high - low) : 0.5;
  return rows.length - 1 - row + MARGIN + (1 - 2 * MARGIN) * share;
}

/** What stands beside a row. */
export function rowText({ label, low, high, edges }: SignalRow): string {
  return edges ? `${label}\n${numberText(low)} … ${numberText(high)}` : label;
}

export function numberText(value: number): string {
  return String(Number(value.toPrecision(3))).replace("-", "−");
}

/** The value at `time`: of the last instant up to it. */
export function valueAt(times: number[], values: (number | null)[], time: number): number | null {
  let [low, high] = [0, times.length];
  while (low < high) {
    const middle = (low + high) >> 1;
    if ((times[middle] ?? Infinity) <= time) low = middle + 1;
    else high = middle;
  }
  return low > 0 ? (values[low - 1] ?? null) : null;
}
