// A game controller: face buttons are gestures, the right stick is the gaze. Numbers are those of the standard
// layout that browsers map controllers to.

import { strings } from "./strings";
import type { GestureKey } from "./settings";

const BUTTONS: { button: number; gesture: GestureKey; name: string }[] = [
  { button: 7, gesture: "wrist_extension", name: "right trigger" },
  { button: 3, gesture: "wrist_extension", name: "Y" },
  { button: 0, gesture: "wrist_flexion", name: "A" },
  { button: 2, gesture: "hand_close", name: "X" },
  { button: 1, gesture: "hand_open", name: "B" },
];
const START = 9;
const VIEW = 8;
/** A stick at rest is never quite at zero. */
const DEAD_ZONE = 0.15;
/** The gaze crosses half the window in this time with the stick fully out, seconds. */
const GAZE_CROSSING_SECS = 0.7;

export const GAMEPAD_HELP = strings.controls.gamepad;

export interface GamepadHandlers {
  hold(source: string, gesture: GestureKey, down: boolean): void;
  /** Moves the gaze by shares of the half window, x to the right, y up. */
  moveGaze(x: number, y: number): void;
  restart(): void;
  camera(): void;
  found(name: string): void;
  /** It is disconnected; what it held is let go of. */
  lost(): void;
}

export class GamepadInput {
  /** The buttons that were pressed when the gamepad was last read. */
  private readonly down = new Set<string>();
  /** Index of the gamepad in use. */
  private index: number | null = null;

  constructor(private readonly handlers: GamepadHandlers) {
    // Not left to the next picture, which may be long in coming.
    window.addEventListener("gamepaddisconnected", ({ gamepad }) => {
      if (gamepad.index === this.index) this.releaseAll();
    });
  }

  /** Called once per picture. */
  update(seconds: number): void {
    const pad = navigator.getGamepads?.().find((candidate) => candidate?.connected) ?? null;
    // Some browsers drop a gamepad from the list without the event.
    if (this.index !== null && pad?.index !== this.index) this.releaseAll();
    if (!pad) return;
    if (this.index === null) this.handlers.found(pad.id);
    this.index = pad.index;
    for (const { button, gesture } of BUTTONS) {
      this.onButtonChange(pad, button, (source, down) => this.handlers.hold(source, gesture, down));
    }
    this.onButtonChange(pad, START, (_, down) => down && this.handlers.restart());
    this.onButtonChange(pad, VIEW, (_, down) => down && this.handlers.camera());
    const [x, y] = [applyDeadZone(pad.axes[2]), applyDeadZone(pad.axes[3])];
    const step = Math.min(seconds, 0.1) / GAZE_CROSSING_SECS;
    if (x !== 0 || y !== 0) this.handlers.moveGaze(x * step, -y * step);
  }

  /** Lets go of everything. `down` stays: a button that is still pressed when the gamepad is back is no new press. */
  private releaseAll(): void {
    this.index = null;
    for (const { button, gesture } of BUTTONS) this.handlers.hold(sourceOf(button), gesture, false);
    this.handlers.lost();
  }

  private onButtonChange(pad: Gamepad, button: number, changed: (source: string, down: boolean) => void): void {
    const source = sourceOf(button);
    const down = (pad.buttons[button]?.value ?? 0) > 0.5;
    if (down === this.down.has(source)) return;
    if (down) this.down.add(source);
    else this.down.delete(source);
    changed(source, down);
  }
}

function sourceOf(button: number): string {
  return `gamepad ${button}`;
}

function applyDeadZone(value = 0): number {
  return Math.abs(value) < DEAD_ZONE ? 0 : value;
}
