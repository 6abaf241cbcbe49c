// The headset's board: one question at a time, cells that a ray can meet, and choosing by rest.

import assert from "node:assert/strict";
import { test } from "node:test";
import { load } from "./bundle.mjs";

const { BOARD_HEIGHT, BOARD_WIDTH, cellAt, DwellSelector, DWELL_MS, pageOf, pagesOf, wrapLines } = await load("formLayout");
const { questionsOf, ranksOf } = await load("forms");

const scale = (key, most = 5, step = 1) => ({ kind: "scale", key, name: {}, text: { en: key }, low: { en: "low" }, high: { en: "high" }, least: 0, most, step });
const option = (value) => ({ value, text: { en: value } });
const choice = (key, count, several = false) => ({ kind: "choice", key, text: { en: key }, several, options: Array.from({ length: count }, (_, k) => option(`${key}${k}`)) });
const items = [
  scale("short"),
  scale("long", 100, 5),
  scale("endless", 1000, 1),
  choice("few", 3),
  choice("many", 12),
  choice("some", 4, true),
  { kind: "ranking", key: "ranks", text: { en: "ranks" } },
  { kind: "condition", key: "best", text: { en: "best" } },
  { kind: "consent", key: "consent", version: "2", text: { en: "consent" } },
  { kind: "text", key: "why", text: { en: "why" }, optional: false },
  { kind: "text", key: "more", text: { en: "more" }, optional: true },
];
const pages = pagesOf(questionsOf({ form: { items }, pairs: [{ key: "short_or_long", first: "short", second: "long" }] }));
const at = (key) => pages.findIndex((page) => page.key === key);
const pageWith = (key, answers = {}, ranks = ranksOf(answers[key])) =>
  pageOf({ pages, pageIndex: at(key), conditions: ["A", "B", "C"], language: "en", answer: (name) => answers[name] ?? null, ranks });
const answersOf = (page) => page.cells.filter(({ action }) => action.act === "answer").map(({ action }) => action.answer);

test("every question has cells on the board, wide enough for a ray, that do not overlap", () => {
  for (const { key } of pages) {
    const { cells } = pageWith(key);
    for (const [k, cell] of cells.entries()) {
      assert.ok(cell.x >= 0 && cell.y >= 0 && cell.x + cell.width <= BOARD_WIDTH && cell.y + cell.height <= BOARD_HEIGHT, `${key} ${k} is on the board`);
      assert.ok(cell.width >= 18 && cell.height >= 44, `${key} ${k} is ${cell.width} by ${cell.height}`);
      const middle = [cell.x + cell.width / 2, cell.y + cell.height / 2];
      assert.equal(cellAt(cells, ...middle), cell, `${key} ${k} is met in its middle`);
    }
  }
  assert.equal(cellAt(pageWith("short").cells, 2, 2), null);
});

test("each kind gives the answers that the server takes", () => {
  assert.deepEqual(answersOf(pageWith("short")), [0, 1, 2, 3, 4, 5]);
  assert.equal(answersOf(pageWith("long")).length, 21);
  const thinned = answersOf(pageWith("endless"));
  assert.ok(thinned.length <= 42 && thinned[0] === 0 && thinned[thinned.length - 1] === 1000, "both ends of a scale of a thousand");
  assert.deepEqual(answersOf(pageWith("few")), ["few0", "few1", "few2"]);
  assert.deepEqual(answersOf(pageWith("some", { some: ["some2"] })), [["some0", "some2"], ["some1", "some2"], null, ["some2", "some3"], []]);
  assert.deepEqual(answersOf(pageWith("best")), ["A", "B", "C"]);
  assert.deepEqual(answersOf(pageWith("consent")), ["2"]);
  assert.deepEqual(answersOf(pageWith("consent", { consent: "2" })), [null], "agreement can be taken back");
  assert.deepEqual(answersOf(pageWith("short_or_long")), ["short", "long"]);
  const ranks = pageWith("ranks").cells.filter(({ action }) => action.act === "rank");
  assert.deepEqual(ranks.slice(0, 3).map(({ action }) => [action.condition, action.place]), [["A", 1], ["A", 2], ["A", 3]]);
});

test("what was answered is marked", () => {
  const chosen = (key, answers) => pageWith(key, answers).cells.filter((cell) => cell.chosen).map(({ label }) => label);
  assert.deepEqual(chosen("short", { short: 3 }), ["3"]);
  assert.deepEqual(chosen("some", { some: ["some0", "some3"] }), ["some0", "some3"]);
  assert.deepEqual(chosen("some", { some: [] }), ["None of these"]);
  assert.deepEqual(chosen("ranks", { ranks: [["B"], ["A", "C"]] }), ["2", "1", "2"]);
});

test("words that are wanted are asked for at the screen, and others are left out", () => {
  assert.equal(pageWith("why").note, "Answer this one at the screen.");
  assert.equal(at("more"), -1);
  const empty = pageOf({ pages: [], pageIndex: 0, conditions: [], language: "en", answer: () => null, ranks: new Map() });
  assert.deepEqual(empty.cells.map(({ label }) => label), ["Done"]);
});

test("the first page has no way back, and the last one ends the questionnaire", () => {
  const turns = (key) => pageWith(key).cells.filter(({ action }) => action.act === "turn" || action.act === "done").map(({ label }) => label);
  assert.deepEqual(turns(pages[0].key), ["Next"]);
  assert.deepEqual(turns(pages[1].key), ["Back", "Next"]);
  assert.deepEqual(turns(pages[pages.length - 1].key), ["Back", "Done"]);
});

test("a ray that rests chooses once, and again only after it has left", () => {
  const dwell = new DwellSelector();
  const next = { x: 1, y: 2, width: 3, height: 4 };
  assert.equal(dwell.update(0, next).chosen, false);
  assert.equal(dwell.update(DWELL_MS / 2, next).share, 0.5);
  assert.equal(dwell.update(DWELL_MS, next).chosen, true);
  // The page has turned: another button is at the same place.
  assert.deepEqual(dwell.update(3 * DWELL_MS, { ...next }), { share: 0, chosen: false });
  dwell.update(3.1 * DWELL_MS, null);
  dwell.update(3.2 * DWELL_MS, next);
  assert.equal(dwell.update(4.2 * DWELL_MS, next).chosen, true);
});

test("a new questionnaire chooses nothing that comes to be under the ray by chance", () => {
  const dwell = new DwellSelector();
  const [done, other] = [{ x: 1, y: 2, width: 3, height: 4 }, { x: 9, y: 2, width: 3, height: 4 }];
  dwell.update(0, null);
  dwell.begin();
  dwell.update(10, done);
  assert.equal(dwell.update(9 * DWELL_MS, done).chosen, false);
  dwell.update(9.1 * DWELL_MS, other);
  assert.equal(dwell.update(10.2 * DWELL_MS, other).chosen, true);
});

test("a ray that leaves too early chooses nothing, and what the trigger chose is not chosen again", () => {
  const dwell = new DwellSelector();
  const [one, other] = [{ x: 1, y: 2, width: 3, height: 4 }, { x: 9, y: 2, width: 3, height: 4 }];
  dwell.update(0, one);
  dwell.update(0.9 * DWELL_MS, other);
  assert.equal(dwell.update(1.5 * DWELL_MS, other).chosen, false);
  dwell.reset();
  assert.equal(dwell.update(9 * DWELL_MS, other).chosen, false);
});

test("text is broken between words", () => {
  const measure = (text) => text.length;
  assert.deepEqual(wrapLines("one two three four", 9, measure), ["one two", "three", "four"]);
  assert.deepEqual(wrapLines("immeasurable", 5, measure), ["immeasurable"]);
});
