// The one next thing to do, for every state that a frame can show. Pure.

import type { DisplayFrame, GestureName, InputSource, ObjectId, PlannerView, Stop } from "./generated/types";
import type { Aim } from "./aim";
import { plainName } from "./objects";
import { capitalised, gestureOfCode, GESTURE_NAMES } from "./protocol";
import type { GestureKey } from "./settings";

/** A place marker this near to the target is on it, metres. */
const ON_TARGET = 0.05;

/** The eight steps of a transfer with methods that select by gaze. */
export const STEPS: readonly { gesture: GestureKey | null; text: string }[] = [
  { gesture: null, text: "Look at a block" },
  { gesture: "wrist_flexion", text: "Lock it" },
  { gesture: "wrist_extension", text: "Reach" },
  { gesture: "hand_close", text: "Grip" },
  { gesture: null, text: "Look at its target" },
  { gesture: "wrist_flexion", text: "Lock it" },
  { gesture: "wrist_extension", text: "Carry" },
  { gesture: "hand_open", text: "Release" },
];

/** Where the target of an object is, metres in `world`; none if it has no place of its own. */
export type TargetPlace = (object: ObjectId) => { x: number; y: number } | null;

/** What a hint has to know beside the frame. */
export interface Circumstances {
  target: TargetPlace;
  /** The trunk can lean. */
  lean: boolean;
  /** The page's mouse is the gaze. */
  mouse: boolean;
  /** What makes a gesture, such as the key `W`; empty where muscles do. */
  key(gesture: GestureKey): string;
  /** The page may begin another trial. */
  restarts: boolean;
  /** Where the hand has to go, for methods that move one joint or axis after the other. */
  aim: Aim | null;
}

export interface Advice {
  /** Index into STEPS; none when none applies. */
  step: number | null;
  hint: string;
}

/** What the arm is stopped by, when that is alive again: the testbed's words for it. */
const RETURNED = /; it is back\b/;

/** A gesture by name, with its key: `wrist flexion (S)`. */
export function named(gesture: GestureKey, now: Circumstances): string {
  const key = now.key(gesture);
  const name = GESTURE_NAMES[gesture].name.toLowerCase();
  return key ? `${name} (${key})` : name;
}

/** The testbed's short forms of gestures, such as `HO`, as a person reads them. */
export function spelled(text: string, now: Circumstances): string {
  return text
    .replace(/ \((WE|WF|HC|HO)\)/g, (_, code: string) => `: ${of(code, now)}`)
    .replace(/\b(WE|WF|HC|HO)\b/g, (code) => of(code, now));
}

function of(code: string, now: Circumstances): string {
  const gesture = gestureOfCode(code);
  return gesture ? named(gesture, now) : code;
}

/** What to do now, whatever the style of the method. */
export function nextThing(frame: DisplayFrame, now: Circumstances): Advice {
  if (frame.finished) return { step: null, hint: now.restarts ? "The trial is over. Restart begins another." : "The trial is over." };
  if (frame.stop) return { step: null, hint: afterStop(frame.stop, now) };
  const asked = confirmation(frame.planner);
  if (asked) return { step: frame.hand.holds !== null && !frame.mode ? 7 : null, hint: `${capitalised(spelled(asked, now))}.` };
  return frame.mode ? jogging(frame, now) : selecting(frame, now);
}

/** A gesture that has to be made twice says so in the planner's place. */
function confirmation(planner: PlannerView): string | null {
  const waits = planner.state === "failed" && planner.status === "invalid" && /\bagain within\b/.test(planner.reason);
  return waits ? planner.reason : null;
}

/** The way out of a stop. */
export function afterStop(stop: Stop, now: Circumstances): string {
  if (RETURNED.test(stop.reason)) return now.key("wrist_extension") ? "Let go of all keys to go on." : "Relax your hand to go on.";
  const ways: Record<InputSource, string> = {
    armband: "Check the armband: it has to sit tight and be switched on.",
    gesture_topic: "Start the program that sends the gestures.",
    page: "Let go of all keys to go on.",
    eye_tracker: now.mouse
      ? "Move the mouse onto the box."
      : stop.cause === "lost"
        ? "Sit so that the eye tracker sees your eyes."
        : "Check that the eye tracker is connected.",
    shoulder_tracker: "Move back to where the tracker sees your shoulder.",
    limb_tracker: "Move back to where the tracker sees your arm.",
    stage: "Start the part of the program that ended.",
  };
  return ways[stop.source];
}

function look(what: string, now: Circumstances): string {
  return now.mouse ? `Move the mouse onto ${what}.` : `Look at ${what}.`;
}

/** With methods that select by gaze. */
function selecting(frame: DisplayFrame, now: Circumstances): Advice {
  const { hand, planner, target: selection } = frame;
  const moving = frame.gesture === "wrist_extension" && (planner.state === "planning" || planner.state === "executing");
  const extension = named("wrist_extension", now);
  const held = hand.holds !== null;
  const reach = held ? 6 : 2;
  if (!held && hand.state === "closing") return { step: 3, hint: "Wait: the hand closes." };
  if (hand.state === "opening") return { step: held ? 7 : null, hint: "Wait: the hand opens." };
  if (!held && hand.state === "closed") {
    return { step: null, hint: `The hand is closed around nothing: ${named("hand_open", now)} opens it.` };
  }
  if (planner.state === "failed" && !selection.locked && !held && selection.object === null) {
    return { step: 0, hint: `Nothing is selected. ${look(wanted(frame), now)}` };
  }
  if (planner.state === "failed") return { step: selection.locked ? reach : null, hint: afterFailure(frame, planner, now) };
  if (planner.state === "arrived" && planner.intermediate) {
    const hint = now.lean ? "Out of reach from here: lean towards it." : `Out of reach from here: let go, then hold ${extension} again.`;
    return { step: reach, hint };
  }
  if (moving) return { step: reach, hint: `Keep holding ${extension} until the arm arrives.` };
  if (hand.holds !== null) {
    const block = plainName(hand.holds);
    if (planner.state === "arrived") return { step: 7, hint: `${capitalised(named("hand_open", now))} puts ${block} down.` };
    if (selection.locked) return { step: 6, hint: `Hold ${extension}: the arm carries ${block}.` };
    const lock = `${capitalised(named("wrist_flexion", now))} locks the place under the marker.`;
    const goal = now.target(hand.holds);
    if (!goal) return { step: 5, hint: `${capitalised(named("wrist_flexion", now))} locks the place under the marker, beyond the partition.` };
    const near = selection.place && Math.hypot(goal.x - selection.place[0], goal.y - selection.place[1]) < ON_TARGET;
    return near ? { step: 5, hint: lock } : { step: 4, hint: look(`the target of ${block}`, now) };
  }
  if (planner.state === "arrived") return { step: 3, hint: `${capitalised(named("hand_close", now))} grips it.` };
  if (selection.locked) return { step: 2, hint: `Hold ${extension}: the arm reaches for it.` };
  return selection.object !== null && (frame.next === null || selection.object === frame.next)
    ? { step: 1, hint: `${capitalised(named("wrist_flexion", now))} locks what is highlighted.` }
    : { step: 0, hint: look(wanted(frame), now) };
}

function wanted(frame: DisplayFrame): string {
  return frame.next !== null ? plainName(frame.next) : "an object";
}

/** The planner's reason, and the way out of it. */
function afterFailure(frame: DisplayFrame, planner: Extract<PlannerView, { state: "failed" }>, now: Circumstances): string {
  const reason = capitalised(spelled(planner.reason || "no way was found", now).replace(/\.$/, ""));
  const again = `Let go, then hold ${named("wrist_extension", now)} again.`;
  const other = frame.target.locked
    ? `${capitalised(named("wrist_flexion", now))} unlocks it, so that you can choose another.`
    : look(frame.hand.holds !== null ? "another place" : "another block", now);
  const ways: Record<typeof planner.status, string> = {
    ok: again,
    intermediate: again,
    cancelled: again,
    no_plan: now.lean ? "Lean a little, and the arm tries again." : again,
    unreachable: now.lean ? "Lean towards it." : other,
    goal_in_collision: other,
    start_in_collision: now.lean ? "Lean away from it." : now.restarts ? "Restart begins another trial." : "Ask for help.",
    // A method's own refusal says itself what to do.
    invalid: "",
  };
  return `${reason}. ${ways[planner.status]}`.trimEnd();
}

/** With methods that move one joint or axis after the other. */
function jogging(frame: DisplayFrame, now: Circumstances): Advice {
  const { planner, hand } = frame;
  const [open, close] = [named("hand_open", now), named("hand_close", now)];
  const advice = (hint: string) => ({ step: null, hint });
  if (planner.state === "failed") {
    const reason = capitalised(spelled(planner.reason || "this way is closed", now).replace(/\.$/, ""));
    return advice(`${reason}. ${capitalised(open)} goes to the next.`);
  }
  if (hand.holds !== null) {
    const block = plainName(hand.holds);
    if (hand.state !== "opening" && now.aim) {
      const way = along(frame, now);
      if (way) return advice(way);
    }
    return advice(hand.state === "opening" ? "Wait: the hand opens." : `Carry ${block} over the partition and lower it; ${close} lets go.`);
  }
  if (hand.state === "closing") return advice("Wait: the hand closes.");
  if (hand.state === "closed") return advice(`The hand is closed around nothing: ${close} opens it.`);
  if (hand.state === "opening") return advice("Wait: the hand opens.");
  return advice(along(frame, now) ?? `Bring the hand around ${wanted(frame)}; ${close} grips.`);
}

/** The next way with axes; with joints the distances alone are told. */
function along(frame: DisplayFrame, now: Circumstances): string | null {
  const { aim } = now;
  const moves = frame.mode?.moves;
  if (!aim || !frame.mode || !moves || "joint" in moves) return null;
  const close = capitalised(named("hand_close", now));
  const block = plainName(aim.object);
  if (!aim.next) return frame.hand.holds === null ? `${close} grips ${block}.` : `${close} lets go of ${block}.`;
  const { kind, axis, amount } = aim.next;
  const [chosen, turns] = "rotation" in moves ? [moves.rotation, true] : [moves.translation, false];
  if (chosen !== axis || turns !== (kind === "turn")) {
    return `${capitalised(named("hand_open", now))} until "${AXES[kind][axis]}" is chosen.`;
  }
  const extends_ = amount * (frame.mode.we_sign < 0 ? -1 : 1) > 0;
  const gesture = named(extends_ ? "wrist_extension" : "wrist_flexion", now);
  const direction = frame.mode.directions[extends_ ? 0 : 1];
  const far = kind === "turn" ? `${Math.round((Math.abs(amount) * 180) / Math.PI)}°` : `${Math.max(Math.round(100 * Math.abs(amount)), 1)} cm`;
  return `Hold ${gesture}: ${far} ${direction}.`;
}

/** As the profile calls the axes. */
const AXES = {
  slide: ["translation along x", "translation along y", "translation along z"],
  turn: ["rotation about x", "rotation about y", "rotation about z"],
} as const;

/** How far the hand, or the block in it, is from where it has to go: `12 cm forward, 3 cm right, 21 cm down`. */
export function distances({ off }: Aim): string {
  const words: [string, string][] = [["forward", "backward"], ["left", "right"], ["up", "down"]];
  const parts = words.map(([plus, minus], k) => {
    const cm = Math.round(100 * (off[k] ?? 0));
    return cm === 0 ? "" : `${Math.abs(cm)} cm ${cm > 0 ? plus : minus}`;
  });
  return parts.filter(Boolean).join(", ") || "there";
}

/** A gesture of the model's own says what was made, else the command's name. */
export function recognisedText(frame: { gesture: keyof typeof GESTURE_NAMES; recognised: GestureName }): string {
  return frame.recognised === frame.gesture ? GESTURE_NAMES[frame.gesture].name : frame.recognised.replaceAll("_", " ");
}
