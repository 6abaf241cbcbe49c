// What a person is told, for each state of the page: the one next thing, in the words of the page.

import assert from "node:assert/strict";
import { test } from "node:test";
import { load } from "./bundle.mjs";

const { STEPS, nextHint, setSceneObjects } = await load("hints", "objects");
setSceneObjects({ objects: ["red1", "red2", "blue1", "blue2"].map((name) => ({ name })) });

const KEYS = { wrist_extension: "W", wrist_flexion: "S", hand_close: "A", hand_open: "D" };
const page = { target: () => ({ x: 0.05, y: 0.2 }), lean: false, mouseIsGaze: true, key: (gesture) => KEYS[gesture], mayRestart: true, jogGoal: null };
const seated = { ...page, lean: true };
const muscles = { ...page, mouseIsGaze: false, key: () => "" };

function frame(changes = {}) {
  return {
    finished: false,
    next: 0,
    gesture: "no_motion",
    mode: null,
    stop: null,
    hand: { state: "open", holds: null },
    target: { object: null, place: null, locked: false, posterior: [] },
    planner: { state: "idle" },
    ...changes,
  };
}

const arrived = { state: "arrived", intermediate: false };
const seen = { object: 0, place: null, locked: false };
const locked = { object: 0, place: null, locked: true };
const holding = { state: "closed", holds: 0 };
const over = { object: null, place: [0.05, 0.19, 1], locked: false };
const placed = { ...over, locked: true };
const failed = (status, reason) => ({ state: "failed", status, reason });
const stop = (source, cause, reason = `the ${source.replace("_", " ")} is ${cause}`) => ({ source, cause, since: 10, reason });
const mode = { moves: { joint: 3 }, name: "elbow flexion", directions: ["flexion", "extension"], we_sign: 1, next_in_secs: null };
const WE = "wrist_extension";

/** State, circumstances, what is said. */
const TABLE = [
  // A transfer, step by step.
  [{}, page, "Move the mouse onto red 1."],
  [{}, muscles, "Look at red 1."],
  [{ next: null }, page, "Move the mouse onto an object."],
  [{ target: { ...seen, object: 3 } }, page, "Move the mouse onto red 1."],
  [{ target: seen }, page, "Wrist flexion (S) locks what is highlighted."],
  [{ target: seen }, muscles, "Wrist flexion locks what is highlighted."],
  [{ target: locked }, page, "Hold wrist extension (W): the arm reaches for it."],
  [{ target: locked, gesture: WE, planner: { state: "planning" } }, page, "Keep holding wrist extension (W) until the arm arrives."],
  [{ target: seen, gesture: WE, planner: { state: "executing", progress: 0.2, intermediate: false } }, page, "Keep holding wrist extension (W) until the arm arrives."],
  [{ target: locked, planner: arrived }, page, "Hand close (A) grips it."],
  [{ target: seen, planner: arrived }, page, "Hand close (A) grips it."],
  [{ hand: { state: "closing", holds: null }, target: locked, planner: arrived }, page, "Wait: the hand closes."],
  [{ hand: holding, target: { ...over, place: [0.1, 0.05, 1] } }, page, "Move the mouse onto the target of red 1."],
  [{ hand: holding, target: over }, page, "Wrist flexion (S) locks the place under the marker."],
  [{ hand: holding, target: placed }, page, "Hold wrist extension (W): the arm carries red 1."],
  [{ hand: holding, target: placed, planner: arrived }, page, "Hand open (D) puts red 1 down."],
  [{ hand: { state: "opening", holds: 0 }, target: placed, planner: arrived }, page, "Wait: the hand opens."],
  // A grip in the air, whatever else is on display.
  [{ hand: { state: "closed", holds: null } }, page, "The hand is closed around nothing: hand open (D) opens it."],
  [{ hand: { state: "closed", holds: null }, target: locked, planner: arrived }, page, "The hand is closed around nothing: hand open (D) opens it."],
  [
    { hand: { state: "closed", holds: null }, planner: failed("invalid", "the hand is closed and empty: open it first (HO)") },
    page,
    "The hand is closed around nothing: hand open (D) opens it.",
  ],
  // No plan.
  [{ planner: failed("invalid", "nothing is selected: look at a block") }, page, "Nothing is selected. Move the mouse onto red 1."],
  [{ planner: failed("invalid", "nothing is selected: look at a block") }, muscles, "Nothing is selected. Look at red 1."],
  [{ target: locked, planner: failed("unreachable", "4 cm too far") }, seated, "4 cm too far. Lean towards it."],
  [
    { target: locked, planner: failed("unreachable", "4 cm too far") },
    page,
    "4 cm too far. Wrist flexion (S) unlocks it, so that you can choose another.",
  ],
  [{ target: seen, planner: failed("unreachable", "4 cm too far.") }, page, "4 cm too far. Move the mouse onto another block."],
  [{ hand: holding, target: over, planner: failed("goal_in_collision", "blue 1 is there") }, page, "Blue 1 is there. Move the mouse onto another place."],
  [{ target: locked, planner: failed("no_plan", "no way was found") }, page, "No way was found. Let go, then hold wrist extension (W) again."],
  [{ target: locked, planner: failed("start_in_collision", "the arm touches the box") }, page, "The arm touches the box. Restart begins another trial."],
  [{ target: locked, planner: failed("start_in_collision", "the arm touches the box") }, seated, "The arm touches the box. Lean away from it."],
  [{ target: locked, planner: { state: "arrived", intermediate: true } }, seated, "Out of reach from here: lean towards it."],
  [
    { target: locked, planner: { state: "arrived", intermediate: true } },
    page,
    "Out of reach from here: let go, then hold wrist extension (W) again.",
  ],
  [
    { hand: holding, target: placed, planner: failed("invalid", "HO again within 1.5 s opens the hand") },
    page,
    "Hand open (D) again within 1.5 s opens the hand.",
  ],
  // One joint or axis after the other.
  [{ mode }, page, "Bring the hand around red 1; hand close (A) grips."],
  [{ mode, next: null }, muscles, "Bring the hand around an object; hand close grips."],
  [{ mode, hand: holding }, page, "Carry red 1 over the partition and lower it; hand close (A) lets go."],
  [{ mode, hand: { state: "closed", holds: null } }, page, "The hand is closed around nothing: hand close (A) opens it."],
  [{ mode, hand: { state: "closing", holds: null } }, page, "Wait: the hand closes."],
  [{ mode, hand: { state: "opening", holds: null } }, page, "Wait: the hand opens."],
  [{ mode, planner: failed("invalid", "the elbow is at its limit") }, page, "The elbow is at its limit. Hand open (D) goes to the next."],
  [{ mode, hand: holding, planner: failed("invalid", "HC again within 1.5 s opens the hand") }, page, "Hand close (A) again within 1.5 s opens the hand."],
  // A stop comes before everything but the end.
  [{ target: locked, stop: stop("eye_tracker", "silent") }, page, "Move the mouse onto the box."],
  [{ target: locked, stop: stop("eye_tracker", "lost") }, muscles, "Sit so that the eye tracker sees your eyes."],
  [{ stop: stop("eye_tracker", "frozen") }, muscles, "Check that the eye tracker is connected."],
  [{ stop: stop("eye_tracker", "undecided") }, page, "Check that this program runs and answers."],
  [{ stop: stop("armband", "undecided") }, muscles, "Check that this program runs and answers."],
  [{ stop: stop("participant", "undecided") }, page, "Check that this program runs and answers."],
  [{ mode, stop: stop("page", "silent") }, page, "Let go of all keys to go on."],
  [{ stop: stop("eye_tracker", "silent", "the eye tracker is silent; it is back: relax the hand to go on") }, page, "Let go of all keys to go on."],
  [{ stop: stop("armband", "silent", "the armband is silent; it is back: relax the hand to go on") }, muscles, "Relax your hand to go on."],
  [{ stop: stop("armband", "flat") }, muscles, "Check the armband: it has to sit tight and be switched on."],
  [{ stop: stop("gesture_topic", "silent") }, page, "Start the program that sends the gestures."],
  [{ stop: stop("shoulder_tracker", "silent") }, page, "Move back to where the tracker sees your shoulder."],
  [{ stop: stop("limb_tracker", "frozen") }, page, "Move back to where the tracker sees your arm."],
  [{ stop: stop("stage", "lost") }, page, "Start the part of the program that ended."],
  [{ finished: true, stop: stop("page", "silent") }, page, "The trial is over. Restart begins another."],
  [{ finished: true }, { ...page, mayRestart: false }, "The trial is over."],
];

test("each state has its hint, which says the one next thing", () => {
  for (const [state, circumstances, said] of TABLE) {
    assert.equal(nextHint(frame(state), circumstances).hint, said, JSON.stringify(state));
  }
});

test("no hint has a bare code, a developer's word or the same verb twice", () => {
  for (const [state, circumstances] of TABLE) {
    const { hint } = nextHint(frame(state), circumstances);
    assert.doesNotMatch(hint, /\b(WE|WF|HC|HO|NM|plan|planner|invalid|null|undefined)\b/, hint);
    assert.doesNotMatch(hint, /\bhold\b.*\bhold\b/i, hint);
    assert.ok(hint.split(/[.] /).length <= 2, `a reason and one thing to do: ${hint}`);
  }
});

test("a transfer walks through all eight steps in order", () => {
  const situations = [
    {},
    { target: seen },
    { target: locked },
    { target: locked, planner: arrived },
    { hand: holding, target: { ...over, place: [0.1, 0.05, 1] } },
    { hand: holding, target: over },
    { hand: holding, target: placed },
    { hand: holding, target: placed, planner: arrived },
  ];
  assert.deepEqual(situations.map((now) => nextHint(frame(now), page).step), STEPS.map((_, k) => k));
});
