// The drawer of signals: muscles, what the model makes of them, gaze, what is meant and joint angles over one time axis, live or up
// to half a minute back. Its pictures come with the first opening.

import { button, element, setText } from "./dom";
import type { DisplayFrame, IntentEstimate, MethodInfo, PageContent, Signals } from "./generated/types";
import { IntentView } from "./intentView";
import type { SignalRows } from "./signalRows";
import { strings } from "./strings";
import { MAX_BACK_SECS, TimeWindow, WINDOW_SECS } from "./timeWindow";
import { fixed } from "./numbers";

const words = strings.signals;
/** Of the slider, seconds. */
const STEP_SECS = 0.5;
/** What is meant is kept for so long, seconds. */
const INTENT_SECS = MAX_BACK_SECS + WINDOW_SECS;

export class SignalsDrawer {
  readonly root = element("section", "card drawer");
  readonly intent = new IntentView();
  readonly time = new TimeWindow();
  private readonly state = element("span", "state");
  private readonly slider = element("input");
  private readonly pauseButton = button(words.pause, () => this.pause());
  private readonly liveButton = button(words.live, () => this.goLive());
  private readonly rowsPlace = element("div", "rows");
  private readonly crosshair = element("div", "crosshair");
  private rows: SignalRows | null = null;
  private loading = false;
  private intents: { time: number; intent: IntentEstimate | null }[] = [];
  private content: PageContent | null = null;
  private method: MethodInfo | undefined;
  private cursorTime: number | null = null;
  private drag: { x: number; back: number } | null = null;
  private needsDraw = true;

  /** `opened`: it was opened or closed, and signals are wanted from the server or no longer; `escaped` by a key of its own. */
  constructor(private readonly opened: (open: boolean, escaped: boolean) => void) {
    const { root, slider } = this;
    root.hidden = true;
    root.setAttribute("aria-label", words.title);
    slider.type = "range";
    [slider.min, slider.max, slider.step, slider.value] = [String(-MAX_BACK_SECS), "0", String(STEP_SECS), "0"];
    slider.setAttribute("aria-label", words.slider);
    slider.addEventListener("input", () => this.lookBack(-Number(slider.value)));
    this.state.setAttribute("role", "status");
    this.crosshair.hidden = true;
    // Many rows scroll, also by keys.
    this.rowsPlace.tabIndex = 0;
    this.rowsPlace.setAttribute("role", "group");
    this.rowsPlace.setAttribute("aria-label", words.rows);
    root.append(
      element("div", "drawerhead", element("h3", "", words.title), this.state, slider, this.pauseButton, this.liveButton, button(words.close, () => this.toggle(), "close")),
      element("div", "drawerbody", element("div", "timed", this.rowsPlace, this.crosshair), this.intent.root),
    );
    root.addEventListener("keydown", (event) => this.key(event));
    this.rowsPlace.addEventListener("pointerdown", (event) => this.startDrag(event));
    this.rowsPlace.addEventListener("pointermove", (event) => this.onPointer(event));
    this.rowsPlace.addEventListener("pointerleave", () => this.moveCursor(null));
    for (const end of ["pointerup", "pointercancel"] as const) this.rowsPlace.addEventListener(end, () => (this.drag = null));
    this.showValues();
  }

  get open(): boolean {
    return !this.root.hidden;
  }

  toggle(escaped = false): void {
    this.root.hidden = this.open;
    this.clear();
    this.opened(this.open, escaped);
    if (this.open) void this.load();
  }

  /** Another trial, or a gap: what was shown is void. */
  clear(): void {
    this.time.clear();
    this.intents = [];
    this.rows?.clear();
    this.intent.clear();
    this.needsDraw = true;
    this.showValues();
  }

  show(content: PageContent): void {
    this.content = content;
    this.rows?.show(content);
  }

  frame(frame: DisplayFrame, method: MethodInfo | undefined): void {
    if (!this.open) return;
    this.method = method;
    this.rows?.frame(frame);
    this.time.advance(frame.time / 1000);
    this.needsDraw = true;
  }

  addSignals(signals: Signals): void {
    if (!this.open) return;
    this.rows?.signals(signals);
    const now = signals.time / 1000;
    this.intents.push({ time: now, intent: signals.intent });
    while ((this.intents[0]?.time ?? now) < now - INTENT_SECS) this.intents.shift();
    if (this.time.live) this.showIntent();
    this.needsDraw = true;
  }

  /** Draws what has changed; call it with every picture of the browser. */
  draw(): void {
    if (!this.open || !this.rows || !this.needsDraw) return;
    this.needsDraw = false;
    const { time, rows } = this;
    rows.draw(time.from, time.edge);
    rows.showValues(this.cursorTime ?? time.edge);
    this.showValues();
  }

  private async load(): Promise<void> {
    if (this.rows || this.loading) return;
    this.loading = true;
    const { SignalRows: Rows } = await import("./signalRows");
    this.rows = new Rows();
    if (this.content) this.rows.show(this.content);
    this.rowsPlace.replaceChildren(...this.rows.nodes);
    this.loading = false;
  }

  private pause(): void {
    this.time.pause();
    this.onTimeMoved();
  }

  private goLive(): void {
    this.time.goLive();
    this.onTimeMoved();
  }

  private lookBack(seconds: number): void {
    this.time.lookBack(seconds);
    this.onTimeMoved();
  }

  private onTimeMoved(): void {
    this.needsDraw = true;
    this.showIntent();
    this.showValues();
  }

  private showIntent(): void {
    const { edge } = this.time;
    const until = this.time.live ? this.intents : this.intents.filter(({ time }) => time <= edge);
    this.intent.show(until[until.length - 1]?.intent ?? null, this.content, this.method);
  }

  private showValues(): void {
    const { time, slider } = this;
    const back = Math.round(time.lagSecs / STEP_SECS) * STEP_SECS;
    setText(this.state, time.live ? words.isLive : words.isBack(fixed(back, 1)));
    const value = String(-back);
    if (slider.value !== value) slider.value = value;
    const said = time.live ? words.isLive : words.isBack(fixed(back, 1));
    if (slider.getAttribute("aria-valuetext") !== said) slider.setAttribute("aria-valuetext", said);
    this.pauseButton.disabled = !time.live;
    this.liveButton.disabled = time.live;
  }

  /** Keys that move through time belong to the drawer while the focus is in it; all others go on meaning gestures. */
  private key(event: KeyboardEvent): void {
    const steps: Record<string, number> = { ArrowLeft: 1, ArrowRight: -1, PageUp: 5, PageDown: -5, Home: MAX_BACK_SECS, End: -MAX_BACK_SECS };
    const step = steps[event.code];
    if (step !== undefined) {
      this.lookBack(this.time.lagSecs + step);
      event.preventDefault();
      event.stopPropagation();
    } else if (event.code === "ArrowUp" || event.code === "ArrowDown") {
      event.stopPropagation();
    } else if (event.code === "Escape") {
      this.toggle(true);
    }
  }

  private startDrag(event: PointerEvent): void {
    this.drag = { x: event.clientX, back: this.time.lagSecs };
    this.rowsPlace.setPointerCapture(event.pointerId);
  }

  private onPointer(event: PointerEvent): void {
    const picture = this.rows?.plotArea();
    if (!picture) return;
    const perPixel = WINDOW_SECS / Math.max(picture.width, 1);
    if (this.drag && Math.abs(event.clientX - this.drag.x) > 3) this.lookBack(this.drag.back + (event.clientX - this.drag.x) * perPixel);
    const x = event.clientX - picture.left;
    this.moveCursor(x >= 0 && x <= picture.width ? { time: this.time.from + x * perPixel, x: event.clientX } : null);
  }

  private moveCursor(at: { time: number; x: number } | null): void {
    this.cursorTime = at?.time ?? null;
    this.crosshair.hidden = at === null;
    if (at) this.crosshair.style.left = `${at.x - this.rowsPlace.getBoundingClientRect().left}px`;
    this.needsDraw = true;
  }
}
