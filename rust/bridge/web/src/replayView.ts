// One recorded trial on display: its scene, what is known of the instant, and its signals below.

import { element, setClass, setText } from "./dom";
import type { RecordedTrial, TrialEvent, TrialSummary } from "./generated/types";
import { scoreText } from "./hud";
import { objectName } from "./objects";
import { GESTURE_NAMES } from "./protocol";
import { groupOf, replayEventText } from "./replayEvents";
import type { FigureTrial } from "./replayFigure";
import { lanesOf, type Lane, type LaneName } from "./replaySignals";
import { SignalPlot } from "./signalPlot";
import { SceneRenderer } from "./renderer";
import { strings } from "./strings";
import { Timeline } from "./timeline";
import { fixed } from "./numbers";

const words = strings.replay;

/** What a view asks of the page. */
export interface ReplayViewHandlers {
  /** Another trial is on display. */
  loaded(): void;
  /** Go there, milliseconds on the common axis. */
  jump(time: number): void;
  /** A plot was folded or unfolded. */
  folded(lane: LaneName, fold: boolean): void;
  isFolded(lane: LaneName): boolean;
  shows(event: TrialEvent): boolean;
}

/** A lane of the plots; drawn only while it is unfolded. */
interface LaneView {
  lane: Lane;
  root: HTMLDetailsElement;
  plot: SignalPlot | null;
}

/** Times that a trial is asked for whose answer breaks off. */
const MAX_FETCH_ATTEMPTS = 3;

export class ReplayView {
  readonly root: HTMLElement;
  readonly canvas = element("canvas");
  timeline: Timeline | null = null;
  readonly stage: SceneRenderer;
  /** The instant of the trial at which the common axis has its zero, ms. */
  zero = 0;
  /** Number of its trial in the server's list. */
  number = -1;
  /** Its trial is on its way. */
  loading = false;
  private readonly select = element("select");
  private readonly facts = element("div", "facts");
  private readonly now = element("div", "facts now");
  private readonly verdict = element("span", "chip");
  private readonly marks = element("div", "marks");
  private readonly timeLabel = element("i", "here");
  private readonly plots = element("div", "plots");
  private lanes: LaneView[] = [];
  /** On display of the common axis, ms. */
  private window: [number, number] = [0, 1];
  private time = 0;
  /** The scene stays in sight while plots are scrolled: what is scrolled to has to stop below it. */
  private readonly resized = new ResizeObserver(([entry]) => {
    const height = entry?.target.clientHeight ?? 0;
    this.root.parentElement?.style.setProperty("--scene-height", `${height}px`);
    this.stage.resize();
  });

  constructor(
    trials: TrialSummary[],
    private readonly ports: ReplayViewHandlers,
  ) {
    this.select.setAttribute("aria-label", words.trial);
    trials.forEach((trial, k) => {
      const seed = trial.seed === null ? "" : words.seed(trial.seed);
      const option = element("option", "", `${trial.name} · ${trial.method}, ${trial.setup}${seed}`);
      option.value = String(k);
      this.select.append(option);
    });
    this.select.addEventListener("change", () => this.load(Number(this.select.value)).catch((error: unknown) => console.error(error)));
    const scene = element(
      "div",
      "scene",
      element("div", "pane view", this.canvas, element("div", "head", this.select, this.verdict)),
      element("div", "pane state", this.facts, this.now, this.marks),
    );
    this.root = element("section", "trial", scene, this.plots);
    this.marks.append(this.timeLabel);
    this.stage = new SceneRenderer(this.canvas, true);
    this.resized.observe(scene);
  }

  async load(number: number): Promise<void> {
    this.loading = true;
    try {
      await this.setTrial(number);
    } finally {
      if (this.number === number) this.loading = false;
    }
  }

  private async setTrial(number: number): Promise<void> {
    this.number = number;
    this.select.value = String(number);
    setText(this.verdict, words.loading);
    const record = await fetchTrial(number).catch((error: unknown) => {
      setText(this.verdict, words.failed);
      throw error;
    });
    if (this.number !== number) return;
    this.timeline = new Timeline(record);
    this.stage.show(record.content);
    this.stage.resize();
    setText(this.verdict, record.agrees === null ? words.bag : record.agrees ? words.agrees : words.differs);
    setClass(this.verdict, "live", record.agrees === true);
    setClass(this.verdict, "off", record.agrees === false);
    const fact = (name: string, value: string) => element("span", "", `${name} `, element("b", "", value));
    this.facts.replaceChildren(
      fact(words.facts.method, `${record.method} · ${record.content.method.title}`),
      fact(words.facts.score, scoreText(record.score, record.content.briefing)),
      fact(words.facts.length, words.length(this.timeline.end / 1000, record.finished)),
    );
    this.plot(record);
    this.ports.loaded();
  }

  /** From the first to the last instant on the common axis, ms. */
  get extent(): [number, number] {
    return [-this.zero, (this.timeline?.end ?? 0) - this.zero];
  }

  /** Shows this part of the common axis in the plots, and the events on a ruler of its whole length. */
  setWindow(window: [number, number], whole: [number, number]): void {
    this.window = window;
    const [begin, length] = [whole[0], Math.max(whole[1] - whole[0], 1)];
    const events = this.timeline?.events.filter((event) => this.ports.shows(event)) ?? [];
    this.marks.replaceChildren(
      ...events.map((event) => {
        const mark = element("i", groupOf(event));
        mark.style.left = `${(100 * (event.time - this.zero - begin)) / length}%`;
        mark.title = `${fixed(event.time / 1000, 1)} s: ${replayEventText(event)}`;
        mark.addEventListener("click", () => this.ports.jump(event.time - this.zero));
        return mark;
      }),
      this.timeLabel,
    );
    for (const { plot } of this.lanes) if (plot) this.place(plot);
  }

  draw(time: number, whole: [number, number], seconds: number, wall: number): void {
    this.time = time;
    const own = Math.min(Math.max(time + this.zero, 0), this.timeline?.end ?? 0);
    this.timeLabel.style.left = `${(100 * (time - whole[0])) / Math.max(whole[1] - whole[0], 1)}%`;
    for (const { plot } of this.lanes) plot?.moveTo((time + this.zero) / 1000);
    const now = this.timeline?.at(own);
    if (!now) return;
    const { frame, drawn } = now;
    this.stage.draw(drawn, frame, seconds, wall);
    const event = this.timeline?.lastEvent(own);
    const target = frame.target.object !== null ? objectName(frame.target.object) : words.nothing;
    const parts = [
      GESTURE_NAMES[frame.gesture].name,
      frame.mode ? words.moves(frame.mode.name) : words.selects(target, frame.target.locked),
      frame.hand.holds !== null ? words.holds(objectName(frame.hand.holds)) : words.hand(frame.hand.state),
      frame.mode ? "" : words.planner(frame.planner.state),
      frame.stop ? words.stopped(frame.stop.reason) : "",
      event ? words.last(replayEventText(event)) : "",
    ];
    setText(this.now, parts.filter(Boolean).join(" · "));
  }

  /** What stands under its scene in a video, and above it in a picture. */
  caption(time: number): string {
    const record = this.timeline?.record;
    return record ? words.caption(record.name, record.method, fixed((time + this.zero) / 1000, 2)) : "";
  }

  /** It as part of a picture: the scene, and the plots that are unfolded. */
  toFigure(time: number): FigureTrial {
    const open = this.lanes.flatMap(({ lane, plot }) => (plot ? [{ title: titleOf(lane), data: lane.data, isLineShown: (k: number) => plot.isLineShown(k) }] : []));
    return {
      caption: this.caption(time),
      scene: this.canvas,
      plots: open,
      time: (time + this.zero) / 1000,
      window: [(this.window[0] + this.zero) / 1000, (this.window[1] + this.zero) / 1000],
      zero: this.zero / 1000,
    };
  }

  dispose(): void {
    this.resized.disconnect();
    for (const { plot } of this.lanes) plot?.destroy();
    this.stage.renderer.dispose();
    this.root.remove();
  }

  private plot(record: RecordedTrial): void {
    for (const { plot } of this.lanes) plot?.destroy();
    this.lanes = lanesOf(record).map((lane) => {
      const summary = element("summary", "", element("b", "", lane.title), lane.note ? element("span", "small", lane.note) : null);
      const root = element("details", `pane lane ${lane.name}`, summary);
      const view: LaneView = { lane, root, plot: null };
      root.open = !this.ports.isFolded(lane.name);
      // Told of the first state as well.
      root.addEventListener("toggle", () => {
        this.unfold(view);
        this.ports.folded(lane.name, !root.open);
      });
      return view;
    });
    this.plots.replaceChildren(...this.lanes.map(({ root }) => root));
    for (const view of this.lanes) this.unfold(view);
  }

  private unfold(view: LaneView): void {
    const { lane, root } = view;
    if (root.open === (view.plot !== null)) return;
    if (view.plot) {
      view.plot.destroy();
      view.plot.legend.remove();
      view.plot = null;
      return;
    }
    view.plot = new SignalPlot(lane.data, titleOf(lane), (time) => this.ports.jump(1000 * time - this.zero));
    root.append(view.plot.legend, view.plot.root);
    this.place(view.plot);
    view.plot.moveTo((this.time + this.zero) / 1000);
  }

  private place(plot: SignalPlot): void {
    plot.show((this.window[0] + this.zero) / 1000, (this.window[1] + this.zero) / 1000, this.zero / 1000);
  }
}

function titleOf({ title, note }: Lane): string {
  return note ? `${title}, ${note}` : title;
}

/** A recorded trial, asked for again where the connection broke off on its way. */
async function fetchTrial(number: number): Promise<RecordedTrial> {
  for (let left = MAX_FETCH_ATTEMPTS - 1; ; left -= 1) {
    const answer = await fetch(`/api/trials/${number}`);
    if (!answer.ok) throw new Error(`trial ${number}: ${(await answer.text()) || answer.status}`);
    try {
      return (await answer.json()) as RecordedTrial;
    } catch (error) {
      if (left === 0) throw error;
    }
  }
}
