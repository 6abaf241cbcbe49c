// Scene and plots of a replay as one labelled picture: pixels or vectors, drawn by the same code.

import { MARGIN, SPAN_ALPHA, axisLabels, numberText, rowPosition, spanKinds, valueAt, type SignalData, type SignalLine } from "./signalData";
import { fixed } from "./numbers";

interface TextStyle {
  size: number;
  color?: string;
  bold?: boolean;
  anchor?: "start" | "middle" | "end";
}

/** What a picture is drawn with. Points and sizes are CSS pixels, texts lie on their middle line. */
export interface Pen {
  rect(x: number, y: number, width: number, height: number, colour: string, alpha?: number): void;
  line(points: [number, number][], colour: string, width: number, dashed?: boolean): void;
  text(x: number, y: number, text: string, style: TextStyle): void;
  image(canvas: HTMLCanvasElement, x: number, y: number, width: number, height: number): void;
  /** What `draw` draws is cut off at the edges of the box. */
  clip(x: number, y: number, width: number, height: number, draw: () => void): void;
}

/** A plot of the picture. */
export interface FigurePlot {
  title: string;
  data: SignalData;
  /** Whether the line of that number is to be seen. */
  isLineShown(line: number): boolean;
}

/** A trial of the picture. */
export interface FigureTrial {
  caption: string;
  scene: HTMLCanvasElement | null;
  plots: FigurePlot[];
  /** Seconds of the trial: the cursor, what is on display, and where the axis begins to count. */
  time: number;
  window: [number, number];
  zero: number;
}

export const TEXT_COLOR = "#17212b";
const MUTED_COLOR = "#4f5d6a";
const LINE_COLOR = "#c9d2da";
const BACKGROUND_COLOR = "#ffffff";
const FONT_FAMILY = "system-ui, sans-serif";
/** Width of a trial's column, and what lies around and in it, CSS pixels. */
const COLUMN_WIDTH_PX = 860;
const GAP = 24;
const CAPTION = 34;
const TITLE = 20;
const LEGEND = 16;
/** A letter of 10 px, about, and the swatch beside it. */
const LETTER_WIDTH_PX = 5.8;
const SWATCH = 30;
const AXIS = 20;
const LEFT = 56;

/** Points of a line without those that would not be seen: of each pixel the first, the lowest, the highest and the last. */
export function decimate(points: [number, number][]): [number, number][] {
  const kept: [number, number][] = [];
  for (let k = 0; k < points.length; ) {
    const slot = Math.floor(points[k]?.[0] ?? 0);
    let [low, high, end] = [k, k, k];
    for (; end < points.length && Math.floor(points[end]?.[0] ?? 0) === slot; end++) {
      const y = points[end]?.[1] ?? 0;
      if (y < (points[low]?.[1] ?? 0)) low = end;
      if (y > (points[high]?.[1] ?? 0)) high = end;
    }
    for (const index of new Set([k, Math.min(low, high), Math.max(low, high), end - 1])) {
      const point = points[index];
      if (point) kept.push(point);
    }
    k = end;
  }
  return kept;
}

/** The marks of a time axis: round numbers, at most about `most`. */
export function axisTicks(from: number, to: number, most: number): number[] {
  const rough = Math.max(to - from, 1e-6) / most;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = power * ([1, 2, 5, 10].find((factor) => factor * power >= rough) ?? 10);
  const marks: number[] = [];
  for (let k = Math.ceil(from / step); k * step <= to + 1e-9; k++) marks.push(k * step);
  return marks;
}

/** An entry of a plot's legend, placed from the legend's left top. */
interface LegendEntry {
  text: string;
  color: string;
  line: SignalLine | null;
  x: number;
  row: number;
}

function legendOf({ data, isLineShown: shows }: FigurePlot, time: number): LegendEntry[] {
  const lines = data.lines.flatMap((line, k): Omit<LegendEntry, "x" | "row">[] => {
    if (line.isSecondary || !shows(k)) return [];
    const value = valueAt(data.times, line.values, time);
    const text = value === null ? "" : ` ${fixed(value, line.digits).replace("-", "−")}${line.unit}`;
    return [{ text: line.label + text, color: line.color, line }];
  });
  const spans = data.lines.length > 0 ? [] : spanKinds(data).map(({ label, color }) => ({ text: label, color, line: null }));
  // Channels of a grid are named beside their rows.
  const entries = data.rows.length > 1 && !data.rows[0]?.edges ? [] : [...lines, ...spans];
  let [x, row] = [0, 0];
  return entries.map((entry) => {
    const width = SWATCH + LETTER_WIDTH_PX * entry.text.length;
    if (x > 0 && x + width > COLUMN_WIDTH_PX - LEFT) [x, row] = [0, row + 1];
    x += width;
    return { ...entry, x: x - width, row };
  });
}

function legendHeight(entries: LegendEntry[]): number {
  return entries.length > 0 ? ((entries[entries.length - 1]?.row ?? 0) + 1) * LEGEND : 0;
}

function plotHeight(plot: FigurePlot, time: number): number {
  return TITLE + legendHeight(legendOf(plot, time)) + plot.data.rows.length * plot.data.rowHeight + AXIS + 10;
}

function sceneHeight({ scene }: FigureTrial): number {
  return scene && scene.width > 0 ? (COLUMN_WIDTH_PX * scene.height) / scene.width : 0;
}

export function sizeOf(trials: FigureTrial[]): { width: number; height: number } {
  const heights = trials.map((trial) => {
    return CAPTION + sceneHeight(trial) + trial.plots.reduce((sum, plot) => sum + plotHeight(plot, trial.time), 0);
  });
  return { width: trials.length * (COLUMN_WIDTH_PX + GAP) + GAP, height: Math.ceil(Math.max(0, ...heights) + 2 * GAP) };
}

/** Draws the trials side by side; `axis` is what the time axes say. */
export function drawFigure(pen: Pen, trials: FigureTrial[], axis: string): void {
  const { width, height } = sizeOf(trials);
  pen.rect(0, 0, width, height, BACKGROUND_COLOR);
  trials.forEach((trial, k) => {
    const left = GAP + k * (COLUMN_WIDTH_PX + GAP);
    let top = GAP;
    pen.text(left, top + CAPTION / 2 - 4, trial.caption, { size: 16, bold: true });
    top += CAPTION;
    const high = sceneHeight(trial);
    if (trial.scene && high > 0) {
      pen.rect(left, top, COLUMN_WIDTH_PX, high, "#e3e9ee");
      pen.image(trial.scene, left, top, COLUMN_WIDTH_PX, high);
    }
    top += high;
    for (const plot of trial.plots) {
      drawPlot(pen, trial, plot, left, top, axis);
      top += plotHeight(plot, trial.time);
    }
  });
}

function drawPlot(pen: Pen, trial: FigureTrial, plot: FigurePlot, left: number, top: number, axis: string): void {
  const { title, data, isLineShown: shows } = plot;
  pen.text(left, top + TITLE / 2 + 2, title, { size: 13, bold: true });
  let y = top + TITLE;
  const legend = legendOf(plot, trial.time);
  for (const { text, color, line, x, row } of legend) {
    const [across, middle] = [left + LEFT + x, y + row * LEGEND + LEGEND / 2];
    if (line) pen.line([[across, middle], [across + 14, middle]], color, 2.5, line.dashed ?? false);
    else pen.rect(across, middle - 5, 14, 10, color, 0.6);
    pen.text(across + 18, middle, text, { size: 10 });
  }
  y += legendHeight(legend);
  const [wide, high, count] = [COLUMN_WIDTH_PX - LEFT, data.rows.length * data.rowHeight, data.rows.length];
  const [from, to] = trial.window;
  const x0 = left + LEFT;
  const across = (time: number) => x0 + (wide * (time - from)) / Math.max(to - from, 1e-6);
  const down = (place: number) => y + high * (1 - place / count);
  pen.clip(x0, y, wide, high, () => {
    for (const span of data.spans.filter((each) => each.to > from && each.from < to)) {
      const [begin, end] = [Math.max(across(span.from), x0), Math.min(across(span.to), x0 + wide)];
      pen.rect(begin, y, Math.max(end - begin, 0.5), high, span.color, SPAN_ALPHA);
      if (span.label && end - begin > 6 * span.label.length) pen.text(begin + 3, y + high / 2, span.label, { size: 9 });
    }
    for (const mark of axisTicks(from - trial.zero, to - trial.zero, 8)) {
      const x = across(mark + trial.zero);
      pen.line([[x, y], [x, y + high]], LINE_COLOR, 0.75);
    }
    data.rows.forEach((row, k) => {
      if (!row.edges) return;
      for (const share of [MARGIN, 1 - MARGIN]) pen.line([[x0, down(count - 1 - k + share)], [x0 + wide, down(count - 1 - k + share)]], MUTED_COLOR, 0.4);
    });
    data.lines.forEach((line, k) => {
      if (!shows(k)) return;
      for (const part of continuousSegments(data, line, from, to, across, down)) pen.line(decimate(part), line.color, 1.1, line.dashed ?? false);
    });
    pen.line([[across(trial.time), y], [across(trial.time), y + high]], TEXT_COLOR, 1.5);
  });
  pen.line([[x0, y], [x0 + wide, y], [x0 + wide, y + high], [x0, y + high], [x0, y]], MUTED_COLOR, 0.6);
  for (const { place, text } of axisLabels(data)) pen.text(x0 - 6, down(place), text, { size: 10, color: MUTED_COLOR, anchor: "end" });
  data.rows.forEach(({ label, edges }, k) => {
    if (edges) pen.text(x0 + 4, down(count - k - MARGIN) + 8, label, { size: 10 });
  });
  for (const mark of axisTicks(from - trial.zero, to - trial.zero, 8)) {
    pen.text(across(mark + trial.zero), y + high + 10, numberText(Math.round(mark * 1000) / 1000), { size: 10, color: MUTED_COLOR, anchor: "middle" });
  }
  pen.text(x0 + wide, top + TITLE / 2 + 2, `${axis} (s)`, { size: 10, color: MUTED_COLOR, anchor: "end" });
}

/** A line without its gaps, as points of the picture; one point beyond either end of what is on display. */
function continuousSegments(
  data: SignalData,
  line: SignalLine,
  from: number,
  to: number,
  across: (time: number) => number,
  down: (place: number) => number,
): [number, number][][] {
  const parts: [number, number][][] = [];
  let part: [number, number][] = [];
  data.times.forEach((time, k) => {
    const value = line.values[k] ?? null;
    const seen = (data.times[k + 1] ?? time) >= from && (data.times[k - 1] ?? time) <= to;
    if (value === null || !seen) {
      if (part.length > 1) parts.push(part);
      part = [];
      return;
    }
    const point: [number, number] = [across(time), down(rowPosition(data, line, value))];
    const before = part[part.length - 1];
    if (line.stepped && before) part.push([point[0], before[1]]);
    part.push(point);
  });
  if (part.length > 1) parts.push(part);
  return parts;
}

/** Draws on a canvas that has `scale` pixels a CSS pixel. */
export class CanvasPen implements Pen {
  constructor(
    private readonly context: CanvasRenderingContext2D,
    scale: number,
  ) {
    context.scale(scale, scale);
  }

  rect(x: number, y: number, width: number, height: number, colour: string, alpha = 1): void {
    this.context.globalAlpha = alpha;
    this.context.fillStyle = colour;
    this.context.fillRect(x, y, width, height);
    this.context.globalAlpha = 1;
  }

  line(points: [number, number][], colour: string, width: number, dashed = false): void {
    const { context } = this;
    context.strokeStyle = colour;
    context.lineWidth = width;
    context.lineJoin = "round";
    context.setLineDash(dashed ? [4, 3] : []);
    context.beginPath();
    points.forEach(([x, y], k) => (k === 0 ? context.moveTo(x, y) : context.lineTo(x, y)));
    context.stroke();
  }

  text(x: number, y: number, text: string, { size, color = TEXT_COLOR, bold = false, anchor = "start" }: TextStyle): void {
    const { context } = this;
    context.font = `${bold ? 650 : 400} ${size}px ${FONT_FAMILY}`;
    context.fillStyle = color;
    context.textBaseline = "middle";
    context.textAlign = anchor === "middle" ? "center" : anchor;
    context.fillText(text, x, y);
  }

  image(canvas: HTMLCanvasElement, x: number, y: number, width: number, height: number): void {
    this.context.drawImage(canvas, x, y, width, height);
  }

  clip(x: number, y: number, width: number, height: number, draw: () => void): void {
    this.context.save();
    this.context.beginPath();
    this.context.rect(x, y, width, height);
    this.context.clip();
    draw();
    this.context.restore();
  }
}

/** Writes SVG: lines and letters stay what they are, the scene is a picture in it. */
export class SvgPen implements Pen {
  private readonly parts: string[] = [];
  private boxes = 0;

  constructor(
    private readonly width: number,
    private readonly height: number,
    private readonly title: string,
  ) {}

  toString(): string {
    const size = `width="${this.width}" height="${this.height}" viewBox="0 0 ${this.width} ${this.height}"`;
    return [
      `<svg xmlns="http://www.w3.org/2000/svg" ${size} font-family="${FONT_FAMILY}">`,
      `<title>${escapeXml(this.title)}</title>`,
      ...this.parts,
      "</svg>\n",
    ].join("\n");
  }

  rect(x: number, y: number, width: number, height: number, colour: string, alpha = 1): void {
    const place = `x="${short(x)}" y="${short(y)}" width="${short(width)}" height="${short(height)}"`;
    this.parts.push(`<rect ${place} fill="${colour}"${alpha < 1 ? ` fill-opacity="${alpha}"` : ""}/>`);
  }

  line(points: [number, number][], colour: string, width: number, dashed = false): void {
    const list = points.map(([x, y]) => `${short(x)},${short(y)}`).join(" ");
    const dash = dashed ? ' stroke-dasharray="4 3"' : "";
    this.parts.push(`<polyline points="${list}" fill="none" stroke="${colour}" stroke-width="${width}" stroke-linejoin="round"${dash}/>`);
  }

  text(x: number, y: number, text: string, { size, color = TEXT_COLOR, bold = false, anchor = "start" }: TextStyle): void {
    const look = `font-size="${size}" fill="${color}" text-anchor="${anchor}" dominant-baseline="central"${bold ? ' font-weight="650"' : ""}`;
    this.parts.push(`<text x="${short(x)}" y="${short(y)}" ${look}>${escapeXml(text)}</text>`);
  }

  image(canvas: HTMLCanvasElement, x: number, y: number, width: number, height: number): void {
    const place = `x="${short(x)}" y="${short(y)}" width="${short(width)}" height="${short(height)}"`;
    this.parts.push(`<image ${place} href="${canvas.toDataURL("image/png")}"/>`);
  }

  clip(x: number, y: number, width: number, height: number, draw: () => void): void {
    const name = `box${(this.boxes += 1)}`;
    this.parts.push(`<clipPath id="${name}"><rect x="${short(x)}" y="${short(y)}" width="${short(width)}" height="${short(height)}"/></clipPath>`);
    this.parts.push(`<g clip-path="url(#${name})">`);
    draw();
    this.parts.push("</g>");
  }
}

function short(value: number): string {
  return String(Math.round(value * 100) / 100);
}

function escapeXml(text: string): string {
  return text.replaceAll("&", "&amp;").replaceAll("<", "&lt;").replaceAll(">", "&gt;");
}
