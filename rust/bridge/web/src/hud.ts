// The heads-up display: everything that is not seen in the scene.

import { element, returnFocus, setClass, setText, setWidth } from "./dom";
import { selectionState, type SelectionState } from "./selectionState";
import { StopBanner } from "./stopBanner";
import type { Briefing, DisplayFrame, GraspFault, MethodInfo, ObjectId, PageContent, PlannerView, PlanStatus, TrialEvent, TrialStatus } from "./generated/types";
import { objectColor, objectLabel, objectName, plainName } from "./objects";
import type { JogGoal } from "./jogGoal";
import { distanceText, recognizedText } from "./hints";
import { capitalize } from "./protocol";
import { strings } from "./strings";
import { fixed } from "./numbers";

const words = strings.hud;
const SELECTION_NAMES: Record<SelectionState, string> = words.markings;
const EMG_NAMES: Record<string, string> = words.sources;
/** More objects than these have no pips of their own. */
const MAX_PIPS = 16;
/** Lines of the event list. */
const MAX_EVENTS_SHOWN = 6;

/** Events that are told to a screen reader: those that change what one has to do. */
const ANNOUNCED_EVENTS = new Set<TrialEvent["event"]>([
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
const WIDE_LAYOUT = "(min-width: 1000px) and (min-height: 560px)";

export class Hud {
  readonly root = element("div", "hud");
  /** Where the scene is, which no card covers. */
  readonly view = element("div", "view");
  /** The cards at both sides; in a small window one after the other. */
  readonly left = element("div", "left");
  readonly right = element("div", "right");
  private readonly foldedCards: HTMLDetailsElement[] = [];
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
  private readonly jogLabel = element("span", "label");
  private readonly jogText = element("b", "value");
  private readonly jogRow = element("div", "row");
  private readonly nextFill = element("i", "fill");
  private readonly nextBar = element("div", "bar", this.nextFill);
  private readonly selectionRow = element("div", "row");
  private readonly plannerLabel = element("span", "label", words.arm);
  private readonly progress = element("i", "fill");
  private readonly progressBar = element("div", "bar", this.progress);
  private readonly events = element("ol", "events");
  /** What happens, for those who do not see it. */
  private readonly liveRegion = element("div", "only-heard");
  private readonly sceneTitle = element("h2", "scenetitle card");
  private readonly stop = new StopBanner();
  private readonly delay = element("div", "delay-banner");
  /** Why there is nothing new to see; over everything else. */
  readonly banner = element("div", "banner");
  private readonly toast = element("div", "toast");
  private readonly trialOver = element("div", "over card");
  private readonly pause = element("div", "over card");
  private readonly clockLabel = element("span", "label", words.timeLeft);
  private readonly methodMenu = element("div", "chooser");
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
    this.jogRow.append(this.jogLabel, this.jogText);
    this.modeBox.append(row(words.moves, this.mode), this.modeNote, this.nextBar, this.jogRow);
    this.selectionRow.append(element("span", "label", words.selection), element("div", "line", this.selection, this.lock));
    this.liveRegion.setAttribute("aria-live", "polite");
    this.toast.setAttribute("role", "status");
    this.link.setAttribute("role", "status");
    this.banner.setAttribute("role", "alert");
    this.delay.setAttribute("role", "alert");
    this.delay.hidden = this.banner.hidden = this.toast.hidden = this.trialOver.hidden = this.sceneTitle.hidden = true;
    const brand = this.makeFoldable(
      "brand",
      element("div", "logo", element("strong", "", "ProACT"), this.title),
      element("div", "methodline", this.method, this.methodName),
      this.methodMenu,
      element("div", "chips", this.setup, this.source),
    );
    const status = this.makeFoldable(
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
    const log = this.makeFoldable("log", words.events, this.events);
    this.left.append(brand, log);
    this.right.append(element("div", "card connection", this.link, wheel, this.corner), status);
    this.view.append(this.sceneTitle, this.stop.root, this.delay, this.trialOver, this.pause, this.toast);
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
      this.liveRegion,
    );
    // Open where there is room for it, folded where there is not.
    const roomy = window.matchMedia(WIDE_LAYOUT);
    const fits = () => this.foldedCards.forEach((fold) => (fold.open = roomy.matches));
    roomy.addEventListener("change", fits);
    fits();
  }

  /** A card that can be folded up to its title. */
  private makeFoldable(classes: string, title: string | HTMLElement, ...children: HTMLElement[]): HTMLElement {
    const summary = element("summary", "", typeof title === "string" ? element("span", "label", title) : title);
    const card = element("details", `card ${classes}`, summary, ...children);
    this.foldedCards.push(card);
    return card;
  }

  setContent(content: PageContent): void {
    setText(this.title, content.title);
    setText(this.setup, words.setup(content.setup));
    this.briefing = content.briefing;
    this.setup.title = content.briefing.text;
    setText(this.scoreLabel, capitalize(content.briefing.score_name));
    const count = content.scene.objects.length;
    this.pips = Array.from({ length: count <= MAX_PIPS ? count : 0 }, (_, id) => {
      const pip = element("i", "pip", objectLabel(id));
      pip.style.setProperty("--pip", objectColor(id));
      return pip;
    });
    this.pipRow.replaceChildren(...this.pips);
    const known = [content.method, ...content.methods];
    this.titles = Object.fromEntries(known.map(({ name, title }) => [name, title]));
    this.methodMenu.replaceChildren(...content.methods.map((method) => this.methodOption(method)));
  }

  private methodOption({ name, title }: MethodInfo): HTMLElement {
    const button = element("button", "methodbutton", name);
    button.type = "button";
    button.title = words.newTrial(name, title);
    button.setAttribute("aria-label", button.title);
    button.addEventListener("click", (event) => {
      returnFocus(event, button);
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

  /** The line's round trip, ms, while it is longer than the trial allows. */
  setDelay(ms: number | null): void {
    if (ms !== null) setText(this.delay, words.delayed(fixed(ms)));
    this.delay.hidden = ms === null;
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

  showToast(message: string): void {
    setText(this.toast, message);
    this.toast.hidden = false;
    window.clearTimeout(this.toastTimer);
    this.toastTimer = window.setTimeout(() => (this.toast.hidden = true), 2500);
  }

  /** Says it until something else is said. */
  private showPermanentToast(message: string): void {
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
      if (event.event === "base_held") this.showPermanentToast(words.holdStill(eventText(event)));
      if (event.event === "base_follows") this.showToast(eventText(event));
      const line = element(
        "li",
        event.event,
        element("time", "", fixed(event.time / 1000, 1)),
        element("span", "", eventText(event)),
      );
      this.events.prepend(line);
      if (ANNOUNCED_EVENTS.has(event.event)) setText(this.liveRegion, eventText(event));
    }
    // The newest on top; a screen holds only so many.
    while (this.events.children.length > MAX_EVENTS_SHOWN) this.events.lastElementChild?.remove();
  }

  /** `restarts`: this page may begin another trial. `way`: what ends a stop, for whoever drives. */
  update(frame: DisplayFrame, restarts: boolean, way: string, aim: JogGoal | null): void {
    if (frame.time < this.lastTime) this.startTrial();
    this.lastTime = frame.time;
    this.addEvents(frame.events);
    this.stop.show(frame.stop, way);
    setText(this.method, frame.method);
    setText(this.methodName, this.titles[frame.method] ?? words.method);
    this.methodMenu.hidden = !restarts;
    this.method.hidden = restarts;
    for (const button of this.methodMenu.children) setClass(button as HTMLElement, "now", button.textContent === frame.method);
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
    const free = this.briefing?.order === "any" ? words.anyObject : (GOAL_TEXTS[frame.asked?.type ?? ""] ?? words.allMoved);
    setText(this.next, frame.next !== null ? words.next(objectName(frame.next)) : free);

    setText(this.gesture, recognizedText(frame));
    setClass(this.gesture, "active", frame.gesture !== "no_motion");
    setWidth(this.confidence, frame.confidence);
    setText(this.confidenceText, `${Math.round(100 * frame.confidence)} %`);
    setWidth(this.effort, frame.effort);
    setText(this.effortText, `${Math.round(100 * frame.effort)} %`);

    this.jogRow.hidden = aim === null || frame.mode === null;
    if (aim) {
      setText(this.jogLabel, (frame.hand.holds !== null ? words.toTarget : words.toObject)(plainName(aim.object)));
      setText(this.jogText, distanceText(aim));
    }
    this.modeBox.hidden = frame.mode === null;
    if (frame.mode) {
      const { name, directions, next_in_secs } = frame.mode;
      setText(this.mode, name);
      const next = next_in_secs === null ? "" : words.backIn(fixed(next_in_secs, 1));
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
    const state = selectionState(frame);
    setText(this.lock, SELECTION_NAMES[state]);
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

    this.trialOver.hidden = !frame.finished;
    if (frame.finished) {
      const result = scoreText(frame.score, this.briefing);
      const more = restarts ? words.pressR : "";
      setText(this.trialOver, [words.over, result, more].filter(Boolean).join(" · "));
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
const PLAN_FAILURE_LABELS: Record<string, string> = words.failed;

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
      return { text: jogs ? words.refused : (PLAN_FAILURE_LABELS[planner.status] ?? words.notPossible), note: "", share: null, kind: "bad" };
  }
}

/** How looking for a way ended, as an event. */
const PLAN_STATUS_TEXTS: Record<PlanStatus, string> = { ...words.failed, ...words.planned };
const GRASP_FAULTS: Record<GraspFault, string> = words.graspFaults;
const eventTexts = strings.events;

/** What is next where the task asks for no object. */
const GOAL_TEXTS: Record<string, string> = words.goals;

export function eventText(event: TrialEvent): string {
  const block = "object" in event && event.object !== null ? objectName(event.object) : "";
  switch (event.event) {
    case "object_attached":
      return eventTexts.contactMade(block);
    case "object_released":
      return eventTexts.contactLost(block);
    case "grasp_failed":
      return eventTexts.notHeld(block, GRASP_FAULTS[event.reason]);
    case "locked":
      return block ? eventTexts.locked(block) : eventTexts.placeLocked;
    case "unlocked":
      return eventTexts.unlocked;
    case "plan_requested":
      return eventTexts.planning;
    case "plan_finished":
      // The reason names the links or objects that collide.
      return event.reason ? eventTexts.planFailed(PLAN_STATUS_TEXTS[event.status], event.reason) : PLAN_STATUS_TEXTS[event.status];
    case "plans_failed":
      return eventTexts.plansFailed(event.count, event.reason);
    case "method_note":
      return event.text;
    case "motion_stopped":
      return eventTexts.motionStopped;
    case "motion_finished":
      return eventTexts.motionFinished;
    case "object_on_target":
      return eventTexts.onTarget(block, fixed(100 * event.distance, 1));
    case "object_off_target":
      return eventTexts.offTarget(block);
    case "object_crossed":
      return eventTexts.crossed(block);
    case "goal_reached":
      return eventTexts.goalReached(event.number);
    case "goal_missed":
      return eventTexts.goalMissed(event.number);
    case "practice_finished":
      return eventTexts.practiceOver;
    case "emg_gap":
      return eventTexts.emgGap;
    case "stopped":
      return eventTexts.stopped(event.reason);
    case "rearmed":
      return eventTexts.rearmed;
    case "base_held":
      return eventTexts.baseHeld(fixed(100 * event.distance));
    case "base_follows":
      return eventTexts.baseFollows;
    case "contacts_unsolved":
      return eventTexts.unsolved;
    case "trial_finished":
      return eventTexts.over;
    default:
      return event.event.replaceAll("_", " ");
  }
}
