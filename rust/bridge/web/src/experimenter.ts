// The experimenter's page: the live scene, the signals, the rates, and the buttons of a study. A spectator sees the
// same without the buttons. While a study is conducted, its plan decides what comes next, and its pane comes first.

import "./theme.css";
import "./workstation.css";
import "./dialogs.css";
import "./form.css";
import "./signals.css";
import { CAMERA_KINDS, CAMERA_NAMES } from "./cameras";
import { Conduct } from "./conduct";
import { button, element, setClass, setText } from "./dom";
import { FrameCounter } from "./frameCount";
import { expandGestureCodes, type HintContext } from "./hints";
import { eventText, scoreText } from "./hud";
import { LatencyTable } from "./latencyTable";
import { objectName } from "./objects";
import { LiveConnection } from "./liveConnection";
import { FrameInterpolator } from "./frameInterpolation";
import type { DisplayFrame, PageContent, Signals, Stop, TrialEvent, TrialStatus } from "./generated/types";
import { GESTURE_NAMES, methodOf } from "./protocol";
import { SignalsDrawer } from "./signalsDrawer";
import { SceneRenderer, drawErrorText } from "./renderer";
import { StopBanner } from "./stopBanner";
import { strings } from "./strings";
import { TraceView } from "./traces";
import { fixed } from "./numbers";

const texts = strings.experimenter;

/** Lines of the log that are kept on the page. */
const LOG_LINES = 400;
/** Whoever watches has no keys, and nothing to aim at. */
const SPECTATOR_CIRCUMSTANCES: HintContext = { target: () => null, lean: false, mouseIsGaze: false, key: () => "", mayRestart: false, jogGoal: null };
/** Ages and times above which a figure stands out. */
const STALE_GAZE_MS = 500;
const SLOW_TICK_US = 1000;

const spectator = location.pathname.startsWith("/spectator");
const pageRoot = document.getElementById("desk") as HTMLDivElement;

/** A list of names and figures. */
class FigureList {
  readonly root = element("dl", "figures");
  private readonly cells = new Map<string, HTMLElement>();

  set(name: string, value: string, bad = false): void {
    let cell = this.cells.get(name);
    if (!cell) {
      cell = element("dd");
      this.cells.set(name, cell);
      this.root.append(element("dt", "", name), cell);
    }
    setText(cell, value);
    setClass(cell, "bad", bad);
  }
}

function start(): void {
  document.title = spectator ? texts.spectatorTitle : texts.title;
  const canvas = element("canvas");
  const traceCanvas = element("canvas");
  const traces = new TraceView(traceCanvas);
  const noArmband = element("p", "empty", texts.noArmband);
  const link = element("span", "chip off", texts.offline);
  const [method, setup, seed, record] = [0, 0, 0, 0].map(() => element("span", "chip")) as [HTMLElement, HTMLElement, HTMLElement, HTMLElement];
  const state = element("span", "chip live state", texts.running);
  const overview = element("b", "overview");
  const stop = new StopBanner();
  const trial = new FigureList();
  const rates = new FigureList();
  const latencies = new LatencyTable();
  const log = element("ol", "loglist");
  log.tabIndex = 0;
  log.setAttribute("aria-label", texts.eventsLabel);
  const events: TrialEvent[] = [];
  const motion = new FrameInterpolator();
  const count = new FrameCounter();
  let interactive = false;
  let lastTime = -1;
  let status: TrialStatus | null = null;

  const buttons = {
    start: button(texts.newTrial, () => live.send({ type: "restart" }), "primary"),
    pause: button(texts.pause, () => live.send({ type: "study", action: status?.paused ? "resume" : "pause" })),
    reset: button(texts.reset, () => live.send({ type: "restart", again: true })),
    check: button(texts.checkGaze, () => live.send({ type: "study", action: "check_gaze" })),
    calibrate: button(texts.calibrateGaze, () => live.send({ type: "study", action: "calibrate_gaze" })),
    abort: button(texts.endTrial, () => live.send({ type: "study", action: "abort" }), "danger"),
  };
  buttons.reset.title = texts.resetAbout;
  buttons.check.title = texts.checkAbout;
  buttons.calibrate.title = texts.calibrateAbout;
  const conduct = new Conduct((message) => live.send(message));
  const methods = element("div", "methodrow");
  const drawer = new SignalsDrawer((open, escaped) => {
    drawerButton.setAttribute("aria-expanded", String(open));
    if (escaped) drawerButton.focus();
  });
  drawer.root.classList.add("floating");
  const drawerButton = button(strings.signals.overTime, () => drawer.toggle());
  drawerButton.setAttribute("aria-expanded", "false");
  // Where nothing has the focus.
  document.addEventListener("keydown", ({ target, code, ctrlKey, metaKey, altKey }) => {
    if (target === document.body && code === "KeyG" && !ctrlKey && !metaKey && !altKey) drawer.toggle();
  });
  const cameraBar = element("div", "camerabar", ...CAMERA_KINDS.map((kind) => button(CAMERA_NAMES[kind], () => chooseCamera(kind))));
  const pane = (title: string, classes: string, ...children: HTMLElement[]) =>
    element("section", `pane ${classes}`, element("h2", "", title), ...children);
  const actions = spectator ? null : pane(texts.trial, "", methods, element("div", "actionsgrid", ...Object.values(buttons)));
  const side = element("div", "side", actions, pane(texts.state, "", trial.root), pane(texts.rates, "", rates.root), pane(strings.latency.title, "", latencies.root));
  const logPane = element("section", "pane logpane", element("div", "loghead", element("h2", "", texts.events), button(texts.save, save)), log);
  const bar = element(
    "header",
    "deskbar",
    element("div", "logo", element("strong", "", "ProACT"), element("span", "title", spectator ? texts.spectatorHead : texts.head)),
    method,
    setup,
    seed,
    record,
    element("span", "push"),
    drawerButton,
    link,
  );
  pageRoot.append(
    bar,
    element("div", "experiment", element("section", "pane view", canvas, overview, state, stop.root, cameraBar), side),
    element("div", "signals", pane(texts.emg, "traces", traceCanvas, noArmband), logPane),
    drawer.root,
  );
  const stage = new SceneRenderer(canvas);
  chooseCamera("shoulder");

  const live = new LiveConnection(
    {
      reset() {
        motion.clear();
        count.restart();
        clearTrial();
        drawer.clear();
        stage.showGhost(null);
      },
      ghost: (arm) => stage.showGhost(arm),
      content: show,
      frame,
      events: addEvents,
      status(next) {
        status = next;
        showStatus();
      },
      signals,
      study(screen) {
        beginStudy();
        conduct.show(screen);
        showStatus(motion.latest?.finished);
      },
      connected(connected) {
        conduct.showConnected(connected);
        setText(link, connected ? texts.live : texts.offline);
        setClass(link, "off", !connected);
        setClass(link, "live", connected);
      },
      roundTrip: (ms) => rates.set(texts.roundTrip, `${fixed(ms, 1)} ms`, ms > 50),
      messageRefused(message) {
        console.warn(`ProACT: ${message}`);
        conduct.showNotice(message);
      },
    },
    spectator ? "spectator" : "experimenter",
  );

  /** Makes room for a study. What its plan decides is not offered beside it. */
  function beginStudy(): void {
    if (!actions || pageRoot.classList.contains("study")) return;
    pageRoot.classList.add("study");
    actions.remove();
    conduct.bar.secondaryButtons.prepend(buttons.check);
    bar.after(conduct.root, conduct.notes.root);
    // The notes stand where the events were.
    side.append(logPane);
    pageRoot.append(...conduct.dialogs);
  }

  function chooseCamera(kind: (typeof CAMERA_KINDS)[number]): void {
    stage.cameras.choose(kind, stage.taskScene);
    [...cameraBar.children].forEach((node, k) => setClass(node, "now", CAMERA_KINDS[k] === kind));
  }

  function show(content: PageContent): void {
    stage.show(content);
    drawer.show(content);
    interactive = content.interactive;
    setText(setup, `Set-up: ${content.setup}`);
    methods.replaceChildren(
      ...content.methods.map(({ name, title }) => {
        const choice = button(name, () => live.send({ type: "restart", method: name }));
        choice.title = texts.newWith(name, title);
        choice.disabled = !interactive;
        return choice;
      }),
    );
    for (const node of [buttons.start, buttons.reset]) node.disabled = !interactive;
  }

  function clearTrial(): void {
    log.replaceChildren();
    events.length = 0;
    lastTime = -1;
    stop.show(null);
    traces.clear();
    latencies.show([]);
  }

  function frame(next: DisplayFrame): void {
    if (next.time < lastTime) clearTrial();
    lastTime = next.time;
    motion.push(next, performance.now());
    count.countFrame(next.time);
    drawer.frame(next, methodOf(stage.content, next));
    addEvents(next.events);
    showStop(next.stop);
    setText(method, texts.method(next.method));
    for (const node of methods.children) setClass(node as HTMLElement, "now", node.textContent === next.method);
    const left = Math.max(next.time_left_secs, 0);
    const clock = `${Math.floor(left / 60)}:${String(Math.floor(left % 60)).padStart(2, "0")}`;
    setText(overview, texts.left(clock, scoreText(next.score, stage.content?.briefing)));
    const { name } = GESTURE_NAMES[next.gesture];
    const recognised = next.recognised === next.gesture ? name : `${next.recognised}: ${name}`;
    trial.set(texts.gesture, texts.recognised(recognised, Math.round(100 * next.confidence), Math.round(100 * next.effort)));
    trial.set(texts.source, next.emg_source);
    trial.set(texts.selection, next.target.object !== null ? texts.locked(objectName(next.target.object), next.target.locked) : "–");
    trial.set(texts.moves, next.mode?.name ?? "–");
    trial.set(texts.hand, next.hand.holds !== null ? texts.holds(objectName(next.hand.holds)) : next.hand.state);
    trial.set(texts.planner, next.planner.state === "failed" ? expandGestureCodes(next.planner.reason, SPECTATOR_CIRCUMSTANCES) || "failed" : next.planner.state);
    trial.set(texts.next, next.next !== null ? objectName(next.next) : "–");
    showStatus(next.finished);
  }

  function showStop(now: Stop | null): void {
    stop.show(now);
    const words = now && `${now.source.replaceAll("_", " ")}, ${now.cause.replaceAll("_", " ")} at ${fixed(now.since / 1000, 1)} s`;
    trial.set(texts.stop, words ?? "–", now !== null);
  }

  function showStatus(finished = false): void {
    const words = finished ? texts.finished : status?.aborted ? texts.ended : status?.paused ? texts.paused : texts.running;
    setText(state, words);
    setClass(state, "paused", words !== texts.running);
    setClass(state, "live", words === texts.running);
    setText(buttons.pause, status?.paused ? texts.resume : texts.pause);
    setClass(buttons.pause, "now", status?.paused ?? false);
    buttons.check.disabled = buttons.calibrate.disabled = !interactive || words !== texts.running;
    buttons.pause.disabled = buttons.abort.disabled = finished || !status?.can_pause || status.aborted;
    // Between the trials of a study nothing runs.
    const idle = pageRoot.classList.contains("study") && !conduct.showsScene;
    for (const node of [state, overview, seed, record, buttons.check]) node.hidden = idle;
    conduct.showTrial(words, overview.textContent ?? "", words === texts.paused);
    setText(seed, status ? texts.seed(status.seed) : "");
    setText(record, status ? (status.record ? texts.record(status.record) : texts.notRecorded) : "");
    setClass(record, "warn", status?.record === null);
  }

  function signals(next: Signals): void {
    traces.setSignals(next);
    drawer.addSignals(next);
    noArmband.hidden = next.emg_rate_hz > 0;
    const age = next.gaze_age_ms;
    rates.set(texts.tick, `${fixed(next.tick_mean_us)} / ${fixed(next.tick_max_us)} µs`, next.tick_mean_us > SLOW_TICK_US);
    rates.set(texts.pace, fixed(next.pace, 2), next.pace < 0.9);
    rates.set(texts.gaze, age === null ? texts.noGaze : texts.gazeRate(next.gaze_hz, age), (age ?? 0) > STALE_GAZE_MS);
    rates.set(texts.tracking, `${fixed(next.tracking_hz)} Hz`);
    if (next.emg_rate_hz > 0) {
      rates.set("EMG", `${fixed(next.emg_rate_hz)} Hz, ${fixed(100 * next.emg_lost_share, 1)} % lost`, next.emg_lost_share > 0.01);
    }
    rates.set(texts.pages, String(next.pages));
    latencies.show(next.latency);
  }

  function addEvents(more: TrialEvent[]): void {
    for (const event of more) {
      events.push(event);
      const text = event.event === "gesture_changed" ? strings.gestures.changed(GESTURE_NAMES[event.gesture].name) : eventText(event);
      log.prepend(element("li", event.event, element("time", "", fixed(event.time / 1000, 2)), element("span", "", text)));
    }
    while (log.children.length > LOG_LINES) log.lastElementChild?.remove();
  }

  function save(): void {
    const text = events.map((event) => JSON.stringify(event)).join("\n");
    const anchor = element("a");
    anchor.href = URL.createObjectURL(new Blob([`${text}\n`], { type: "application/jsonl" }));
    anchor.download = "events.jsonl";
    anchor.click();
    URL.revokeObjectURL(anchor.href);
  }

  let before = performance.now();
  const shown = { since: before, received: 0, drawn: 0 };
  stage.renderer.setAnimationLoop((wall: number) => {
    const seconds = Math.max((wall - before) / 1000, 0);
    before = wall;
    stage.draw(motion.interpolateAt(wall), motion.latest, seconds, wall);
    traces.draw();
    drawer.draw();
    if (wall - shown.since > 1000) {
      const span = (wall - shown.since) / 1000;
      rates.set(texts.frames, texts.frameRate(Math.round((count.received - shown.received) / span), count.dropped));
      stage.adaptQuality((stage.frameCount - shown.drawn) / span);
      Object.assign(shown, { since: wall, received: count.received, drawn: stage.frameCount });
    }
  });
  (window as unknown as { __proact: object }).__proact = {
    get frame() {
      return motion.latest;
    },
    get framesDrawn() {
      return stage.frameCount;
    },
    get channels() {
      return traces.channels;
    },
    get status() {
      return status;
    },
    live,
  };
}

try {
  start();
} catch (error) {
  pageRoot.append(element("div", "banner", drawErrorText(error)));
}
