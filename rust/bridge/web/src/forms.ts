// What a questionnaire asks and what counts as an answer to it. Pure.

import type { FormAnswer, Form, FormItem, FormScreen } from "./generated/types";
import { strings } from "./strings";

const texts = strings.forms;

/** A text by language, such as `en`. */
export type LocalizedTexts = { [key in string]: string };
/** The place of each condition, from 1. Several may share one, and places may be left out. */
export type RankByCondition = ReadonlyMap<string, number>;

/** Longest answer in free words, bytes of UTF-8. The server refuses more. */
export const MAX_TEXT_BYTES = 10_000;
/** A scale of so many numbers is a row of cells. A longer one is a slider. */
export const MAX_SCALE_CELLS = 11;
/** What can be chosen where several answers are asked for and none applies. */
export const NONE_OF_THESE = texts.none;

/** Something that is asked: an item, or which of two items contributed more. */
export type Question = { key: string; number: number; optional: boolean } & (
  | { kind: "item"; item: FormItem }
  | { kind: "pair"; first: FormItem; second: FormItem }
);

/** All that is asked, in the order in which it is shown. */
export function questionsOf({ form, pairs }: Pick<FormScreen, "form" | "pairs">): Question[] {
  const asked: Question[] = form.items.map((item, k) => ({
    kind: "item",
    key: item.key,
    number: k + 1,
    optional: item.kind === "text" && item.optional,
    item,
  }));
  for (const { key, first, second } of pairs) {
    const [one, other] = [first, second].map((name) => form.items.find((item) => item.key === name));
    if (one && other) asked.push({ kind: "pair", key, number: asked.length + 1, optional: false, first: one, second: other });
  }
  return asked;
}

// Languages.

function textsOf(item: FormItem): LocalizedTexts[] {
  switch (item.kind) {
    case "scale":
      return [item.name, item.text, item.low, item.high];
    case "choice":
      return [item.text, ...item.options.map(({ text }) => text)];
    default:
      return [item.text];
  }
}

/** The languages in which there is any text. */
export function languagesOf(form: Form): string[] {
  const texts = [form.title, ...form.items.flatMap(textsOf)];
  return [...new Set(texts.flatMap((text) => Object.keys(text)))].sort();
}

/** Of the languages that there are the one that is wanted most, English, or the first. */
export function chooseLanguage(languages: readonly string[], wanted: readonly string[]): string {
  const plain = (language: string) => language.toLowerCase().split("-")[0];
  for (const requested of wanted) {
    const exact = languages.find((language) => language.toLowerCase() === requested.toLowerCase());
    const found = exact ?? languages.find((language) => plain(language) === plain(requested));
    if (found !== undefined) return found;
  }
  return languages.find((language) => plain(language) === "en") ?? languages[0] ?? "en";
}

/** The text in this language, and the language that it is in: another one where it was not translated. */
export function textInLanguage(texts: LocalizedTexts, language: string): { text: string; language: string } {
  const found = chooseLanguage(Object.keys(texts), [language]);
  return { text: texts[found] ?? "", language: found };
}

/** The short name of an item, or its text if it has none. */
export function itemName(item: FormItem): LocalizedTexts {
  return item.kind === "scale" && Object.keys(item.name).length > 0 ? item.name : item.text;
}

/** A condition as people hear of it. */
export function conditionName(condition: string): string {
  return texts.condition(condition);
}

// Scales.

/** How many steps there are from the lowest number to the highest. */
export function stepsOf({ least, most, step }: { least: number; most: number; step: number }): number {
  return Math.round((most - least) / step);
}

/** The numbers of a scale. Steps such as 0.1 leave no trace of binary fractions. */
export function scaleValues(scale: { least: number; most: number; step: number }): number[] {
  return Array.from({ length: stepsOf(scale) + 1 }, (_, k) => Number((scale.least + k * scale.step).toPrecision(12)));
}

// Rankings.

/** The conditions place by place, without empty places; none while a condition has no place. */
export function conditionsByRank(conditions: readonly string[], ranks: RankByCondition): string[][] | null {
  if (conditions.length === 0 || !conditions.every((condition) => ranks.has(condition))) return null;
  const taken = [...new Set(ranks.values())].sort((a, b) => a - b);
  const places = taken.map((place) => conditions.filter((condition) => ranks.get(condition) === place));
  return places.filter((place) => place.length > 0);
}

/** The places of an answered ranking. Without an answer nobody has a place. */
export function ranksOf(answer: FormAnswer | null | undefined): Map<string, number> {
  const places = Array.isArray(answer) ? answer : [];
  return new Map(places.flatMap((place, k) => (Array.isArray(place) ? place.map((name): [string, number] => [name, k + 1]) : [])));
}

/** A ranking in words, such as `B, then A and C together`. */
export function orderText(places: readonly (readonly string[])[]): string {
  const together = (place: readonly string[]) =>
    place.length < 2 ? place.join() : `${place.slice(0, -1).join(", ")} and ${place[place.length - 1]} together`;
  return places.map(together).join(", then ");
}

// Free words.

export function byteLength(text: string): number {
  return new TextEncoder().encode(text).length;
}

/** The longest beginning of the text that is not too long. No character is cut in two. */
export function truncateUtf8(text: string, mostBytes = MAX_TEXT_BYTES): string {
  if (byteLength(text) <= mostBytes) return text;
  let bytes = 0;
  let end = 0;
  for (const character of text) {
    bytes += byteLength(character);
    if (bytes > mostBytes) break;
    end += character.length;
  }
  return text.slice(0, end);
}

// Answers.

export function sameAnswer(one: FormAnswer | null | undefined, other: FormAnswer | null | undefined): boolean {
  return JSON.stringify(one ?? null) === JSON.stringify(other ?? null);
}

/** The answers of which several may be given, with this one more or less, in the order in which they are offered. */
export function toggleAnswer(options: readonly string[], answer: FormAnswer | null | undefined, value: string): string[] | null {
  const chosen = new Set(Array.isArray(answer) ? answer.flat() : []);
  if (!chosen.delete(value)) chosen.add(value);
  return chosen.size > 0 ? options.filter((option) => chosen.has(option)) : null;
}

/** Which questions are missing, by number, such as `2, 5 and 7`. */
export function numbersText(questions: readonly Question[]): string {
  const numbers = questions.map(({ number }) => String(number));
  return numbers.length < 2 ? numbers.join() : `${numbers.slice(0, -1).join(", ")} and ${numbers[numbers.length - 1]}`;
}
