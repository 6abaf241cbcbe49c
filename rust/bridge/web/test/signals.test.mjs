// The pure parts of the drawer of signals and of the scoreboard.

import assert from "node:assert/strict";
import { test } from "node:test";
import { load } from "./bundle.mjs";

const {
  SignalHistory, TimeWindow, MAX_BACK_SECS, EmgColumns, confidenceInterval, toCsv, simulatedTrials, measureInterval, visitTrials, methodsOf, ScriptTime,
} = await load(
  "signalHistory",
  "timeWindow",
  "emgColumns",
  "confidenceInterval",
  "scores",
  "frameCount",
);

test("a history gives any part of its last entries as one piece, however often it has gone round", () => {
  const history = new SignalHistory(100);
  for (let k = 0; k < 1234; k++) history.push(k / 10, [k, -k]);
  assert.equal(history.latest, 123.3);
  assert.equal(history.oldest, 113.4);
  const { times, series } = history.between(115, 116);
  // An entry more at both ends.
  assert.deepEqual([...times].map((t) => Math.round(10 * t)), Array.from({ length: 12 }, (_, k) => 1149 + k));
  assert.deepEqual([...series[1]], Array.from({ length: 12 }, (_, k) => -1149 - k));
  assert.equal(history.between(0, 1e9).times.length, 100);
});

test("a value holds until the next, and time that goes back begins anew", () => {
  const history = new SignalHistory(10);
  history.push(1, [5]);
  history.push(2, [6]);
  assert.deepEqual(history.at(1.9), [5]);
  assert.deepEqual(history.at(2), [6]);
  assert.deepEqual(history.at(99), [6]);
  assert.deepEqual(history.at(0.5), []);
  history.push(2, [7]);
  assert.deepEqual(history.at(2), [7]);
  assert.equal(history.between(0, 9).times.length, 2);
  history.push(0.1, [8]);
  assert.equal(history.oldest, 0.1);
});

test("the window goes along, stands, and looks back no further than is kept", () => {
  const time = new TimeWindow();
  time.advance(50);
  assert.equal(time.edge, 50);
  time.lookBack(12);
  time.advance(55);
  assert.deepEqual([time.live, time.edge, time.lagSecs], [false, 38, 17]);
  time.lookBack(1000);
  assert.equal(time.lagSecs, MAX_BACK_SECS);
  time.advance(60);
  assert.equal(time.lagSecs, MAX_BACK_SECS);
  time.lookBack(0);
  assert.deepEqual([time.live, time.edge], [true, 60]);
  time.pause();
  time.advance(61);
  assert.equal(time.edge, 60);
  time.goLive();
  assert.equal(time.edge, 61);
});

test("columns of EMG are kept for as long as one may look back", () => {
  const emg = new EmgColumns(10, 30);
  const rows = Array.from({ length: 50 }, (_, k) => [k, -k]);
  for (let second = 0; second < 60; second++) for (let k = 0; k < 4; k++) emg.push(rows, 200);
  assert.ok(emg.columnCount - emg.oldest >= 4 * emg.count - 1);
  assert.deepEqual([emg.count, emg.channels], [600, 2]);
});

test("an interval is Student's, within what the numbers can be", () => {
  // Worked by hand: mean 3, standard deviation 1, t of two degrees of freedom 4.303, root of three.
  const { mean, bounds } = confidenceInterval([2, 3, 4]);
  assert.equal(mean, 3);
  assert.ok(Math.abs(bounds[0] - (3 - 4.303 / Math.sqrt(3))) < 1e-9);
  assert.deepEqual(confidenceInterval([4, 4, 3], 0, 4).bounds[1], 4);
  assert.equal(confidenceInterval([7]).bounds, null);
  assert.equal(confidenceInterval([]), null);
  // Sixty degrees of freedom: 2.000 in the tables.
  const many = Array.from({ length: 61 }, (_, k) => k % 2);
  const { count, mean: half, bounds: wide } = confidenceInterval(many);
  const sd = Math.sqrt(many.reduce((sum, value) => sum + (value - half) ** 2, 0) / 60);
  assert.equal(count, 61);
  assert.ok(Math.abs(wide[1] - half - (2.0 * sd) / Math.sqrt(61)) < 1e-3);
});

const card = { who: 'You, "me"', method: "D", score: 3, most: 4, score_name: "blocks on target", seconds: 61.5, attempts: 4, path_m: 2.5, objects: [], norms: [], faults: [] };
const content = { setup: "still", briefing: { most: 4, score_name: "blocks on target" }, arm: { side: "right" } };

test("trials of a visit become a row each for a spreadsheet", () => {
  const trials = visitTrials([card, { ...card, method: "A" }], content);
  assert.deepEqual(trials.map(({ method }) => method), ["A", "D"]);
  const lines = toCsv([...trials, { ...trials[0], path: null }]).split("\r\n");
  assert.equal(lines[0], "who,method,setup,score,seconds,attempts,path_m");
  assert.equal(lines[2], '"You, ""me""",D,still,3,61.5,4,2.5');
  assert.ok(lines[3].endsWith(",4,"));
  assert.equal(lines.length, 5);
});

test("simulated people stand beside the task and set-up that they have tried, and no other", () => {
  const people = simulatedTrials(content, "Simulated people");
  assert.deepEqual(methodsOf(people), ["A", "B", "C", "D"]);
  const [a, d] = ["A", "D"].map((method) => measureInterval(people, method, "score", 4));
  assert.ok(a.count === d.count && d.count >= 8 && d.mean > a.mean && d.bounds[1] <= 4);
  // A path that is not known is not counted as none.
  assert.ok(measureInterval(people, "A", "path", 4).count < a.count);
  assert.deepEqual(simulatedTrials({ ...content, setup: "elsewhere" }, "x"), []);
  assert.deepEqual(simulatedTrials({ ...content, briefing: { most: null, score_name: "cubes" } }, "x"), []);
  assert.deepEqual(simulatedTrials({ ...content, arm: { side: "left" } }, "x"), []);
});

test("of a picture's time the median and what nearly all keep are told, of the last pictures", () => {
  const time = new ScriptTime();
  for (let k = 0; k < 500; k++) time.take(k < 400 ? 100 : 1 + (k % 10));
  assert.ok(time.median < 110 && time.most === 100);
  for (let k = 0; k < 120; k++) time.take(k === 7 ? 50 : 2);
  assert.deepEqual([time.median, time.most], [2, 2]);
});
