// The strip that tells a newcomer what to do next with methods C and D. The step follows from the frame alone.

import { element, setClass, setText } from "./dom";
import type { DisplayFrame, MethodHelp, MethodInfo, ObjectId } from "./generated/types";
import { plainName } from "./objects";
import { capitalised, stopText } from "./protocol";

/** A place marker this near to the target is on it, metres. */
const ON_TARGET = 0.05;

export const STEPS = [
  { key: "", text: "Look at a block" },
  { key: "WF", text: "locks it" },
  { key: "WE", text: "hold to reach" },
  { key: "HC", text: "grips" },
  { key: "", text: "Look at its target" },
  { key: "WF", text: "locks it" },
  { key: "WE", text: "hold to carry" },
  { key: "HO", text: "releases" },
] as const;

/** Where the target of an object is, metres in `world`; none if it has no place of its own. */
export type TargetPlace = (object: ObjectId) => { x: number; y: number } | null;

export interface Advice {
  /** Index into STEPS; none when none applies. */
  step: number | null;
  hint: string;
}

/** What a person has to do now. */
export function advise(frame: DisplayFrame, target: TargetPlace, lean: boolean): Advice {
  const { hand, planner, target: selection } = frame;
  if (frame.finished) return { step: null, hint: "The trial is over." };
  if (frame.stop) return { step: null, hint: stopText(frame.stop) };
  const arrived = planner.state === "arrived";
  if (planner.state === "failed") {
    const reason = planner.reason || "there is no plan";
    const what = lean ? "Lean, or look elsewhere, then try again." : "Look elsewhere, then try again.";
    return {
      step: selection.locked ? (hand.holds !== null ? 6 : 2) : null,
      hint: `${capitalised(reason.replace(/\.$/, ""))}. ${what}`,
    };
  }
  if (arrived && planner.intermediate) {
    return { step: hand.holds !== null ? 6 : 2, hint: `Out of reach from here: ${lean ? "lean towards it, " : ""}relax, then hold WE again.` };
  }
  if (hand.holds !== null) {
    const block = plainName(hand.holds);
    if (hand.state === "opening") return { step: 7, hint: `Releasing ${block} …` };
    if (arrived && selection.locked) return { step: 7, hint: `HO opens the hand and puts ${block} down.` };
    if (selection.locked) return { step: 6, hint: `Hold WE: the arm carries ${block}. Anything else stops it.` };
    const goal = target(hand.holds);
    if (!goal) return { step: 5, hint: "Look across the partition; WF locks the place under the marker." };
    const near =
      selection.place && Math.hypot(goal.x - selection.place[0], goal.y - selection.place[1]) < ON_TARGET;
    return near
      ? { step: 5, hint: "WF locks the place under the marker." }
      : { step: 4, hint: `Look at the target of ${block} on the other side.` };
  }
  if (hand.state === "closing") return { step: 3, hint: "The hand closes …" };
  if (hand.state === "closed") return { step: null, hint: "The hand is closed around nothing: HO opens it." };
  if (arrived && selection.locked) return { step: 3, hint: "HC closes the hand around it." };
  if (selection.locked) return { step: 2, hint: "Hold WE: the arm reaches for it. Anything else stops it." };
  const wanted = frame.next;
  const name = wanted !== null ? plainName(wanted) : "an object";
  return selection.object !== null && (wanted === null || selection.object === wanted)
    ? { step: 1, hint: "WF locks what is highlighted." }
    : { step: 0, hint: `Look at ${name}.` };
}

export class Guide {
  readonly root = element("section", "card guide");
  private readonly steps = STEPS.map(({ key, text }) =>
    element("li", "", key ? element("kbd", "", key) : null, element("span", "", text)),
  );
  private readonly hint = element("p", "hint");

  private readonly list = element("ol", "steps", ...this.steps);
  private readonly moves = [
    { gesture: "hand_open", key: "HO", text: element("span") },
    { gesture: "wrist_extension", key: "WE", text: element("span") },
    { gesture: "wrist_flexion", key: "WF", text: element("span") },
    { gesture: "hand_close", key: "HC", text: element("span") },
  ].map(({ gesture, key, text }) => ({ gesture, text, item: element("li", "", element("kbd", "", key), text) }));
  private readonly modes = element("ol", "steps", ...this.moves.map(({ item }) => item));

  constructor() {
    this.root.append(this.list, this.modes, this.hint);
    this.root.setAttribute("aria-label", "What to do next");
    this.root.hidden = true;
  }

  update(frame: DisplayFrame, target: TargetPlace, lean: boolean, method: MethodInfo | undefined): void {
    const stepwise = method?.style === "jogging";
    this.root.hidden = method === undefined;
    this.list.hidden = stepwise;
    this.modes.hidden = !stepwise;
    if (stepwise) {
      this.showMode(frame, method.help);
      return;
    }
    const advice = advise(frame, target, lean);
    this.steps.forEach((step, k) => {
      setClass(step, "now", k === advice.step);
      setClass(step, "past", advice.step !== null && k < advice.step);
    });
    setText(this.hint, advice.hint);
  }

  /** Such methods have no selection: the strip says what each gesture does now. */
  private showMode(frame: DisplayFrame, help: MethodHelp): void {
    const texts: Record<string, string> = {
      hand_open: `${help.hand_open || "next"} (hold: back)`,
      wrist_extension: frame.mode?.directions[0] ?? (help.wrist_extension || "+"),
      wrist_flexion: frame.mode?.directions[1] ?? (help.wrist_flexion || "−"),
      hand_close: frame.hand.state === "open" ? "close" : "open",
    };
    for (const { gesture, text, item } of this.moves) {
      setText(text, texts[gesture] ?? "");
      setClass(item, "now", frame.gesture === gesture);
    }
    setText(this.hint, stepwiseHint(frame));
  }
}

/** What a person has to do now with a method that moves one joint or axis after the other. */
export function stepwiseHint(frame: DisplayFrame): string {
  const moved = capitalised(frame.mode?.name ?? "");
  if (frame.finished) return "The trial is over.";
  if (frame.stop) return stopText(frame.stop);
  if (frame.planner.state === "failed") return `${frame.planner.reason.replace(/\.$/, "")}: move another way, or HO for the next.`;
  if (frame.hand.holds !== null) return `${moved}. Carry ${plainName(frame.hand.holds)} over the partition, lower it, HC lets go.`;
  const goal = frame.next !== null ? `Bring the hand around ${plainName(frame.next)}, HC grips.` : "Bring the hand around an object, HC grips.";
  return `${moved}. ${goal}`;
}
