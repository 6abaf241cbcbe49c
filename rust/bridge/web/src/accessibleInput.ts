// Ways to drive with less than a keyboard and a mouse: the mouse's own buttons, resting the pointer, and a single switch.

import { element, setClass, setText } from "./dom";
import type { Command } from "./generated/types";
import type { FocusTargets, FocusTarget } from "./focusTargets";
import { focusTargetLabel } from "./focusTargets";
import { GESTURE_NAMES } from "./protocol";
import { Scanner, type ScanChoice } from "./scanning";
import type { GestureKey, Settings } from "./settings";
import { strings } from "./strings";

/** A tap is so long, ms: the testbed takes a gesture at its next control step, 10 ms later. */
const TAP_MS = 200;
/** A pointer that moves less than this rests, CSS pixels. */
const REST_RADIUS_PX = 12;
/** Turns of the wheel closer together than this are one, ms. */
const WHEEL_DEBOUNCE_MS = 300;

export interface AccessibleInputHandlers {
  /** Presses or lets go of a gesture. */
  hold(source: string, gesture: Command, down: boolean): void;
  restart(): void;
  /** Another trial may be begun. */
  mayRestart(): boolean;
  /** Keys and mouse drive now: no dialog is open, and this page has the wheel. */
  isDriving(): boolean;
  /** The mouse's buttons turn the scene instead. */
  mouseTurnsView(): boolean;
  /** The method follows the gaze. */
  selectsByGaze(): boolean;
  /** What one may want to look at now, the likeliest first. */
  focusTargets(): FocusTarget[];
}

export class AccessibleInput {
  readonly root = element("div", "card scan");
  private readonly offerLabel = element("b");
  private readonly scanner = new Scanner(
    (gesture) => gesture === "wrist_extension" || (!this.handlers.selectsByGaze() && gesture === "wrist_flexion"),
    () => this.handlers.mayRestart(),
  );
  private lastWheelTime = 0;
  private restState: { x: number; y: number; since: number; done: boolean; over: EventTarget | null } | null = null;
  private restingButton: HTMLElement | null = null;

  constructor(
    private readonly canvas: HTMLCanvasElement,
    private readonly marks: FocusTargets,
    private readonly handlers: AccessibleInputHandlers,
    private settings: Settings,
  ) {
    this.root.append(element("span", "label", strings.access.switch), this.offerLabel);
    this.root.setAttribute("role", "status");
    this.root.hidden = true;
    canvas.addEventListener("pointerdown", (event) => this.onMouseButton(event, true));
    for (const end of ["pointerup", "pointercancel", "lostpointercapture"] as const) {
      canvas.addEventListener(end, (event) => this.onMouseButton(event, false));
    }
    canvas.addEventListener("contextmenu", (event) => this.mouseDrives() && event.preventDefault());
    canvas.addEventListener("wheel", (event) => this.onWheel(event), { passive: false });
    window.addEventListener("pointermove", (event) => this.onPointerMove(event));
    window.addEventListener("keydown", (event) => this.onSwitchKey(event), true);
    window.addEventListener("pointerdown", (event) => this.onSwitchClick(event), true);
    window.addEventListener("blur", () => this.releaseAll());
  }

  setSettings(settings: Settings): void {
    this.releaseAll();
    this.settings = settings;
  }

  /** Locks what is looked at. */
  lock(): void {
    if (this.handlers.isDriving()) this.tap("wrist_flexion");
  }

  /** Lets go of everything that is held here. */
  releaseAll(): void {
    this.scanner.reset();
    this.endRest();
    for (const gesture of ["wrist_extension", "wrist_flexion"] as const) {
      this.handlers.hold(`switch ${gesture}`, gesture, false);
      this.handlers.hold(`mouse ${gesture}`, gesture, false);
    }
  }

  /** Called once per picture. */
  update(nowMs: number): void {
    this.updateScan(nowMs);
    this.updateDwell(nowMs);
  }

  private mouseDrives(): boolean {
    return this.settings.mouseGestures && !this.handlers.mouseTurnsView() && this.handlers.isDriving();
  }

  private onMouseButton(event: PointerEvent, down: boolean): void {
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
  private onWheel(event: WheelEvent): void {
    if (!this.mouseDrives() || event.ctrlKey || event.deltaY === 0) return;
    event.preventDefault();
    const again = event.timeStamp - this.lastWheelTime < WHEEL_DEBOUNCE_MS;
    this.lastWheelTime = event.timeStamp;
    if (!again) this.tap(event.deltaY > 0 ? "hand_close" : "hand_open");
  }

  private tap(gesture: GestureKey): void {
    this.handlers.hold(`tap ${gesture}`, gesture, true);
    window.setTimeout(() => this.handlers.hold(`tap ${gesture}`, gesture, false), TAP_MS);
  }

  // Resting the pointer.

  private onPointerMove({ clientX: x, clientY: y, target }: PointerEvent): void {
    const { restState: rested } = this;
    const over = target instanceof Element ? (target.closest(".gesture") ?? target) : target;
    if (rested && over === rested.over && Math.hypot(x - rested.x, y - rested.y) < REST_RADIUS_PX) return;
    // On a button it may move as long as it stays on it.
    if (rested && over === rested.over && this.restingButton) return;
    this.endRest();
    this.restState = { x, y, since: performance.now(), done: false, over };
  }

  private updateDwell(nowMs: number): void {
    const { restState: rested, settings } = this;
    if (settings.dwellMs === 0 || !rested || rested.done || !this.handlers.isDriving() || nowMs - rested.since < settings.dwellMs) return;
    rested.done = true;
    if (rested.over === this.canvas) {
      if (this.handlers.selectsByGaze()) this.tap("wrist_flexion");
    } else if (rested.over instanceof HTMLElement && rested.over.dataset["gesture"]) {
      this.restingButton = rested.over;
      setClass(this.restingButton, "rested", true);
      this.handlers.hold("rest", rested.over.dataset["gesture"] as GestureKey, true);
    }
  }

  private endRest(): void {
    this.restState = null;
    if (!this.restingButton) return;
    setClass(this.restingButton, "rested", false);
    this.handlers.hold("rest", this.restingButton.dataset["gesture"] as GestureKey, false);
    this.restingButton = null;
  }

  // One switch.

  private get isScanning(): boolean {
    return this.settings.scanMs > 0 && this.handlers.isDriving();
  }

  private updateScan(nowMs: number): void {
    this.root.hidden = !this.isScanning;
    if (!this.isScanning) return;
    const places = this.handlers.focusTargets();
    const choice = this.scanner.currentChoice(nowMs, this.settings.scanMs, this.handlers.selectsByGaze(), places.length);
    setText(this.offerLabel, choice ? choiceText(choice, places) : strings.access.letGo);
    for (const node of document.querySelectorAll<HTMLElement>(".gesture")) {
      setClass(node, "offered", choice?.kind === "gesture" && node.dataset["gesture"] === choice.gesture);
    }
  }

  private onSwitchKey(event: KeyboardEvent): void {
    if (!this.isScanning || (event.code !== "Space" && event.code !== "Enter")) return;
    // A button that has the focus keeps its keys, or nobody could leave the switch.
    if (document.activeElement instanceof HTMLButtonElement && !document.activeElement.classList.contains("mark")) return;
    event.preventDefault();
    event.stopPropagation();
    if (!event.repeat) this.activateChoice();
  }

  private onSwitchClick(event: PointerEvent): void {
    if (this.isScanning && event.target === this.canvas) this.activateChoice();
  }

  private activateChoice(): void {
    const places = this.handlers.focusTargets();
    const action = this.scanner.press(performance.now(), this.settings.scanMs, this.handlers.selectsByGaze(), places.length);
    switch (action.act) {
      case "look":
        this.marks.focusOn(places[action.place] ?? null);
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

function choiceText(choice: ScanChoice, places: FocusTarget[]): string {
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
      return place ? focusTargetLabel(place) : "";
    }
  }
}
