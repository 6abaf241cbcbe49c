// Signals as data for a plot, and where their values are in it. Times are seconds.

/** A strip of the plot, as high as its values go. */
export interface SignalRow {
  label: string;
  /** Values at its lower and upper edge. */
  minimum: number;
  maximum: number;
  /** The edges mean something, such as the limits of a joint: they are drawn and their values stand at the left; the label is
   * in the row. */
  edges?: boolean;
}

/** Values over the times of its plot; null where there is none. */
export interface SignalLine {
  label: string;
  unit: string;
  /** Decimals of a value. */
  digits: number;
  color: string;
  row: number;
  values: (number | null)[];
  dashed?: boolean;
  /** A value holds until the next one. */
  stepped?: boolean;
  /** It belongs to the line before it in the same row, and has no entry of its own among the names. */
  isSecondary?: boolean;
}

/** A state that held for a while, from the bottom to the top of the plot. */
export interface SignalSpan {
  from: number;
  to: number;
  label: string;
  color: string;
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
export function rowPosition({ rows }: SignalData, { row }: SignalLine, value: number): number {
  const { minimum: low, maximum: high } = rows[row] ?? { minimum: 0, maximum: 1 };
  const share = high > low ? (value - low) / (high - low) : 0.5;
  return rows.length - 1 - row + MARGIN + (1 - 2 * MARGIN) * share;
}

/** What stands at the left of the plot, each at its height in rows from the bottom. */
export function axisLabels({ rows }: SignalData): { place: number; text: string }[] {
  return rows.flatMap(({ label, minimum: low, maximum: high, edges }, k) => {
    const bottom = rows.length - 1 - k;
    if (label !== "" && !edges) return [{ place: bottom + 0.5, text: label }];
    if (high <= low) return [];
    return (edges ? [0, 1] : [0, 0.5, 1]).map((share) => {
      // Those of two rows that meet do not cover each other.
      const at = edges ? 0.16 + 0.68 * share : share;
      return { place: bottom + MARGIN + (1 - 2 * MARGIN) * at, text: numberText(low + share * (high - low)) };
    });
  });
}

/** The kinds of spans that have a name. */
export function spanKinds({ spans }: SignalData): { label: string; color: string }[] {
  const kinds = new Map(spans.filter(({ label }) => label).map(({ label, color }) => [label, color]));
  return [...kinds].map(([label, color]) => ({ label, color }));
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
