// Ways to drive with less than a keyboard and a mouse: the mouse's own buttons, resting the pointer, and a single switch.

import { element, setClass, setText } from "./dom";
import type { Gesture } from "./generated/types";
import type { Marks, Place } from "./marks";
import { labelOf } from "./marks";
import { GESTURE_NAMES } from "./protocol";
import { Scanner, type Choice } from "./scanning";
import type { GestureKey, Settings } from "./settings";
import { strings } from "./strings";

/** A tap is so long, ms: the testbed takes a gesture at its next control step, 10 ms later. */
const TAP_MS = 200;
/** A pointer that moves less than this rests, CSS pixels. */
const RESTS = 12;
/** Turns of the wheel closer together than this are one, ms. */
const WHEEL_MS = 300;

export interface AccessHandlers {
  /** Presses or lets go of a gesture. */
  hold(source: string, gesture: Gesture, down: boolean): void;
  restart(): void;
  /** Another trial may be begun. */
  restarts(): boolean;
  /** Keys and mouse drive now: no dialog is open, and this page has the wheel. */
  drives(): boolean;
  /** The mouse's buttons turn the scene instead. */
  turns(): boolean;
  /** The method follows the gaze. */
  looks(): boolean;
  /** What one may want to look at now, the likeliest first. */
  places(): Place[];
}

export class Access {
  readonly root = element("div", "card scan");
  private readonly offer = element("b");
  private readonly scanner = new Scanner(
    (gesture) => gesture === "wrist_extension" || (!this.handlers.looks() && gesture === "wrist_flexion"),
    () => this.handlers.restarts(),
  );
  private turned = 0;
  private rested: { x: number; y: number; since: number; done: boolean; over: EventTarget | null } | null = null;
  private resting: HTMLElement | null = null;

  constructor(
    private readonly canvas: HTMLCanvasElement,
    private readonly marks: Marks,
    private readonly handlers: AccessHandlers,
    private settings: Settings,
  ) {
    this.root.append(element("span", "label", strings.access.switch), this.offer);
    this.root.setAttribute("role", "status");
    this.root.hidden = true;
    canvas.addEventListener("pointerdown", (event) => this.button(event, true));
    for (const end of ["pointerup", "pointercancel", "lostpointercapture"] as const) {
      canvas.addEventListener(end, (event) => this.button(event, false));
    }
    canvas.addEventListener("contextmenu", (event) => this.mouseDrives() && event.preventDefault());
    canvas.addEventListener("wheel", (event) => this.wheel(event), { passive: false });
    window.addEventListener("pointermove", (event) => this.rest(event));
    window.addEventListener("keydown", (event) => this.pressed(event), true);
    window.addEventListener("pointerdown", (event) => this.clicked(event), true);
    window.addEventListener("blur", () => this.letGo());
  }

  change(settings: Settings): void {
    this.letGo();
    this.settings = settings;
  }

  /** Locks what is looked at. */
  lock(): void {
    if (this.handlers.drives()) this.tap("wrist_flexion");
  }

  /** Lets go of everything that is held here. */
  letGo(): void {
    this.scanner.reset();
    this.endRest();
    for (const gesture of ["wrist_extension", "wrist_flexion"] as const) {
      this.handlers.hold(`switch ${gesture}`, gesture, false);
      this.handlers.hold(`mouse ${gesture}`, gesture, false);
    }
  }

  /** Called once per picture. */
  update(nowMs: number): void {
    this.offerNext(nowMs);
    this.dwell(nowMs);
  }

  private mouseDrives(): boolean {
    return this.settings.mouseGestures && !this.handlers.turns() && this.handlers.drives();
  }

  private button(event: PointerEvent, down: boolean): void {
    if (event.pointerType !== "mouse") return;
    const gesture = event.button === 2 ? "wrist_flexion" : "wrist_extension";
    if (!down) {
      for (const each of ["wrist_extension", "wrist_flexion"] as const) this.handlers.hold(`mouse ${each}`, each, false);
      return;
    }
    // With a switch, every press is the switch.
    // With Shift the mouse looks around.
    if (!this.mouseDrives() || this.settings.scanMs > 0 || event.button === 1 || event.shiftKey) return;
    this.canvas.setPointerCapture(event.pointerId);
    this.handlers.hold(`mouse ${gesture}`, gesture, true);
  }

  /** Towards the person closes the hand, away opens it. */
  private wheel(event: WheelEvent): void {
    if (!this.mouseDrives() || event.ctrlKey || event.deltaY === 0) return;
    event.preventDefault();
    const again = event.timeStamp - this.turned < WHEEL_MS;
    this.turned = event.timeStamp;
    if (!again) this.tap(event.deltaY > 0 ? "hand_close" : "hand_open");
  }

  private tap(gesture: GestureKey): void {
    this.handlers.hold(`tap ${gesture}`, gesture, true);
    window.setTimeout(() => this.handlers.hold(`tap ${gesture}`, gesture, false), TAP_MS);
  }

  // Resting the pointer.

  private rest({ clientX: x, clientY: y, target }: PointerEvent): void {
    const { rested } = this;
    const over = target instanceof Element ? (target.closest(".gesture") ?? target) : target;
    if (rested && over === rested.over && Math.hypot(x - rested.x, y - rested.y) < RESTS) return;
    // On a button it may move as long as it stays on it.
    if (rested && over === rested.over && this.resting) return;
    this.endRest();
    this.rested = { x, y, since: performance.now(), done: false, over };
  }

  private dwell(nowMs: number): void {
    const { rested, settings } = this;
    if (settings.dwellMs === 0 || !rested || rested.done || !this.handlers.drives() || nowMs - rested.since < settings.dwellMs) return;
    rested.done = true;
    if (rested.over === this.canvas) {
      if (this.handlers.looks()) this.tap("wrist_flexion");
    } else if (rested.over instanceof HTMLElement && rested.over.dataset["gesture"]) {
      this.resting = rested.over;
      setClass(this.resting, "rested", true);
      this.handlers.hold("rest", rested.over.dataset["gesture"] as GestureKey, true);
    }
  }

  private endRest(): void {
    this.rested = null;
    if (!this.resting) return;
    setClass(this.resting, "rested", false);
    this.handlers.hold("rest", this.resting.dataset["gesture"] as GestureKey, false);
    this.resting = null;
  }

  // One switch.

  private get scans(): boolean {
    return this.settings.scanMs > 0 && this.handlers.drives();
  }

  private offerNext(nowMs: number): void {
    this.root.hidden = !this.scans;
    if (!this.scans) return;
    const places = this.handlers.places();
    const choice = this.scanner.offered(nowMs, this.settings.scanMs, this.handlers.looks(), places.length);
    setText(this.offer, choice ? said(choice, places) : strings.access.letGo);
    for (const node of document.querySelectorAll<HTMLElement>(".gesture")) {
      setClass(node, "offered", choice?.kind === "gesture" && node.dataset["gesture"] === choice.gesture);
    }
  }

  private pressed(event: KeyboardEvent): void {
    if (!this.scans || (event.code !== "Space" && event.code !== "Enter")) return;
    // A button that has the focus keeps its keys, or nobody could leave the switch.
    if (document.activeElement instanceof HTMLButtonElement && !document.activeElement.classList.contains("mark")) return;
    event.preventDefault();
    event.stopPropagation();
    if (!event.repeat) this.act();
  }

  private clicked(event: PointerEvent): void {
    if (this.scans && event.target === this.canvas) this.act();
  }

  private act(): void {
    const places = this.handlers.places();
    const action = this.scanner.press(performance.now(), this.settings.scanMs, this.handlers.looks(), places.length);
    switch (action.act) {
      case "look":
        this.marks.look(places[action.place] ?? null);
        break;
      case "tap":
        this.tap(action.gesture);
        break;
      case "hold":
        this.handlers.hold(`switch ${action.gesture}`, action.gesture, true);
        break;
      case "release":
        for (const gesture of ["wrist_extension", "wrist_flexion"] as const) this.handlers.hold(`switch ${gesture}`, gesture, false);
        break;
      case "restart":
        this.handlers.restart();
        break;
      case "none":
        break;
    }
  }
}

function said(choice: Choice, places: Place[]): string {
  switch (choice.kind) {
    case "look":
      return strings.access.look;
    case "back":
      return strings.access.back;
    case "restart":
      return strings.access.restart;
    case "gesture":
      return GESTURE_NAMES[choice.gesture].name;
    case "place": {
      const place = places[choice.place];
      return place ? labelOf(place) : "";
    }
  }
}
