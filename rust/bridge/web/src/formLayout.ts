// What a headset's board shows of a questionnaire, one question at a time, and where on it the ray is. Pure: units are the pixels
// of the board's picture, from its left top.

import {
  conditionName,
  MAX_SCALE_CELLS,
  itemName,
  NONE_OF_THESE,
  orderText,
  conditionsByRank,
  sameAnswer,
  scaleValues,
  toggleAnswer,
  textInLanguage,
  type Question,
  type RankByCondition,
  type LocalizedTexts,
} from "./forms";
import type { FormAnswer, FormItem } from "./generated/types";
import { strings } from "./strings";

const texts = strings.forms;

export const [BOARD_WIDTH, BOARD_HEIGHT] = [1024, 768];
/** A ray that rests on a cell for so long chooses it, ms. */
export const DWELL_MS = 1000;

/** Where the answers are: below the question, above the buttons that turn the page. */
const ANSWER_AREA = { x: 48, y: 300, width: 928, height: 310 };
const PAGE_BUTTONS_Y = 652;
const PAGE_BUTTON = { width: 250, height: 84 };
const GAP = 8;
/** More cells in a row are too narrow for a ray that a hand holds. */
const MAX_CELLS_IN_ROW = 41;
/** Longer lists have two columns. */
const MAX_CELLS_IN_COLUMN = 5;
const MAX_CELL_HEIGHT = 92;

export interface Box {
  x: number;
  y: number;
  width: number;
  height: number;
}

/** What choosing a cell does. */
export type CellAction =
  | { act: "answer"; key: string; answer: FormAnswer | null }
  | { act: "rank"; key: string; condition: string; place: number }
  | { act: "turn"; by: 1 | -1 }
  | { act: "done" };

export interface Cell extends Box {
  label: string;
  chosen: boolean;
  action: CellAction;
}

export interface Label extends Box {
  text: string;
  align: "left" | "right";
}

export interface BoardPage {
  question: string;
  note: string;
  labels: Label[];
  cells: Cell[];
}

/** What a page is made from. */
export interface PageInput {
  pages: readonly Question[];
  /** Which of them is shown. */
  pageIndex: number;
  conditions: string[];
  language: string;
  answer(key: string): FormAnswer | null;
  /** Places given so far, for a ranking that is not complete. */
  ranks: RankByCondition;
}

/** The questions that have a page. Words cannot be spoken to a board: what may be left empty is left out. */
export function pagesOf(questions: readonly Question[]): Question[] {
  return questions.filter(({ optional }) => !optional);
}

export function pageOf(matter: PageInput): BoardPage {
  const question = matter.pages[matter.pageIndex];
  if (!question) {
    const note = texts.typed;
    return { question: texts.nothing, note, labels: [], cells: pageButtons(0, 0) };
  }
  return { ...questionText(question, matter), cells: [...answerCells(question, matter), ...pageButtons(matter.pageIndex, matter.pages.length)] };
}

/** The cell at a point of the board. */
export function cellAt<Where extends Box>(cells: readonly Where[], x: number, y: number): Where | null {
  return cells.find((cell) => x >= cell.x && x < cell.x + cell.width && y >= cell.y && y < cell.y + cell.height) ?? null;
}

/** Breaks a text into lines of at most `width`, as `measure` says how wide a text is. */
export function wrapLines(text: string, width: number, measure: (text: string) => number): string[] {
  const lines: string[] = [];
  for (const word of text.split(/\s+/)) {
    const line = lines.length > 0 ? `${lines[lines.length - 1]} ${word}` : word;
    if (lines.length > 0 && measure(line) <= width) lines[lines.length - 1] = line;
    else lines.push(word);
  }
  return lines;
}

function questionText(question: Question, { conditions, language, ranks }: PageInput): Omit<BoardPage, "cells"> {
  const words = (texts: LocalizedTexts) => textInLanguage(texts, language).text;
  if (question.kind === "pair") return { question: texts.whichMore, note: "", labels: [] };
  const { item } = question;
  const page = { question: words(item.text), note: "", labels: [] as Label[] };
  if (item.kind === "scale") {
    const anchor = (align: "left" | "right", text: string): Label => ({
      text,
      align,
      x: align === "left" ? ANSWER_AREA.x : ANSWER_AREA.x + ANSWER_AREA.width / 2,
      y: ANSWER_AREA.y + 20,
      width: ANSWER_AREA.width / 2,
      height: 60,
    });
    page.labels = [anchor("left", words(item.low)), anchor("right", words(item.high))];
  }
  if (item.kind === "text") page.note = texts.atScreen;
  if (item.kind === "ranking") {
    page.labels = rankRows(conditions).map(({ box, condition }) => ({ ...box, width: 220, text: conditionName(condition), align: "left" }));
    const places = conditionsByRank(conditions, ranks);
    page.note = places ? texts.order(orderText(places)) : texts.rank;
  }
  return page;
}

function answerCells(question: Question, matter: PageInput): Cell[] {
  const { key } = question;
  const now = matter.answer(key);
  const cell = (box: Box, label: string, answer: FormAnswer): Cell => ({ ...box, label, chosen: sameAnswer(now, answer), action: { act: "answer", key, answer } });
  const words = (texts: LocalizedTexts) => textInLanguage(texts, matter.language).text;
  const list = (entries: { label: string; answer: FormAnswer }[]) => {
    const boxes = listOfCells(entries.length);
    return entries.flatMap(({ label, answer }, k) => (boxes[k] ? [cell(boxes[k], label, answer)] : []));
  };
  if (question.kind === "pair") return list([question.first, question.second].map((item) => ({ label: words(itemName(item)), answer: item.key })));
  const { item } = question;
  switch (item.kind) {
    case "scale": {
      const values = subsample(scaleValues(item));
      return rowOfCells(values.length, { ...ANSWER_AREA, y: ANSWER_AREA.y + 96, height: 120 }).flatMap((box, k) => {
        const value = values[k];
        // Numbers that are not read are not written: the paper forms of long scales have none.
        return value === undefined ? [] : [cell(box, values.length <= MAX_SCALE_CELLS ? String(value) : "", value)];
      });
    }
    case "choice":
      return item.several ? multipleChoiceCells(item, now, words) : list(item.options.map(({ value, text }) => ({ label: words(text), answer: value })));
    case "condition":
      return list(matter.conditions.map((condition) => ({ label: conditionName(condition), answer: condition })));
    case "consent": {
      const { version } = item;
      const box = { ...ANSWER_AREA, y: ANSWER_AREA.y + ANSWER_AREA.height - MAX_CELL_HEIGHT, height: MAX_CELL_HEIGHT };
      const agreed = now === version;
      return [{ ...box, label: texts.agree, chosen: agreed, action: { act: "answer", key, answer: agreed ? null : version } }];
    }
    case "ranking":
      return rankRows(matter.conditions).flatMap(({ box, condition }) =>
        rowOfCells(matter.conditions.length, { ...box, x: box.x + 230, width: box.width - 230 }).map((place, k) => ({
          ...place,
          label: String(k + 1),
          chosen: matter.ranks.get(condition) === k + 1,
          action: { act: "rank", key, condition, place: k + 1 },
        })),
      );
    case "text":
      return [];
  }
}

/** Each answer of several turns on and off by itself; none of them is an answer too. */
function multipleChoiceCells(item: Extract<FormItem, { kind: "choice" }>, now: FormAnswer | null, words: (texts: LocalizedTexts) => string): Cell[] {
  const values = item.options.map(({ value }) => value);
  const chosen = Array.isArray(now) ? now.flat() : [];
  const none = Array.isArray(now) && now.length === 0;
  const entries: Pick<Cell, "label" | "chosen" | "action">[] = item.options.map(({ value, text }) => ({
    label: words(text),
    chosen: chosen.includes(value),
    action: { act: "answer", key: item.key, answer: toggleAnswer(values, now, value) },
  }));
  entries.push({ label: NONE_OF_THESE, chosen: none, action: { act: "answer", key: item.key, answer: none ? null : [] } });
  const boxes = listOfCells(entries.length);
  return entries.flatMap((entry, k) => (boxes[k] ? [{ ...boxes[k], ...entry }] : []));
}

/** Back, and Next or Done at the same place. */
function pageButtons(at: number, count: number): Cell[] {
  const right = { x: BOARD_WIDTH - ANSWER_AREA.x - PAGE_BUTTON.width, y: PAGE_BUTTONS_Y, ...PAGE_BUTTON };
  const last = at >= count - 1;
  const ahead: Cell = { ...right, label: last ? texts.done : texts.next, chosen: false, action: last ? { act: "done" } : { act: "turn", by: 1 } };
  if (at === 0) return [ahead];
  return [{ x: ANSWER_AREA.x, y: PAGE_BUTTONS_Y, ...PAGE_BUTTON, label: texts.back, chosen: false, action: { act: "turn", by: -1 } }, ahead];
}

function rowOfCells(count: number, within: Box): Box[] {
  const gap = count > MAX_SCALE_CELLS ? GAP / 2 : GAP;
  const width = (within.width - gap * (count - 1)) / count;
  return Array.from({ length: count }, (_, k) => ({ ...within, x: within.x + k * (width + gap), width }));
}

function listOfCells(count: number): Box[] {
  const columns = count <= MAX_CELLS_IN_COLUMN ? 1 : 2;
  const perColumn = Math.ceil(count / columns);
  const height = Math.min((ANSWER_AREA.height - GAP * (perColumn - 1)) / perColumn, MAX_CELL_HEIGHT);
  const width = (ANSWER_AREA.width - 2 * GAP * (columns - 1)) / columns;
  return Array.from({ length: count }, (_, k) => ({
    x: ANSWER_AREA.x + Math.floor(k / perColumn) * (width + 2 * GAP),
    y: ANSWER_AREA.y + (k % perColumn) * (height + GAP),
    width,
    height,
  }));
}

function rankRows(conditions: string[]): { condition: string; box: Box }[] {
  const height = Math.min((ANSWER_AREA.height - 50 - GAP * (conditions.length - 1)) / conditions.length, MAX_CELL_HEIGHT);
  return conditions.map((condition, k) => ({ condition, box: { ...ANSWER_AREA, y: ANSWER_AREA.y + k * (height + GAP), height } }));
}

/** Of a scale with too many numbers some, the first and the last among them. */
function subsample(values: number[]): number[] {
  const every = Math.ceil((values.length - 1) / (MAX_CELLS_IN_ROW - 1));
  return values.filter((_, k) => k % every === 0 || k === values.length - 1);
}

/** A ray that rests on a cell chooses it, and does not choose again before it has left the place. */
export class DwellSelector {
  private place: Box | null = null;
  private since = 0;
  private chosen = false;
  private fresh = false;

  /** Something else is shown: what comes to be under the ray by chance is not chosen. */
  begin(): void {
    this.fresh = true;
  }

  /** Takes where the ray is now. `share` of the time is over; `chosen` is true once. */
  update(nowMs: number, cell: Box | null): { share: number; chosen: boolean } {
    // What is chosen may change what is there: the place counts.
    if (this.fresh || !cell || !this.place || !samePlace(cell, this.place)) {
      this.place = cell;
      this.since = nowMs;
      this.chosen = this.fresh;
    }
    this.fresh = false;
    if (!cell || this.chosen) return { share: 0, chosen: false };
    const share = Math.min((nowMs - this.since) / DWELL_MS, 1);
    this.chosen = share === 1;
    return { share: this.chosen ? 0 : share, chosen: this.chosen };
  }

  /** The cell was chosen in another way. */
  reset(): void {
    this.chosen = this.place !== null;
  }
}

function samePlace(one: Box, other: Box): boolean {
  return one.x === other.x && one.y === other.y && one.width === other.width && one.height === other.height;
}
