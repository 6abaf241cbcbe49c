// What holds a gesture lets go of it when it is not read.

import assert from "node:assert/strict";
import { test } from "node:test";
import { load } from "./bundle.mjs";

const { Holding, READ_FOR_MS } = await load("holding");

test("the newest gesture is in force, and the one before it when it is let go of", () => {
  const holding = new Holding();
  assert.equal(holding.inForce, "no_motion");
  holding.press("KeyW", "wrist_extension", false);
  holding.press("gamepad 2", "hand_close", true);
  assert.equal(holding.inForce, "hand_close");
  holding.release("gamepad 2");
  assert.equal(holding.inForce, "wrist_extension");
  holding.releaseAll();
  assert.equal(holding.inForce, "no_motion");
});

test("what nobody reads is let go of once, and not while pictures come", () => {
  const holding = new Holding();
  holding.read(1000);
  holding.press("gamepad 7", "wrist_extension", true);
  assert.equal(holding.releaseUnread(1000 + READ_FOR_MS), false);
  holding.read(1000 + READ_FOR_MS);
  assert.equal(holding.releaseUnread(1000 + 2 * READ_FOR_MS), false);
  assert.equal(holding.inForce, "wrist_extension");
  assert.equal(holding.releaseUnread(1001 + 2 * READ_FOR_MS), true);
  assert.equal(holding.inForce, "no_motion");
  assert.equal(holding.releaseUnread(9000), false);
});

test("a key needs no pictures", () => {
  const holding = new Holding();
  holding.press("KeyW", "wrist_extension", false);
  assert.equal(holding.releaseUnread(1e6), false);
  assert.equal(holding.inForce, "wrist_extension");
});
