// A row of named stretches of time, such as the gesture in force: what was named lasts until the next name.

import { clearCanvas, type PlotColors } from "./emgPlots";
import type { TimeSeries } from "./signalHistory";

/** A name is written where there is room for it, pixels a letter. */
const LETTER_WIDTH_PX = 7;

export interface BandStyle {
  text: string;
  /** Filled; otherwise it is a line alone. */
  strong: boolean;
  /** Nothing is drawn. */
  empty?: boolean;
}

/** Draws the series `k` of `stretch`, whose values `look` explains, between the times `from` and `to`. */
export function drawBand(
  canvas: HTMLCanvasElement,
  { times, series }: TimeSeries,
  k: number,
  { from, to, inks, look }: { from: number; to: number; inks: PlotColors; look: (value: number) => BandStyle },
): void {
  const picture = clearCanvas(canvas);
  const values = series[k];
  if (!picture || !values || times.length === 0) return;
  const { context, width, height } = picture;
  const x = (time: number) => (width * (time - from)) / (to - from);
  let begun = 0;
  for (let entry = 1; entry <= times.length; entry++) {
    if (entry < times.length && values[entry] === values[begun]) continue;
    const end = Math.min(times[entry] ?? times[times.length - 1] ?? to, to);
    const { text, strong, empty } = look(values[begun] ?? 0);
    const left = Math.max(x(times[begun] ?? from), 0);
    const right = Math.max(x(end), left + 1);
    begun = entry;
    if (empty) continue;
    context.fillStyle = context.strokeStyle = inks.accent;
    if (strong) context.fillRect(left, 1, right - left, height - 2);
    else context.strokeRect(left + 0.5, 1.5, Math.max(right - left - 1, 0.5), height - 3);
    const letters = Math.floor((right - left - 6) / LETTER_WIDTH_PX);
    if (letters < 2) continue;
    context.fillStyle = strong ? inks.card : inks.ink;
    context.fillText(text.length <= letters ? text : `${text.slice(0, letters - 1)}…`, left + 4, height / 2);
  }
}
