// The rows of the drawer of signals, one below the other over the same stretch of time.

import { drawBand, type BandStyle } from "./bands";
import { element, setClass, setText } from "./dom";
import { EmgColumns } from "./emgColumns";
import { Raster, drawTraces, plotColors, type PlotView } from "./emgPlots";
import type { DisplayFrame, PageContent, Signals } from "./generated/types";
import { percent } from "./intentView";
import { PLOT_LEFT_PX, LineChart, PLOT_RIGHT_PX } from "./lineChart";
import { objectName } from "./objects";
import { gestureTitle } from "./protocol";
import { jointDisplayName } from "./jointNames";
import { SignalHistory } from "./signalHistory";
import { strings } from "./strings";
import { MAX_BACK_SECS, WINDOW_SECS } from "./timeWindow";
import { fixed } from "./numbers";

const words = strings.signals;
/** Frames, and messages of signals, a second; a little more than come. */
const FRAME_HZ = 62;
const SIGNAL_HZ = 20;
const KEPT_SECS = MAX_BACK_SECS + WINDOW_SECS + 2;
/** Streams of more channels are a raster; as on the page of EMG. */
const MAX_TRACES = 16;
/** As on the page of EMG. */
const MIN_RANGE = 4;
/** Fewer missing samples are the jitter of messages, seconds. */
const GAP_SECS = 0.02;
const RASTER_RANGE_FRACTION = 0.5;
/** Series of a frame; the gaze has two, and joints follow. */
const [GESTURE, MEANT, GAZE, FIRST_JOINT] = [0, 1, 2, 4];
const DEGREES = 180 / Math.PI;

interface JointRange {
  name: string;
  /** rad; none where it turns without end. */
  limits: [number, number] | null;
}

export class SignalRows {
  readonly nodes: HTMLElement[];
  private readonly emg = new EmgColumns(WINDOW_SECS, MAX_BACK_SECS + 2);
  private readonly raster = new Raster();
  private readonly emgCanvas = element("canvas");
  private readonly channels = element("ol", "lanes");
  private readonly emgRow = element("div", "signalrow emg");
  private readonly none = element("p", "note", words.noEmg);
  private readonly classes = new LineChart({ label: words.classes, range: [0, 1], ticks: { at: [0, 0.5, 1], text: percent } });
  private readonly gestureCanvas = element("canvas");
  private readonly intentCanvas = element("canvas");
  private readonly gaze = new LineChart({ label: words.gaze });
  private readonly joints = new LineChart({
    label: words.joints,
    range: [-0.04, 1.04],
    ticks: { at: [0, 1], text: (share) => (share === 0 ? words.lowLimit : words.highLimit) },
    timeAxis: true,
  });
  private readonly frames = new SignalHistory(KEPT_SECS * FRAME_HZ);
  private readonly recognized = new SignalHistory(KEPT_SECS * SIGNAL_HZ);
  private gestures: string[] = [];
  private classNames: string[] = [];
  private ranges: JointRange[] = [];
  private tableHeight = 0;
  private emgUntil = 0;
  /** When the rows began, seconds, and how many were taken. */
  private emgBegan: number | undefined;
  private emgRows = 0;
  private lastRow: number[] | undefined;
  private shown: PlotView | null = null;
  private readonly dark = window.matchMedia("(prefers-color-scheme: dark)");

  constructor() {
    const band = (label: string, canvas: HTMLCanvasElement) => {
      canvas.setAttribute("role", "img");
      canvas.setAttribute("aria-label", label);
      return element("div", "signalrow band", element("h4", "", label), element("div", "holder", canvas));
    };
    this.emgCanvas.setAttribute("role", "img");
    this.emgCanvas.setAttribute("aria-label", words.emg);
    this.emgRow.append(element("h4", "", words.emg), element("div", "holder", this.channels, this.emgCanvas));
    this.emgRow.hidden = this.classes.root.hidden = true;
    this.joints.root.classList.add("joints");
    for (const canvas of [this.emgCanvas, this.gestureCanvas, this.intentCanvas]) {
      canvas.style.left = `${PLOT_LEFT_PX}px`;
      canvas.style.width = `calc(100% - ${PLOT_LEFT_PX + PLOT_RIGHT_PX}px)`;
    }
    this.nodes = [
      this.none,
      this.emgRow,
      this.classes.root,
      band(words.gesture, this.gestureCanvas),
      band(words.meant, this.intentCanvas),
      this.gaze.root,
      this.joints.root,
    ];
  }

  clear(): void {
    this.emg.clear();
    this.frames.clear();
    this.recognized.clear();
    this.emgUntil = this.emgRows = 0;
    this.emgBegan = this.lastRow = undefined;
    this.shown = null;
  }

  show({ arm, scene }: PageContent): void {
    this.tableHeight = scene.table_height;
    this.ranges = arm.arm.map((k) => {
      const joint = arm.joints[k];
      return { name: joint ? jointDisplayName(arm, joint.name) : "", limits: joint && joint.kind !== "continuous" ? [joint.limits.lower, joint.limits.upper] : null };
    });
  }

  frame(frame: DisplayFrame): void {
    const { target, hand } = frame;
    let gesture = this.gestures.indexOf(frame.recognised);
    if (gesture < 0) gesture = this.gestures.push(frame.recognised) - 1;
    const meant = hand.holds === null ? (target.object === null ? 0 : target.object + 1) : target.place ? -1 : 0;
    const looked = this.gazeOnTable(frame) ?? this.frames.at(Infinity).slice(GAZE, FIRST_JOINT);
    const joints = this.ranges.map(({ limits }, k) => rangeFraction(frame.joints[k] ?? 0, limits));
    // A lock is a half: names stay whole numbers.
    this.frames.push(frame.time / 1000, [gesture, meant === 0 ? 0 : meant + (target.locked ? 0.5 : 0), looked[0] ?? 0, looked[1] ?? 0, ...joints]);
  }

  signals(signals: Signals): void {
    const { recognition } = signals;
    this.none.hidden = signals.emg_rate_hz > 0;
    this.emgRow.hidden = this.classes.root.hidden = !this.none.hidden;
    this.emg.push(this.fillGaps(signals), signals.emg_row_hz);
    this.emgUntil = signals.time / 1000;
    if (recognition) {
      this.classNames = recognition.gestures.map(gestureTitle);
      if (recognition.posterior.length > 0) this.recognized.push(this.emgUntil, recognition.posterior);
    }
    if (this.emg.channels > 0) this.measure(signals.lights);
  }

  draw(from: number, to: number): void {
    const inks = plotColors(this.emgRow);
    const axis = { from, to, inks, dark: this.dark.matches };
    this.drawEmg(to, inks);
    if (!this.classes.root.hidden) this.classes.draw(this.recognized.between(from, to), this.classNames, axis);
    const stretch = this.frames.between(from, to);
    drawBand(this.gestureCanvas, stretch, GESTURE, { ...axis, look: (value) => this.gestureLook(value) });
    drawBand(this.intentCanvas, stretch, MEANT, { ...axis, look: intentStyle });
    this.gaze.draw({ times: stretch.times, series: stretch.series.slice(GAZE, FIRST_JOINT) }, [words.gazeAhead, words.gazeSide], axis);
    this.joints.draw({ times: stretch.times, series: stretch.series.slice(FIRST_JOINT) }, this.ranges.map(({ name }) => name), axis);
  }

  /** Writes the values of one instant beside the names. */
  showValues(time: number): void {
    const values = this.frames.at(time);
    const centimetres = (metres: number) => `${Math.round(100 * metres) || 0} cm`;
    this.gaze.showValues(values.slice(GAZE, FIRST_JOINT).map(centimetres));
    this.joints.showValues(values.slice(FIRST_JOINT).map((share, k) => angleText(share, this.ranges[k]?.limits ?? null)));
    this.classes.showValues(this.recognized.at(time).map(percent));
  }

  /** Where the pictures lie on the screen, all of them alike. */
  plotArea(): { left: number; width: number } {
    const bounds = this.gestureCanvas.getBoundingClientRect();
    return { left: bounds.left, width: bounds.width };
  }

  private gestureLook(value: number): BandStyle {
    const name = this.gestures[value] ?? "no_motion";
    return { text: gestureTitle(name), strong: name !== "no_motion" };
  }

  private drawEmg(to: number, inks: ReturnType<typeof plotColors>): void {
    const { emg, shown } = this;
    if (!shown || emg.channels === 0) return;
    // The newest column is of the last message; the axis goes on until the next.
    const edge = emg.columnCount + (to - this.emgUntil) * (emg.count / WINDOW_SECS);
    if (emg.channels > MAX_TRACES) this.raster.draw(this.emgCanvas, { ...shown, edge, range: RASTER_RANGE_FRACTION * shown.range }, inks);
    else drawTraces(this.emgCanvas, { ...shown, edge }, [...Array(emg.channels).keys()], inks);
  }

  /** The rows of a message so that columns, which are counted, keep step with time: a gap is a flat line, and of what came too quickly,
   * since the trial cannot keep up with the armband, the oldest is left out. */
  private fillGaps({ emg, emg_row_hz, time }: Signals): number[][] {
    const still = this.lastRow ?? emg[0];
    if (!still) return emg;
    this.lastRow = emg[emg.length - 1] ?? still;
    this.emgBegan ??= time / 1000 - emg.length / emg_row_hz;
    const missing = Math.round((time / 1000 - this.emgBegan) * emg_row_hz) - this.emgRows - emg.length;
    let rows = emg;
    if (missing > GAP_SECS * emg_row_hz) rows = [...Array<number[]>(Math.min(missing, KEPT_SECS * emg_row_hz)).fill(still), ...emg];
    else if (-missing > GAP_SECS * emg_row_hz) rows = emg.slice(-missing);
    this.emgRows += rows.length;
    return rows;
  }

  /** Levels and a common scale; a bad channel does not make the others flat. */
  private measure(lights: string[]): void {
    const { emg } = this;
    const all = [...Array(emg.channels).keys()];
    const levels = all.map((channel) => emg.baseline(channel));
    const peaks = levels.map((level, channel) => emg.peak(channel, level));
    const sound = peaks.filter((_, channel) => lights[channel] !== "red");
    this.shown = { columns: emg, edge: 0, range: Math.max(MIN_RANGE, ...(sound.length > 0 ? sound : peaks)), baselines: levels, selected: -1 };
    setClass(this.emgRow, "many", emg.channels > MAX_TRACES);
    const labelled = emg.channels > MAX_TRACES ? [0, emg.channels - 1] : all;
    while (this.channels.children.length > labelled.length) this.channels.lastElementChild?.remove();
    while (this.channels.children.length < labelled.length) this.channels.append(element("li", "", element("i", "light"), element("span")));
    labelled.forEach((channel, place) => {
      const [light, text] = this.channels.children[place]?.children ?? [];
      if (!light || !text) return;
      setText(text, String(channel + 1));
      for (const name of ["green", "amber", "red"]) setClass(light, name, lights[channel] === name);
    });
  }

  /** Where the gaze meets the table, metres ahead and to the left. */
  private gazeOnTable({ gaze }: DisplayFrame): [number, number] | null {
    if (!gaze?.valid) return null;
    const [dx, dy, dz] = gaze.direction;
    const way = (this.tableHeight - gaze.origin[2]) / dz;
    return Number.isFinite(way) && way > 0 ? [gaze.origin[0] + way * dx, gaze.origin[1] + way * dy] : null;
  }
}

function intentStyle(value: number): BandStyle {
  const locked = value !== Math.floor(value);
  const whole = Math.floor(value);
  if (whole === 0) return { text: "", strong: false, empty: true };
  const name = whole < 0 ? words.place : objectName(whole - 1);
  return { text: locked ? words.locked(name) : name, strong: locked };
}

/** From the lower limit, 0, to the upper one, 1; where there is none, of a whole turn. */
function rangeFraction(angle: number, limits: [number, number] | null): number {
  const [low, high] = limits ?? [-Math.PI, Math.PI];
  return (angle - low) / Math.max(high - low, 1e-9);
}

function angleText(share: number, limits: [number, number] | null): string {
  const [low, high] = limits ?? [-Math.PI, Math.PI];
  const degrees = (value: number) => fixed(value * DEGREES);
  const range = limits ? ` (${degrees(low)} to ${degrees(high)})` : "";
  return `${degrees(low + share * (high - low))}°${range}`;
}
