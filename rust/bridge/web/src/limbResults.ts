// What the motion test and target achievement control found, as tables: a row with a bar for each gesture or axis, and all together.

import { element, setWidth } from "./dom";
import type { MotionReport, TacReport } from "./generated/types";
import { gestureInstruction } from "./hand";
import { withUnit } from "./limbTests";
import { strings } from "./strings";
import { fixed } from "./numbers";

const words = strings.limb;

/** One row: how many of how many were done, and the means that belong to it; none of nothing. */
export type ResultRow = { name: string; done: number; all: number; means: (number | null)[] };

/** Mean of what is known; none of nothing. */
function mean(values: (number | null)[]): number | null {
  const known = values.filter((value): value is number => value !== null);
  return known.length > 0 ? known.reduce((sum, value) => sum + value, 0) / known.length : null;
}

/** `items` by what `name` says of them, in the order of their first, and all of them at the end. */
function rows<Item>(items: Item[], name: (item: Item, k: number) => string, done: (item: Item) => boolean, figures: ((item: Item) => number | null)[]): ResultRow[] {
  const row = (title: string, some: Item[]): ResultRow => ({
    name: title,
    done: some.filter(done).length,
    all: some.length,
    means: figures.map((figure) => mean(some.map(figure))),
  });
  const names = items.map(name);
  return [...[...new Set(names)].map((one) => row(one, items.filter((_, k) => names[k] === one))), row(words.all, items)];
}

/** A row a gesture: seconds to select and to complete it, decisions that were wrong. */
export function motionRows(report: MotionReport): ResultRow[] {
  return rows(
    report.attempts,
    ({ prompt }) => gestureInstruction(prompt),
    ({ completion_secs: secs }) => secs !== null,
    [(attempt) => attempt.selection_secs, (attempt) => attempt.completion_secs, (attempt) => attempt.wrong],
  );
}

/** A row an axis, or a target of several axes: seconds, overshoots, path efficiency in per cent. */
export function tacRows(report: TacReport): ResultRow[] {
  return rows(
    report.trials,
    ({ target }, k) =>
      target.length === 1
        ? (target[0]?.[0] ?? "")
        : `${k + 1}: ${target.map(([axis, place]) => `${axis} ${withUnit(axis, place)}`).join(", ")}`,
    ({ secs }) => secs !== null,
    [
      (trial) => trial.secs,
      (trial) => trial.overshoots,
      (trial) => (trial.path_efficiency === null ? null : 100 * trial.path_efficiency),
    ],
  );
}

function table({ title, what, done, heads }: (typeof words.tables)["motion"], found: ResultRow[]): HTMLElement {
  const head = element("tr", "", ...[what, done, ...heads].map((text) => columnHead(text)));
  const body = found.map(({ name, done: count, all, means }) => {
    const fill = element("div");
    setWidth(fill, all > 0 ? count / all : 0);
    const rowHead = element("th", "", name);
    rowHead.scope = "row";
    const cells = means.map((value) => element("td", "", value === null ? "–" : fixed(value, value < 10 ? 2 : 0)));
    return element("tr", name === words.all ? "all" : "", rowHead, element("td", "share", element("div", "bar", fill), words.share(count, all)), ...cells);
  });
  const scroll = element("div", "scroll", element("table", "results", element("thead", "", head), element("tbody", "", ...body)));
  // What can be scrolled must be within reach of the keys.
  scroll.tabIndex = 0;
  scroll.setAttribute("role", "region");
  scroll.setAttribute("aria-label", title);
  return element("section", "", element("h2", "", title), scroll);
}

function columnHead(text: string): HTMLTableCellElement {
  const cell = element("th", "", text);
  cell.scope = "col";
  return cell;
}

/** The tables of those of the tests that are in `result`. */
export function limbResults(result: Record<string, unknown>): HTMLElement[] {
  const tables: HTMLElement[] = [];
  if (result.motion) tables.push(table(words.tables.motion, motionRows(result.motion as MotionReport)));
  for (const name of ["tac1", "tac3"] as const) {
    if (result[name]) tables.push(table(words.tables[name], tacRows(result[name] as TacReport)));
  }
  return tables;
}
