// The strip that tells a newcomer what to do next with methods C and D. The step follows from the frame alone.

import { element, setClass, setText } from "./dom";
import type { Frame } from "./protocol";
import { numberOf, colourOf } from "./protocol";

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

/** Where the target of a block is, metres in `world`. */
export type TargetPlace = (block: string) => { x: number; y: number } | null;

export interface Advice {
  /** Index into STEPS; none when none applies. */
  step: number | null;
  hint: string;
}

/** What a person has to do now. */
export function advise(frame: Frame, target: TargetPlace, lean: boolean): Advice {
  const { hand, planner, target: selection } = frame;
  if (frame.finished) return { step: null, hint: "The trial is over." };
  const arrived = planner.state === "arrived";
  if (planner.state === "failed") {
    const reason = planner.reason || "there is no plan";
    const what = lean ? "Lean, or look elsewhere, then try again." : "Look elsewhere, then try again.";
    return {
      step: selection.locked ? (hand.holds ? 6 : 2) : null,
      hint: `${reason[0]?.toUpperCase()}${reason.slice(1).replace(/\.$/, "")}. ${what}`,
    };
  }
  if (arrived && planner.intermediate) {
    return { step: hand.holds ? 6 : 2, hint: `Out of reach from here: ${lean ? "lean towards it, " : ""}relax, then hold WE again.` };
  }
  if (hand.holds) {
    const block = `${colourOf(hand.holds)} ${numberOf(hand.holds)}`;
    if (hand.state === "opening") return { step: 7, hint: `Releasing ${block} …` };
    if (arrived && selection.locked) return { step: 7, hint: `HO opens the hand and puts ${block} down.` };
    if (selection.locked) return { step: 6, hint: `Hold WE: the arm carries ${block}. Anything else stops it.` };
    const goal = target(hand.holds);
    const near =
      goal && selection.place && Math.hypot(goal.x - selection.place[0], goal.y - selection.place[1]) < ON_TARGET;
    return near
      ? { step: 5, hint: "WF locks the place under the marker." }
      : { step: 4, hint: `Look at target ${block} on the other side.` };
  }
  if (hand.state === "closing") return { step: 3, hint: "The hand closes …" };
  if (hand.state === "closed") return { step: null, hint: "The hand is closed around nothing: HO opens it." };
  if (arrived && selection.locked) return { step: 3, hint: "HC closes the hand around the block." };
  if (selection.locked) return { step: 2, hint: "Hold WE: the arm reaches for the block. Anything else stops it." };
  const wanted = frame.next_block;
  const name = wanted ? `${colourOf(wanted)} ${numberOf(wanted)}` : "a block";
  return selection.block !== null && (wanted === null || selection.block === wanted)
    ? { step: 1, hint: "WF locks the highlighted block." }
    : { step: 0, hint: `Look at ${name}.` };
}

export class Guide {
  readonly root = element("section", "card guide");
  private readonly steps = STEPS.map(({ key, text }) =>
    element("li", "", key ? element("kbd", "", key) : null, element("span", "", text)),
  );
  private readonly hint = element("p", "hint");

  constructor() {
    this.root.append(element("ol", "steps", ...this.steps), this.hint);
    this.root.setAttribute("aria-label", "What to do next");
    this.root.hidden = true;
  }

  update(frame: Frame, target: TargetPlace, lean: boolean): void {
    // Methods A and B have no selection: the strip would mislead.
    this.root.hidden = !["C", "D"].includes(frame.method);
    const advice = advise(frame, target, lean);
    this.steps.forEach((step, k) => {
      setClass(step, "now", k === advice.step);
      setClass(step, "past", advice.step !== null && k < advice.step);
    });
    setText(this.hint, advice.hint);
  }
}
