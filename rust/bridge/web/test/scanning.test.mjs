// One switch is enough for everything.

import assert from "node:assert/strict";
import { test } from "node:test";
import { load } from "./bundle.mjs";

const { Scanner } = await load("scanning");
const { DWELL_CHOICES_MS, SCAN_CHOICES_MS, parseSettings } = await load("settings");
const PERIOD = 1000;
const selecting = () => new Scanner((gesture) => gesture === "wrist_extension");

test("choices are offered one after the other and begin again after the last", () => {
  const scanner = selecting();
  const offered = (now) => scanner.currentChoice(now, PERIOD, true, 4);
  const round = [0, 1, 2, 3, 4, 5].map((k) => offered(1000 * k + 500));
  assert.deepEqual(round[0], { kind: "look" });
  assert.deepEqual(round.slice(1, 5).map(({ gesture }) => gesture), ["wrist_flexion", "wrist_extension", "hand_close", "hand_open"]);
  assert.deepEqual(round[5], { kind: "restart" });
  assert.deepEqual(offered(6500), { kind: "look" });
  // Without gaze there is nothing to look at.
  assert.equal(selecting().currentChoice(0, PERIOD, false, 4).gesture, "wrist_flexion");
});

test("where no other trial may be begun, none is offered", () => {
  const scanner = new Scanner(() => false, () => false);
  assert.ok(!scanner.choices(true, 4).some(({ kind }) => kind === "restart"));
  assert.ok(selecting().choices(true, 4).some(({ kind }) => kind === "restart"));
});

test("a look opens the places, and the lock is offered after one was taken", () => {
  const scanner = selecting();
  const press = (now) => scanner.press(now, PERIOD, true, 2);
  assert.deepEqual(press(0), { act: "none" });
  assert.deepEqual(scanner.currentChoice(100, PERIOD, true, 2), { kind: "place", place: 0 });
  assert.deepEqual(press(1100), { act: "look", place: 1 });
  assert.deepEqual(press(1200), { act: "tap", gesture: "wrist_flexion" });
});

test("one may go back from the places", () => {
  const scanner = selecting();
  scanner.press(0, PERIOD, true, 2);
  assert.deepEqual(scanner.currentChoice(2100, PERIOD, true, 2), { kind: "back" });
  assert.deepEqual(scanner.press(2100, PERIOD, true, 2), { act: "none" });
  assert.deepEqual(scanner.currentChoice(2200, PERIOD, true, 2), { kind: "look" });
});

test("a gesture that lasts goes on until the next press, whatever the time", () => {
  const scanner = selecting();
  scanner.currentChoice(0, PERIOD, true, 4);
  assert.deepEqual(scanner.press(2500, PERIOD, true, 4), { act: "hold", gesture: "wrist_extension" });
  assert.equal(scanner.currentChoice(60_000, PERIOD, true, 4), null);
  assert.deepEqual(scanner.press(60_000, PERIOD, true, 4), { act: "release" });
  scanner.currentChoice(60_000, PERIOD, true, 4);
  scanner.reset();
  assert.notEqual(scanner.currentChoice(70_000, PERIOD, true, 4), null);
});

test("times of resting and scanning are those that are offered", () => {
  assert.equal(parseSettings('{"dwellMs":1000,"scanMs":1500}').dwellMs, 1000);
  const odd = parseSettings('{"dwellMs":3,"scanMs":"1500","mouseGestures":false}');
  assert.deepEqual([odd.dwellMs, odd.scanMs, odd.mouseGestures], [0, 0, false]);
  assert.ok(DWELL_CHOICES_MS.includes(0) && SCAN_CHOICES_MS.includes(0));
});
