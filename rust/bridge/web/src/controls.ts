// Keys, buttons, mouse and gamepad to gestures, trunk and gaze. The keys are one table, shown on screen from it.

import { element, returnFocus, setClass, setText } from "./dom";
import { GAMEPAD_HELP } from "./gamepad";
import { gestureInstruction } from "./hand";
import { HeldGestures } from "./heldGestures";
import type { Command, MethodHelp, ModeView } from "./generated/types";
import { GESTURE_NAMES } from "./protocol";
import { strings } from "./strings";
import { keyName, type ActionKey, type KeyCommand, type GestureKey, type LeanKey, type Settings } from "./settings";

type Axis = "forward" | "lateral" | "axial";

const words = strings.controls;
const GESTURES: { gesture: GestureKey; effect: string }[] = (["wrist_extension", "hand_close", "wrist_flexion", "hand_open"] as const).map((gesture) => ({
  gesture,
  effect: words.effects[gesture],
}));
/** In the order of the keyboard's two rows. */
const LEAN_KEYS: { command: LeanKey; axis: Axis; sign: 1 | -1 }[] = [
  { command: "turn_left", axis: "axial", sign: 1 },
  { command: "ahead", axis: "forward", sign: 1 },
  { command: "turn_right", axis: "axial", sign: -1 },
  { command: "left", axis: "lateral", sign: -1 },
  { command: "back", axis: "forward", sign: -1 },
  { command: "right", axis: "lateral", sign: 1 },
];
const ACTIONS: ActionKey[] = ["upright", "camera", "signals", "views", "scores", "restart"];
/** They stay pressed as long as what they open is open. */
const TOGGLE_ACTIONS = new Set<KeyCommand>(["signals", "views", "scores"]);
/** A participant neither compares trials nor watches signals. */
const HIDDEN_IN_STUDY = new Set<ActionKey>(["signals", "scores"]);
/** The trunk's limits and speed, as in the seated set-up: degrees, degrees per second. */
const MAX_LEAN_DEG = { forward: 35, lateral: 25, axial: 40 };
const LEAN_SPEED_DEG_PER_S = 30;
const DEGREE = Math.PI / 180;
/** Time between signs of life, ms. By default the server stops the arm after a fifth of a second without one. */
const HEARTBEAT_MS = 40;

export interface ControlHandlers {
  gesture(gesture: Command): void;
  /** Nothing new, but still here. */
  heartbeat(): void;
  /** A gamepad or a headset's controller was not read for too long, and what it held was let go of. */
  pollingStopped(): void;
  trunk(posture: { forward: number; lateral: number; axial: number }): void;
  restart(): void;
  camera(): void;
  signals(): void;
  /** Small pictures of the hand's and the eyes' view. */
  views(): void;
  /** Results side by side. */
  scores(): void;
  /** Shift and an arrow key; true if the view took it. */
  turn(code: string): boolean;
  /** An arrow key; true if the gaze took it. */
  arrow(code: string): boolean;
}

export class Controls {
  readonly root = element("section", "card keys");
  private readonly heldGestures = new HeldGestures();
  private heartbeatAt = 0;
  private readonly leaning = new Map<string, { axis: Axis; sign: 1 | -1 }>();
  private readonly posture = { forward: 0, lateral: 0, axial: 0 };
  private readonly buttons = new Map<KeyCommand, HTMLElement>();
  private readonly pad = element("div", "pad");
  /** Where the gestures' buttons are while they are trained. */
  private trainingSlot: HTMLElement | null = null;
  private readonly readout = element("span", "readout");
  private readonly padHelp = element("p", "mouse pad-help", GAMEPAD_HELP);
  private inForce: Command = "no_motion";
  private interactive = false;
  /** A dialogue is open: keys belong to it. */
  suspended = false;
  /** The scene is shown mirrored: leaning left on the screen is leaning right in the world. */
  mirrored = false;

  constructor(
    private readonly handlers: ControlHandlers,
    private keys: Settings["keys"],
  ) {
    this.build();
    this.setKeys(keys);
    this.padHelp.hidden = true;
    window.addEventListener("keydown", (event) => this.key(event, true));
    window.addEventListener("keyup", (event) => this.key(event, false));
    // A key released while another window has the focus is never reported: everything is let go.
    window.addEventListener("blur", () => this.releaseAll());
    document.addEventListener("visibilitychange", () => document.hidden && this.releaseAll());
    window.addEventListener("pagehide", () => this.releaseAll());
    window.setInterval(() => this.sendHeartbeat(), HEARTBEAT_MS);
  }

  /** The gesture itself is not said again: after a stop it takes a new press, or a lock would toggle by itself. */
  private sendHeartbeat(): void {
    // The timer runs on when no pictures are made, and must not vouch for a gamepad that nobody reads.
    this.heartbeatAt = performance.now();
    if (this.heldGestures.releaseUnpolled(this.heartbeatAt)) {
      this.applyActiveGesture();
      this.handlers.pollingStopped();
    }
    if (this.inForce !== "no_motion") this.handlers.heartbeat();
  }

  /** Other keys from now on. */
  setKeys(keys: Settings["keys"]): void {
    this.keys = keys;
    this.releaseAll();
    for (const [command, button] of this.buttons) {
      const label = button.querySelector("kbd");
      if (label) setText(label, this.keys[command].map(keyName).join(" ") || "–");
    }
  }

  setMode(interactive: boolean, lean: boolean): void {
    this.interactive = interactive;
    if (!interactive) this.releaseAll();
    setClass(this.root, "watching", !interactive);
    setClass(this.root, "still", !lean);
    Object.assign(this.posture, { forward: 0, lateral: 0, axial: 0 });
    this.showPosture();
  }

  /** Says on the keys what the gestures do now: where the selected joint or axis goes, else what the method says. */
  setEffects(help: MethodHelp | undefined, mode: ModeView | null): void {
    const moves: Partial<Record<Command, string | undefined>> = {
      wrist_extension: mode?.directions[0],
      wrist_flexion: mode?.directions[1],
    };
    for (const { gesture, effect } of GESTURES) {
      const label = this.buttons.get(gesture)?.querySelector("span");
      if (label) setText(label, this.trainingSlot ? gestureInstruction(gesture) : moves[gesture] || help?.[gesture] || effect);
    }
  }

  /** Lends the gestures' buttons to a screen on which they are trained, in its words; none takes them back. */
  moveGestureButtons(lesson: HTMLElement | null): void {
    if (lesson === this.trainingSlot) return;
    this.trainingSlot = lesson;
    if (lesson) lesson.append(this.pad);
    else this.root.querySelector(".leanbox")?.before(this.pad);
    this.setEffects(undefined, null);
  }

  /** Leaning goes on while its key is held; called once per picture, as the gamepad and the headset are read. */
  update(seconds: number): void {
    const now = performance.now();
    this.heldGestures.markPolled(now);
    // Where drawing keeps the page's thread busy, timers are the last to run.
    if (now - this.heartbeatAt >= HEARTBEAT_MS) this.sendHeartbeat();
    if (this.leaning.size === 0) return;
    for (const { axis, sign } of this.leaning.values()) {
      const max = MAX_LEAN_DEG[axis];
      // Nobody leans backwards in a chair as far as forwards.
      const min = axis === "forward" ? -max / 3 : -max;
      const side = this.mirrored && axis !== "forward" ? -sign : sign;
      const moved = this.posture[axis] + side * LEAN_SPEED_DEG_PER_S * Math.min(seconds, 0.1);
      this.posture[axis] = Math.min(Math.max(moved, min), max);
    }
    this.sendPosture();
  }

  /** From a gamepad or a headset's controllers, which are read once per picture. */
  holdPolled(source: string, gesture: Command, down: boolean): void {
    this.hold(source, gesture, down, true);
  }

  /** Whether what an action opens is open, for screen readers. */
  setOpen(action: ActionKey, open: boolean): void {
    this.buttons.get(action)?.setAttribute("aria-expanded", String(open));
    setClass(this.buttons.get(action) ?? this.root, "down", open);
  }

  /** To give the focus back to. */
  focus(action: ActionKey): void {
    this.buttons.get(action)?.focus();
  }

  showGamepad(): void {
    this.padHelp.hidden = false;
  }

  /** Lets go of everything: the person, the window or the connection is gone. */
  releaseAll(): void {
    this.heldGestures.releaseAll();
    this.leaning.clear();
    for (const button of this.buttons.values()) setClass(button, "down", false);
    this.applyActiveGesture();
  }

  private build(): void {
    const { pad } = this;
    for (const { gesture, effect } of GESTURES) {
      const button = element(
        "button",
        `gesture ${gesture}`,
        element("kbd"),
        element("b", "", GESTURE_NAMES[gesture].name),
        element("span", "", effect),
      );
      button.title = GESTURE_NAMES[gesture].name;
      button.dataset["gesture"] = gesture;
      const source = `button ${gesture}`;
      this.holdable(button, (down) => this.hold(source, gesture, down));
      button.addEventListener("contextmenu", (event) => event.preventDefault());
      this.buttons.set(gesture, button);
      pad.append(button);
    }
    const leans = element("div", "leans");
    for (const { command, axis, sign } of LEAN_KEYS) {
      const button = element("button", "lean", element("kbd"), element("span", "", words.leans[command]));
      this.holdable(button, (down) => {
        if (down && this.interactive) this.leaning.set(`button ${command}`, { axis, sign });
        else this.leaning.delete(`button ${command}`);
      });
      this.buttons.set(command, button);
      leans.append(button);
    }
    const actions = element("div", "actions");
    for (const command of ACTIONS) {
      const classes = `action ${command}${HIDDEN_IN_STUDY.has(command) ? " not-in-study" : ""}`;
      const button = element("button", classes, element("kbd"), element("span", "", words.actions[command]));
      button.type = "button";
      button.addEventListener("click", (event) => {
        this.act(command);
        returnFocus(event, button);
      });
      this.buttons.set(command, button);
      actions.append(button);
    }
    this.root.append(
      element("p", "mouse", element("kbd", "", words.mouse), words.isGaze),
      pad,
      element("div", "leanbox", element("span", "label", words.lean), leans, this.readout),
      actions,
      this.padHelp,
    );
  }

  /** A button that does something for as long as it is pressed. */
  private holdable(button: HTMLButtonElement, changed: (down: boolean) => void): void {
    button.type = "button";
    button.addEventListener("pointerdown", (event) => {
      event.preventDefault();
      button.setPointerCapture(event.pointerId);
      changed(true);
    });
    for (const end of ["pointerup", "pointercancel", "lostpointercapture", "blur"] as const) {
      button.addEventListener(end, () => changed(false));
    }
    // With the focus on it, Space and Enter press it.
    const presses = ({ code }: KeyboardEvent) => code === "Space" || code === "Enter";
    button.addEventListener("keydown", (event) => {
      if (!presses(event)) return;
      event.preventDefault();
      if (!event.repeat) changed(true);
    });
    button.addEventListener("keyup", (event) => presses(event) && changed(false));
  }

  private key(event: KeyboardEvent, down: boolean): void {
    // Ctrl+R and its like belong to the browser.
    if (down && (this.suspended || event.ctrlKey || event.metaKey || event.altKey)) return;
    if (event.shiftKey && down && this.handlers.turn(event.code)) {
      event.preventDefault();
      return;
    }
    // Arrows move the gaze where that is in the focus.
    if (event.code.startsWith("Arrow") && this.interactive && down && this.handlers.arrow(event.code)) {
      event.preventDefault();
      return;
    }
    const bound = (command: KeyCommand) => this.keys[command].includes(event.code);
    const gesture = GESTURES.find((candidate) => bound(candidate.gesture))?.gesture;
    const lean = LEAN_KEYS.find((candidate) => bound(candidate.command));
    const action = ACTIONS.find(bound);
    if (gesture || lean) event.preventDefault();
    if (event.repeat) return;
    const shown = lean?.command ?? action;
    if (shown && !gesture && !TOGGLE_ACTIONS.has(shown)) setClass(this.buttons.get(shown) ?? this.root, "down", down);
    if (gesture) this.hold(event.code, gesture, down);
    if (lean && this.interactive) {
      if (down) this.leaning.set(event.code, lean);
      else this.leaning.delete(event.code);
    }
    if (action && down) this.act(action);
  }

  /** `source` makes a gesture, or no longer. */
  hold(source: string, gesture: Command, down: boolean, polled = false): void {
    if (down && this.interactive && !this.suspended) this.heldGestures.press(source, gesture, polled);
    else this.heldGestures.release(source);
    this.applyActiveGesture();
  }

  private act(action: ActionKey): void {
    if (action === "camera") this.handlers.camera();
    if (action === "signals" || action === "views" || action === "scores") this.handlers[action]();
    if (!this.interactive) return;
    if (action === "restart") this.handlers.restart();
    if (action === "upright") {
      Object.assign(this.posture, { forward: 0, lateral: 0, axial: 0 });
      this.sendPosture();
    }
  }

  private applyActiveGesture(): void {
    const now = this.heldGestures.inForce;
    if (now === this.inForce) return;
    this.inForce = now;
    for (const { gesture } of GESTURES) {
      const button = this.buttons.get(gesture);
      if (button) setClass(button, "down", gesture === now);
    }
    this.handlers.gesture(now);
  }

  private sendPosture(): void {
    const { forward, lateral, axial } = this.posture;
    this.handlers.trunk({ forward: forward * DEGREE, lateral: lateral * DEGREE, axial: axial * DEGREE });
    this.showPosture();
  }

  private showPosture(): void {
    const { forward, lateral, axial } = this.posture;
    const part = (name: string, angle: number) => `${name} ${Math.round(angle) || 0}°`;
    const side = this.mirrored ? -1 : 1;
    const parts = [part(words.leans.ahead, forward), part(words.leans.right, side * lateral), part(words.turn, side * axial)];
    this.readout.textContent = parts.join(" · ");
  }
}
