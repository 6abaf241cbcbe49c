// The one next thing to do, for every state that a frame can show. Pure.

import type { DisplayFrame, Gesture, InputSource, ObjectId, PlannerView, Stop } from "./generated/types";
import type { JogGoal } from "./jogGoal";
import { plainName } from "./objects";
import { capitalize, gestureOfCode, GESTURE_NAMES } from "./protocol";
import type { GestureKey } from "./settings";
import { strings } from "./strings";

const words = strings.hints;

/** A place marker this near to the target is on it, metres. */
const ON_TARGET_DISTANCE_M = 0.05;

/** The eight steps of a transfer with methods that select by gaze. */
export const STEPS: readonly { gesture: GestureKey | null; text: string }[] = [
  { gesture: null, text: words.steps.look },
  { gesture: "wrist_flexion", text: words.steps.lock },
  { gesture: "wrist_extension", text: words.steps.reach },
  { gesture: "hand_close", text: words.steps.grip },
  { gesture: null, text: words.steps.lookAtTarget },
  { gesture: "wrist_flexion", text: words.steps.lock },
  { gesture: "wrist_extension", text: words.steps.carry },
  { gesture: "hand_open", text: words.steps.release },
];

/** Where the target of an object is, metres in `world`; none if it has no place of its own. */
export type TargetPosition = (object: ObjectId) => { x: number; y: number } | null;

/** What a hint has to know beside the frame. */
export interface HintContext {
  target: TargetPosition;
  /** The trunk can lean. */
  lean: boolean;
  /** The page's mouse is the gaze. */
  mouseIsGaze: boolean;
  /** What makes a gesture, such as the key `W`; empty where muscles do. */
  key(gesture: GestureKey): string;
  /** The page may begin another trial. */
  mayRestart: boolean;
  /** Where the hand has to go, for methods that move one joint or axis after the other. */
  jogGoal: JogGoal | null;
}

export interface Advice {
  /** Index into STEPS; none when none applies. */
  step: number | null;
  hint: string;
}

/** What the arm is stopped by, when that is alive again: the testbed's words for it. */
const RECOVERABLE_STOPS = /; it is back\b/;

/** A gesture by name, with its key: `wrist flexion (S)`. */
export function gestureWithKey(gesture: GestureKey, now: HintContext): string {
  const key = now.key(gesture);
  const name = GESTURE_NAMES[gesture].name.toLowerCase();
  return key ? `${name} (${key})` : name;
}

/** The testbed's short forms of gestures, such as `HO`, as a person reads them. */
export function expandGestureCodes(text: string, now: HintContext): string {
  return text
    .replace(/ \((WE|WF|HC|HO)\)/g, (_, code: string) => `: ${of(code, now)}`)
    .replace(/\b(WE|WF|HC|HO)\b/g, (code) => of(code, now));
}

function of(code: string, now: HintContext): string {
  const gesture = gestureOfCode(code);
  return gesture ? gestureWithKey(gesture, now) : code;
}

/** What to do now, whatever the style of the method. */
export function nextHint(frame: DisplayFrame, now: HintContext): Advice {
  if (frame.finished) return { step: null, hint: now.mayRestart ? words.overRestart : words.over };
  if (frame.stop) return { step: null, hint: stopHint(frame.stop, now) };
  const asked = confirmation(frame.planner);
  if (asked) return { step: frame.hand.holds !== null && !frame.mode ? 7 : null, hint: `${capitalize(expandGestureCodes(asked, now))}.` };
  return frame.mode ? jogHint(frame, now) : selectionHint(frame, now);
}

/** A gesture that has to be made twice says so in the planner's place. */
function confirmation(planner: PlannerView): string | null {
  const waits = planner.state === "failed" && planner.status === "invalid" && /\bagain within\b/.test(planner.reason);
  return waits ? planner.reason : null;
}

/** The way out of a stop. */
export function stopHint(stop: Stop, now: HintContext): string {
  if (RECOVERABLE_STOPS.test(stop.reason)) return now.key("wrist_extension") ? words.letGoOfKeys : words.relax;
  if (stop.cause === "undecided" || stop.source === "method") return words.program;
  const ways: Record<InputSource, string> = {
    armband: words.armband,
    gesture_topic: words.gestureTopic,
    page: words.letGoOfKeys,
    eye_tracker: now.mouseIsGaze
      ? words.mouseOntoBox
      : stop.cause === "lost"
        ? words.eyesLost
        : words.eyeTracker,
    shoulder_tracker: words.shoulder,
    limb_tracker: words.limb,
    stage: words.stage,
    participant: words.program,
    method: words.program,
  };
  return ways[stop.source];
}

function lookHint(what: string, now: HintContext): string {
  return (now.mouseIsGaze ? words.mouseOnto : words.lookAt)(what);
}

/** With methods that select by gaze. */
function selectionHint(frame: DisplayFrame, now: HintContext): Advice {
  const { hand, planner, target: selection } = frame;
  const moving = frame.gesture === "wrist_extension" && (planner.state === "planning" || planner.state === "executing");
  const extension = gestureWithKey("wrist_extension", now);
  const held = hand.holds !== null;
  const reach = held ? 6 : 2;
  if (!held && hand.state === "closing") return { step: 3, hint: words.closes };
  if (hand.state === "opening") return { step: held ? 7 : null, hint: words.opens };
  if (!held && hand.state === "closed") {
    return { step: null, hint: words.aroundNothing(gestureWithKey("hand_open", now)) };
  }
  if (planner.state === "failed" && !selection.locked && !held && selection.object === null) {
    return { step: 0, hint: words.nothingSelected(lookHint(wanted(frame), now)) };
  }
  if (planner.state === "failed") return { step: selection.locked ? reach : null, hint: planFailureHint(frame, planner, now) };
  if (planner.state === "arrived" && planner.intermediate) {
    const hint = now.lean ? words.outOfReachLean : words.outOfReachAgain(extension);
    return { step: reach, hint };
  }
  if (moving) return { step: reach, hint: words.keepHolding(extension) };
  if (hand.holds !== null) {
    const block = plainName(hand.holds);
    if (planner.state === "arrived") return { step: 7, hint: capitalize(words.putsDown(gestureWithKey("hand_open", now), block)) };
    if (selection.locked) return { step: 6, hint: words.holdToCarry(extension, block) };
    const lock = capitalize(words.locksPlace(gestureWithKey("wrist_flexion", now)));
    const goal = now.target(hand.holds);
    if (!goal) return { step: 5, hint: capitalize(words.locksPlaceBeyond(gestureWithKey("wrist_flexion", now))) };
    const near = selection.place && Math.hypot(goal.x - selection.place[0], goal.y - selection.place[1]) < ON_TARGET_DISTANCE_M;
    return near ? { step: 5, hint: lock } : { step: 4, hint: lookHint(words.targetOf(block), now) };
  }
  if (planner.state === "arrived") return { step: 3, hint: capitalize(words.gripsIt(gestureWithKey("hand_close", now))) };
  if (selection.locked) return { step: 2, hint: words.holdToReach(extension) };
  return selection.object !== null && (frame.next === null || selection.object === frame.next)
    ? { step: 1, hint: capitalize(words.locksHighlighted(gestureWithKey("wrist_flexion", now))) }
    : { step: 0, hint: lookHint(wanted(frame), now) };
}

function wanted(frame: DisplayFrame): string {
  return frame.next !== null ? plainName(frame.next) : words.anObject;
}

/** The planner's reason, and the way out of it. */
function planFailureHint(frame: DisplayFrame, planner: Extract<PlannerView, { state: "failed" }>, now: HintContext): string {
  const reason = capitalize(expandGestureCodes(planner.reason || words.noWay, now).replace(/\.$/, ""));
  const again = words.again(gestureWithKey("wrist_extension", now));
  const other = frame.target.locked
    ? capitalize(words.unlocks(gestureWithKey("wrist_flexion", now)))
    : lookHint(frame.hand.holds !== null ? words.anotherPlace : words.anotherBlock, now);
  const ways: Record<typeof planner.status, string> = {
    ok: again,
    intermediate: again,
    cancelled: again,
    no_plan: now.lean ? words.leanALittle : again,
    unreachable: now.lean ? words.leanTowards : other,
    goal_in_collision: other,
    start_in_collision: now.lean ? words.leanAway : now.mayRestart ? words.restart : words.askForHelp,
    // A method's own refusal says itself what to do.
    invalid: "",
  };
  return `${reason}. ${ways[planner.status]}`.trimEnd();
}

/** With methods that move one joint or axis after the other. */
function jogHint(frame: DisplayFrame, now: HintContext): Advice {
  const { planner, hand } = frame;
  const [open, close] = [gestureWithKey("hand_open", now), gestureWithKey("hand_close", now)];
  const advice = (hint: string) => ({ step: null, hint });
  if (planner.state === "failed") {
    const reason = capitalize(expandGestureCodes(planner.reason || words.closed, now).replace(/\.$/, ""));
    return advice(words.goesToNext(reason, capitalize(open)));
  }
  if (hand.holds !== null) {
    const block = plainName(hand.holds);
    if (hand.state !== "opening" && now.jogGoal) {
      const way = moveHint(frame, now);
      if (way) return advice(way);
    }
    return advice(hand.state === "opening" ? words.opens : words.carryOver(block, close));
  }
  if (hand.state === "closing") return advice(words.closes);
  if (hand.state === "closed") return advice(words.aroundNothing(close));
  if (hand.state === "opening") return advice(words.opens);
  return advice(moveHint(frame, now) ?? words.bringAround(wanted(frame), close));
}

/** The next way with axes; with joints the distances alone are told. */
function moveHint(frame: DisplayFrame, now: HintContext): string | null {
  const { jogGoal: aim } = now;
  const moves = frame.mode?.moves;
  if (!aim || !frame.mode || !moves || "joint" in moves) return null;
  const close = capitalize(gestureWithKey("hand_close", now));
  const block = plainName(aim.object);
  if (!aim.nextMove) return (frame.hand.holds === null ? words.grips : words.letsGoOf)(close, block);
  const { kind, axis, amount } = aim.nextMove;
  const [chosen, turns] = "rotation" in moves ? [moves.rotation, true] : [moves.translation, false];
  if (chosen !== axis || turns !== (kind === "turn")) {
    return capitalize(words.untilChosen(gestureWithKey("hand_open", now), AXES[kind][axis]));
  }
  const extends_ = amount * (frame.mode.we_sign < 0 ? -1 : 1) > 0;
  const gesture = gestureWithKey(extends_ ? "wrist_extension" : "wrist_flexion", now);
  const direction = frame.mode.directions[extends_ ? 0 : 1];
  const far = kind === "turn" ? `${Math.round((Math.abs(amount) * 180) / Math.PI)}°` : `${Math.max(Math.round(100 * Math.abs(amount)), 1)} cm`;
  return words.holdFar(gesture, far, direction);
}

/** As the profile calls the axes. */
const AXES = {
  slide: ["translation along x", "translation along y", "translation along z"],
  turn: ["rotation about x", "rotation about y", "rotation about z"],
} as const;

/** How far the hand, or the block in it, is from where it has to go: `12 cm forward, 3 cm right, 21 cm down`. */
export function distanceText({ offset: off }: JogGoal): string {
  const parts = words.directions.map(([plus, minus], k) => {
    const cm = Math.round(100 * (off[k] ?? 0));
    return cm === 0 ? "" : `${Math.abs(cm)} cm ${cm > 0 ? plus : minus}`;
  });
  return parts.filter(Boolean).join(", ") || words.there;
}

/** A gesture of the model's own says what was made, else the command's name. */
export function recognizedText(frame: { gesture: keyof typeof GESTURE_NAMES; recognised: Gesture }): string {
  return frame.recognised === frame.gesture ? GESTURE_NAMES[frame.gesture].name : frame.recognised.replaceAll("_", " ");
}
