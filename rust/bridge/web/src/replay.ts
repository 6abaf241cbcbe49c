// Recorded trials as a laboratory sees them: scenes and signals on one time axis, two trials laid over each other at an event,
// slow motion, pictures, videos, and links to a moment.

import "./theme.css";
import "./workstation.css";
import "./replay.css";
import { CAMERA_KINDS, CAMERA_NAMES, type CameraKind } from "./cameras";
import { button, element, setClass, setText } from "./dom";
import { Recorder, saveAs } from "./videoExport";
import type { TrialEvent, TrialSummary } from "./generated/types";
import { EventList, timeOf } from "./replayEvents";
import { fromQuery, toQuery, type ReplayMoment } from "./replayLink";
import { CanvasPen, SvgPen, drawFigure, sizeOf } from "./replayFigure";
import { ReplayView } from "./replayView";
import { drawErrorText } from "./renderer";
import { strings } from "./strings";
import { fixed } from "./numbers";

const words = strings.replay;

const SPEEDS = [0.1, 0.25, 0.5, 1, 2, 4];
/** A step of the arrow keys, ms. */
const STEP_MS = 100;
/** One step of zooming, and the shortest part of the axis on display, ms. */
const ZOOM_FACTOR = 2;
const MIN_WINDOW_MS = 200;
/** Pixels of a saved PNG a CSS pixel. */
const PNG_SCALE = 2;

const pageRoot = document.getElementById("desk") as HTMLDivElement;

async function start(): Promise<void> {
  const answer = await fetch("/api/trials", { cache: "no-store" });
  const trials = answer.ok ? ((await answer.json()) as TrialSummary[]) : [];
  if (trials.length === 0) {
    pageRoot.append(element("p", "pane", words.none));
    return;
  }
  (window as unknown as { __proact: object }).__proact = new Replay(trials);
}

class Replay {
  /** `time` is on the common axis, whose zero is the start of the trials, or the event that they are aligned by; ms. */
  readonly state: ReplayMoment & { playing: boolean; begin: number; length: number };
  readonly views: ReplayView[] = [];
  readonly recorder = new Recorder();
  private readonly shown = element("div", "trials");
  private readonly events: EventList;
  private readonly range = element("input");
  private readonly now = element("span", "now");
  private readonly speed = element("select", "", ...SPEEDS.map((value) => element("option", "", `${value}×`)));
  private readonly align = element("select");
  private readonly alignNumber = element("input");
  private readonly message = element("span", "small told");
  private readonly play = button(words.play, () => this.setPlaying(!this.state.playing), "primary");
  private readonly compare = button(words.compare, () => this.toggleSecond());
  private readonly plotsBelow = button(words.below, () => this.setBelow(!this.state.below));
  private readonly video = button(words.video, () => void this.toggleVideo());
  private readonly cameras = CAMERA_KINDS.map((kind) => button(CAMERA_NAMES[kind], () => this.chooseCamera(kind)));
  /** The address that is in the bar. */
  private currentLink = "";

  constructor(private readonly trials: TrialSummary[]) {
    const asked = fromQuery(new URLSearchParams(location.search), trials.length, SPEEDS);
    this.state = { ...asked, playing: false, begin: 0, length: 0 };
    this.events = new EventList(asked.hidden, (time) => this.seek(time), () => this.filter());
    this.build();
    for (const number of asked.trials) this.add(number);
    this.chooseCamera(asked.camera);
    this.setBelow(asked.below);
    let before = performance.now();
    const draw = (wall: number) => {
      const seconds = Math.min(Math.max((wall - before) / 1000, 0), 0.25);
      before = wall;
      this.draw(seconds, wall);
      requestAnimationFrame(draw);
    };
    requestAnimationFrame(draw);
  }

  private build(): void {
    const { range, speed, align, alignNumber } = this;
    Object.assign(range, { type: "range", step: "1" });
    range.setAttribute("aria-label", words.time);
    range.addEventListener("input", () => this.seek(Number(range.value)));
    speed.value = `${this.state.speed}×`;
    speed.setAttribute("aria-label", words.speed);
    speed.addEventListener("change", () => (this.state.speed = Number.parseFloat(speed.value)));
    Object.assign(alignNumber, { type: "number", min: "1", value: String(this.state.align?.occurrence ?? 1) });
    alignNumber.setAttribute("aria-label", words.alignNumber);
    for (const node of [align, alignNumber]) node.addEventListener("change", () => this.alignBy());
    this.message.setAttribute("role", "status");
    const zoom = (label: string, name: string, act: () => void) => {
      const node = button(label, act);
      node.title = name;
      node.setAttribute("aria-label", name);
      return node;
    };
    pageRoot.append(
      element(
        "header",
        "deskbar replaybar",
        element("div", "logo", element("strong", "", "ProACT"), element("span", "title", words.title)),
        ...this.cameras,
        element("span", "push"),
        this.compare,
        this.plotsBelow,
        element("label", "align", words.align, align),
        alignNumber,
        button(words.picture, () => void this.savePng()),
        button(words.drawing, () => this.saveSvg()),
        this.video,
        button(words.link, () => void this.copyLink()),
        this.message,
      ),
      element("div", "replay", this.shown, this.events.root),
      element(
        "div",
        "pane scrub",
        this.play,
        speed,
        zoom("|◂", words.previousEvent, () => this.seekEvent(-1)),
        zoom("▸|", words.nextEvent, () => this.seekEvent(1)),
        range,
        zoom("−", words.zoomOut, () => this.zoom(ZOOM_FACTOR)),
        zoom("+", words.zoomIn, () => this.zoom(1 / ZOOM_FACTOR)),
        zoom("⤢", words.whole, () => this.show(null)),
        this.now,
      ),
    );
    this.events.root.append(element("p", "small keys", words.keys));
    window.addEventListener("keydown", (event) => this.key(event));
  }

  private add(number: number): void {
    const view = new ReplayView(this.trials, {
      loaded: () => this.measure(),
      jump: (time) => this.seek(time),
      isFolded: (lane) => this.state.folded.includes(lane),
      folded: (lane, fold) => {
        const others = this.state.folded.filter((other) => other !== lane);
        this.state.folded = fold ? [...others, lane] : others;
      },
      shows: (event) => this.events.isShown(event),
    });
    this.views.push(view);
    this.shown.append(view.root);
    view.load(number).catch((error: unknown) => pageRoot.append(element("p", "pane", String(error))));
    this.arrange();
  }

  private toggleSecond(): void {
    if (this.views.length === 1) {
      this.add(this.trials.length > 1 ? (this.views[0]?.number === 1 ? 0 : 1) : 0);
      this.chooseCamera(this.state.camera);
    } else {
      this.views.pop()?.dispose();
      this.arrange();
      this.measure();
    }
  }

  private arrange(): void {
    setText(this.compare, this.views.length === 1 ? words.compare : words.one);
    this.plotsBelow.hidden = this.views.length === 1;
    setClass(this.shown, "two", this.views.length > 1);
    for (const each of this.views) each.stage.resize();
  }

  private setBelow(below: boolean): void {
    this.state.below = below;
    setText(this.plotsBelow, below ? words.beside : words.below);
    setClass(this.shown, "below", below);
    for (const each of this.views) each.stage.resize();
  }

  private get timelines() {
    return this.views.flatMap(({ timeline }) => (timeline ? [timeline] : []));
  }

  /** After another trial, another alignment, another choice of events. */
  private measure(): void {
    const { align } = this.state;
    const missing: string[] = [];
    for (const view of this.views) {
      const time = align && view.timeline ? timeOf(view.timeline.events, align.event, align.occurrence) : 0;
      view.zero = time ?? 0;
      const { timeline } = view;
      if (align && timeline && time === null) {
        const count = timeline.events.filter(({ event }) => event === align.event).length;
        missing.push(words.alignMissing(timeline.record.name, count));
      }
    }
    setText(this.message, missing.join("; "));
    const extents = this.views.filter(({ timeline }) => timeline).map(({ extent }) => extent);
    if (extents.length === 0) return;
    const begin = Math.min(...extents.map(([from]) => from));
    const end = Math.max(...extents.map(([, to]) => to));
    Object.assign(this.state, { begin, length: end - begin });
    Object.assign(this.range, { min: String(begin), max: String(end) });
    // Until all trials are there, a moment that lies further off is kept.
    if (extents.length === this.views.length) this.state.time = Math.min(Math.max(this.state.time, begin), end);
    this.offerKinds();
    this.filter();
  }

  private offerKinds(): void {
    const kinds = new Set(this.timelines.flatMap(({ events }) => events.map(({ event }) => event)));
    if (this.state.align) kinds.add(this.state.align.event);
    const option = (value: string, text: string) => Object.assign(element("option", "", text), { value });
    this.align.replaceChildren(option("", words.alignStart), ...[...kinds].sort().map((kind) => option(kind, words.kinds[kind])));
    this.align.value = this.state.align?.event ?? "";
    this.alignNumber.hidden = this.state.align === null;
  }

  private alignBy(): void {
    const event = this.align.value as TrialEvent["event"] | "";
    const number = Math.max(Math.round(Number(this.alignNumber.value)) || 1, 1);
    this.alignNumber.value = String(number);
    // What is on display of the first trial stays on display.
    const own = this.state.time + (this.views[0]?.zero ?? 0);
    this.state.align = event === "" ? null : { event, occurrence: number };
    this.state.window = null;
    this.measure();
    this.seek(event === "" ? own : 0);
  }

  private filter(): void {
    this.state.hidden = this.events.hiddenGroups;
    const placed = this.views.flatMap(({ timeline, zero }, view) => timeline?.events.map((event) => ({ event, time: event.time - zero, view })) ?? []);
    this.events.setEvents(placed, this.views.length);
    this.show(this.state.window);
  }

  /** Shows this part of the axis; null for all of it. */
  private show(part: [number, number] | null): void {
    this.state.window = part;
    for (const view of this.views) view.setWindow(part ?? this.showAll, this.showAll);
  }

  private get showAll(): [number, number] {
    return [this.state.begin, this.state.begin + this.state.length];
  }

  private zoom(factor: number): void {
    const [from, to] = this.state.window ?? this.showAll;
    const span = Math.max((to - from) * factor, MIN_WINDOW_MS);
    this.show(span >= this.state.length ? null : this.windowAround(this.state.time, span));
  }

  /** A part of the axis about `time`. */
  private windowAround(time: number, span: number): [number, number] {
    const [begin, end] = this.showAll;
    const from = Math.min(Math.max(time - span / 2, begin), end - span);
    return [from, from + span];
  }

  private seek(time: number): void {
    const [begin, end] = this.showAll;
    this.state.time = Math.min(Math.max(time, begin), end);
    this.follow();
  }

  /** A part of the axis that the cursor has left moves on. */
  private follow(): void {
    const { window: part, time } = this.state;
    if (!part || (time >= part[0] && time <= part[1])) return;
    const span = part[1] - part[0];
    this.show(this.state.playing ? this.windowAround(time + span / 2, span) : this.windowAround(time, span));
  }

  private seekEvent(direction: 1 | -1): void {
    const time = this.events.neighbor(this.state.time, direction);
    if (time !== null) this.seek(time);
  }

  private chooseCamera(kind: CameraKind): void {
    const { eye, at } = this.state;
    this.state.camera = kind;
    for (const { stage } of this.views) {
      stage.cameras.choose(kind, stage.taskScene);
      if (kind === "free" && eye && at) stage.cameras.placeFreeCamera(eye, at);
    }
    this.cameras.forEach((node, k) => setClass(node, "now", CAMERA_KINDS[k] === kind));
  }

  private setPlaying(playing: boolean): void {
    const [begin, end] = this.showAll;
    if (playing && this.state.time >= end) this.state.time = begin;
    this.state.playing = playing;
    setText(this.play, playing ? words.pause : words.play);
  }

  private draw(seconds: number, wall: number): void {
    const { state } = this;
    const [begin, end] = this.showAll;
    // Where drawing takes all of the processor, a trial of megabytes would not come through.
    if (this.views.some(({ loading }) => loading)) return;
    if (state.playing) {
      state.time = Math.min(state.time + 1000 * seconds * state.speed, end);
      this.follow();
      if (state.time >= end) {
        this.setPlaying(false);
        if (this.recorder.running) void this.toggleVideo();
      }
    }
    for (const view of this.views) view.draw(state.time, this.showAll, seconds, wall);
    this.recorder.draw(this.views, state.time);
    this.events.moveTo(state.time);
    if (document.activeElement !== this.range || state.playing) this.range.value = String(state.time);
    setText(this.now, `${fixed(state.time / 1000, 2).replace("-", "−")} / ${fixed((begin + state.length) / 1000, 1)} s`);
    if (!state.playing && this.views.every(({ timeline }) => timeline)) this.keepLink();
  }

  /** The address bar has the link to what is on display. */
  private keepLink(): void {
    this.state.trials = this.views.map(({ number }) => number);
    const place = this.views[0]?.stage.cameras.freeCameraPose ?? null;
    Object.assign(this.state, { eye: place?.eye ?? null, at: place?.at ?? null });
    const query = toQuery(this.state, new URLSearchParams(location.search)).toString();
    if (query === this.currentLink) return;
    this.currentLink = query;
    history.replaceState(null, "", `?${query}`);
  }

  private async copyLink(): Promise<void> {
    this.keepLink();
    try {
      await navigator.clipboard.writeText(location.href);
      setText(this.message, words.linkCopied);
    } catch {
      setText(this.message, words.linkShown);
    }
  }

  private get axis(): string {
    const { align } = this.state;
    return align ? words.axisFrom(`${words.kinds[align.event]} ${align.occurrence}`) : words.axis;
  }

  private fileName(ending: string): string {
    return `replay-${fixed(this.state.time / 1000, 2)}s.${ending}`;
  }

  private async savePng(): Promise<void> {
    const pictured = this.views.map((view) => view.toFigure(this.state.time));
    const { width, height } = sizeOf(pictured);
    const canvas = element("canvas");
    Object.assign(canvas, { width: PNG_SCALE * width, height: PNG_SCALE * height });
    const context = canvas.getContext("2d");
    if (!context) return;
    drawFigure(new CanvasPen(context, PNG_SCALE), pictured, this.axis);
    const blob = await new Promise<Blob | null>((resolve) => canvas.toBlob(resolve, "image/png"));
    if (blob) saveAs(blob, this.fileName("png"));
  }

  private saveSvg(): void {
    const pictured = this.views.map((view) => view.toFigure(this.state.time));
    const { width, height } = sizeOf(pictured);
    const pen = new SvgPen(width, height, pictured.map(({ caption }) => caption).join(" · "));
    drawFigure(pen, pictured, this.axis);
    saveAs(new Blob([pen.toString()], { type: "image/svg+xml" }), this.fileName("svg"));
  }

  private async toggleVideo(): Promise<void> {
    if (this.recorder.running) {
      setText(this.video, words.video);
      saveAs(await this.recorder.stop(), "replay.webm");
      this.setPlaying(false);
      return;
    }
    this.recorder.start(this.views);
    setText(this.video, words.stopVideo);
    this.setPlaying(true);
  }

  private key(event: KeyboardEvent): void {
    const { target } = event;
    if (event.ctrlKey || event.metaKey || event.altKey || target instanceof HTMLSelectElement) return;
    if (target instanceof HTMLInputElement && target.type === "number") return;
    const direction = event.code === "ArrowRight" ? 1 : event.code === "ArrowLeft" ? -1 : 0;
    // Space is the button's or the box's that has the focus.
    const plays = event.code === "Space" && (target === document.body || target === this.range);
    if (direction !== 0 && event.shiftKey) this.seekEvent(direction);
    else if (direction !== 0) this.seek(this.state.time + direction * STEP_MS);
    else if (plays) this.setPlaying(!this.state.playing);
    else if (event.key === "+") this.zoom(1 / ZOOM_FACTOR);
    else if (event.key === "-") this.zoom(ZOOM_FACTOR);
    else return;
    event.preventDefault();
  }
}

start().catch((error: unknown) => pageRoot.append(element("div", "banner", drawErrorText(error))));
