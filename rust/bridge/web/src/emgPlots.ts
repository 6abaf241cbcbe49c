// The pictures of the EMG view: traces, a raster of many channels, a spectrum.

import type { EmgColumns } from "./emgColumns";
import type { Spectrum } from "./spectrum";
import { strings } from "./strings";

/** Colours of the page as it is now, light or dark. */
export interface PlotColors {
  ink: string;
  muted: string;
  line: string;
  card: string;
  accent: string;
  warn: string;
  bad: string;
}

/** What of the columns is drawn. */
export interface PlotView {
  columns: EmgColumns;
  /** The column at the right edge; between two columns while it scrolls. */
  edge: number;
  /** What fills a lane, the unit of the stream. */
  range: number;
  baselines: number[];
  selected: number;
}

const FONT = "12px system-ui, sans-serif";
/** Frequencies of the world's mains, hertz. */
const MAINS_HZ = [50, 60];
const SHADE_COUNT = 64;
/** Columns of a cell of the raster: of single ones muscle is no more than speckle. */
const CELL_COLUMNS = 5;

export function plotColors(node: Element): PlotColors {
  const style = getComputedStyle(node);
  const ink = (name: string) => style.getPropertyValue(`--${name}`).trim();
  return { ink: ink("ink"), muted: ink("soft"), line: ink("line"), card: ink("card"), accent: ink("accent-ink"), warn: ink("warn"), bad: ink("bad") };
}

/** An empty canvas in the size that it has on the page, in CSS pixels; none while it is hidden. */
export function clearCanvas(canvas: HTMLCanvasElement): { context: CanvasRenderingContext2D; width: number; height: number } | null {
  // Drawn by the processor: long paths of many points are slow on a graphics card, and slower still on an emulated one.
  const context = canvas.getContext("2d", { willReadFrequently: true });
  const [width, height] = [canvas.clientWidth, canvas.clientHeight];
  if (!context || width < 2 || height < 2) return null;
  const ratio = window.devicePixelRatio;
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
  }
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, width, height);
  context.font = FONT;
  context.lineWidth = 1;
  context.textBaseline = "middle";
  return { context, width, height };
}

/** A lane for each of `channels`, from top to bottom. */
export function drawTraces(canvas: HTMLCanvasElement, shown: PlotView, channels: number[], inks: PlotColors): void {
  const picture = clearCanvas(canvas);
  if (!picture) return;
  const { context, width, height } = picture;
  const lane = height / channels.length;
  drawSeconds(context, { width, height, span: shown.columns.spanSecs }, inks);
  channels.forEach((channel, place) => {
    const middle = (place + 0.5) * lane;
    if (channel === shown.selected && channels.length > 1) {
      context.globalAlpha = 0.12;
      context.fillStyle = inks.accent;
      context.fillRect(0, place * lane, width, lane);
      context.globalAlpha = 1;
    }
    context.strokeStyle = inks.line;
    context.lineWidth = 1;
    stroke(context, [[0, middle], [width, middle]]);
    drawTrace(context, shown, channel, { width, middle, half: 0.48 * lane });
    context.strokeStyle = channel === shown.selected ? inks.accent : inks.ink;
    context.stroke();
  });
}

/** The path of one channel. What leaves its lane is cut off there. */
function drawTrace(
  context: CanvasRenderingContext2D,
  { columns, edge, range, baselines: levels }: PlotView,
  channel: number,
  { width, middle, half }: { width: number; middle: number; half: number },
): void {
  const level = levels[channel] ?? 0;
  const y = (value: number) => middle - Math.min(Math.max((value - level) / range, -1), 1) * half;
  const step = width / columns.count;
  context.beginPath();
  for (let column = Math.max(columns.oldest, Math.floor(edge) - columns.count - 1); column < Math.min(columns.columnCount, edge); column++) {
    const x = width - (edge - column) * step;
    context.lineTo(x, y(columns.maximum(column, channel)));
    context.lineTo(x, y(columns.minimum(column, channel)) + 0.5);
  }
}

/** A line each second back from now. */
function drawSeconds(context: CanvasRenderingContext2D, { width, height, span }: { width: number; height: number; span: number }, inks: PlotColors): void {
  context.strokeStyle = inks.line;
  context.setLineDash([2, 4]);
  for (let second = 1; second < span; second++) {
    const x = Math.round(width * (1 - second / span)) + 0.5;
    stroke(context, [[x, 0], [x, height]]);
  }
  context.setLineDash([]);
}

/** Time from left to right, channels from top to bottom; the stronger, the further from the ground's colour. */
export class Raster {
  private readonly cells = document.createElement("canvas");

  draw(canvas: HTMLCanvasElement, shown: PlotView, inks: PlotColors): void {
    const picture = clearCanvas(canvas);
    if (!picture) return;
    const { context, width, height } = picture;
    const { columns, edge, range, baselines: levels, selected } = shown;
    const across = Math.ceil(columns.count / CELL_COLUMNS) + 1;
    if (this.cells.width !== across || this.cells.height !== columns.channels) {
      [this.cells.width, this.cells.height] = [across, columns.channels];
    }
    const cells = this.cells.getContext("2d", { willReadFrequently: true });
    if (!cells) return;
    const image = cells.createImageData(across, columns.channels);
    const shades = shadesOf(inks);
    // Cells begin at multiples of their length, so that a cell keeps its shade while it scrolls.
    const first = Math.floor(Math.min(columns.columnCount, edge) / CELL_COLUMNS) - across;
    for (let x = 0; x < across; x++) {
      const from = (first + x) * CELL_COLUMNS;
      if (from < columns.oldest) continue;
      for (let channel = 0; channel < columns.channels; channel++) {
        let strength = 0;
        for (let k = 0; k < CELL_COLUMNS; k++) strength += columns.distance(from + k, channel, levels[channel] ?? 0);
        const share = strength / CELL_COLUMNS / range;
        const shade = shades[Math.min(Math.max(Math.floor(share * SHADE_COUNT), 0), SHADE_COUNT - 1)] ?? [0, 0, 0];
        image.data.set([...shade, 255], 4 * (channel * across + x));
      }
    }
    cells.putImageData(image, 0, 0);
    context.imageSmoothingEnabled = false;
    const step = width / columns.count;
    context.drawImage(this.cells, width - (edge - first * CELL_COLUMNS) * step, 0, across * CELL_COLUMNS * step, height);
    // The selected channel in a frame that is no shade.
    const lane = height / columns.channels;
    context.strokeStyle = inks.warn;
    context.lineWidth = 2;
    context.strokeRect(1, Math.max(selected * lane - 1, 1), width - 2, Math.min(lane + 2, height));
  }
}

/** From ground over accent to ink. */
function shadesOf({ card, accent, ink }: PlotColors): number[][] {
  const stops = [card, accent, ink].map((text) => [1, 3, 5].map((k) => Number.parseInt(text.slice(k, k + 2), 16) || 0));
  return Array.from({ length: SHADE_COUNT }, (_, k) => {
    const place = (2 * k) / (SHADE_COUNT - 1);
    const from = Math.min(Math.floor(place), 1);
    return [0, 1, 2].map((c) => (stops[from]?.[c] ?? 0) * (1 - (place - from)) + (stops[from + 1]?.[c] ?? 0) * (place - from));
  });
}

/** The square root of the density over frequency, with the mains. */
export function drawSpectrum(canvas: HTMLCanvasElement, spectrum: Spectrum | null, inks: PlotColors): void {
  const picture = clearCanvas(canvas);
  if (!picture || !spectrum) return;
  const { context, width, height } = picture;
  const { stepHz, density } = spectrum;
  const [left, floor] = [4, height - 18];
  const most = density.length * stepHz;
  const x = (hz: number) => left + ((width - left - 4) * hz) / most;
  const top = Math.sqrt(Math.max(...density, Number.MIN_VALUE));
  context.strokeStyle = inks.line;
  context.fillStyle = inks.muted;
  context.textAlign = "center";
  const tick = [10, 20, 50, 100, 200, 500, 1000, 2000, 5000].find((step) => most / step <= 6) ?? most;
  for (let hz = 0; hz <= most; hz += tick) {
    stroke(context, [[x(hz), 14], [x(hz), floor]]);
    context.textAlign = hz === 0 ? "left" : x(hz) > width - 24 ? "right" : "center";
    context.fillText(hz === 0 ? "0 Hz" : String(hz), x(hz), height - 8);
  }
  context.strokeStyle = inks.bad;
  context.setLineDash([3, 3]);
  for (const hz of MAINS_HZ.filter((mains) => mains < most)) {
    stroke(context, [[x(hz), 14], [x(hz), floor]]);
  }
  context.setLineDash([]);
  if (MAINS_HZ.every((mains) => mains < most)) {
    context.textAlign = "left";
    context.fillStyle = inks.bad;
    context.fillText(strings.emg.mains, Math.max(x(50) - 36, 0), 6);
  }
  context.strokeStyle = inks.accent;
  context.fillStyle = inks.accent;
  context.lineWidth = 1.5;
  context.beginPath();
  density.forEach((value, k) => context.lineTo(x(k * stepHz), floor - (Math.sqrt(value) / top) * (floor - 18)));
  context.stroke();
  context.lineTo(x(most - stepHz), floor);
  context.lineTo(x(0), floor);
  context.globalAlpha = 0.2;
  context.fill();
  context.globalAlpha = 1;
}

function stroke(context: CanvasRenderingContext2D, points: [number, number][]): void {
  context.beginPath();
  for (const [x, y] of points) context.lineTo(x, y);
  context.stroke();
}
