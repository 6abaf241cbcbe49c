// Questionnaires for the page's tests: those that ship with the program, as the server sends them, and one of our own with what
// they lack. `rust/study/data/forms` has the originals.

const en = (text) => ({ en: text });

function scale(key, text, [least, most, step], low, high, name = "") {
  return { kind: "scale", key, name: name ? en(name) : {}, text: en(text), low: en(low), high: en(high), least, most, step };
}

function choice(key, text, options, several = false) {
  return { kind: "choice", key, text: en(text), several, options: options.map(([value, words]) => ({ value, text: en(words) })) };
}

function form(name, title, items, scoring = { by: "nothing" }) {
  return { name, title: en(title), source: "our own", licence: "MIT OR Apache-2.0", confirmed: true, scoring, items };
}

export const CONDITIONS = ["A", "B", "C"];

/** All but the consent's text is shortened to four of its seven choices. */
export const participant = form("participant", "About you", [
  {
    kind: "consent",
    key: "consent",
    version: "1",
    text: en(
      "I have been told what this study is for, what is recorded and who sees it. I take part of my own free will, and know that I may stop at any time without giving a reason.",
    ),
  },
  choice("age_band", "How old are you?", [
    ["18-24", "18 to 24"],
    ["25-34", "25 to 34"],
    ["35-44", "35 to 44"],
    ["45-54", "45 to 54"],
    ["55-64", "55 to 64"],
    ["65+", "65 or more"],
    ["unsaid", "I would rather not say"],
  ]),
  choice("handedness", "Which hand do you write with?", [
    ["right", "Right"],
    ["left", "Left"],
    ["both", "Both"],
  ]),
  choice("vision", "How do you see today?", [
    ["normal", "Well without correction"],
    ["glasses", "With glasses"],
    ["lenses", "With contact lenses"],
    ["impaired", "Not well, even with correction"],
  ]),
]);

export const easeAgencySpeed = form("ease_agency_speed", "After this way of driving the arm", [
  scale("ease", "How easy was it to do the task?", [1, 5, 1], "Very hard", "Very easy"),
  scale("agency", "How much did you feel that you moved the arm yourself?", [1, 5, 1], "Not at all", "Completely"),
  scale("speed", "How fast could you do the task?", [1, 5, 1], "Very slowly", "Very fast"),
]);

const LOAD = [0, 100, 5];
export const nasaTlx = form(
  "nasa_tlx",
  "NASA Task Load Index",
  [
    scale("mental_demand", "How mentally demanding was the task?", LOAD, "Very Low", "Very High", "Mental Demand"),
    scale("physical_demand", "How physically demanding was the task?", LOAD, "Very Low", "Very High", "Physical Demand"),
    scale("temporal_demand", "How hurried or rushed was the pace of the task?", LOAD, "Very Low", "Very High", "Temporal Demand"),
    scale("performance", "How successful were you in accomplishing what you were asked to do?", LOAD, "Perfect", "Failure", "Performance"),
    scale("effort", "How hard did you have to work to accomplish your level of performance?", LOAD, "Very Low", "Very High", "Effort"),
    scale("frustration", "How insecure, discouraged, irritated, stressed, and annoyed were you?", LOAD, "Very Low", "Very High", "Frustration"),
  ],
  { by: "task_load", pairs: true },
);

export const ranking = form("ranking", "Comparing the ways of driving the arm", [
  { kind: "ranking", key: "ease", text: en("Put them in order, the easiest first. Equal ones may share a place.") },
  { kind: "ranking", key: "speed", text: en("Put them in order, the fastest first. Equal ones may share a place.") },
]);

export const lastTrial = form("last_trial", "One last trial", [
  { kind: "condition", key: "choice", text: en("If you could do one last trial in any of these ways, which would you choose?") },
  { kind: "text", key: "why", text: en("Why?"), optional: false },
]);

export const comments = form("comments", "Comments", [
  { kind: "text", key: "comments", text: en("Is there anything that you would like to say?"), optional: true },
]);

/** Two languages, several answers, a scale of eleven and one in tenths. */
export const odd = form("odd", "Everything else", [
  choice("symptoms", "What do you feel?", [["tired", "Tired arm"], ["eyes", "Tired eyes"], ["sick", "Sickness"]], true),
  scale("pain", "How much does it hurt?", [0, 10, 1], "Not at all", "As much as I can think of"),
  scale("weight", "How heavy did the arm seem?", [0.1, 0.5, 0.1], "Light", "Heavy"),
]);
odd.title.de = "Alles andere";
odd.items[0].text.de = "Was spüren Sie?";
odd.items[0].options[0].text.de = "Müder Arm";

/** As the server makes them of the items of a task load index. */
export function pairsOf({ items, scoring }) {
  if (scoring.by !== "task_load" || !scoring.pairs) return [];
  const keys = items.map(({ key }) => key);
  return keys.flatMap((first, k) => keys.slice(k + 1).map((second) => ({ key: `${first}_or_${second}`, first, second })));
}
