// Everything with one switch: choices are offered one after the other, and the switch takes the one that is offered. A gesture
// that is held goes on until the switch is pressed again. Pure: the time is handed in.

import type { GestureKey } from "./settings";

export type ScanChoice =
  | { kind: "look" }
  | { kind: "back" }
  | { kind: "restart" }
  | { kind: "gesture"; gesture: GestureKey }
  | { kind: "place"; place: number };

export type ScanAction =
  | { act: "none" }
  | { act: "look"; place: number }
  | { act: "tap"; gesture: GestureKey }
  | { act: "hold"; gesture: GestureKey }
  | { act: "release" }
  | { act: "restart" };

/** Gestures whose effect lasts as long as they are made. */
export type HasDuration = (gesture: GestureKey) => boolean;

const GESTURES: GestureKey[] = ["wrist_flexion", "wrist_extension", "hand_close", "hand_open"];

export class Scanner {
  private level: "all" | "places" = "all";
  private index = 0;
  private since: number | null = null;
  private held: GestureKey | null = null;

  constructor(
    private readonly isHoldable: HasDuration,
    /** Another trial may be begun. */
    private readonly mayRestart = () => true,
  ) {}

  /** What is offered, in order. `looks`: the method follows the gaze; `places`: how many there are to look at. */
  choices(looks: boolean, places: number): ScanChoice[] {
    if (this.level === "places") {
      return [...Array.from({ length: places }, (_, place): ScanChoice => ({ kind: "place", place })), { kind: "back" }];
    }
    const gestures = GESTURES.map((gesture): ScanChoice => ({ kind: "gesture", gesture }));
    const restart = this.mayRestart() ? [{ kind: "restart" } as const] : [];
    return [...(looks && places > 0 ? [{ kind: "look" } as const] : []), ...gestures, ...restart];
  }

  /** What is offered now, each for `periodMs`; none while a gesture is held. */
  currentChoice(nowMs: number, periodMs: number, looks: boolean, places: number): ScanChoice | null {
    if (this.held) return null;
    const choices = this.choices(looks, places);
    this.since ??= nowMs;
    while (nowMs - this.since >= periodMs) {
      this.since += periodMs;
      this.index += 1;
    }
    this.index %= choices.length;
    return choices[this.index] ?? null;
  }

  /** The switch was pressed. */
  press(nowMs: number, periodMs: number, looks: boolean, places: number): ScanAction {
    if (this.held) {
      this.begin("all", nowMs);
      this.held = null;
      return { act: "release" };
    }
    const choice = this.currentChoice(nowMs, periodMs, looks, places);
    switch (choice?.kind) {
      case "look":
        this.begin("places", nowMs);
        return { act: "none" };
      case "place":
        // What is looked at is locked next.
        this.begin("all", nowMs);
        this.index = 1;
        return { act: "look", place: choice.place };
      case "gesture":
        this.since = nowMs;
        if (!this.isHoldable(choice.gesture)) return { act: "tap", gesture: choice.gesture };
        this.held = choice.gesture;
        return { act: "hold", gesture: choice.gesture };
      case "restart":
        this.begin("all", nowMs);
        return { act: "restart" };
      default:
        this.begin("all", nowMs);
        return { act: "none" };
    }
  }

  /** Lets go without the switch: the window lost the focus, or scanning ended. */
  reset(): void {
    this.held = null;
    this.level = "all";
    this.index = 0;
    this.since = null;
  }

  private begin(level: "all" | "places", nowMs: number): void {
    this.level = level;
    this.index = 0;
    this.since = nowMs;
  }
}
