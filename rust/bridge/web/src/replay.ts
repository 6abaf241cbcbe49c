// Recorded trials: scrub, play, put two side by side, save a picture or a video.

import "./theme.css";
import "./desk.css";
import { CAMERA_KINDS, CAMERA_NAMES, type CameraKind } from "./cameras";
import { button, element, setClass, setText } from "./dom";
import type { RecordedTrial, TrialSummary } from "./generated/types";
import { eventText, scoreText } from "./hud";
import { objectName } from "./objects";
import { GESTURE_NAMES } from "./protocol";
import { Recorder, compose, saveAs } from "./export";
import { Stage, whyNotDrawn } from "./stage";
import { Timeline } from "./timeline";

const SPEEDS = [0.25, 0.5, 1, 2, 5, 10];
/** A step of the arrow keys, ms. */
const STEP_MS = 100;

const desk = document.getElementById("desk") as HTMLDivElement;

/** One trial on display. */
class View {
  readonly root: HTMLElement;
  readonly canvas = element("canvas");
  timeline: Timeline | null = null;
  readonly stage: Stage;
  private readonly select = element("select");
  private readonly facts = element("div", "facts");
  private readonly now = element("div", "facts");
  private readonly verdict = element("span", "chip");
  private readonly marks = element("div", "marks");
  private readonly here = element("i", "here");
  private wanted = -1;

  constructor(
    trials: TrialSummary[],
    private readonly loaded: () => void,
    private readonly jump: (time: number) => void,
  ) {
    this.select.setAttribute("aria-label", "Trial");
    trials.forEach((trial, k) => {
      const seed = trial.seed === null ? "" : `, seed ${trial.seed}`;
      const option = element("option", "", `${trial.name} · ${trial.method}, ${trial.setup}${seed}`);
      option.value = String(k);
      this.select.append(option);
    });
    this.select.addEventListener("change", () => void this.load(Number(this.select.value)));
    this.root = element(
      "section",
      "trial",
      element("div", "pane head", this.select, this.verdict),
      element("div", "pane view", this.canvas),
      element("div", "pane", this.facts, this.now, this.marks),
    );
    this.marks.append(this.here);
    this.stage = new Stage(this.canvas, true);
  }

  async load(number: number): Promise<void> {
    this.wanted = number;
    this.select.value = String(number);
    setText(this.verdict, "Loading …");
    const answer = await fetch(`/api/trials/${number}`);
    if (!answer.ok) {
      setText(this.verdict, "Cannot be shown");
      throw new Error(`trial ${number}: ${(await answer.text()) || answer.status}`);
    }
    const record = (await answer.json()) as RecordedTrial;
    if (this.wanted !== number) return;
    this.timeline = new Timeline(record);
    this.stage.show(record.content);
    this.stage.resize();
    const verdicts = { true: "Digest agrees", false: "Digest DIFFERS: not the recorded trial", null: "From a bag" };
    setText(this.verdict, verdicts[`${record.agrees}`]);
    setClass(this.verdict, "live", record.agrees === true);
    setClass(this.verdict, "off", record.agrees === false);
    const fact = (name: string, value: string) => element("span", "", `${name} `, element("b", "", value));
    this.facts.replaceChildren(
      fact("Method", `${record.method} · ${record.content.method.title}`),
      fact("Score", scoreText(record.score, record.content.briefing)),
      fact("Length", `${(this.timeline.end / 1000).toFixed(1)} s${record.finished ? "" : ", unfinished"}`),
    );
    this.loaded();
  }

  /** Puts the events where they are on a ruler of `length` ms. */
  rule(length: number): void {
    const events = this.timeline?.events.filter(({ event }) => event !== "gesture_changed") ?? [];
    this.marks.replaceChildren(
      ...events.map((event) => {
        const mark = element("i", event.event);
        mark.style.left = `${(100 * event.time) / Math.max(length, 1)}%`;
        mark.title = `${(event.time / 1000).toFixed(1)} s: ${eventText(event)}`;
        mark.addEventListener("click", () => this.jump(event.time));
        return mark;
      }),
      this.here,
    );
  }

  draw(time: number, length: number, seconds: number, wall: number): void {
    const now = this.timeline?.at(Math.min(time, this.timeline.end));
    this.here.style.left = `${(100 * time) / Math.max(length, 1)}%`;
    if (!now) return;
    const { frame, drawn } = now;
    this.stage.draw(drawn, frame, seconds, wall);
    const event = this.timeline?.lastEvent(time);
    const target = frame.target.object !== null ? objectName(frame.target.object) : "nothing";
    const parts = [
      GESTURE_NAMES[frame.gesture].name,
      frame.mode ? `moves ${frame.mode.name}` : `selects ${target}${frame.target.locked ? ", locked" : ""}`,
      frame.hand.holds !== null ? `holds ${objectName(frame.hand.holds)}` : `hand ${frame.hand.state}`,
      frame.mode ? "" : `planner ${frame.planner.state}`,
      frame.stop ? `stopped: ${frame.stop.reason}` : "",
      event ? `last: ${eventText(event)}` : "",
    ];
    setText(this.now, parts.filter(Boolean).join(" · "));
  }

  /** What stands under its picture in an export. */
  caption(time: number): string {
    const record = this.timeline?.record;
    return record ? `${record.name} · method ${record.method} · ${(time / 1000).toFixed(2)} s` : "";
  }
}

/** The trials that the address names, as `?trial=3&trial=5`; without one the first two. */
function asked(count: number): number[] {
  const named = new URLSearchParams(location.search).getAll("trial").map(Number);
  const known = named.filter((number) => Number.isInteger(number) && number >= 0 && number < count);
  return known.length > 0 ? known.slice(0, 2) : count > 1 ? [0, 1] : [0];
}

async function start(): Promise<void> {
  const answer = await fetch("/api/trials", { cache: "no-store" });
  const trials = answer.ok ? ((await answer.json()) as TrialSummary[]) : [];
  if (trials.length === 0) {
    desk.append(element("p", "pane", "No trial is loaded. Start this page with: proact replay TRIAL_DIRECTORY [ANOTHER] --page"));
    return;
  }
  const views: View[] = [];
  const shown = element("div", "trials");
  const range = element("input");
  const now = element("span", "now");
  const speed = element("select", "", ...SPEEDS.map((value) => element("option", "", `${value}×`)));
  const state = { time: 0, length: 0, playing: false };
  const recorder = new Recorder();
  range.type = "range";
  range.min = "0";
  range.step = "10";
  range.setAttribute("aria-label", "Time");
  speed.value = "1×";
  speed.setAttribute("aria-label", "Speed");
  range.addEventListener("input", () => (state.time = Number(range.value)));
  const play = button("Play", () => setPlaying(!state.playing), "primary");
  const compare = button("Compare with another", () => (views.length === 1 ? add(trials.length > 1 ? 1 : 0) : remove()));
  const video = button("Record video", () => void toggleVideo());
  const cameras = CAMERA_KINDS.map((kind) => button(CAMERA_NAMES[kind], () => chooseCamera(kind)));
  desk.append(
    element(
      "header",
      "deskbar",
      element("div", "logo", element("strong", "", "ProACT"), element("span", "title", "Replay")),
      ...cameras,
      element("span", "push"),
      compare,
      button("Save picture", () => void compose(views, state.time).then((picture) => saveAs(picture, `replay-${(state.time / 1000).toFixed(2)}s.png`))),
      video,
    ),
    shown,
    element("div", "pane scrub", play, speed, range, now),
  );

  function add(number: number): void {
    const view = new View(trials, measure, (time) => (state.time = time));
    views.push(view);
    shown.append(view.root);
    for (const each of views) each.stage.resize();
    setText(compare, views.length === 1 ? "Compare with another" : "Show one");
    view.load(number).catch((error: unknown) => desk.append(element("p", "pane", String(error))));
  }

  function remove(): void {
    const view = views.pop();
    view?.stage.renderer.dispose();
    view?.root.remove();
    for (const each of views) each.stage.resize();
    setText(compare, "Compare with another");
    measure();
  }

  function measure(): void {
    state.length = Math.max(...views.map((view) => view.timeline?.end ?? 0));
    range.max = String(state.length);
    for (const view of views) view.rule(state.length);
  }

  function chooseCamera(kind: CameraKind): void {
    for (const view of views) view.stage.cameras.choose(kind, view.stage.room);
    cameras.forEach((node, k) => setClass(node, "now", CAMERA_KINDS[k] === kind));
  }

  function setPlaying(playing: boolean): void {
    if (playing && state.time >= state.length) state.time = 0;
    state.playing = playing;
    setText(play, playing ? "Pause" : "Play");
  }

  async function toggleVideo(): Promise<void> {
    if (recorder.running) {
      setText(video, "Record video");
      saveAs(await recorder.stop(), "replay.webm");
      setPlaying(false);
      return;
    }
    recorder.start(views);
    setText(video, "Stop and save");
    setPlaying(true);
  }

  window.addEventListener("keydown", (event) => {
    if (event.target instanceof HTMLSelectElement) return;
    const step = event.code === "ArrowRight" ? STEP_MS : event.code === "ArrowLeft" ? -STEP_MS : 0;
    if (step !== 0) state.time = Math.min(Math.max(state.time + step, 0), state.length);
    if (event.code === "Space") setPlaying(!state.playing);
    if (step !== 0 || event.code === "Space") event.preventDefault();
  });

  for (const number of asked(trials.length)) add(number);
  chooseCamera("shoulder");
  let before = performance.now();
  requestAnimationFrame(function draw(wall: number) {
    const seconds = Math.min(Math.max((wall - before) / 1000, 0), 0.25);
    before = wall;
    if (state.playing) {
      state.time = Math.min(state.time + 1000 * seconds * Number.parseFloat(speed.value), state.length);
      if (state.time >= state.length) {
        setPlaying(false);
        if (recorder.running) void toggleVideo();
      }
    }
    for (const view of views) view.draw(state.time, state.length, seconds, wall);
    recorder.draw(views, state.time);
    if (document.activeElement !== range || state.playing) range.value = String(state.time);
    setText(now, `${(state.time / 1000).toFixed(2)} / ${(state.length / 1000).toFixed(1)} s`);
    requestAnimationFrame(draw);
  });
  (window as unknown as { __proact: object }).__proact = { state, views, recorder };
}

start().catch((error: unknown) => desk.append(element("div", "banner", whyNotDrawn(error))));
