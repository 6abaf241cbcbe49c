// What is shown beside the scene: quality of the gaze, lost frames, the state of the selection, cues.

import assert from "node:assert/strict";
import { test } from "node:test";
import { load } from "./bundle.mjs";

const { correction, scorePoint, summarize } = await load("gazeCheck");
const { FrameCounter } = await load("frameCount");
const { selectionState } = await load("selectionState");
const { SPOKEN_CUES, cueOf } = await load("sounds");
const { eventText } = await load("hud");

/** A gaze from the origin, `degrees` off the x axis. */
function gaze(degrees, valid = true) {
  const angle = (degrees * Math.PI) / 180;
  return { origin: [0, 0, 0], direction: [Math.cos(angle), Math.sin(angle), 0], valid };
}
const close = (value, expected) => assert.ok(Math.abs(value - expected) < 1e-9, `${value}, expected ${expected}`);

test("accuracy is the mean angle to the point and precision that between samples", () => {
  const looks = [2, 2, 4, 4].map((degrees, k) => ({ time: 16 * k, gaze: gaze(degrees) }));
  const result = scorePoint(looks, [3, 0, 0]);
  close(result.accuracy_deg, 3);
  close(result.precision_deg, Math.sqrt(4 / 3));
  assert.equal(result.lost_share, 0);
  assert.equal(result.samples, 4);
});

test("lost samples count in the share, and a gap of the length of a blink is one", () => {
  const looks = Array.from({ length: 60 }, (_, k) => ({ time: 16 * k, gaze: gaze(0, k < 20 || k >= 30) }));
  looks[50].gaze = null;
  const result = scorePoint(looks, [1, 0, 0]);
  close(result.lost_share, 11 / 60);
  assert.equal(result.blinks, 1);
  close(result.accuracy_deg, 0);
});

test("a source that never sees the eye has no accuracy and is lost altogether", () => {
  assert.deepEqual(scorePoint([], [1, 0, 0]), { accuracy_deg: null, precision_deg: null, offset_deg: null, lost_share: 1, blinks: 0, samples: 0 });
  const blind = scorePoint([{ time: 0, gaze: gaze(0, false) }], [1, 0, 0]);
  assert.equal(blind.accuracy_deg, null);
  assert.equal(summarize([blind]).accuracy, null);
  assert.equal(summarize([blind]).lost, 1);
});

test("a direction of no length is not taken for a good look", () => {
  const nothing = { origin: [0, 0, 0], direction: [0, 0, 0], valid: true };
  assert.equal(scorePoint([{ time: 0, gaze: nothing }], [1, 0, 0]).accuracy_deg, null);
});

test("frames of 60 Hz lose none, and each gap counts what is missing", () => {
  const count = new FrameCounter();
  for (let k = 1; k <= 60; k++) count.countFrame(Math.ceil((k * 1000) / 60));
  assert.equal(count.dropped, 0);
  count.countFrame(1100);
  assert.equal(count.dropped, 5);
  count.restart();
  count.countFrame(5000);
  assert.equal(count.dropped, 5);
  assert.equal(count.received, 62);
});

test("the marker tells free, locked, reachable and not reachable apart", () => {
  const frame = (locked, planner) => ({ target: { locked }, planner });
  assert.equal(selectionState(frame(false, { state: "failed", status: "unreachable" })), "free");
  assert.equal(selectionState(frame(true, { state: "idle" })), "locked");
  assert.equal(selectionState(frame(true, { state: "planning" })), "locked");
  assert.equal(selectionState(frame(true, { state: "executing", progress: 0.5, intermediate: false })), "reachable");
  assert.equal(selectionState(frame(true, { state: "arrived", intermediate: true })), "unreachable");
  assert.equal(selectionState(frame(true, { state: "failed", status: "unreachable", reason: "" })), "unreachable");
});

test("contact is spoken as the testbed says it, and a plan is heard only when it fails", () => {
  const notes = (event) => cueOf({ time: 0, ...event })?.notes;
  assert.notEqual(SPOKEN_CUES.contact_made, SPOKEN_CUES.contact_lost);
  assert.equal(SPOKEN_CUES.grip, undefined);
  assert.equal(notes({ event: "object_attached", object: 0 }), undefined, "the testbed's cue is heard, not the event too");
  assert.equal(notes({ event: "plan_finished", status: "ok" }), undefined);
  assert.ok(notes({ event: "plan_finished", status: "unreachable" }).length > 0);
  assert.equal(notes({ event: "gesture_changed", gesture: "no_motion" }), undefined);
});

test("a stop is told with its reason, and what ended it", () => {
  const reason = "the armband repeats its samples: relax the hand to go on";
  assert.equal(eventText({ time: 0, event: "stopped", source: "armband", cause: "frozen", reason }), `Stopped: ${reason}`);
  assert.equal(eventText({ time: 9, event: "rearmed" }), "Relaxed: gestures act again");
});

test("a calibration takes off the error that the points agree on, and nothing else", () => {
  const points = (error) => [-20, 0, 20].map((at) => scorePoint([{ time: 0, gaze: gaze(error(at)) }], gaze(at).direction));
  const [left, up] = correction(points((at) => at + 2));
  close(left, 2);
  close(up, 0);
  assert.match(correction(points((at) => at + 2).slice(1)), /only 2 of 2 points/);
  assert.match(correction(points((at) => at + 16)), /off by 16.0°/);
  assert.match(correction(points((at) => 1.5 * at)), /differ by 10.0°/);
});

const { defaultPageName, driverText } = await load("controlLease");

test("a page says by name who drives, and has a name of its own", () => {
  assert.equal(driverText({ name: "Ann", you: true, may_drive: true }), "You drive");
  assert.equal(driverText({ name: "Ann", you: false, may_drive: true }), "Ann drives. You watch.");
  assert.equal(driverText({ name: null, you: false, may_drive: true }), "Nobody drives");
  const agents = {
    "Mozilla/5.0 (X11; Linux x86_64) AppleWebKit/537.36 (KHTML, like Gecko) Chrome/149.0.0.0 Safari/537.36": "Chrome on Linux",
    "Mozilla/5.0 (Android 14; Mobile; rv:140.0) Gecko/140.0 Firefox/140.0": "Firefox on Android",
    "Mozilla/5.0 (Macintosh; Intel Mac OS X 10_15_7) AppleWebKit/605.1.15 (KHTML, like Gecko) Version/18.5 Safari/605.1.15": "Safari on macOS",
    "something else": "A page",
  };
  for (const [agent, name] of Object.entries(agents)) assert.equal(defaultPageName(agent), name);
});
