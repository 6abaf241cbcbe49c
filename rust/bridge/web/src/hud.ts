// The heads-up display: everything that is not seen in the scene.

import { element, giveBack, setClass, setText, setWidth } from "./dom";
import { marking, type Marking } from "./marking";
import { StopBanner } from "./stopbanner";
import type { Briefing, DisplayFrame, GraspFault, MethodInfo, ObjectId, PageContent, PlannerView, PlanStatus, TrialEvent, TrialStatus } from "./generated/types";
import { objectColour, objectLabel, objectName, plainName } from "./objects";
import type { Aim } from "./aim";
import { distances, recognisedText } from "./hints";
import { capitalised } from "./protocol";
import { strings } from "./strings";

const words = strings.hud;
const MARKING_NAMES: Record<Marking, string> = words.markings;
const EMG_NAMES: Record<string, string> = words.sources;
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
  private readonly scoreLabel = element("span", "label");
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
  private readonly plannerLabel = element("span", "label", words.arm);
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
  private readonly clockLabel = element("span", "label", words.timeLeft);
  private readonly chooser = element("div", "chooser");
  private titles: Record<string, string> = {};
  private readonly settingsButton = element("button", "cog", words.settings);
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
    this.modeBox.append(row(words.moves, this.mode), this.modeNote, this.nextBar, this.aimRow);
    this.selectionRow.append(element("span", "label", words.selection), element("div", "line", this.selection, this.lock));
    this.heard.setAttribute("aria-live", "polite");
    this.toast.setAttribute("role", "status");
    this.link.setAttribute("role", "status");
    this.banner.setAttribute("role", "alert");
    this.banner.hidden = this.toast.hidden = this.over.hidden = this.sceneTitle.hidden = true;
    const brand = this.fold("brand", element("div", "logo", element("strong", "", "ProACT"), this.title), element("div", "methodline", this.method, this.methodName), this.chooser, element("div", "chips", this.setup, this.source));
    const status = this.fold(
      "status",
      words.armAndHand,
      row(words.gesture, this.gesture),
      meter(words.confidence, this.confidence, this.confidenceText),
      meter(words.effort, this.effort, this.effortText),
      this.modeBox,
      this.selectionRow,
      row(words.hand, this.hand),
      element("div", "row", this.plannerLabel, this.planner),
      this.progressBar,
      this.plannerNote,
    );
    const log = this.fold("log", words.events, this.events);
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
    setText(this.setup, words.setup(content.setup));
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
    button.title = words.newTrial(name, title);
    button.setAttribute("aria-label", button.title);
    button.addEventListener("click", (event) => {
      giveBack(event, button);
      this.chosen(name);
    });
    return button;
  }

  setConnected(connected: boolean, ever: boolean): void {
    setText(this.link, connected ? words.live : words.offline);
    setClass(this.link, "off", !connected);
    this.banner.hidden = connected;
    setText(
      this.banner,
      ever ? words.lost : words.connecting,
    );
  }

  setRate(framesPerSecond: number, drawnPerSecond: number, dropped: number): void {
    this.link.title = words.rates(Math.round(framesPerSecond), Math.round(drawnPerSecond), dropped);
  }

  /** What a study calls the scene; empty if nothing. */
  setSceneTitle(title: string): void {
    setText(this.sceneTitle, title);
    this.sceneTitle.hidden = title === "";
  }

  /** What the clock does, and why it stands still. */
  setStatus({ paused, held, waiting }: TrialStatus, drives: boolean): void {
    this.pause.hidden = !paused && !(held && !drives);
    setText(this.pause, paused ? words.paused : words.held);
    setText(this.clockLabel, waiting ? words.startsWithYou : held ? words.stands : words.timeLeft);
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
      if (event.event === "base_held") this.keepSaying(words.holdStill(eventText(event)));
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
    setText(this.methodName, this.titles[frame.method] ?? words.method);
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
    const free = this.briefing?.order === "any" ? words.anyObject : (GOALS[frame.asked?.type ?? ""] ?? words.allMoved);
    setText(this.next, frame.next !== null ? words.next(objectName(frame.next)) : free);

    setText(this.gesture, recognisedText(frame));
    setClass(this.gesture, "active", frame.gesture !== "no_motion");
    setWidth(this.confidence, frame.confidence);
    setText(this.confidenceText, `${Math.round(100 * frame.confidence)} %`);
    setWidth(this.effort, frame.effort);
    setText(this.effortText, `${Math.round(100 * frame.effort)} %`);

    this.aimRow.hidden = aim === null || frame.mode === null;
    if (aim) {
      setText(this.aimLabel, (frame.hand.holds !== null ? words.toTarget : words.toObject)(plainName(aim.object)));
      setText(this.aim, distances(aim));
    }
    this.modeBox.hidden = frame.mode === null;
    if (frame.mode) {
      const { name, directions, next_in_secs } = frame.mode;
      setText(this.mode, name);
      const next = next_in_secs === null ? "" : words.backIn(next_in_secs.toFixed(1));
      setText(this.modeNote, words.directions(directions[0], directions[1]) + next);
      setClass(this.nextBar, "idle", next_in_secs === null);
      setWidth(this.nextFill, 1 - (next_in_secs ?? 0));
    }

    const { target, hand } = frame;
    const held = hand.holds !== null;
    const something = held ? target.place !== null : target.object !== null;
    setText(
      this.selection,
      held ? (something ? words.place : words.noPlace) : target.object !== null ? objectName(target.object) : words.nothing,
    );
    const state = marking(frame);
    setText(this.lock, MARKING_NAMES[state]);
    this.lock.dataset["state"] = state;
    this.lock.hidden = !something;
    setText(this.hand, hand.holds !== null ? words.holds(objectName(hand.holds)) : words.handStates[hand.state]);

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
      const more = restarts ? words.pressR : "";
      setText(this.over, [words.over, result, more].filter(Boolean).join(" · "));
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
  return most === null ? `${score} ${name}` : words.scoreOf(score, most, name);
}

/** How a plan failed, in at most five words (those of the planner's `five_words`); the reason stands below. */
const FAILED: Record<string, string> = words.failed;

function plannerText(planner: PlannerView, jogs: boolean): { text: string; note: string; share: number | null; kind: string } {
  switch (planner.state) {
    case "idle":
      return { text: words.atRest, note: "", share: null, kind: "idle" };
    case "planning":
      return { text: words.planning, note: "", share: null, kind: "busy" };
    case "executing":
      return {
        text: words.moving,
        note: planner.intermediate ? words.asNear : "",
        share: planner.progress,
        kind: "busy",
      };
    case "arrived":
      return {
        text: planner.intermediate ? words.onTheWay : words.arrived,
        note: planner.intermediate ? words.goalOutOfReach : "",
        share: 1,
        kind: planner.intermediate ? "warn" : "good",
      };
    case "failed":
      return { text: jogs ? words.refused : (FAILED[planner.status] ?? words.notPossible), note: "", share: null, kind: "bad" };
  }
}

/** How looking for a way ended, as an event. */
const PLANNED: Record<PlanStatus, string> = { ...words.failed, ...words.planned };
const GRASP_FAULTS: Record<GraspFault, string> = words.graspFaults;
const happened = strings.events;

/** What is next where the task asks for no object. */
const GOALS: Record<string, string> = words.goals;

export function eventText(event: TrialEvent): string {
  const block = "object" in event && event.object !== null ? objectName(event.object) : "";
  switch (event.event) {
    case "object_attached":
      return happened.contactMade(block);
    case "object_released":
      return happened.contactLost(block);
    case "grasp_failed":
      return happened.notHeld(block, GRASP_FAULTS[event.reason]);
    case "locked":
      return block ? happened.locked(block) : happened.placeLocked;
    case "unlocked":
      return happened.unlocked;
    case "plan_requested":
      return happened.planning;
    case "plan_finished":
      // The reason names the links or objects that collide.
      return event.reason ? happened.planFailed(PLANNED[event.status], event.reason) : PLANNED[event.status];
    case "plans_failed":
      return happened.plansFailed(event.count, event.reason);
    case "method_note":
      return event.text;
    case "motion_stopped":
      return happened.motionStopped;
    case "motion_finished":
      return happened.motionFinished;
    case "object_on_target":
      return happened.onTarget(block, (100 * event.distance).toFixed(1));
    case "object_off_target":
      return happened.offTarget(block);
    case "object_crossed":
      return happened.crossed(block);
    case "goal_reached":
      return happened.goalReached(event.number);
    case "goal_missed":
      return happened.goalMissed(event.number);
    case "practice_finished":
      return happened.practiceOver;
    case "emg_gap":
      return happened.emgGap;
    case "stopped":
      return happened.stopped(event.reason);
    case "rearmed":
      return happened.rearmed;
    case "base_held":
      return happened.baseHeld((100 * event.distance).toFixed(0));
    case "base_follows":
      return happened.baseFollows;
    case "contacts_unsolved":
      return happened.unsolved;
    case "trial_finished":
      return happened.over;
    default:
      return event.event.replaceAll("_", " ");
  }
}
