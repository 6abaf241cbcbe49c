// Questionnaires: languages, scales, rankings, free words, and what of the answers is kept.

import assert from "node:assert/strict";
import { test } from "node:test";
import { load } from "./bundle.mjs";

const forms = await load("forms");
const { FormState } = await load("formState");
const { clockText, Countdown, promptTexts, sentenceOf } = await load("participantScreens");

const scale = (key, more = {}) => ({ kind: "scale", key, name: {}, text: { en: key }, low: { en: "low" }, high: { en: "high" }, least: 1, most: 5, step: 1, ...more });
const text = (key, optional) => ({ kind: "text", key, text: { en: key }, optional });
const form = (...items) => ({ name: "form", title: { en: "Form" }, source: "", licence: "", confirmed: true, scoring: { by: "nothing" }, items });
const screen = (items, more = {}) => ({
  step: 3,
  form: form(...items),
  pairs: [],
  conditions: ["A", "B", "C"],
  about: null,
  answers: {},
  missing: [],
  refused: null,
  ...more,
});

test("of the languages that there are the one that is wanted is shown", () => {
  const choose = forms.chooseLanguage;
  assert.equal(choose(["de", "en", "fr"], ["fr"]), "fr");
  assert.equal(choose(["de", "en"], ["de-AT"]), "de", "a dialect is the language");
  assert.equal(choose(["pt-BR", "en"], ["pt"]), "pt-BR");
  assert.equal(choose(["pt-BR", "pt-PT"], ["pt-PT"]), "pt-PT", "an exact match comes first");
  assert.equal(choose(["de", "en"], ["it", "fr"]), "en", "English else");
  assert.equal(choose(["de", "fr"], ["it"]), "de", "the first else");
  assert.equal(choose([], ["it"]), "en");
  assert.deepEqual(forms.textInLanguage({ en: "Yes", de: "Ja" }, "de"), { text: "Ja", language: "de" });
  assert.deepEqual(forms.textInLanguage({ en: "Yes" }, "de"), { text: "Yes", language: "en" }, "what was not translated says what it is");
  assert.deepEqual(forms.languagesOf(form(scale("a", { low: { en: "low", de: "tief" } }))), ["de", "en"]);
});

test("the numbers of a scale are those of its steps, without binary fractions", () => {
  assert.deepEqual(forms.scaleValues({ least: 1, most: 5, step: 1 }), [1, 2, 3, 4, 5]);
  assert.deepEqual(forms.scaleValues({ least: 0.1, most: 0.5, step: 0.1 }), [0.1, 0.2, 0.3, 0.4, 0.5]);
  assert.equal(forms.scaleValues({ least: 0, most: 100, step: 5 }).length, 21);
});

test("a ranking becomes places without empty ones, and comes back", () => {
  const conditions = ["A", "B", "C", "D"];
  const places = (ranks) => forms.conditionsByRank(conditions, new Map(Object.entries(ranks)));
  assert.deepEqual(places({ A: 2, B: 1, C: 3, D: 4 }), [["B"], ["A"], ["C"], ["D"]]);
  assert.deepEqual(places({ A: 4, B: 1, C: 4, D: 1 }), [["B", "D"], ["A", "C"]], "shared places, and none between them");
  assert.deepEqual(places({ A: 2, B: 2, C: 2, D: 2 }), [conditions]);
  assert.equal(places({ A: 1, B: 2, C: 3 }), null, "one has no place yet");
  assert.equal(forms.conditionsByRank([], new Map()), null);
  for (const answer of [[["B"], ["A", "C"], ["D"]], [conditions]]) {
    assert.deepEqual(forms.conditionsByRank(conditions, forms.ranksOf(answer)), answer);
  }
  assert.equal(forms.ranksOf(null).size, 0);
  assert.equal(forms.orderText([["B"], ["A", "C", "D"]]), "B, then A, C and D together");
});

test("free words are cut at the limit in bytes, never in a character", () => {
  assert.equal(forms.byteLength("für"), 4);
  assert.equal(forms.truncateUtf8("für", 10), "für");
  assert.equal(forms.truncateUtf8("für", 2), "f", "ü takes two bytes");
  assert.equal(forms.truncateUtf8("a😀b", 4), "a", "a face takes four");
  assert.equal(forms.truncateUtf8("a😀b", 5), "a😀");
  assert.equal(forms.byteLength(forms.truncateUtf8("ü".repeat(6000))), forms.MAX_TEXT_BYTES);
});

test("several answers are listed as they are offered, and the last one taken back is no answer", () => {
  const options = ["x", "y", "z"];
  assert.deepEqual(forms.toggleAnswer(options, ["z"], "x"), ["x", "z"]);
  assert.deepEqual(forms.toggleAnswer(options, [], "y"), ["y"], "none of these is over then");
  assert.equal(forms.toggleAnswer(options, ["y"], "y"), null);
});

function drafted(items, more) {
  const sent = [];
  const draft = new FormState({ answer: (step, key, answer) => sent.push([step, key, answer]), submit: (step) => sent.push([step]) });
  const take = (again = {}) => draft.setScreen(screen(items, { ...more, ...again }));
  take();
  return { draft, sent, take };
}

test("an answer counts once it comes back, and what comes in between does not undo it", () => {
  const { draft, sent, take } = drafted([scale("ease"), scale("speed")]);
  draft.setAnswer("ease", 4);
  assert.deepEqual(sent, [[3, "ease", 4]]);
  assert.deepEqual([draft.state("ease"), draft.answer("ease")], ["sending", 4]);
  take({ answers: { speed: 1 } });
  assert.deepEqual([draft.state("ease"), draft.answer("ease"), draft.state("speed")], ["sending", 4, "saved"]);
  assert.deepEqual(draft.progress(), { kept: 1, of: 2 });
  take({ answers: { speed: 1, ease: 4 } });
  assert.equal(draft.state("ease"), "saved");
  draft.setAnswer("ease", null);
  assert.deepEqual([draft.state("ease"), draft.answer("ease")], ["sending", null]);
  take({ answers: { speed: 1 } });
  assert.equal(draft.state("ease"), "none");
});

test("a refused answer stays as it was typed, with the reason, until another is given", () => {
  const { draft, take } = drafted([text("why", false)]);
  draft.setAnswer("why", "long");
  const refused = { key: "why", reason: "too long" };
  take({ refused });
  assert.deepEqual([draft.state("why"), draft.reason("why"), draft.answer("why")], ["refused", "too long", "long"]);
  assert.deepEqual(draft.missing().map(({ key }) => key), ["why"], "it is still to be answered");
  draft.setAnswer("why", "short");
  assert.deepEqual([draft.state("why"), draft.reason("why")], ["sending", ""]);
  take({ answers: { why: "short" }, refused });
  assert.deepEqual([draft.state("why"), draft.reason("why")], ["saved", ""]);
});

test("an answer that is changed and changed back is what the server has", () => {
  const { draft, sent } = drafted([scale("ease")], { answers: { ease: 4 } });
  draft.setAnswer("ease", 5);
  assert.equal(draft.state("ease"), "sending");
  draft.setAnswer("ease", 4);
  assert.equal(draft.state("ease"), "saved", "no message may come of it");
  assert.deepEqual(sent.map(([, , answer]) => answer), [5, 4]);
});

test("what is refused twice for the same reason stays refused", () => {
  const { draft, take } = drafted([text("why", false)]);
  draft.setAnswer("why", "x");
  take({ refused: { key: "why", reason: "too short" } });
  draft.setAnswer("why", "x");
  assert.equal(draft.reason("why"), "too short");
});

test("what is typed is sent when the typing ends, and again when the line was lost", () => {
  const { draft, sent, take } = drafted([text("why", false)]);
  draft.setAnswer("why", "a", true);
  draft.setAnswer("why", "ab", true);
  assert.deepEqual(sent, []);
  take();
  assert.equal(draft.answer("why"), "ab", "a message does not undo what is typed");
  draft.flush();
  draft.flush();
  assert.deepEqual(sent, [[3, "why", "ab"]]);
  draft.resend();
  assert.deepEqual(sent, [[3, "why", "ab"], [3, "why", "ab"]]);
  take({ answers: { why: "ab" } });
  draft.resend();
  assert.equal(sent.length, 2, "what is kept is not sent again");
});

test("a questionnaire is sent when nothing is missing but what may be", () => {
  const { draft, sent, take } = drafted([scale("ease"), text("more", true)], { pairs: [{ key: "ease_or_more", first: "ease", second: "more" }] });
  assert.deepEqual(draft.submit().map(({ number }) => number), [1, 3]);
  assert.equal(forms.numbersText(draft.missing()), "1 and 3");
  draft.setAnswer("ease", 2);
  draft.setAnswer("ease_or_more", "ease");
  draft.setAnswer("more", "words", true);
  sent.length = 0;
  assert.deepEqual(draft.submit(), []);
  assert.deepEqual(sent, [[3, "more", "words"], [3]], "words that were still being typed go first");
  take({ step: 4 });
  assert.deepEqual([draft.state("ease"), draft.answer("ease")], ["none", null], "the next questionnaire begins empty");
});

test("a break counts down by itself, and messages that are a little late do not shake it", () => {
  const rest = new Countdown();
  rest.set(60, 0);
  assert.equal(rest.left(500), 59.5);
  rest.set(59, 1300);
  assert.equal(rest.left(2000), 58);
  rest.set(120, 2000);
  assert.equal(rest.left(3000), 119, "a break that was made longer is");
  assert.equal(rest.left(1e9), 0);
  assert.deepEqual([clockText(272.1), clockText(0.2), clockText(0), clockText(-3)], ["4:33", "0:01", "0:00", "0:00"]);
});

test("screens say what is to be done", () => {
  assert.equal(sentenceOf({ show: "rest", left_secs: 5 }, 5).title, "Take a break");
  assert.equal(sentenceOf({ show: "rest", left_secs: 0 }, 0).title, "The break is over");
  assert.equal(sentenceOf({ show: "scene", countdown: false, title: "" }), null);
  const prompt = { gesture: "hand_open", text: "", share: 0, recording: false, recognised: "hand_open", in_a_row: 2, wanted: 5, passed: false };
  assert.deepEqual(promptTexts(prompt), { recognised: "Recognised: Open the hand", row: "In a row: 2 of 5" });
  assert.equal(promptTexts({ ...prompt, wanted: null }).row, "2 in a row");
  assert.equal(promptTexts({ ...prompt, passed: true }).row, "Passed");
});
