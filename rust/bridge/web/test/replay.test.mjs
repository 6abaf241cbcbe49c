// Replay: what is plotted, what a link holds, and what a saved picture says.

import assert from "node:assert/strict";
import { test } from "node:test";
import { load } from "./bundle.mjs";

const { fromQuery, toQuery, defaultMoment } = await load("replayLink");
const { lanesOf, spansOf } = await load("replaySignals");
const { timeOf } = await load("replayEvents");
const { axisLabels, rowPosition, valueAt } = await load("signalData");
const { SvgPen, drawFigure, axisTicks, sizeOf, decimate } = await load("replayFigure");

const SPEEDS = [0.1, 0.25, 0.5, 1, 2, 4];

test("a link opens the moment that it was made at", () => {
  const moment = {
    ...defaultMoment(),
    trials: [3, 1],
    time: -1234,
    camera: "free",
    eye: [0.1, -0.2, 1.5],
    at: [0, 0, 1],
    speed: 0.25,
    hidden: ["gesture", "plan"],
    folded: ["emg"],
    align: { event: "grasp_made", occurrence: 2 },
    window: [-5000, 2500],
    below: true,
  };
  const query = toQuery(moment, new URLSearchParams("quality=3&t=9"));
  assert.equal(query.get("quality"), "3", "what else the address says stays");
  assert.deepEqual(fromQuery(new URLSearchParams(query.toString()), 4, SPEEDS), moment);
});

test("what a link says wrongly is as it begins", () => {
  const moment = fromQuery(new URLSearchParams("trial=7&t=x&camera=roof&eye=1,2&speed=3&hide=no&align=grasp_made,0&window=5,1"), 1, SPEEDS);
  assert.deepEqual(moment, { ...defaultMoment(), trials: [0] });
  assert.equal(fromQuery(new URLSearchParams("align=no_such_event,1"), 1, SPEEDS).align, null);
  assert.deepEqual(fromQuery(new URLSearchParams(""), 3, SPEEDS).trials, [0, 1], "the first two");
});

test("trials are aligned by the event of a kind and number", () => {
  const events = [10, 20, 30].map((time, k) => ({ time, event: k === 1 ? "locked" : "grasp_made" }));
  assert.equal(timeOf(events, "grasp_made", 2), 30);
  assert.equal(timeOf(events, "grasp_made", 3), null);
});

test("a state is a span from its first instant to the next state", () => {
  const spans = spansOf([0, 1, 2, 3], ["a", "a", null, "b"], (label) => ({ label, color: "" }));
  assert.deepEqual(spans.map(({ from, to, label }) => [from, to, label]), [[0, 2, "a"], [3, 3, "b"]]);
});

test("the value at an instant is that of the last one up to it", () => {
  assert.equal(valueAt([1, 2, 3], [10, null, 30], 0.9), null);
  assert.equal(valueAt([1, 2, 3], [10, null, 30], 1.5), 10);
  assert.equal(valueAt([1, 2, 3], [10, null, 30], 2.5), null);
  assert.equal(valueAt([1, 2, 3], [10, null, 30], 99), 30);
});

/** A record with what the plots read of it. */
function recorded() {
  const frame = (time, share) => ({
    time,
    joints: [share],
    objects: [],
    gaze: { origin: [0, 0, 2], direction: [0.1, 0.2, -1], valid: time !== 100 },
    target: { object: 0, place: [0.1, 0.2, 1], locked: time >= 100, posterior: [share, 1 - share] },
    planner: time < 100 ? { state: "idle" } : { state: "executing", progress: share, intermediate: false },
    goal: time < 100 ? null : [0.5],
    recognised: time < 100 ? "no_motion" : "wrist_extension",
  });
  const thing = (name, colour) => ({ name, colour });
  return {
    name: "record",
    frames: [frame(0, 0), frame(100, 0.25), frame(200, 1)],
    content: {
      arm: {
        arm: [0],
        joints: [{ name: "m__elbow", kind: "revolute", limits: { lower: -1, upper: 1 } }],
        settings: { joints: [{ joint: "elbow", name: "elbow flexion" }] },
      },
      scene: { table_height: 1, objects: [thing("red1", [1, 0, 0]), thing("red2", [1, 0, 0])] },
    },
    emg: {
      rate_hz: 1000,
      step_ms: 10,
      lowest: [[9, -1], [], [8, -2]],
      highest: [[11, 1], [], [12, 2]],
      gestures: ["hand_close", "pinch"],
      windows: [{ time: 50, posterior: [0.25, 0.75], in_force: "pinch", effort: 0.5 }],
    },
  };
}

test("a trial is plotted with its muscles, intent, plans and joints between their limits", () => {
  const lanes = Object.fromEntries(lanesOf(recorded()).map((lane) => [lane.name, lane]));
  assert.deepEqual(Object.keys(lanes), ["emg", "decoder", "gesture", "gaze", "intent", "plan", "joints"]);
  const emg = lanes.emg.data;
  assert.equal(emg.rows.length, 2);
  assert.deepEqual(emg.times, [0, 0.005, 0.01, 0.015, 0.02, 0.025]);
  assert.deepEqual(emg.lines[0].values, [-1, 1, null, null, -2, 2], "about its mean, with a gap");
  assert.deepEqual(lanes.decoder.data.lines.map(({ label }) => label), ["Hand close", "Pinch", "Effort"]);
  assert.deepEqual(lanes.gesture.data.spans.map(({ label }) => label), ["", "Wrist extension"]);
  assert.deepEqual(lanes.gaze.data.lines[1].values, [0.2, null, 0.2], "where the ray meets the table");
  assert.deepEqual(lanes.gaze.data.spans.map(({ from, to }) => [from, to]), [[0.1, 0.2]]);
  assert.deepEqual(lanes.intent.data.lines.map(({ label, dashed }) => [label, dashed]), [["Red 1", false], ["Red 2", true]]);
  assert.deepEqual(lanes.plan.data.lines[0].values, [null, 0.25, 1]);
  const [row] = lanes.joints.data.rows;
  assert.deepEqual([row.label, Math.round(row.minimum), Math.round(row.maximum)], ["Elbow flexion", -57, 57]);
  const [angle, goal] = lanes.joints.data.lines;
  assert.ok(goal.isSecondary && goal.values[0] === null);
  const lowest = rowPosition(lanes.joints.data, angle, row.minimum);
  const highest = rowPosition(lanes.joints.data, angle, row.maximum);
  assert.ok(lowest > 0 && highest < 1 && highest > lowest, "the limits lie inside the row");
});

test("what a trial has not is not plotted", () => {
  const record = recorded();
  record.emg = null;
  for (const frame of record.frames) {
    Object.assign(frame, { gaze: null, planner: { state: "idle" }, target: { ...frame.target, posterior: [] } });
  }
  assert.deepEqual(lanesOf(record).map(({ name }) => name), ["gesture", "joints"]);
});

test("marks of a time axis are round, and a dense line keeps its peaks", () => {
  assert.deepEqual(axisTicks(-3, 7, 5), [-2, 0, 2, 4, 6]);
  const points = Array.from({ length: 1000 }, (_, k) => [k / 100, k === 523 ? 99 : k % 2]);
  const kept = decimate(points);
  assert.ok(kept.length < 100 && kept.some(([, y]) => y === 99), `${kept.length} points`);
});

test("a picture says of which trial and moment it is, and names its axes and lines", () => {
  const plots = lanesOf(recorded()).map(({ title, data }) => ({ title, data, isLineShown: () => true }));
  const trial = { caption: "a <b> & c", scene: null, plots, time: 0.15, window: [0, 0.2], zero: 0.1 };
  const { width, height } = sizeOf([trial]);
  const pen = new SvgPen(width, height, "title");
  drawFigure(pen, [trial], "Time from: grasp made 1");
  const svg = pen.toString();
  const texts = [...svg.matchAll(/<text[^>]*>([^<]*)<\/text>/g)].map((match) => match[1]);
  for (const text of ["a &lt;b&gt; &amp; c", "Time from: grasp made 1 (s)", "Joint angles", "Elbow flexion 14.3°", "Red 1 0.25", "−0.1", "−57.3"]) {
    assert.ok(texts.includes(text), `${text} in ${texts.join(" | ")}`);
  }
  assert.ok(!svg.includes("NaN") && svg.split("<polyline").length > 10);
});

test("what stands at the left of a row with edges lies within the row", () => {
  const rows = [0, 1].map((k) => ({ label: `joint ${k}`, minimum: -10, maximum: 20 * (k + 1), edges: true }));
  const levels = axisLabels({ rows });
  assert.deepEqual(levels.map(({ text }) => text), ["−10", "20", "−10", "40"]);
  assert.ok(levels[0].place > 1 && levels[1].place < 2 && levels[3].place < 1);
});
