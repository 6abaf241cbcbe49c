// What the experimenter's page says of a study: labels, reasons, times.

import assert from "node:assert/strict";
import { test } from "node:test";
import { load } from "./bundle.mjs";

const {
  subjectText,
  ageText,
  answerCounts,
  beginLabel,
  BreakClock,
  breakText,
  clockText,
  deviationText,
  suggestedId,
  leftText,
  nextLabel,
  stepState,
  noteCounts,
  participantText,
} = await load("conductText");
const { QUESTIONS } = await load("reasons");

const KINDS = ["say", "form", "train", "calibrate_gaze", "demonstrate", "practise", "rest", "trial"];
const line = (step, label, more = {}) => ({ step, label, condition: null, outcome: null, attempts: 0, deviations: [], ...more });
const now = (step, is, running = true, more = {}) => ({ step, label: `step ${step}`, running, since_secs: 0, what: { is, ...more } });

test("the next button says what it does to the step that is on", () => {
  const labels = (running) => KINDS.map((is) => nextLabel(now(1, is, running)));
  assert.deepEqual(labels(false), [
    "Start",
    "Start questionnaire",
    "Start training",
    "Start calibration",
    "Start demonstration",
    "Start practice",
    "Start break",
    "Start trial",
  ]);
  assert.deepEqual(labels(true), ["Done, next", "Done, next", "End training", "Done, next", "End demonstration", "End practice", "End break", "Next"]);
  assert.equal(nextLabel(null), "Finish session");
});

test("a session that was begun before is continued", () => {
  const next = { participant: 3, id: "P03", session: "1", begun: false, departs: "" };
  assert.equal(beginLabel(next), "Begin session");
  assert.equal(beginLabel({ ...next, begun: true }), "Continue session");
  assert.equal(beginLabel(null), "Begin session");
});

test("the step that is on is now, whatever became of an attempt before", () => {
  const is = now(2, "trial");
  assert.equal(stepState(line(1, "trial 1 of A", { outcome: "aborted" }), is), "aborted");
  assert.equal(stepState(line(2, "trial 2 of A", { attempts: 1 }), is), "now");
  assert.equal(stepState(line(3, "trial 3 of A"), is), "to_do");
  assert.equal(stepState(line(2, "trial 2 of A"), null), "to_do");
});

test("deviations are a sentence", () => {
  assert.equal(deviationText(["repeated", "not_ready"]), "Done again; begun although something was not ready");
  assert.equal(deviationText([]), "");
});

test("ages, clocks and what is left are rounded so that none promises too much", () => {
  assert.deepEqual([-1, 0, 59.9, 60, 3599, 3600, 7380].map(ageText), ["0 s", "0 s", "59 s", "1 min", "59 min", "1 h 0 min", "2 h 3 min"]);
  assert.deepEqual([0, 9.9, 65, 600].map(clockText), ["0:00", "0:09", "1:05", "10:00"]);
  assert.deepEqual([61.2, 60, 4.1, 0, -2].map(leftText), ["at most 1 h 2 min left", "at most 1 h 0 min left", "at most 5 min left", "at most 0 min left", "at most 0 min left"]);
});

test("who is next has a place, and a pseudonym where there is one", () => {
  assert.equal(participantText({ participant: 3, id: "P03", session: "1" }), "P03 · Participant 3 · Session 1");
  assert.equal(participantText({ participant: 5, id: null, session: "2" }), "Participant 5 · Session 2");
});

test("a new participant is named after the first free place", () => {
  const people = (...ids) => ids.map((id, k) => ({ participant: k + 1, id, steps: [0, 1], trials: [0, 1] }));
  assert.equal(suggestedId(people("mira", null, "P03", null)), "P02");
  assert.equal(suggestedId(people("mira")), "");
});

test("optional questions do not count as questions to be answered", () => {
  const item = (key, optional = false) => ({ kind: "text", key, text: { en: key }, optional });
  const screen = { form: { items: [item("a"), item("b"), item("c", true)] }, pairs: [], missing: ["b"] };
  assert.deepEqual(answerCounts(screen), [1, 2]);
});

test("a break counts on by itself, and over its time once it is over", () => {
  const clock = new BreakClock();
  clock.take(5, 10, 1000);
  assert.equal(clock.leftSecs(4000), 7);
  assert.deepEqual(breakText(clock.leftSecs(4200)), { text: "0:07 left", over: false });
  // The server says no more than that it is over.
  clock.take(5, 0, 12_000);
  assert.deepEqual(breakText(clock.leftSecs(74_000)), { text: "1:03 over time", over: true });
  // The server's clock is ahead of this one.
  clock.take(5, 3, 80_000);
  clock.take(5, 0, 81_000);
  assert.equal(clock.leftSecs(82_000), -1);
});

test("of a break that was over when the page was opened nobody knows since when", () => {
  const clock = new BreakClock();
  clock.take(5, 0, 1000);
  assert.deepEqual(breakText(clock.leftSecs(9000)), { text: "Over", over: true });
  clock.take(6, 60, 10_000);
  assert.equal(clock.leftSecs(10_000), 60);
  clock.take(7, 0, 11_000);
  assert.equal(clock.leftSecs(11_000), null, "another break has another end");
});

test("a dialog says what it is about", () => {
  const checks = [
    { name: "eye_tracker", ready: false, found: "2.9° off" },
    { name: "armband", ready: true, found: "8 channels" },
    { name: "disk", ready: false, found: "full" },
  ];
  const steps = [line(1, "trial 1 of A", { outcome: "done" }), line(2, "break", { outcome: "done" }), line(3, "trial 2 of A")];
  const session = { steps, now: { ...now(3, "trial", false, { checks }), label: "trial 2 of A" } };
  assert.equal(subjectText("redo", session), "Trial 1 of A");
  assert.equal(subjectText("skip", session), "Trial 2 of A");
  assert.equal(subjectText("start_anyway", session), "Not ready: eye tracker (2.9° off), disk (full)");
  assert.equal(subjectText("retrain", session), "");
  assert.equal(subjectText("redo", { steps: [], now: null }), "");
});

test("a note has come through once it is there once more", () => {
  const before = ["09:31 band moved", "band moved"];
  assert.equal(noteCounts(before, "band moved"), 2);
  assert.equal(noteCounts([...before, "09:40 band moved"], "band moved"), 3);
  assert.equal(noteCounts(before, "moved away"), 0);
});

test("every question has reasons to choose from by mouse, each once", () => {
  for (const [what, { title, act, reasons }] of Object.entries(QUESTIONS)) {
    assert.ok(title.endsWith("?") && act, what);
    assert.ok(reasons.length >= 3 && reasons.every(Boolean), what);
    assert.equal(new Set(reasons).size, reasons.length, what);
  }
  const needed = Object.keys(QUESTIONS).filter((what) => !QUESTIONS[what].optional);
  assert.deepEqual(needed.sort(), ["recalibrate", "redo", "retrain", "skip", "start_anyway"], "what the server takes only with a reason");
});
