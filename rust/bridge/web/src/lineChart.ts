// Lines over the common time axis, by uPlot, with a list of names and values beside them.

import uPlot from "uplot";
import { element, setText } from "./dom";
import type { PlotColors } from "./emgPlots";
import type { TimeSeries } from "./signalHistory";

/** Where the pictures of all rows begin, CSS pixels from the left: names stand there. */
export const PLOT_LEFT_PX = 58;
/** Where they end, from the right. */
export const PLOT_RIGHT_PX = 6;

/** They differ in brightness as well (Okabe and Ito), and lines beyond the first four are dashed. */
const LIGHT_COLORS = ["#0b6fb8", "#a34700", "#00694e", "#9c3f78", "#17212b", "#0b6fb8", "#a34700", "#00694e", "#9c3f78", "#17212b"];
const DARK_COLORS = ["#6db5f0", "#f0b04a", "#4cc79a", "#f29ac9", "#e8edf2", "#6db5f0", "#f0b04a", "#4cc79a", "#f29ac9", "#e8edf2"];
const SOLID_LINES = 5;

export interface LineChartOptions {
  label: string;
  /** Values at the ends of the axis; found from the data if left out. */
  range?: [number, number];
  /** What stands at the axis, in order of height. */
  ticks?: { at: number[]; text(value: number): string };
  /** The times are written below it. */
  timeAxis?: boolean;
}

export class LineChart {
  readonly root = element("div", "signalrow lines");
  private readonly holder = element("div", "holder");
  private readonly list = element("ul", "values");
  private plot: uPlot | null = null;
  private names = "";
  private dark = false;

  constructor(private readonly options: LineChartOptions) {
    this.root.append(element("h4", "", options.label), this.holder, this.list);
    this.holder.setAttribute("role", "img");
    this.holder.setAttribute("aria-label", options.label);
  }

  /** Draws `stretch` between two times. Other names or colours make another chart. */
  draw(stretch: TimeSeries, names: string[], { from, to, inks, dark }: { from: number; to: number; inks: PlotColors; dark: boolean }): void {
    const [width, height] = [this.holder.clientWidth, this.holder.clientHeight];
    if (width < 2 || height < 2 || names.length === 0) return;
    const known = names.join("\n");
    if (!this.plot || this.names !== known || this.dark !== dark) this.make(names, inks, dark, width, height);
    this.names = known;
    this.dark = dark;
    const { plot } = this;
    if (!plot) return;
    if (plot.width !== width || plot.height !== height) plot.setSize({ width, height });
    plot.batch(() => {
      plot.setData([stretch.times, ...stretch.series.slice(0, names.length)] as unknown as uPlot.AlignedData, false);
      plot.setScale("x", { min: from, max: to });
      if (!this.options.range) plot.setScale("y", valueRange(stretch.series));
    });
  }

  /** What stands beside the names; nothing where there are no values. */
  showValues(values: string[]): void {
    [...this.list.children].forEach((item, k) => {
      if (item.lastElementChild) setText(item.lastElementChild, values[k] ?? "");
    });
  }

  private make(names: string[], inks: PlotColors, dark: boolean, width: number, height: number): void {
    this.plot?.destroy();
    const { range, ticks, timeAxis } = this.options;
    const colours = dark ? DARK_COLORS : LIGHT_COLORS;
    const colour = (k: number) => colours[k % colours.length] ?? inks.ink;
    const dash = (k: number) => (k % colours.length < SOLID_LINES ? [] : [5, 3]);
    const grid = { stroke: inks.line, width: 1 };
    const font = "11px system-ui, sans-serif";
    this.plot = new uPlot(
      {
        width,
        height,
        padding: [4, PLOT_RIGHT_PX, timeAxis ? 0 : 4, 0],
        cursor: { show: false },
        legend: { show: false },
        // uPlot would take the numbers for dates.
        scales: { x: { time: false, auto: false }, y: { auto: false, ...(range ? { range } : {}) } },
        axes: [
          { stroke: inks.muted, grid, font, ticks: { show: false }, size: timeAxis ? 20 : 0, gap: 2, values: (_, at) => (timeAxis ? at.map((time) => `${time} s`) : []) },
          {
            stroke: inks.muted,
            grid,
            font,
            ticks: { show: false },
            size: PLOT_LEFT_PX,
            gap: 4,
            ...(ticks ? { splits: () => ticks.at, values: (_: uPlot, at: number[]) => at.map((value) => ticks.text(value)) } : { space: 22 }),
          },
        ],
        series: [{}, ...names.map((label, k) => ({ label, stroke: colour(k), width: 1.5, dash: dash(k), points: { show: false } }))],
      },
      [[], ...names.map(() => [])] as uPlot.AlignedData,
      this.holder,
    );
    this.list.replaceChildren(
      ...names.map((name, k) => {
        const mark = element("i", dash(k).length > 0 ? "dashed" : "");
        mark.style.borderColor = colour(k);
        return element("li", "", mark, element("span", "", name), element("b"));
      }),
    );
  }
}

/** Lowest and highest of all, a little apart. */
function valueRange(series: Float32Array[]): { min: number; max: number } {
  let [min, max] = [Infinity, -Infinity];
  for (const line of series) for (const value of line) [min, max] = [Math.min(min, value), Math.max(max, value)];
  if (min > max) return { min: 0, max: 1 };
  const margin = Math.max(0.08 * (max - min), 1e-3);
  return { min: min - margin, max: max + margin };
}
