// The heads-up display: everything that is not seen in the scene.

import { element, giveBack, setClass, setText, setWidth } from "./dom";
import { marking, type Marking } from "./marking";
import { StopBanner } from "./stopbanner";
import type { Briefing, DisplayFrame, GraspFault, MethodInfo, ObjectId, PageContent, PlannerView, PlanStatus, TrialEvent, TrialStatus } from "./generated/types";
import { objectColour, objectLabel, objectName, plainName } from "./objects";
import type { Aim } from "./aim";
import { distances, recognisedText } from "./hints";
import { capitalised } from "./protocol";

const MARKING_NAMES: Record<Marking, string> = {
  free: "Free",
  locked: "Locked",
  reachable: "Reachable",
  unreachable: "Out of reach",
};
const EMG_NAMES: Record<string, string> = {
  recording: "EMG: recording",
  synthetic: "EMG: synthetic",
  keys: "Gestures: keys",
};
/** More objects than these have no pips of their own. */
const MOST_PIPS = 16;
/** Lines of the event list. */
const EVENTS_SHOWN = 6;

/** Events that are told to a screen reader: those that change what one has to do. */
const HEARD = new Set<TrialEvent["event"]>([
  "locked",
  "unlocked",
  "plan_finished",
  "motion_finished",
  "object_attached",
  "object_released",
  "grasp_failed",
  "object_on_target",
  "object_off_target",
  "object_crossed",
  "trial_finished",
  "rearmed",
]);

/** There is room for all cards beside the scene; as in layout.css. */
const ROOMY = "(min-width: 1000px) and (min-height: 560px)";

export class Hud {
  readonly root = element("div", "hud");
  /** Where the scene is, which no card covers. */
  readonly view = element("div", "view");
  /** The cards at both sides; in a small window one after the other. */
  readonly left = element("div", "left");
  readonly right = element("div", "right");
  private readonly folds: HTMLDetailsElement[] = [];
  /** Buttons of the page itself. */
  readonly corner = element("div", "corner");
  private readonly title = element("span", "title");
  private readonly setup = element("span", "chip");
  private readonly source = element("span", "chip");
  private readonly method = element("span", "method");
  private readonly methodName = element("span", "methodname");
  private readonly clock = element("span", "clock", "–:––");
  private readonly count = element("span", "count");
  private readonly pipRow = element("div", "pips");
  private pips: HTMLElement[] = [];
  private briefing: Briefing | undefined;
  private readonly scoreLabel = element("span", "label", "On target");
  private readonly next = element("span", "next");
  private readonly link = element("span", "link");
  private readonly gesture = element("b", "value");
  private readonly confidence = element("i", "fill");
  private readonly confidenceText = element("span", "small");
  private readonly effort = element("i", "fill");
  private readonly effortText = element("span", "small");
  private readonly selection = element("b", "value");
  private readonly lock = element("span", "lock");
  private readonly hand = element("b", "value");
  private readonly planner = element("b", "value");
  private readonly plannerNote = element("p", "note");
  private readonly mode = element("b", "value");
  private readonly modeNote = element("p", "note");
  private readonly modeBox = element("div", "modebox");
  private readonly aimLabel = element("span", "label");
  private readonly aim = element("b", "value");
  private readonly aimRow = element("div", "row");
  private readonly nextFill = element("i", "fill");
  private readonly nextBar = element("div", "bar", this.nextFill);
  private readonly selectionRow = element("div", "row");
  private readonly plannerLabel = element("span", "label", "Arm");
  private readonly progress = element("i", "fill");
  private readonly progressBar = element("div", "bar", this.progress);
  private readonly events = element("ol", "events");
  /** What happens, for those who do not see it. */
  private readonly heard = element("div", "only-heard");
  private readonly sceneTitle = element("h2", "scenetitle card");
  private readonly stop = new StopBanner();
  /** Why there is nothing new to see; over everything else. */
  readonly banner = element("div", "banner");
  private readonly toast = element("div", "toast");
  private readonly over = element("div", "over card");
  private readonly pause = element("div", "over card");
  private readonly clockLabel = element("span", "label", "Time left");
  private readonly chooser = element("div", "chooser");
  private titles: Record<string, string> = {};
  private readonly settingsButton = element("button", "cog", "Settings");
  private readonly onTarget = new Set<ObjectId>();
  private lastTime = -1;
  private toastTimer = 0;

  constructor(
    private readonly chosen: (method: string) => void,
    wheel: HTMLElement,
    settings: () => void,
  ) {
    this.settingsButton.type = "button";
    this.settingsButton.addEventListener("click", settings);
    this.corner.append(this.settingsButton);
    this.pause.hidden = true;
    const row = (label: string, ...children: HTMLElement[]) =>
      element("div", "row", element("span", "label", label), ...children);
    const meter = (label: string, fill: HTMLElement, text: HTMLElement) =>
      element("div", "meter", element("span", "label", label), element("div", "bar", fill), text);
    this.aimRow.append(this.aimLabel, this.aim);
    this.modeBox.append(row("Moves", this.mode), this.modeNote, this.nextBar, this.aimRow);
    this.selectionRow.append(element("span", "label", "Selection"), element("div", "line", this.selection, this.lock));
    this.heard.setAttribute("aria-live", "polite");
    this.toast.setAttribute("role", "status");
    this.link.setAttribute("role", "status");
    this.banner.setAttribute("role", "alert");
    this.banner.hidden = this.toast.hidden = this.over.hidden = this.sceneTitle.hidden = true;
    const brand = this.fold("brand", element("div", "logo", element("strong", "", "ProACT"), this.title), element("div", "methodline", this.method, this.methodName), this.chooser, element("div", "chips", this.setup, this.source));
    const status = this.fold(
      "status",
      "Arm and hand",
      row("Gesture", this.gesture),
      meter("Confidence", this.confidence, this.confidenceText),
      meter("Effort", this.effort, this.effortText),
      this.modeBox,
      this.selectionRow,
      row("Hand", this.hand),
      element("div", "row", this.plannerLabel, this.planner),
      this.progressBar,
      this.plannerNote,
    );
    const log = this.fold("log", "Events", this.events);
    this.left.append(brand, log);
    this.right.append(element("div", "card connection", this.link, wheel, this.corner), status);
    this.view.append(this.sceneTitle, this.stop.root, this.over, this.pause, this.toast);
    this.root.append(
      element(
        "header",
        "top card score",
        element("div", "clockbox", this.clockLabel, this.clock),
        element("div", "blocks", this.scoreLabel, this.count),
        this.pipRow,
        this.next,
      ),
      this.view,
      element("div", "cards", this.left, this.right),
      this.heard,
    );
    // Open where there is room for it, folded where there is not.
    const roomy = window.matchMedia(ROOMY);
    const fits = () => this.folds.forEach((fold) => (fold.open = roomy.matches));
    roomy.addEventListener("change", fits);
    fits();
  }

  /** A card that can be folded up to its title. */
  private fold(classes: string, title: string | HTMLElement, ...children: HTMLElement[]): HTMLElement {
    const summary = element("summary", "", typeof title === "string" ? element("span", "label", title) : title);
    const card = element("details", `card ${classes}`, summary, ...children);
    this.folds.push(card);
    return card;
  }

  setContent(content: PageContent): void {
    setText(this.title, content.title);
    setText(this.setup, `Set-up: ${content.setup}`);
    this.briefing = content.briefing;
    this.setup.title = content.briefing.text;
    setText(this.scoreLabel, capitalised(content.briefing.score_name));
    const count = content.scene.objects.length;
    this.pips = Array.from({ length: count <= MOST_PIPS ? count : 0 }, (_, id) => {
      const pip = element("i", "pip", objectLabel(id));
      pip.style.setProperty("--pip", objectColour(id));
      return pip;
    });
    this.pipRow.replaceChildren(...this.pips);
    const known = [content.method, ...content.methods];
    this.titles = Object.fromEntries(known.map(({ name, title }) => [name, title]));
    this.chooser.replaceChildren(...content.methods.map((method) => this.choice(method)));
  }

  private choice({ name, title }: MethodInfo): HTMLElement {
    const button = element("button", "methodbutton", name);
    button.type = "button";
    button.title = `New trial with method ${name}: ${title}`;
    button.setAttribute("aria-label", button.title);
    button.addEventListener("click", (event) => {
      giveBack(event, button);
      this.chosen(name);
    });
    return button;
  }

  setConnected(connected: boolean, ever: boolean): void {
    setText(this.link, connected ? "Live" : "Offline");
    setClass(this.link, "off", !connected);
    this.banner.hidden = connected;
    setText(
      this.banner,
      ever
        ? "The connection to ProACT is lost. This page comes back by itself as soon as the program runs again."
        : "Connecting to ProACT …",
    );
  }

  setRate(framesPerSecond: number, drawnPerSecond: number, dropped: number): void {
    this.link.title = `${Math.round(framesPerSecond)} frames a second received, ${Math.round(drawnPerSecond)} drawn, ${dropped} lost`;
  }

  /** What a study calls the scene; empty if nothing. */
  setSceneTitle(title: string): void {
    setText(this.sceneTitle, title);
    this.sceneTitle.hidden = title === "";
  }

  /** What the clock does, and why it stands still. */
  setStatus({ paused, held, waiting }: TrialStatus, drives: boolean): void {
    this.pause.hidden = !paused && !(held && !drives);
    setText(this.pause, paused ? "Paused by the experimenter" : "Paused: who drives reads a dialog");
    setText(this.clockLabel, waiting ? "Starts with you" : held ? "Paused" : "Time left");
    setClass(this.clock, "waits", waiting || held);
  }

  say(message: string): void {
    setText(this.toast, message);
    this.toast.hidden = false;
    window.clearTimeout(this.toastTimer);
    this.toastTimer = window.setTimeout(() => (this.toast.hidden = true), 2500);
  }

  /** Says it until something else is said. */
  private keepSaying(message: string): void {
    window.clearTimeout(this.toastTimer);
    setText(this.toast, message);
    this.toast.hidden = false;
  }

  addEvents(events: TrialEvent[]): void {
    for (const event of events) {
      if (event.event === "object_on_target" || event.event === "object_crossed") this.onTarget.add(event.object);
      if (event.event === "object_attached") this.onTarget.delete(event.object);
      // The gesture is on display already; its changes would flood the list.
      if (event.event === "gesture_changed") continue;
      // Contact made and lost say the same.
      if (event.event === "grasp_made" || event.event === "grasp_ended") continue;
      if (event.event === "base_held") this.keepSaying(`${eventText(event)}. Hold still, or move back`);
      if (event.event === "base_follows") this.say(eventText(event));
      const line = element(
        "li",
        event.event,
        element("time", "", (event.time / 1000).toFixed(1)),
        element("span", "", eventText(event)),
      );
      this.events.prepend(line);
      if (HEARD.has(event.event)) setText(this.heard, eventText(event));
    }
    // The newest on top; a screen holds only so many.
    while (this.events.children.length > EVENTS_SHOWN) this.events.lastElementChild?.remove();
  }

  /** `restarts`: this page may begin another trial. `way`: what ends a stop, for whoever drives. */
  update(frame: DisplayFrame, restarts: boolean, way: string, aim: Aim | null): void {
    if (frame.time < this.lastTime) this.startTrial();
    this.lastTime = frame.time;
    this.addEvents(frame.events);
    this.stop.show(frame.stop, way);
    setText(this.method, frame.method);
    setText(this.methodName, this.titles[frame.method] ?? "Method");
    this.chooser.hidden = !restarts;
    this.method.hidden = restarts;
    for (const button of this.chooser.children) setClass(button as HTMLElement, "now", button.textContent === frame.method);
    setText(this.source, EMG_NAMES[frame.emg_source] ?? frame.emg_source);
    setClass(this.source, "warn", frame.emg_source === "synthetic");

    const left = Math.max(frame.time_left_secs, 0);
    setText(this.clock, `${Math.floor(left / 60)}:${String(Math.floor(left % 60)).padStart(2, "0")}`);
    setClass(this.clock, "late", left < 30);
    const most = this.briefing?.most ?? null;
    setText(this.count, most === null ? `${frame.score}` : `${frame.score} / ${most}`);
    this.pips.forEach((pip, id) => {
      setClass(pip, "done", this.onTarget.has(id));
      setClass(pip, "wanted", frame.next === id && !frame.finished);
    });
    const free = this.briefing?.order === "any" ? "Any object" : (GOALS[frame.asked?.type ?? ""] ?? "All moved");
    setText(this.next, frame.next !== null ? `Next: ${objectName(frame.next)}` : free);

    setText(this.gesture, recognisedText(frame));
    setClass(this.gesture, "active", frame.gesture !== "no_motion");
    setWidth(this.confidence, frame.confidence);
    setText(this.confidenceText, `${Math.round(100 * frame.confidence)} %`);
    setWidth(this.effort, frame.effort);
    setText(this.effortText, `${Math.round(100 * frame.effort)} %`);

    this.aimRow.hidden = aim === null || frame.mode === null;
    if (aim) {
      setText(this.aimLabel, `To ${frame.hand.holds !== null ? "the target of " : ""}${plainName(aim.object)}`);
      setText(this.aim, distances(aim));
    }
    this.modeBox.hidden = frame.mode === null;
    if (frame.mode) {
      const { name, directions, next_in_secs } = frame.mode;
      setText(this.mode, name);
      const next = next_in_secs === null ? "" : ` · back in ${next_in_secs.toFixed(1)} s`;
      setText(this.modeNote, `Wrist extension: ${directions[0]} · wrist flexion: ${directions[1]}${next}`);
      setClass(this.nextBar, "idle", next_in_secs === null);
      setWidth(this.nextFill, 1 - (next_in_secs ?? 0));
    }

    const { target, hand } = frame;
    const held = hand.holds !== null;
    const something = held ? target.place !== null : target.object !== null;
    setText(
      this.selection,
      held ? (something ? "Place" : "No place") : target.object !== null ? objectName(target.object) : "Nothing",
    );
    const state = marking(frame);
    setText(this.lock, MARKING_NAMES[state]);
    this.lock.dataset["state"] = state;
    this.lock.hidden = !something;
    const states = { open: "Open", closing: "Closing …", closed: "Closed", opening: "Opening …" };
    setText(this.hand, hand.holds !== null ? `Holds ${objectName(hand.holds)}` : states[hand.state]);

    const jogs = frame.mode !== null;
    const { text, note, share, kind } = plannerText(frame.planner, jogs);
    this.selectionRow.hidden = jogs;
    setText(this.planner, text);
    this.planner.dataset["kind"] = kind;
    setText(this.plannerNote, note);
    this.plannerNote.hidden = note === "";
    setClass(this.progressBar, "idle", share === null);
    setWidth(this.progress, share ?? 0);

    this.over.hidden = !frame.finished;
    if (frame.finished) {
      const result = scoreText(frame.score, this.briefing);
      const more = restarts ? "Press R for a new trial" : "";
      setText(this.over, [`Trial over`, result, more].filter(Boolean).join(" · "));
    }
  }

  /** Forgets the trial that was on display. */
  startTrial(): void {
    this.events.replaceChildren();
    this.onTarget.clear();
    this.stop.show(null);
    this.lastTime = -1;
  }
}

/** What the task counts, such as "2 of 4 blocks on target". */
export function scoreText(score: number, briefing: Briefing | undefined): string {
  const most = briefing?.most ?? null;
  const name = briefing?.score_name ?? "";
  return most === null ? `${score} ${name}` : `${score} of ${most} ${name}`;
}

/** How a plan failed, in at most five words (those of the planner's `five_words`); the reason stands below. */
const FAILED: Record<string, string> = {
  no_plan: "No way was found",
  unreachable: "Out of reach",
  start_in_collision: "Arm is stuck on something",
  goal_in_collision: "Something is in the way",
};

function plannerText(planner: PlannerView, jogs: boolean): { text: string; note: string; share: number | null; kind: string } {
  switch (planner.state) {
    case "idle":
      return { text: "At rest", note: "", share: null, kind: "idle" };
    case "planning":
      return { text: "Looking for a way …", note: "", share: null, kind: "busy" };
    case "executing":
      return {
        text: "Moving",
        note: planner.intermediate ? "Out of reach: moving as near as possible" : "",
        share: planner.progress,
        kind: "busy",
      };
    case "arrived":
      return {
        text: planner.intermediate ? "Stopped on the way" : "Arrived",
        note: planner.intermediate ? "The goal is out of reach from here" : "",
        share: 1,
        kind: planner.intermediate ? "warn" : "good",
      };
    case "failed":
      return { text: jogs ? "Refused" : (FAILED[planner.status] ?? "Not possible now"), note: "", share: null, kind: "bad" };
  }
}

/** How looking for a way ended, as an event. */
const PLANNED: Record<PlanStatus, string> = {
  ok: "A way was found",
  intermediate: "A way was found, part of the way",
  no_plan: "No way was found",
  unreachable: "Out of reach",
  start_in_collision: "Arm is stuck on something",
  goal_in_collision: "Something is in the way",
  invalid: "Not possible now",
  cancelled: "Stopped looking for a way",
};

const GRASP_FAULTS: Record<GraspFault, string> = {
  no_grasp: "the hand has no grasp for this width",
  nothing: "nothing was between the fingers",
  not_touched: "the fingers did not touch it",
  one_digit: "one finger alone touched it",
  not_opposing: "the fingers do not press against each other",
  slipped: "it slipped out of the fingers",
};

/** What is next where the task asks for no object. */
const GOALS: Record<string, string> = { ball: "Hand into the ball", posture: "Arm like its ghost" };

export function eventText(event: TrialEvent): string {
  const block = "object" in event && event.object !== null ? objectName(event.object) : "";
  switch (event.event) {
    case "object_attached":
      return `Contact made: ${block}`;
    case "object_released":
      return `Contact lost: ${block}`;
    case "grasp_failed":
      return `Not held${block ? `: ${block}` : ""}, ${GRASP_FAULTS[event.reason]}`;
    case "locked":
      return block ? `Locked: ${block}` : "Place locked";
    case "unlocked":
      return "Lock off";
    case "plan_requested":
      return "Looking for a way";
    case "plan_finished":
      return PLANNED[event.status];
    case "method_note":
      return event.text;
    case "motion_stopped":
      return "Motion stopped";
    case "motion_finished":
      return "Motion finished";
    case "object_on_target":
      return `On target: ${block} (${(100 * event.distance).toFixed(1)} cm)`;
    case "object_off_target":
      return `Off target: ${block}`;
    case "object_crossed":
      return `Crossed: ${block}`;
    case "goal_reached":
      return `Goal ${event.number} reached`;
    case "goal_missed":
      return `Goal ${event.number}: time is up`;
    case "practice_finished":
      return "Practice is over: from now on it counts";
    case "emg_gap":
      return "Gap in the EMG";
    case "stopped":
      return `Stopped: ${event.reason}`;
    case "rearmed":
      return "Relaxed: gestures act again";
    case "base_held":
      return `Paused: the shoulder jumped by ${(100 * event.distance).toFixed(0)} cm`;
    case "base_follows":
      return "The arm follows the shoulder again";
    case "contacts_unsolved":
      return "The physics is inexact for a moment";
    case "trial_finished":
      return "Trial over";
    default:
      return event.event.replaceAll("_", " ");
  }
}
