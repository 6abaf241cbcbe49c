// Which way comes next with methods that move one axis after the other.

import assert from "node:assert/strict";
import { test } from "node:test";
import { load } from "./bundle.mjs";

const { jogGoal } = await load("jogGoal");

const arm = { grasps: [{ widths: [0, 0.06], centre: [0, 0, 0], roll: 0, roll_range: [-0.5, 0.5], lean: 0.5 }] };
const scene = { table_height: 1, objects: [{ shape: { type: "cylinder", radius: 0.025, length: 0.05 } }], targets: [] };
const still = [0, 0, 0, 1];
/** The hand is upright and high, `x` and `y` from the block, with this axis chosen. */
const frame = (x, y, moves) => ({
  hand: { holds: null },
  next: 0,
  mode: { moves },
  objects: [{ translation: [0, 0, 1.02], rotation: still }],
  world_from_base: { translation: [0, 0, 1.5], rotation: still },
  world_from_tip: { translation: [-x, -y, 1.3], rotation: still },
});
const next = (...now) => jogGoal(frame(...now), arm, scene).nextMove;

test("the axis that is chosen is used up before the next one comes", () => {
  assert.equal(next(0.1, 0.2, { translation: 2 }).axis, 1, "the longer way first");
  assert.equal(next(0.1, 0.2, { translation: 0 }).axis, 0, "but not if another is chosen that has a way to go");
  assert.equal(next(0.1, 0.099, { translation: 1 }).axis, 1, "however near the two are");
  assert.equal(next(0.1, 0.01, { translation: 1 }).axis, 0, "until it is done");
  assert.equal(next(0.01, 0.01, { translation: 1 }).axis, 2, "then down");
});
