// The live view of EMG: channels with their lights, the spectrum of one of them, and what the model makes of the stream. It
// stands on a page of its own, and wherever its root is put.

import "./emgview.css";
import { button, element, setClass, setText, setWidth } from "./dom";
import { EmgColumns, SPAN_SECS } from "./emgColumns";
import { Raster, drawSpectrum, drawTraces, plotColors, type PlotView } from "./emgPlots";
import { strings } from "./strings";
import { medianFrequency, powerSpectrum, type Spectrum } from "./spectrum";
import { capitalize, gestureTitle } from "./protocol";
import type { Recognition, Signals } from "./generated/types";
import { fixed } from "./numbers";

/** Streams of more channels are a raster. */
const MAX_TRACES = 16;
/** Columns of the list of channels beside a raster. */
const LIST_COLUMNS = 8;
/** Widest deviation that fills a lane, at least this many units of the stream: noise is not blown up. */
const MIN_RANGE = 4;
/** Peaks fill a lane; a cell of a raster is a mean and has less. */
const RASTER_RANGE_FRACTION = 0.5;
/** Length of the signal that a spectrum is of, seconds. */
const SPECTRUM_SECS = 1;
/** The picture runs this far behind the newest message, so that it scrolls evenly between two of them, seconds. */
const LAG_SECS = 0.15;
/** Narrower than this, parts stand below each other, CSS pixels. */
const NARROW_WIDTH_PX = 900;
/** From picture to picture, ms. */
const DRAW_INTERVAL_MS = 45;

const words = strings.emg;

export class EmgView {
  readonly root = element("section", "emgview");
  readonly columns = new EmgColumns();
  selected = 0;
  frozen = false;
  /** The column at the right edge of the picture. */
  edge = 0;
  private readonly verdict = element("p", "verdict");
  private readonly freeze = button(words.freeze, () => this.setFrozen(!this.frozen));
  private readonly list = element("ul", "channels");
  private readonly canvas = element("canvas");
  private readonly scale = element("p", "small");
  private readonly trace = element("canvas", "one");
  private readonly inForce = element("strong", "inforce");
  private readonly newest = element("p", "small");
  private readonly effort = element("div", "fill");
  private readonly effortText = element("span", "percent");
  private readonly bars = element("ul", "bars");
  private readonly inertial = element("p", "small inertial");
  private readonly spectrumTitle = element("h2");
  private readonly spectrum = element("canvas", "spectrum");
  private readonly spectrumText = element("p", "small");
  private readonly raster = new Raster();
  private recent: number[][] = [];
  /** Of dense streams, by channel. */
  private readonly spectra = new Map<number, Spectrum>();
  private signals: Signals | null = null;
  private gestures = "";
  private shown: PlotView | null = null;
  private drawn = 0;
  private due = true;

  constructor() {
    const { root, list } = this;
    this.verdict.setAttribute("role", "status");
    this.freeze.title = words.freezeTitle;
    // Models of many gestures scroll.
    this.bars.tabIndex = 0;
    this.bars.setAttribute("aria-label", words.probabilitiesLabel);
    list.tabIndex = 0;
    list.setAttribute("role", "listbox");
    list.setAttribute("aria-label", words.channelsLabel);
    list.addEventListener("click", ({ target }) => {
      const place = [...list.children].findIndex((item) => item.contains(target as Node));
      if (place >= 0) this.select(place);
    });
    for (const [canvas, label] of [[this.canvas, words.signalsLabel], [this.trace, words.signalLabel], [this.spectrum, words.spectrumLabel]] as const) {
      canvas.setAttribute("role", "img");
      canvas.setAttribute("aria-label", label);
    }
    const pane = (classes: string, ...children: HTMLElement[]) => element("section", `part ${classes}`, ...children);
    const effort = element("div", "effort", element("span", "", words.effort), element("div", "bar", this.effort), this.effortText);
    root.append(
      element("div", "emgbar", this.verdict, this.freeze),
      pane("signalpart", element("h2", "", words.channels(SPAN_SECS)), element("div", "lanes", list, element("div", "pictures", this.canvas, this.trace)), this.scale, this.inertial),
      pane("gesturepart", element("h2", "", words.inForceTitle), this.inForce, this.newest, effort, element("h2", "", words.probabilities), this.bars),
      pane("spectrumpart", this.spectrumTitle, this.spectrum, this.spectrumText),
    );
    root.addEventListener("keydown", (event) => {
      if (this.key(event)) event.preventDefault();
    });
    new ResizeObserver(() => setClass(root, "narrow", root.clientWidth < NARROW_WIDTH_PX)).observe(root);
  }

  /** Another trial: what was shown is void. */
  clear(): void {
    this.columns.clear();
    this.recent = [];
    this.spectra.clear();
    this.edge = 0;
  }

  /** Takes a message; what it says is on display until the next. */
  setSignals(signals: Signals): void {
    if (this.frozen) return;
    this.signals = signals;
    this.columns.push(signals.emg, signals.emg_row_hz);
    if (signals.emg.length > 0 && signals.emg[0]?.length !== this.recent[0]?.length) this.recent = [];
    this.recent.push(...signals.emg);
    this.recent.splice(0, this.recent.length - Math.ceil(SPECTRUM_SECS * signals.emg_row_hz));
    for (const { channel, step_hz, density } of signals.spectra) this.spectra.set(channel, { stepHz: step_hz, density });
    if (this.selected >= this.columns.channels) this.selected = 0;
    this.measure();
    this.showChannels(signals);
    this.showInertial(signals);
    if (signals.recognition) this.showRecognition(signals.recognition);
    this.showSpectrum();
  }

  /** A key that was pressed; true if it meant something. */
  key({ key, ctrlKey, metaKey, altKey }: KeyboardEvent): boolean {
    if (ctrlKey || metaKey || altKey) return false;
    const down = this.columns.channels > MAX_TRACES ? LIST_COLUMNS : 1;
    const steps: Record<string, number> = { ArrowDown: down, ArrowUp: -down, ArrowRight: 1, ArrowLeft: -1, Home: -Infinity, End: Infinity };
    const step = steps[key];
    if (step !== undefined) this.select(Math.min(Math.max(this.selected + step, 0), this.columns.channels - 1));
    else if (key.toLowerCase() === "f") this.setFrozen(!this.frozen);
    else return false;
    return true;
  }

  select(channel: number): void {
    this.selected = Math.max(channel, 0);
    if (this.shown) this.shown.selected = this.selected;
    if (this.signals) this.showChannels(this.signals);
    this.showSpectrum();
    this.list.children[this.selected]?.scrollIntoView({ block: "nearest" });
    this.due = true;
  }

  /** Draws what has changed; call it with every picture of the browser. */
  draw(wall: number): void {
    const due = this.due || wall - this.drawn >= DRAW_INTERVAL_MS;
    if (!this.shown || this.columns.columnCount === 0 || !due) return;
    this.due = false;
    const seconds = Math.min((wall - this.drawn) / 1000, 0.5);
    this.drawn = wall;
    const rate = this.columns.count / SPAN_SECS;
    const behind = this.columns.columnCount - this.edge - LAG_SECS * rate;
    // Time goes on evenly; what it lags behind too much or too little is made up for bit by bit.
    if (!this.frozen) this.edge += seconds * rate + 0.1 * behind;
    if (Math.abs(behind) > rate || this.edge > this.columns.columnCount) this.edge = Math.max(this.columns.columnCount - LAG_SECS * rate, 0);
    const shown = { ...this.shown, edge: this.edge };
    const inks = plotColors(this.root);
    if (this.columns.channels > MAX_TRACES) {
      this.raster.draw(this.canvas, { ...shown, range: RASTER_RANGE_FRACTION * shown.range }, inks);
      drawTraces(this.trace, shown, [this.selected], inks);
    } else {
      drawTraces(this.canvas, shown, [...Array(this.columns.channels).keys()], inks);
    }
  }

  private setFrozen(frozen: boolean): void {
    this.frozen = frozen;
    setText(this.freeze, frozen ? words.goOn : words.freeze);
    setClass(this.freeze, "primary", frozen);
    setClass(this.root, "frozen", frozen);
  }

  /** Levels and the common scale. A bad channel does not make the others flat. */
  private measure(): void {
    const { columns, signals } = this;
    const levels = Array.from({ length: columns.channels }, (_, channel) => columns.baseline(channel));
    const peaks = levels.map((level, channel) => columns.peak(channel, level));
    const sound = peaks.filter((_, channel) => signals?.lights[channel] !== "red");
    const range = Math.max(MIN_RANGE, ...(sound.length > 0 ? sound : peaks));
    this.shown = { columns, edge: this.edge, range, baselines: levels, selected: this.selected };
    const units = (value: number) => words.units(Number(value.toPrecision(2)));
    const many = columns.channels > MAX_TRACES;
    setText(this.scale, many ? words.shade(units(RASTER_RANGE_FRACTION * range), this.selected + 1, units(range)) : words.lane(units(range)));
  }

  private showChannels({ lights, faults, emg_lost_share, emg_rate_hz, recognition }: Signals): void {
    const { list, columns } = this;
    const many = columns.channels > MAX_TRACES;
    setClass(this.root, "many", many);
    while (list.children.length > columns.channels) list.lastElementChild?.remove();
    while (list.children.length < columns.channels) {
      const item = element("li", "", element("span", "light"), element("span", "number", String(list.children.length + 1)), element("span", "word"));
      item.setAttribute("role", "option");
      item.id = `emg-channel-${list.children.length + 1}`;
      list.append(item);
    }
    list.setAttribute("aria-activedescendant", `emg-channel-${this.selected + 1}`);
    [...list.children].forEach((item, channel) => {
      const light = lights[channel] ?? "";
      const fault = faults[channel] ?? null;
      const word = fault ? shortGestureName(fault) : (words.lights[light] ?? words.noVerdict);
      // A grid has room for a mark only; the name of the option says the same in words.
      setText(item.children[2] as HTMLElement, !many ? word : light === "red" ? "!!" : light === "amber" ? "!" : "");
      const label = words.channel(channel + 1, fault ? `${word}, ${words.lights[light] ?? light}` : word);
      if (item.getAttribute("aria-label") !== label) item.setAttribute("aria-label", label);
      for (const name of ["green", "amber", "red"]) setClass(item.children[0] as HTMLElement, name, light === name);
      setClass(item as HTMLElement, "selected", channel === this.selected);
      item.setAttribute("aria-selected", String(channel === this.selected));
    });
    const lost = emg_lost_share > 0 ? words.lost(fixed(100 * emg_lost_share, 1)) : "";
    const stream = words.stream(columns.channels, fixed(emg_rate_hz), lost);
    const dead = recognition?.fault ?? null;
    const waits = recognition && !recognition.armed ? words.waits : "";
    setText(this.verdict, dead ? words.stopped(dead, waits) : `${stream}. ${faultText(lights, faults)}${waits}`);
    setClass(this.verdict, "bad", dead !== null || lights.includes("red"));
    setClass(this.verdict, "warn", dead === null && !lights.includes("red") && (lights.includes("amber") || waits !== ""));
  }

  /** Newest values of an inertial measurement unit, by name. */
  private showInertial({ inertial }: Signals): void {
    const said = inertial.map(({ name, unit, value }) => `${name.replaceAll("_", " ")} ${value === null ? words.nothing : fixed(value, 2)}${value === null || unit === "1" ? "" : ` ${unit}`}`);
    this.inertial.hidden = said.length === 0;
    setText(this.inertial, words.inertial(said.join(", ")));
  }

  private showRecognition({ gestures, posterior, in_force, window_class, effort, fault }: Recognition): void {
    setText(this.inForce, gestureTitle(in_force));
    const most = Math.max(...posterior);
    const likeliest = posterior.length > 0 && most > 0 ? posterior.indexOf(most) : -1;
    const name = gestures[likeliest];
    const percent = (share: number) => `${Math.round(100 * share)} %`;
    setText(this.newest, fault || name === undefined ? words.noWindow : words.newest(gestureTitle(name), percent(most), window_class === null));
    setWidth(this.effort, effort);
    setText(this.effortText, percent(effort));
    if (this.gestures !== gestures.join()) {
      this.gestures = gestures.join();
      this.bars.replaceChildren(
        ...gestures.map((gesture) => element("li", "", element("span", "name", gestureTitle(gesture)), element("div", "bar", element("div", "fill")), element("span", "percent"), element("span", "mark"))),
      );
    }
    [...this.bars.children].forEach((item, k) => {
      const [, bar, text, mark] = item.children as unknown as HTMLElement[];
      setWidth(bar?.firstElementChild as HTMLElement, posterior[k] ?? 0);
      setText(text as HTMLElement, posterior.length > 0 ? percent(posterior[k] ?? 0) : "–");
      setText(mark as HTMLElement, gestures[k] === in_force ? words.inForce : "");
      setClass(item as HTMLElement, "now", gestures[k] === in_force);
    });
  }

  private showSpectrum(): void {
    const { signals, selected } = this;
    if (!signals) return;
    setText(this.spectrumTitle, words.spectrum(selected + 1));
    const fault = signals.faults[selected];
    const finding = fault ? words.finding(selected + 1, words.faults[fault]?.long ?? fault.replaceAll("_", " ")) : "";
    // Lowest and highest values are no samples: the program takes their spectra.
    const whole = Math.abs(signals.emg_row_hz - signals.emg_rate_hz) < 1;
    const spectrum = whole ? powerSpectrum(this.recent.map((row) => row[selected] ?? 0), signals.emg_rate_hz) : (this.spectra.get(selected) ?? null);
    drawSpectrum(this.spectrum, spectrum, plotColors(this.root));
    const median = spectrum && medianFrequency(spectrum);
    const figures = median ? words.median(fixed(median), fixed(spectrum.stepHz, 1)) : words.noSignal;
    setText(this.spectrumText, (whole || spectrum ? figures : words.spectrumComes) + finding);
  }
}

function shortGestureName(fault: string): string {
  return words.faults[fault]?.short ?? fault.replaceAll("_", " ");
}

/** What is wrong, channel by channel; of many channels those with the same finding together. */
function faultText(lights: string[], faults: (string | null)[]): string {
  if (lights.length === 0) return words.noVerdicts;
  const found = new Map<string, number[]>();
  faults.forEach((fault, channel) => {
    if (fault) found.set(fault, [...(found.get(fault) ?? []), channel + 1]);
  });
  if (found.size === 0) return words.allGood;
  return [...found].map(([fault, channels]) => {
    const some = channels.length > 8 ? words.more(channels.slice(0, 8).join(", "), channels.length - 8) : channels.join(", ");
    return words.found(capitalize(shortGestureName(fault)), some, channels.length > 1);
  }).join(" ");
}
