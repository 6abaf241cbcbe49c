// Keys, buttons and mouse to gestures, trunk and gaze. The keys are one table, shown on screen from it.

import { element, setClass, setText } from "./dom";
import { GESTURE_NAMES, type Gesture } from "./protocol";

type Action = "restart" | "camera" | "upright";
type Lean = { axis: "forward" | "lateral" | "axial"; sign: 1 | -1; name: string };

interface Binding {
  /** Values of KeyboardEvent.code: places on the keyboard, whatever its layout prints on them. */
  codes: string[];
  label: string;
}

const GESTURE_KEYS: (Binding & { gesture: Gesture; effect: string })[] = [
  { codes: ["KeyW", "ArrowUp"], label: "W ↑", gesture: "wrist_extension", effect: "move (hold)" },
  { codes: ["KeyA", "ArrowLeft"], label: "A ←", gesture: "hand_close", effect: "close hand" },
  { codes: ["KeyS", "ArrowDown"], label: "S ↓", gesture: "wrist_flexion", effect: "lock" },
  { codes: ["KeyD", "ArrowRight"], label: "D →", gesture: "hand_open", effect: "open hand" },
];
const LEAN_KEYS: (Binding & Lean)[] = [
  // In the order of the keyboard's two rows.
  { codes: ["KeyU"], label: "U", axis: "axial", sign: 1, name: "turn ↺" },
  { codes: ["KeyI"], label: "I", axis: "forward", sign: 1, name: "ahead" },
  { codes: ["KeyO"], label: "O", axis: "axial", sign: -1, name: "turn ↻" },
  { codes: ["KeyJ"], label: "J", axis: "lateral", sign: -1, name: "left" },
  { codes: ["KeyK"], label: "K", axis: "forward", sign: -1, name: "back" },
  { codes: ["KeyL"], label: "L", axis: "lateral", sign: 1, name: "right" },
];
const ACTION_KEYS: (Binding & { action: Action; name: string })[] = [
  { codes: ["KeyP"], label: "P", action: "upright", name: "sit up" },
  { codes: ["KeyC"], label: "C", action: "camera", name: "camera" },
  { codes: ["KeyR"], label: "R", action: "restart", name: "restart" },
];
/** What the gestures do with methods A and B, where they move one joint or axis at a time. */
const STEPWISE: Partial<Record<Gesture, string>> = {
  wrist_extension: "move +",
  wrist_flexion: "move −",
  hand_close: "close / open",
  hand_open: "next axis",
};
/** The trunk's limits and speed, as in the seated set-up: degrees, degrees per second. */
const LEAN_MAX = { forward: 35, lateral: 25, axial: 40 };
const LEAN_SPEED = 30;
const DEGREE = Math.PI / 180;

export interface ControlHandlers {
  gesture(gesture: Gesture): void;
  /** Nothing new, but still here. */
  alive(): void;
  trunk(posture: { forward: number; lateral: number; axial: number }): void;
  restart(): void;
  camera(): void;
}

export class Controls {
  readonly root = element("section", "card keys");
  /** Held gestures, the newest last: it is the one in force. */
  private held: { source: string; gesture: Gesture }[] = [];
  private readonly leaning = new Map<string, Lean>();
  private readonly posture = { forward: 0, lateral: 0, axial: 0 };
  private readonly buttons = new Map<string, HTMLElement>();
  private readonly readout = element("span", "readout");
  private inForce: Gesture = "no_motion";
  private interactive = false;

  constructor(private readonly handlers: ControlHandlers) {
    this.build();
    window.addEventListener("keydown", (event) => this.key(event, true));
    window.addEventListener("keyup", (event) => this.key(event, false));
    // A key released while another window has the focus is never reported: everything is let go.
    window.addEventListener("blur", () => this.releaseAll());
    document.addEventListener("visibilitychange", () => document.hidden && this.releaseAll());
    window.addEventListener("pagehide", () => this.releaseAll());
    // Signs of life while something is held; without them the server lets go after half a second. The gesture
    // itself is not said again: after such a release it takes a new press, or a lock would toggle by itself.
    window.setInterval(() => {
      if (this.inForce !== "no_motion") this.handlers.alive();
    }, 100);
  }

  setMode(interactive: boolean, lean: boolean): void {
    this.interactive = interactive;
    if (!interactive) this.releaseAll();
    setClass(this.root, "watching", !interactive);
    setClass(this.root, "still", !lean);
    Object.assign(this.posture, { forward: 0, lateral: 0, axial: 0 });
    this.showPosture();
  }

  /** Says on the keys what the gestures do with this method. */
  setMethod(method: string): void {
    for (const { gesture, effect } of GESTURE_KEYS) {
      const text = ["A", "B"].includes(method) ? STEPWISE[gesture] : undefined;
      const label = this.buttons.get(gesture)?.querySelector("span");
      if (label) setText(label, text ?? effect);
    }
  }

  /** Leaning goes on while its key is held; called once per picture. */
  update(seconds: number): void {
    if (this.leaning.size === 0) return;
    for (const { axis, sign } of this.leaning.values()) {
      const max = LEAN_MAX[axis];
      // Nobody leans backwards in a chair as far as forwards.
      const min = axis === "forward" ? -max / 3 : -max;
      const moved = this.posture[axis] + sign * LEAN_SPEED * Math.min(seconds, 0.1);
      this.posture[axis] = Math.min(Math.max(moved, min), max);
    }
    this.tellPosture();
  }

  private build(): void {
    const pad = element("div", "pad");
    for (const { codes, label, gesture, effect } of GESTURE_KEYS) {
      const button = element(
        "button",
        `gesture ${gesture}`,
        element("kbd", "", label),
        element("b", "", `${GESTURE_NAMES[gesture].short} `),
        element("span", "", effect),
      );
      button.type = "button";
      button.title = GESTURE_NAMES[gesture].name;
      button.dataset["gesture"] = gesture;
      const source = `button ${gesture}`;
      button.addEventListener("pointerdown", (event) => {
        event.preventDefault();
        button.setPointerCapture(event.pointerId);
        this.hold(source, gesture, true);
      });
      for (const end of ["pointerup", "pointercancel", "lostpointercapture"] as const) {
        button.addEventListener(end, () => this.hold(source, gesture, false));
      }
      button.addEventListener("contextmenu", (event) => event.preventDefault());
      for (const code of codes) this.buttons.set(code, button);
      this.buttons.set(gesture, button);
      pad.append(button);
    }
    const leans = element("div", "leans");
    for (const lean of LEAN_KEYS) {
      const button = element("button", "lean", element("kbd", "", lean.label), element("span", "", lean.name));
      button.type = "button";
      const source = `button ${lean.label}`;
      button.addEventListener("pointerdown", (event) => {
        event.preventDefault();
        button.setPointerCapture(event.pointerId);
        this.leaning.set(source, lean);
      });
      for (const end of ["pointerup", "pointercancel", "lostpointercapture"] as const) {
        button.addEventListener(end, () => this.leaning.delete(source));
      }
      for (const code of lean.codes) this.buttons.set(code, button);
      leans.append(button);
    }
    const actions = element("div", "actions");
    for (const { codes, label, action, name } of ACTION_KEYS) {
      const button = element("button", `action ${action}`, element("kbd", "", label), element("span", "", name));
      button.type = "button";
      button.addEventListener("click", () => {
        this.act(action);
        button.blur();
      });
      for (const code of codes) this.buttons.set(code, button);
      actions.append(button);
    }
    this.root.append(
      element("p", "mouse", element("kbd", "", "Mouse"), " is your gaze"),
      pad,
      element("div", "leanbox", element("span", "label", "Lean"), leans, this.readout),
      actions,
    );
  }

  private key(event: KeyboardEvent, down: boolean): void {
    // Ctrl+R and its like belong to the browser.
    if (down && (event.ctrlKey || event.metaKey || event.altKey)) return;
    const gesture = GESTURE_KEYS.find((binding) => binding.codes.includes(event.code));
    const lean = LEAN_KEYS.find((binding) => binding.codes.includes(event.code));
    const action = ACTION_KEYS.find((binding) => binding.codes.includes(event.code));
    if (!gesture && !lean && !action) return;
    if (gesture || lean) event.preventDefault();
    if (event.repeat) return;
    const button = this.buttons.get(event.code);
    if (button && !gesture) setClass(button, "down", down);
    if (gesture) this.hold(event.code, gesture.gesture, down);
    if (lean && this.interactive) {
      if (down) this.leaning.set(event.code, lean);
      else this.leaning.delete(event.code);
    }
    if (action && down) this.act(action.action);
  }

  private act(action: Action): void {
    if (action === "camera") this.handlers.camera();
    if (!this.interactive) return;
    if (action === "restart") this.handlers.restart();
    if (action === "upright") {
      Object.assign(this.posture, { forward: 0, lateral: 0, axial: 0 });
      this.tellPosture();
    }
  }

  private hold(source: string, gesture: Gesture, down: boolean): void {
    this.held = this.held.filter((held) => held.source !== source);
    if (down && this.interactive) this.held.push({ source, gesture });
    this.settle();
  }

  /** Lets go of everything: the person, the window or the connection is gone. */
  releaseAll(): void {
    this.held = [];
    this.leaning.clear();
    for (const button of this.buttons.values()) setClass(button, "down", false);
    this.settle();
  }

  private settle(): void {
    const now = this.held[this.held.length - 1]?.gesture ?? "no_motion";
    if (now === this.inForce) return;
    this.inForce = now;
    for (const { gesture } of GESTURE_KEYS) {
      const button = this.buttons.get(gesture);
      if (button) setClass(button, "down", gesture === now);
    }
    this.handlers.gesture(now);
  }

  private tellPosture(): void {
    const { forward, lateral, axial } = this.posture;
    this.handlers.trunk({ forward: forward * DEGREE, lateral: lateral * DEGREE, axial: axial * DEGREE });
    this.showPosture();
  }

  private showPosture(): void {
    const { forward, lateral, axial } = this.posture;
    const part = (name: string, angle: number) => `${name} ${Math.round(angle)}°`;
    this.readout.textContent = [part("ahead", forward), part("right", lateral), part("turn", axial)].join(" · ");
  }
}
