// A plot of signals over time: rows one above the other on one time axis, with spans behind them and a cursor that can be
// dragged. It knows nothing of what the signals are. Times are seconds.

import "uplot/dist/uPlot.min.css";
import "./signalplot.css";
import uPlot from "uplot";
import { element, setClass, setText } from "./dom";
import { MARGIN, SPAN_ALPHA, axisLabels, numberText, rowPosition, spanKinds, valueAt, type SignalData, type SignalLine } from "./signalData";
import { fixed } from "./numbers";

/** Room for what stands at the left, CSS pixels: the same for all plots, so that they lie on one time axis. */
const PLOT_LEFT_PX = 48;
const PLOT_RIGHT_PX = 12;
const AXIS_HEIGHT = 22;
const FONT = "11px system-ui, sans-serif";

export class SignalPlot {
  readonly root = element("div", "signalplot");
  /** Names, colours and values at the cursor; choosing one shows or hides its line. */
  readonly legend = element("div", "signallegend");
  private readonly plot: uPlot;
  private readonly playhead = element("i", "playhead");
  /** Of each line what its value is written to; none for lines without a name. */
  private readonly figures: (HTMLElement | null)[] = [];
  private readonly resized = new ResizeObserver(() => this.fit());
  private readonly dark = window.matchMedia("(prefers-color-scheme: dark)");
  private readonly updateColors = () => this.plot.redraw(false);
  private window: [number, number] = [0, 1];
  private zero = 0;
  private time = 0;

  /** `seek` is told where the cursor was dragged to. */
  constructor(
    readonly data: SignalData,
    label: string,
    private readonly seek: (time: number) => void,
  ) {
    const lines = data.lines.map((line) => line.values.map((value) => (value === null ? null : rowPosition(data, line, value))));
    this.plot = new uPlot(this.options(), [data.times, ...lines] as uPlot.AlignedData, this.root);
    this.root.setAttribute("role", "img");
    this.root.setAttribute("aria-label", label);
    this.plot.over.append(this.playhead);
    this.listen(this.plot.over);
    this.legend.append(...data.lines.flatMap((line, k) => this.entry(line, k)));
    // Where there are lines, spans have their names in the plot.
    if (data.lines.length === 0) {
      this.legend.append(...spanKinds(data).map(({ label, color }) => element("span", "entry", swatch(color, "block"), label)));
    }
    this.resized.observe(this.root);
    this.dark.addEventListener("change", this.updateColors);
  }

  /** Shows `from` to `to`; the axis counts from `zero`. */
  show(from: number, to: number, zero: number): void {
    if (from === this.window[0] && to === this.window[1] && zero === this.zero) return;
    this.window = [from, Math.max(to, from + 1e-3)];
    this.zero = zero;
    this.plot.setScale("x", { min: from, max: to });
    this.moveTo(this.time);
  }

  /** Puts the cursor there. */
  moveTo(time: number): void {
    this.time = time;
    const [from, to] = this.window;
    const inside = time >= from && time <= to;
    setClass(this.playhead, "away", !inside);
    if (inside) this.playhead.style.transform = `translateX(${this.plot.valToPos(time, "x")}px)`;
    this.data.lines.forEach((line, k) => {
      const value = valueAt(this.data.times, line.values, time);
      const figure = this.figures[k];
      if (figure) setText(figure, value === null ? "–" : `${fixed(value, line.digits).replace("-", "−")}${line.unit}`);
    });
  }

  /** Whether the line of that number is to be seen. */
  isLineShown(line: number): boolean {
    return this.plot.series[line + 1]?.show ?? false;
  }

  destroy(): void {
    this.resized.disconnect();
    this.dark.removeEventListener("change", this.updateColors);
    this.plot.destroy();
    this.root.remove();
  }

  private fit(): void {
    const width = this.root.clientWidth;
    if (width === 0 || width === this.plot.width) return;
    this.plot.setSize({ width, height: this.height() });
    this.moveTo(this.time);
  }

  private height(): number {
    const { rows, rowHeight } = this.data;
    return rows.length * rowHeight + AXIS_HEIGHT + 4;
  }

  private entry(line: SignalLine, k: number): HTMLElement[] {
    this.figures.push(line.isSecondary ? null : element("span", "value"));
    if (line.isSecondary) return [];
    const node = element("button", "entry", swatch(line.color, line.dashed ? "dashed" : ""), element("span", "", line.label), this.figures[k]);
    node.type = "button";
    node.setAttribute("aria-pressed", "true");
    node.addEventListener("click", () => {
      const show = !this.isLineShown(k);
      this.data.lines.forEach((other, n) => {
        if (n === k || (other.isSecondary && other.row === line.row)) this.plot.setSeries(n + 1, { show });
      });
      node.setAttribute("aria-pressed", String(show));
    });
    return [node];
  }

  /** The pointer takes the cursor along for as long as it is pressed. */
  private listen(over: HTMLElement): void {
    const take = (event: PointerEvent) => {
      const [from, to] = this.window;
      const time = this.plot.posToVal(event.clientX - over.getBoundingClientRect().left, "x");
      this.seek(Math.min(Math.max(time, from), to));
    };
    over.addEventListener("pointerdown", (event) => {
      if (event.button !== 0) return;
      over.setPointerCapture(event.pointerId);
      take(event);
    });
    over.addEventListener("pointermove", (event) => {
      if (over.hasPointerCapture(event.pointerId)) take(event);
    });
  }

  private options(): uPlot.Options {
    const { rows, lines } = this.data;
    const colour = (name: string) => () => getComputedStyle(this.root).getPropertyValue(name);
    const levels = axisLabels(this.data);
    return {
      width: 600,
      height: this.height(),
      padding: [4, PLOT_RIGHT_PX, 0, 0],
      legend: { show: false },
      cursor: { show: false },
      scales: { x: { time: false, range: () => this.window }, y: { range: [0, rows.length] } },
      axes: [
        {
          stroke: colour("--soft"),
          font: FONT,
          size: AXIS_HEIGHT,
          gap: 2,
          space: 60,
          grid: { stroke: colour("--line"), width: 1 },
          ticks: { show: false },
          splits: (_, __, from, to, step) => {
            const count = Math.floor((to - this.zero) / step) - Math.ceil((from - this.zero) / step);
            return Array.from({ length: Math.max(count + 1, 0) }, (___, k) => (Math.ceil((from - this.zero) / step) + k) * step + this.zero);
          },
          values: (_, splits) => splits.map((split) => `${numberText(Math.round((split - this.zero) * 1000) / 1000)} s`),
        },
        {
          stroke: colour("--soft"),
          font: FONT,
          size: PLOT_LEFT_PX,
          gap: 4,
          grid: { show: false },
          ticks: { show: false },
          splits: () => levels.map(({ place }) => place),
          values: () => levels.map(({ text }) => text),
        },
      ],
      series: [
        {},
        ...lines.map((line) => ({
          stroke: line.color,
          width: 1.25,
          points: { show: false },
          ...(line.dashed ? { dash: [5, 4] } : {}),
          ...(line.stepped && uPlot.paths.stepped ? { paths: uPlot.paths.stepped({ align: 1 }) } : {}),
        })),
      ],
      hooks: { drawClear: [(plot) => this.paintBehind(plot)], draw: [(plot) => this.drawRowNames(plot)] },
    };
  }

  /** Spans, and the edges of rows. */
  private paintBehind(plot: uPlot): void {
    const { ctx, bbox } = plot;
    ctx.save();
    ctx.beginPath();
    ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
    ctx.clip();
    ctx.globalAlpha = SPAN_ALPHA;
    for (const { from, to, color } of this.data.spans) {
      const [left, right] = [plot.valToPos(from, "x", true), plot.valToPos(to, "x", true)];
      ctx.fillStyle = color;
      ctx.fillRect(left, bbox.top, Math.max(right - left, 1), bbox.height);
    }
    ctx.globalAlpha = 1;
    ctx.strokeStyle = getComputedStyle(this.root).getPropertyValue("--edge");
    ctx.lineWidth = 0.6 * uPlot.pxRatio;
    this.data.rows.forEach((row, k) => {
      if (!row.edges) return;
      for (const share of [MARGIN, 1 - MARGIN]) {
        const y = plot.valToPos(this.data.rows.length - 1 - k + share, "y", true);
        ctx.beginPath();
        ctx.moveTo(bbox.left, y);
        ctx.lineTo(bbox.left + bbox.width, y);
        ctx.stroke();
      }
    });
    ctx.restore();
  }

  /** The names of rows, and of spans that have room for theirs. */
  private drawRowNames(plot: uPlot): void {
    const { ctx, bbox } = plot;
    ctx.save();
    ctx.font = `${10 * uPlot.pxRatio}px system-ui, sans-serif`;
    ctx.fillStyle = getComputedStyle(this.root).getPropertyValue("--ink");
    ctx.textBaseline = "top";
    ctx.textAlign = "left";
    this.data.rows.forEach(({ label, edges }, k) => {
      const top = plot.valToPos(this.data.rows.length - k - MARGIN, "y", true);
      if (edges) ctx.fillText(label, bbox.left + 3 * uPlot.pxRatio, top + 2 * uPlot.pxRatio);
    });
    ctx.textBaseline = "middle";
    for (const { from, to, label } of this.data.spans) {
      const left = Math.max(plot.valToPos(from, "x", true), bbox.left) + 3 * uPlot.pxRatio;
      const right = Math.min(plot.valToPos(to, "x", true), bbox.left + bbox.width);
      if (label && ctx.measureText(label).width < right - left) ctx.fillText(label, left, bbox.top + bbox.height / 2);
    }
    ctx.restore();
  }
}

function swatch(colour: string, kind: string): HTMLElement {
  const node = element("i", `swatch ${kind}`);
  node.style.color = colour;
  return node;
}
