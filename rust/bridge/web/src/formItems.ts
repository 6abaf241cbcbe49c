// What a person answers a question with: cells, a slider, lists, places, text. Each control shows an answer and tells of another.

import { button, element, setClass, setText } from "./dom";
import {
  truncateUtf8,
  conditionName,
  MAX_SCALE_CELLS,
  itemName,
  NONE_OF_THESE,
  orderText,
  conditionsByRank,
  ranksOf,
  scaleValues,
  stepsOf,
  toggleAnswer,
  textInLanguage,
  type Question,
  type LocalizedTexts,
} from "./forms";
import type { FormAnswer, FormItem } from "./generated/types";
import { strings } from "./strings";

const texts = strings.forms;

/** More steps than these have no room for a line each. */
const MAX_TICKS = 50;

type Item<Kind extends FormItem["kind"]> = Extract<FormItem, { kind: Kind }>;

export interface Control {
  readonly root: HTMLElement;
  /** The answer that it shows; none while there is none, or half of one. */
  value: FormAnswer | null;
  /** Shows another answer. */
  set(answer: FormAnswer | null): void;
  focus(): void;
}

export interface QuestionContext {
  language: string;
  conditions: string[];
  /** Ids of what names and describes the control. */
  label: string;
  description: string;
  /** An answer was given, or taken back. With `later` more may follow at once. */
  changed(answer: FormAnswer | null, later?: boolean): void;
  /** No more follows. */
  settled(): void;
}

/** An element with a text of the form, marked with the language that it is in. */
export function localizedElement<K extends keyof HTMLElementTagNameMap>(
  tag: K,
  classes: string,
  texts: LocalizedTexts,
  language: string,
): HTMLElementTagNameMap[K] {
  const words = textInLanguage(texts, language);
  const node = element(tag, classes, words.text);
  node.lang = words.language;
  return node;
}

export function controlOf(question: Question, asking: QuestionContext): Control {
  if (question.kind === "pair") {
    const options = [question.first, question.second].map((item) => ({ value: item.key, label: localizedElement("span", "", itemName(item), asking.language) }));
    return radios("pair", options, asking);
  }
  const { item } = question;
  switch (item.kind) {
    case "scale":
      return stepsOf(item) < MAX_SCALE_CELLS ? cells(item, asking) : slider(item, asking);
    case "choice": {
      const options = item.options.map(({ value, text }) => ({ value, label: localizedElement("span", "", text, asking.language) }));
      return item.several ? checkboxes(options, asking) : radios("options", options, asking);
    }
    case "condition":
      return radios("options", asking.conditions.map((value) => ({ value, label: element("span", "", conditionName(value)) })), asking);
    case "ranking":
      return rankingTable(asking);
    case "consent":
      return consent(item, asking);
    case "text":
      return textField(item, asking);
  }
}

let groups = 0;

interface Option<Value> {
  value: Value;
  label: HTMLElement;
  /** What a screen reader says, where the label alone says too little. */
  spoken?: string;
}

function choice(type: "radio" | "checkbox", name: string, label: HTMLElement, spoken?: string): { input: HTMLInputElement; root: HTMLElement } {
  const input = element("input");
  input.type = type;
  input.name = name;
  if (spoken) input.setAttribute("aria-label", spoken);
  label.classList.add("face");
  return { input, root: element("label", "option", input, label) };
}

function withDescription(root: HTMLElement, role: string, { label, description }: QuestionContext): void {
  root.setAttribute("role", role);
  root.setAttribute("aria-labelledby", label);
  root.setAttribute("aria-describedby", description);
}

/** One of several. */
function radios<Value extends string | number>(classes: string, options: Option<Value>[], asking: QuestionContext): Control & { inputs: HTMLInputElement[] } {
  groups += 1;
  const made = options.map(({ label, spoken }) => choice("radio", `question-${groups}`, label, spoken));
  const inputs = made.map(({ input }) => input);
  const root = element("div", `choices ${classes}`, ...made.map((one) => one.root));
  withDescription(root, "radiogroup", asking);
  const control = {
    root,
    inputs,
    value: null as FormAnswer | null,
    set(answer: FormAnswer | null) {
      control.value = answer;
      options.forEach(({ value }, k) => {
        const input = inputs[k];
        if (input) input.checked = value === answer;
      });
    },
    focus: () => (inputs.find(({ checked }) => checked) ?? inputs[0])?.focus(),
  };
  options.forEach(({ value }, k) =>
    inputs[k]?.addEventListener("change", () => {
      control.value = value;
      asking.changed(value);
    }),
  );
  return control;
}

/** A short scale: a row of cells between two anchors. */
function cells(item: Item<"scale">, asking: QuestionContext): Control {
  const [low = "", high = ""] = [item.low, item.high].map((texts) => textInLanguage(texts, asking.language).text);
  const values = scaleValues(item);
  const options = values.map((value, k) => {
    const end = k === 0 ? low : k === values.length - 1 ? high : "";
    return { value, label: element("span", "", String(value)), spoken: end ? `${value}: ${end}` : String(value) };
  });
  const control = radios("cells", options, asking);
  const anchor = (at: number | undefined, texts: LocalizedTexts) =>
    element("span", "", element("b", "", `${at}`), " ", localizedElement("span", "", texts, asking.language));
  const root = element("div", "scale", element("div", "anchors", anchor(values[0], item.low), anchor(values[values.length - 1], item.high)), control.root);
  return Object.assign(control, { root });
}

/** A long scale: a line with a mark for each step, as on paper. It has no answer until it is touched. */
function slider(item: Item<"scale">, asking: QuestionContext): Control {
  const steps = stepsOf(item);
  const input = element("input", "slider");
  input.type = "range";
  [input.min, input.max, input.step] = [String(item.least), String(item.most), String(item.step)];
  const middle = item.least + item.step * Math.round(steps / 2);
  input.setAttribute("aria-labelledby", asking.label);
  input.setAttribute("aria-describedby", asking.description);
  const track = element("div", "track", input);
  track.style.setProperty("--steps", String(steps));
  setClass(track, "ticked", steps <= MAX_TICKS);
  const [low = "", high = ""] = [item.low, item.high].map((texts) => textInLanguage(texts, asking.language).text);
  const show = () => {
    setClass(track, "open", control.value === null);
    const ends = texts.ends(item.least, low, item.most, high);
    input.setAttribute("aria-valuetext", control.value === null ? texts.noAnswer(ends) : `${input.value}, ${ends}`);
  };
  const take = (later: boolean) => {
    control.value = Number(input.value);
    show();
    asking.changed(control.value, later);
  };
  const control: Control = {
    root: element("div", "scale"),
    value: null,
    set(answer) {
      control.value = answer;
      input.value = String(typeof answer === "number" ? answer : middle);
      show();
    },
    focus: () => input.focus(),
  };
  input.addEventListener("input", () => take(true));
  input.addEventListener("change", () => asking.settled());
  // Where it stands already is an answer as well, once somebody says so.
  input.addEventListener("pointerup", () => control.value === null && take(false));
  input.addEventListener("keydown", (event) => {
    if (event.code !== "Space" && event.code !== "Enter") return;
    // The space bar would scroll the form away from under the person.
    event.preventDefault();
    if (control.value === null) take(false);
  });
  // For fingers that are broader than a step. Keys have the arrows.
  const nudge = (sign: 1 | -1, label: string) => {
    const node = button(sign < 0 ? "−" : "+", () => {
      if (sign < 0) input.stepDown();
      else input.stepUp();
      take(false);
    }, "nudge");
    node.tabIndex = -1;
    node.setAttribute("aria-label", label);
    return node;
  };
  const anchors = element(
    "div",
    "anchors",
    nudge(-1, texts.towards(low)),
    localizedElement("span", "", item.low, asking.language),
    localizedElement("span", "", item.high, asking.language),
    nudge(1, texts.towards(high)),
  );
  control.root.append(track, anchors);
  control.set(null);
  return control;
}

/** Some of several, or none of them. */
function checkboxes(options: Option<string>[], asking: QuestionContext): Control {
  const values = options.map(({ value }) => value);
  const made = options.map(({ label }) => choice("checkbox", "", label));
  const none = choice("checkbox", "", element("span", "", NONE_OF_THESE));
  const root = element("div", "choices options", ...made.map((one) => one.root), none.root);
  withDescription(root, "group", asking);
  const control: Control = {
    root,
    value: null,
    set(answer) {
      control.value = answer;
      const chosen = Array.isArray(answer) ? answer.flat() : [];
      made.forEach(({ input }, k) => (input.checked = chosen.includes(values[k] ?? "")));
      none.input.checked = Array.isArray(answer) && answer.length === 0;
    },
    focus: () => made[0]?.input.focus(),
  };
  const give = (answer: string[] | null) => {
    control.set(answer);
    asking.changed(answer);
  };
  made.forEach(({ input }, k) => input.addEventListener("change", () => give(toggleAnswer(values, control.value, values[k] ?? ""))));
  none.input.addEventListener("change", () => give(none.input.checked ? [] : null));
  return control;
}

/** A place for each condition; several may have the same. */
function rankingTable(asking: QuestionContext): Control {
  const { conditions } = asking;
  const ranks = new Map<string, number>();
  const order = element("p", "note");
  const show = () => {
    const places = conditionsByRank(conditions, ranks);
    setText(order, places ? texts.order(orderText(places)) : texts.rank);
  };
  const rows = conditions.map((condition) => {
    const options = conditions.map((_, k) => ({ value: k + 1, label: element("span", "", String(k + 1)), spoken: texts.place(k + 1) }));
    const row = radios("cells", options, {
      ...asking,
      changed(place) {
        ranks.set(condition, Number(place));
        control.value = conditionsByRank(conditions, ranks);
        show();
        if (control.value) asking.changed(control.value);
      },
    });
    row.root.removeAttribute("aria-labelledby");
    row.root.setAttribute("aria-label", conditionName(condition));
    return { condition, row };
  });
  const list = element("div", "places", ...rows.map(({ condition, row }) => element("div", "placed", element("span", "", conditionName(condition)), row.root)));
  const root = element("div", "", list, order);
  withDescription(root, "group", asking);
  const control: Control = {
    root,
    value: null,
    set(answer) {
      ranks.clear();
      for (const [condition, place] of ranksOf(answer)) ranks.set(condition, place);
      control.value = conditionsByRank(conditions, ranks);
      for (const { condition, row } of rows) row.set(ranks.get(condition) ?? null);
      show();
    },
    focus: () => (rows.find(({ condition }) => !ranks.has(condition)) ?? rows[0])?.row.focus(),
  };
  show();
  return control;
}

/** The answer is which text was agreed to. */
function consent(item: Item<"consent">, asking: QuestionContext): Control {
  const { input, root } = choice("checkbox", "", localizedElement("span", "", item.text, asking.language));
  input.setAttribute("aria-describedby", asking.description);
  const control: Control = {
    root: element("div", "choices consent", root),
    value: null,
    set(answer) {
      control.value = answer;
      input.checked = answer === item.version;
    },
    focus: () => input.focus(),
  };
  input.addEventListener("change", () => {
    control.value = input.checked ? item.version : null;
    asking.changed(control.value);
  });
  return control;
}

/** Free words. */
function textField(item: Item<"text">, asking: QuestionContext): Control {
  const field = element("textarea", "words");
  field.rows = 4;
  field.setAttribute("aria-labelledby", asking.label);
  field.setAttribute("aria-describedby", asking.description);
  field.required = !item.optional;
  const full = element("p", "note");
  full.setAttribute("role", "status");
  const control: Control = {
    root: element("div", "", field, full),
    value: null,
    set(answer) {
      control.value = answer;
      field.value = typeof answer === "string" ? answer : "";
    },
    focus: () => field.focus(),
  };
  field.addEventListener("input", () => {
    const kept = truncateUtf8(field.value);
    setText(full, kept === field.value ? "" : texts.tooLong);
    if (kept !== field.value) field.value = kept;
    // Blank is no answer.
    control.value = kept.trim() === "" ? null : kept;
    asking.changed(control.value, true);
  });
  field.addEventListener("blur", () => asking.settled());
  return control;
}
