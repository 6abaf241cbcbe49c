// What holds a gesture lets go of it when it dies or is not read, and takes a new press when it is back.

import assert from "node:assert/strict";
import { test } from "node:test";
import { load } from "./bundle.mjs";

// The gamepad's module looks at these two alone.
globalThis.window = new EventTarget();
let pads = [];
Object.defineProperty(globalThis, "navigator", { value: { getGamepads: () => pads }, configurable: true });

const { HeldGestures, POLL_TIMEOUT_MS } = await load("heldGestures");
const { GamepadInput } = await load("gamepad");
const TRIGGER = 7;

test("the newest gesture is in force, and the one before it when it is let go of", () => {
  const holding = new HeldGestures();
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
  const holding = new HeldGestures();
  holding.markPolled(1000);
  holding.press("gamepad 7", "wrist_extension", true);
  assert.equal(holding.releaseUnpolled(1000 + POLL_TIMEOUT_MS), false);
  holding.markPolled(1000 + POLL_TIMEOUT_MS);
  assert.equal(holding.releaseUnpolled(1000 + 2 * POLL_TIMEOUT_MS), false);
  assert.equal(holding.inForce, "wrist_extension");
  assert.equal(holding.releaseUnpolled(1001 + 2 * POLL_TIMEOUT_MS), true);
  assert.equal(holding.inForce, "no_motion");
  assert.equal(holding.releaseUnpolled(9000), false);
});

test("a key needs no pictures", () => {
  const holding = new HeldGestures();
  holding.press("KeyW", "wrist_extension", false);
  assert.equal(holding.releaseUnpolled(1e6), false);
  assert.equal(holding.inForce, "wrist_extension");
});

/** A gamepad input whose calls are noted, and a gamepad with its trigger pressed. */
function played(index = 0) {
  const calls = [];
  const input = new GamepadInput({
    hold: (source, gesture, down) => calls.push(`${gesture} ${down ? "down" : "up"}`),
    moveGaze() {},
    restart() {},
    camera() {},
    found: () => calls.push("found"),
    lost: () => calls.push("lost"),
  });
  const buttons = Array.from({ length: 17 }, () => ({ value: 0 }));
  const pad = { id: "pad", index, connected: true, axes: [0, 0, 0, 0], buttons };
  pads = [pad];
  buttons[TRIGGER].value = 1;
  input.update(0.016);
  assert.deepEqual(calls.splice(0), ["found", "wrist_extension down"]);
  return { input, calls, pad };
}

function disconnect(pad) {
  window.dispatchEvent(Object.assign(new Event("gamepaddisconnected"), { gamepad: pad }));
}

test("a gamepad that disconnects lets go at once, without a picture", () => {
  const { calls, pad } = played();
  disconnect(pad);
  assert.ok(calls.includes("wrist_extension up"), calls.join());
  assert.equal(calls.at(-1), "lost");
});

test("so does one that the browser drops without a word, and only once", () => {
  const { input, calls } = played();
  pads = [null];
  input.update(0.016);
  assert.ok(calls.includes("wrist_extension up"), calls.join());
  calls.length = 0;
  input.update(0.016);
  assert.deepEqual(calls, []);
});

test("another gamepad that disconnects changes nothing", () => {
  const { calls } = played(1);
  disconnect({ index: 0 });
  assert.deepEqual(calls, []);
});

test("a button held while the gamepad was gone takes a new press", () => {
  const { input, calls, pad } = played();
  disconnect(pad);
  calls.length = 0;
  input.update(0.016);
  assert.deepEqual(calls.splice(0), ["found"]);
  pad.buttons[TRIGGER].value = 0;
  input.update(0.016);
  pad.buttons[TRIGGER].value = 1;
  input.update(0.016);
  assert.deepEqual(calls, ["wrist_extension up", "wrist_extension down"]);
});
