// The figures of the report: plain data in, SVG out. Bundled alone, and run by the program without a browser.

import * as Plot from "@observablehq/plot";
import { parseHTML } from "linkedom/worker";

const { document } = parseHTML("<!doctype html><html><body></body></html>");

/** Okabe and Ito's colours, which people with any colour vision tell apart, without the yellow that paper swallows. */
const COLORS = ["#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#6C6C6C", "#882255", "#44AA99", "#999933"];
/** Those of them on which dark letters are read better. */
const LIGHT_COLORS = new Set(["#CC79A7", "#56B4E9", "#E69F00", "#44AA99", "#999933"]);
/** A column of a paper, pixels. */
const COLUMN_WIDTH_PX = 360;
const FULL_WIDTH_PX = 740;
const FONT = "DejaVu Sans, Verdana, Arial, sans-serif";

type Row = Record<string, string | number | null>;

interface FigureSpec {
  kind: "strip" | "grid" | "lines" | "bars" | "curve" | "growth" | "heat" | "confusion" | "cloud";
  rows: Row[];
  /** What is on the axes. */
  x: string;
  y: string;
  /** Orders of what is on x and of what has a colour; empty for those of the numbers themselves. */
  order: string[];
  parts: string[];
  /** The highest value that there can be. */
  most?: number;
}

/** The values of a column in the order of the rows, each once. */
function distinct(rows: Row[], key: string): string[] {
  return [...new Set(rows.filter((row) => row[key] !== undefined && row[key] !== null).map((row) => String(row[key])))];
}

function base(spec: FigureSpec, width: number, height: number): Plot.PlotOptions {
  return {
    document: document as unknown as Document,
    width,
    height,
    style: { fontFamily: FONT, fontSize: "11px", overflow: "visible" },
    marginLeft: 48,
    marginBottom: 40,
    color: { domain: spec.parts, range: COLORS.slice(0, spec.parts.length), legend: false },
  };
}

/** Several panels side by side, of which each is as wide as its part of the whole. */
function facets(spec: FigureSpec): { names: string[]; options: Partial<Plot.PlotOptions> } {
  const names = distinct(spec.rows, "facet");
  if (names.length === 0) return { names, options: {} };
  return { names, options: { fx: { domain: names, label: null, padding: 0.12 } } };
}

/** The axis of a value from zero on: up to what there can be, and where all values are zero up to one, since nothing is no length. */
function zeroBasedAxis(spec: FigureSpec, key: string): Plot.ScaleOptions {
  const empty = spec.rows.every((row) => Number(row[key] ?? 0) === 0);
  const most = spec.most ?? (empty ? 1 : undefined);
  return { label: spec.y, grid: true, ...(most !== undefined && { domain: [0, most] }) };
}

/** Each value as a dot beside the quartiles of its condition. */
function stripPlot(spec: FigureSpec): Plot.PlotOptions {
  const { names, options } = facets(spec);
  const splits = distinct(spec.rows, "split");
  const fx = names.length > 0 ? "facet" : undefined;
  const width = names.length > 1 || spec.order.length * Math.max(1, splits.length) > 6 ? FULL_WIDTH_PX : COLUMN_WIDTH_PX;
  // Dots of one value stand beside each other, as many as there are; of more they overlap.
  const places = new Map<string, number>();
  const spread = spec.rows.map((row) => {
    const key = [row["facet"], row["x"], row["split"], Math.round(Number(row["y"]) * 50) / 50].join("|");
    const place = places.get(key) ?? 0;
    places.set(key, place + 1);
    const step = place % 2 === 0 ? place / 2 : -(place + 1) / 2;
    return { ...row, dx: Math.max(-5, Math.min(5, step)) };
  });
  const marks: Plot.Markish[] = [
    Plot.ruleY([0], { strokeOpacity: 0.4 }),
    Plot.boxY(spec.rows, { x: "x", y: "y", ...(fx && { fx }), r: 0, fill: "currentColor", fillOpacity: 0.12, strokeOpacity: 0.7 }),
  ];
  for (const shift of new Set(spread.map((row) => row.dx))) {
    const rows = spread.filter((row) => row.dx === shift);
    marks.push(Plot.dot(rows, { x: "x", y: "y", ...(fx && { fx }), fill: "x", fillOpacity: 0.75, r: 2.2, dx: shift * 3.4 }));
  }
  return {
    ...base({ ...spec, parts: spec.order }, width, 260),
    ...options,
    x: { domain: spec.order, label: spec.x, tickRotate: spec.order.some((name) => name.length > 9) ? -25 : 0 },
    y: { ...zeroBasedAxis(spec, "y"), nice: true },
    marks,
  };
}

/** What became of each block: a cell a block, with a letter beside the colour. */
function outcomeGrid(spec: FigureSpec): Plot.PlotOptions {
  const columns = distinct(spec.rows, "facet");
  const rows = distinct(spec.rows, "y");
  const fx = columns.length > 0 ? { fx: "facet" } : {};
  return {
    ...base(spec, FULL_WIDTH_PX, 60 + 17 * rows.length),
    fx: { domain: columns, label: null, padding: 0.05 },
    x: { domain: spec.order, label: spec.x, axis: null },
    y: { domain: rows, label: null },
    marginLeft: 60,
    marginBottom: 14,
    marks: [
      Plot.cell(spec.rows, { x: "x", y: "y", ...fx, fill: "part", inset: 0.5 }),
      // Two marks, since a colour in a row would be taken for a part.
      ...[true, false].map((light) =>
        Plot.text(
          spec.rows.filter((row) => LIGHT_COLORS.has(COLORS[spec.parts.indexOf(String(row["part"])) % COLORS.length] ?? "") === light),
          { x: "x", y: "y", ...fx, text: "letter", fill: light ? "#1a1a1a" : "#ffffff", fontSize: 9, fontWeight: "bold" },
        ),
      ),
    ],
  };
}

/** A line a condition, a panel a participant. */
function linePlot(spec: FigureSpec): Plot.PlotOptions {
  const { names, options } = facets(spec);
  const fx = names.length > 0 ? { fx: "facet" } : {};
  const last = Math.max(1, ...spec.rows.map((row) => Number(row["x"])));
  const ticks = [...Array(last).keys()].map((k) => k + 1).filter((k) => last < 8 || k % Math.ceil(last / 4) === 0);
  const bounds = spec.rows.filter((row) => row["low"] !== undefined && row["low"] !== null);
  return {
    ...base(spec, names.length > 1 ? FULL_WIDTH_PX : COLUMN_WIDTH_PX, 220),
    ...options,
    x: { label: spec.x, ticks, tickFormat: "d", inset: 6 },
    y: zeroBasedAxis(spec, "y"),
    marks: [
      Plot.ruleY([0], { strokeOpacity: 0.4 }),
      Plot.areaY(bounds, { x: "x", y1: "low", y2: "high", z: "part", fill: "part", fillOpacity: 0.15, ...fx }),
      Plot.line(spec.rows, { x: "x", y: "y", z: "part", stroke: "part", strokeWidth: 1.6, ...fx }),
      Plot.dot(spec.rows, { x: "x", y: "y", fill: "part", symbol: "part", r: 3, ...fx }),
    ],
    symbol: { domain: spec.parts, legend: false },
  };
}

/** Parts of a whole or of a count, stacked. */
function stackedBars(spec: FigureSpec): Plot.PlotOptions {
  const { names, options } = facets(spec);
  const fx = names.length > 0 ? { fx: "facet" } : {};
  return {
    ...base(spec, names.length > 1 ? FULL_WIDTH_PX : COLUMN_WIDTH_PX, 240),
    ...options,
    x: { domain: spec.order, label: spec.x },
    y: zeroBasedAxis(spec, "value"),
    marks: [
      Plot.barY(spec.rows, { x: "x", y: "value", fill: "part", order: spec.parts, insetLeft: 2, insetRight: 2, ...fx }),
      Plot.ruleY([0]),
    ],
  };
}

/** A value that rises or falls along numbers, a line a part. */
function curvePlot(spec: FigureSpec): Plot.PlotOptions {
  return {
    ...base(spec, COLUMN_WIDTH_PX, 240),
    x: { label: spec.x },
    y: zeroBasedAxis(spec, "y"),
    marks: [
      Plot.ruleY([0, 0.8], { strokeOpacity: 0.4, strokeDasharray: "3 3" }),
      Plot.line(spec.rows, { x: "x", y: "y", stroke: "part", strokeWidth: 1.6 }),
      Plot.dot(spec.rows, { x: "x", y: "y", fill: "part", symbol: "part", r: 3 }),
    ],
    symbol: { domain: spec.parts, legend: false },
  };
}

/** Costs over sizes, both as ratios: a power is a straight line. */
function logLogPlot(spec: FigureSpec): Plot.PlotOptions {
  const sizes = [...new Set(spec.rows.map((row) => Number(row["x"])))];
  return {
    ...base(spec, COLUMN_WIDTH_PX, 240),
    x: { type: "log", label: spec.x, ticks: sizes, tickFormat: (size: number) => String(Number(size.toPrecision(3))), inset: 6 },
    y: { type: "log", label: spec.y, grid: true, nice: true, ticks: 4, tickFormat: "~r" },
    marks: [
      Plot.line(spec.rows, { x: "x", y: "y", z: "part", stroke: "part", strokeWidth: 1.6 }),
      Plot.dot(spec.rows, { x: "x", y: "y", fill: "part", symbol: "part", r: 3 }),
    ],
    symbol: { domain: spec.parts, legend: false },
  };
}

/** A value in two directions: a cell a pair, with its number, a panel a condition. */
function heatmap(spec: FigureSpec): Plot.PlotOptions {
  const { names, options } = facets(spec);
  const fx = names.length > 0 ? { fx: "facet" } : {};
  const ys = distinct(spec.rows, "y");
  const most = spec.most ?? 1;
  const panels = Math.max(1, names.length);
  const longest = Math.max(...ys.map((name) => name.length), 4);
  return {
    ...base(spec, panels > 1 ? FULL_WIDTH_PX : COLUMN_WIDTH_PX, 90 + 30 * ys.length),
    ...options,
    color: { type: "linear", domain: [0, most], range: ["#f2f6fb", "#0b4f8a"], legend: false },
    x: { domain: spec.order, label: spec.x, tickRotate: spec.order.length * panels > 16 ? -45 : 0 },
    y: { domain: [...ys].reverse(), label: spec.y },
    marginLeft: 24 + 7 * longest,
    marginBottom: 48,
    marks: [
      Plot.cell(spec.rows, { x: "x", y: "y", ...fx, fill: "value", inset: 0.5 }),
      // Dark letters on light cells, light ones on dark.
      ...[true, false].map((light) =>
        Plot.text(
          spec.rows.filter((row) => Number(row["value"]) < most / 2 === light),
          { x: "x", y: "y", ...fx, text: "letter", fill: light ? "#1a1a1a" : "#ffffff" },
        ),
      ),
    ],
  };
}

/** What was asked for by what was recognised: the first at the top left, so that what is right lies on the way down. */
function confusionMatrix(spec: FigureSpec): Plot.PlotOptions {
  const longest = Math.max(...spec.order.map((name) => name.length), 4);
  const slanted = 20 + 4.6 * longest;
  const cells = 34 * spec.order.length;
  return {
    ...heatmap(spec),
    width: Math.max(COLUMN_WIDTH_PX, 60 + 7 * longest + 1.2 * cells),
    height: 30 + slanted + distinct(spec.rows, "y").length * 34,
    x: { domain: spec.order, label: spec.x, tickRotate: -40 },
    y: { domain: distinct(spec.rows, "y"), label: spec.y },
    marginLeft: 34 + 7 * longest,
    marginBottom: slanted,
  };
}

/** Dots in a plane, a colour and a shape a part. */
function scatterPlot(spec: FigureSpec): Plot.PlotOptions {
  return {
    ...base(spec, COLUMN_WIDTH_PX, 300),
    x: { label: spec.x, nice: true, grid: true },
    y: { label: spec.y, nice: true, grid: true },
    marks: [Plot.dot(spec.rows, { x: "x", y: "y", stroke: "part", symbol: "part", r: 2.4, strokeOpacity: 0.7 })],
    symbol: { domain: spec.parts, legend: false },
  };
}

const KINDS = {
  strip: stripPlot,
  grid: outcomeGrid,
  lines: linePlot,
  bars: stackedBars,
  curve: curvePlot,
  growth: logLogPlot,
  heat: heatmap,
  confusion: confusionMatrix,
  cloud: scatterPlot,
};

/** The key below a figure: words beside patches, as many on a line as there is room for. */
function legend(spec: FigureSpec, width: number): { parts: string[]; height: number } {
  if (spec.kind === "strip" || spec.parts.length < 2) return { parts: [], height: 0 };
  const items: string[] = [];
  let x = 8;
  let y = 12;
  spec.parts.forEach((part, k) => {
    // Some 6.6 pixels a letter of this font.
    const room = 24 + 6.8 * part.length;
    if (x + room > width && x > 8) [x, y] = [8, y + 16];
    const text = document.createElement("i");
    text.textContent = part;
    items.push(
      `<rect x="${x}" y="${y - 9}" width="10" height="10" fill="${COLORS[k % COLORS.length]}"/>` +
        `<text x="${x + 14}" y="${y}" text-anchor="start">${text.innerHTML}</text>`,
    );
    x += room;
  });
  return { parts: items, height: y + 8 };
}

/** The SVG of a figure; its colours for words and lines are those of where it is put. */
export function figure(json: string): string {
  const spec = JSON.parse(json) as FigureSpec;
  const options = KINDS[spec.kind](spec);
  const svg = Plot.plot(options) as unknown as Element;
  // Names of marks are for whoever draws; a reader has the figure's own.
  const drawn = svg.innerHTML.replace(/<style>[\s\S]*?<\/style>/, "").replace(/ aria-[a-z]+="[^"]*"/g, "");
  const width = options.width ?? COLUMN_WIDTH_PX;
  const height = Number(svg.getAttribute("height"));
  const key = legend(spec, width);
  const total = height + key.height;
  return (
    `<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 ${width} ${total}" width="${width}" height="${total}" ` +
    `font-family="${FONT}" font-size="11" fill="currentColor">` +
    `<svg width="${width}" height="${height}" viewBox="0 0 ${width} ${height}" font-family="${FONT}" font-size="11" ` +
    `text-anchor="middle" fill="currentColor" overflow="visible">${drawn}</svg>` +
    `<g transform="translate(0,${height})">${key.parts.join("")}</g></svg>`
  );
}

(globalThis as Record<string, unknown>)["figure"] = figure;
