// What the tables at the end of the motion test and of target achievement control say.

import assert from "node:assert/strict";
import { test } from "node:test";
import { load } from "./bundle.mjs";

const { motionRows, tacRows } = await load("limbResults");

test("a row each gesture, and all of them", () => {
  const attempt = (prompt, selection_secs, completion_secs, wrong) => ({ prompt, selection_secs, completion_secs, right: 0, wrong });
  const attempts = [attempt("hand_close", 0.2, 1.2, 0), attempt("hand_open", null, null, 4), attempt("hand_close", 0.4, null, 2)];
  assert.deepEqual(motionRows({ attempts }), [
    { name: "Close the hand", done: 1, all: 2, means: [0.30000000000000004, 1.2, 1] },
    { name: "Open the hand", done: 0, all: 1, means: [null, null, 4] },
    { name: "all", done: 1, all: 3, means: [0.30000000000000004, 1.2, 2] },
  ]);
});

test("a row each axis, or each target of several", () => {
  const trial = (target, secs, overshoots, path_efficiency) => ({ target, secs, overshoots, path_efficiency });
  const one = [trial([["grasp", 40]], 2, 1, 0.5), trial([["wrist flexion", -20]], null, 3, null), trial([["grasp", 80]], 4, 0, 1)];
  assert.deepEqual(tacRows({ trials: one }).map(({ name, done, all, means }) => [name, done, all, ...means]), [
    ["grasp", 2, 2, 3, 0.5, 75],
    ["wrist flexion", 0, 1, null, 3, null],
    ["all", 2, 3, 3, 4 / 3, 75],
  ]);
  const both = trial([["wrist flexion", 31.4], ["grasp", 80]], 5, 0, 0.7);
  assert.deepEqual(tacRows({ trials: [both, both] }).map(({ name }) => name), ["1: wrist flexion 31°, grasp 80 %", "2: wrist flexion 31°, grasp 80 %", "all"]);
});
