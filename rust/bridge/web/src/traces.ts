// EMG as it comes in: one lane a channel, with its traffic light.

import type { Signals } from "./generated/types";
import { strings } from "./strings";

/** Length of what is shown, seconds. */
const SPAN_SECS = 5;
/** Widest deviation that fills a lane, at least this many units of the stream: noise is not blown up. */
const MIN_RANGE = 4;
/** Height that a label needs, pixels: of lower lanes only some are labelled. */
const LABEL_HEIGHT = 14;
const STATUS_COLORS: Record<string, string> = { green: "#00a37a", amber: "#e08a00", red: "#d0342c" };
const GRAY = "#b6c0c9";
const INK = "#23415c";

export class TraceView {
  private samples: number[][] = [];
  private lights: string[] = [];
  private faults: (string | null)[] = [];
  private rate = 0;

  constructor(private readonly canvas: HTMLCanvasElement) {}

  get channels(): number {
    return this.samples[0]?.length ?? 0;
  }

  clear(): void {
    this.samples = [];
  }

  setSignals(signals: Signals): void {
    this.rate = signals.emg_row_hz;
    this.lights = signals.lights;
    this.faults = signals.faults;
    const channels = signals.emg[0]?.length ?? this.channels;
    if (channels !== this.channels) this.samples = [];
    this.samples.push(...signals.emg);
    const kept = Math.round(SPAN_SECS * this.rate);
    if (this.samples.length > kept) this.samples.splice(0, this.samples.length - kept);
  }

  draw(): void {
    const { canvas } = this;
    const context = canvas.getContext("2d");
    if (!context) return;
    const ratio = window.devicePixelRatio;
    const [width, height] = [canvas.clientWidth, canvas.clientHeight];
    if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
      canvas.width = Math.round(width * ratio);
      canvas.height = Math.round(height * ratio);
    }
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, width, height);
    const lanes = this.channels;
    // Not only cleared: what was drawn before may come back for a picture where nothing else is drawn.
    canvas.style.visibility = lanes === 0 ? "hidden" : "";
    if (lanes === 0) return;
    const lane = height / lanes;
    const labelled = Math.max(Math.ceil(LABEL_HEIGHT / lane), 1);
    const dot = Math.min(5, 0.45 * lane);
    const left = 128;
    const total = Math.max(Math.round(SPAN_SECS * this.rate), 1);
    context.font = "12px system-ui, sans-serif";
    context.textBaseline = "middle";
    for (let channel = 0; channel < lanes; channel++) {
      const middle = (channel + 0.5) * lane;
      context.fillStyle = STATUS_COLORS[this.lights[channel] ?? ""] ?? GRAY;
      context.beginPath();
      context.arc(10, middle, dot, 0, 2 * Math.PI);
      context.fill();
      context.fillStyle = INK;
      if (channel % labelled === 0) context.fillText(strings.experimenter.channel(channel + 1), 22, middle);
      const fault = this.faults[channel];
      if (fault && labelled === 1) {
        context.fillStyle = STATUS_COLORS["red"] ?? INK;
        context.fillText(fault.replaceAll("_", " "), 86, middle);
      }
      this.drawLane(context, channel, { left, width: width - left, middle, half: 0.46 * lane, total });
    }
  }

  private drawLane(
    context: CanvasRenderingContext2D,
    channel: number,
    { left, width, middle, half, total }: { left: number; width: number; middle: number; half: number; total: number },
  ): void {
    context.strokeStyle = "#e3e9ee";
    context.lineWidth = 1;
    context.beginPath();
    context.moveTo(left, middle);
    context.lineTo(left + width, middle);
    context.stroke();
    const values = this.samples.map((sample) => sample[channel] ?? 0);
    const mean = values.reduce((sum, value) => sum + value, 0) / Math.max(values.length, 1);
    const range = values.reduce((most, value) => Math.max(most, Math.abs(value - mean)), MIN_RANGE);
    context.strokeStyle = INK;
    context.beginPath();
    const first = total - values.length;
    // Lowest and highest value of each pixel: nothing is lost at 1 kHz.
    const pixels = Math.max(Math.floor(width), 1);
    for (let pixel = 0; pixel < pixels; pixel++) {
      const from = Math.floor((pixel * total) / pixels) - first;
      const to = Math.max(Math.floor(((pixel + 1) * total) / pixels) - first, from + 1);
      if (from < 0) continue;
      let [low, high] = [Infinity, -Infinity];
      for (let k = from; k < to && k < values.length; k++) {
        const value = values[k] ?? 0;
        [low, high] = [Math.min(low, value), Math.max(high, value)];
      }
      if (low > high) continue;
      const y = (value: number) => middle - ((value - mean) / range) * half;
      context.lineTo(left + pixel, y(high));
      context.lineTo(left + pixel, y(low) + 0.5);
    }
    context.stroke();
  }
}
