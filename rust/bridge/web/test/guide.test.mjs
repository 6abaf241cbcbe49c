// What the strip tells a newcomer, for each situation of a transfer with method D.

import assert from "node:assert/strict";
import { test } from "node:test";
import { load } from "./bundle.mjs";

const { STEPS, advise, knowObjects, stepwiseHint } = await load("guide", "objects");
knowObjects({ objects: ["red1", "red2", "blue1", "blue2"].map((name) => ({ name })) });
const target = () => ({ x: 0.05, y: 0.2 });

function frame(changes = {}) {
  return {
    finished: false,
    next: 0,
    hand: { state: "open", holds: null },
    target: { object: null, place: null, locked: false, posterior: [] },
    planner: { state: "idle" },
    ...changes,
  };
}

const arrived = { state: "arrived", intermediate: false };
const locked = { object: 0, place: null, locked: true };
const holding = { state: "closed", holds: 0 };

test("a transfer walks through all eight steps in order", () => {
  const situations = [
    frame(),
    frame({ target: { object: 0, place: null, locked: false } }),
    frame({ target: locked }),
    frame({ target: locked, planner: arrived }),
    frame({ hand: holding, target: { object: null, place: [0.1, 0.05, 1], locked: false } }),
    frame({ hand: holding, target: { object: null, place: [0.05, 0.19, 1], locked: false } }),
    frame({ hand: holding, target: { object: null, place: [0.05, 0.19, 1], locked: true } }),
    frame({ hand: holding, target: { object: null, place: [0.05, 0.19, 1], locked: true }, planner: arrived }),
  ];
  assert.deepEqual(situations.map((now) => advise(now, target, false).step), STEPS.map((_, k) => k));
});

test("another block than the one that is next is not to be locked", () => {
  const advice = advise(frame({ target: { object: 3, place: null, locked: false } }), target, false);
  assert.equal(advice.step, 0);
  assert.match(advice.hint, /red 1/);
});

test("a failed plan gives its reason, and leaning only where the trunk can move", () => {
  const now = frame({ target: locked, planner: { state: "failed", status: "unreachable", reason: "4 cm too far" } });
  assert.match(advise(now, target, true).hint, /^4 cm too far\. Lean/);
  assert.doesNotMatch(advise(now, target, false).hint, /[Ll]ean/);
});

test("while the arm is stopped the reason comes before everything but the end", () => {
  const stop = { source: "page", cause: "silent", since: 10, reason: "the page is silent: relax the hand to go on" };
  const now = frame({ stop, target: locked, mode: { name: "elbow flexion/extension" } });
  assert.deepEqual(advise(now, target, true), { step: null, hint: "The page is silent: relax the hand to go on." });
  assert.equal(stepwiseHint(now), "The page is silent: relax the hand to go on.");
  assert.match(advise(frame({ stop, finished: true }), target, true).hint, /over/);
  assert.equal(advise(frame({ stop: null }), target, true).step, 0);
});

test("an intermediate goal asks to relax and hold again", () => {
  const now = frame({ target: locked, planner: { state: "arrived", intermediate: true } });
  assert.equal(advise(now, target, false).step, 2);
  assert.match(advise(now, target, true).hint, /lean towards it, relax/);
});

test("a hand closed around nothing has to be opened", () => {
  assert.match(advise(frame({ hand: { state: "closed", holds: null } }), target, false).hint, /HO opens/);
});
