// Results of this visit by method, beside those of simulated people: numbers, their intervals, and a table for a spreadsheet.

import type { PageContent, ResultCard } from "./generated/types";
import { confidenceInterval, type ConfidenceInterval } from "./confidenceInterval";
import simulated from "./simulated.json";

/** What a trial came to. */
export interface TrialScore {
  driver: string;
  method: string;
  setup: string;
  score: number;
  seconds: number;
  attempts: number;
  /** Metres; none where it is not known. */
  path: number | null;
}

export const MEASURES = ["score", "seconds", "attempts", "path"] as const;
export type Measure = (typeof MEASURES)[number];

type Row = [string, number, number, number, number | null];

/** The trials of a visit, the oldest first. */
export function visitTrials(results: ResultCard[], { setup }: PageContent): TrialScore[] {
  return [...results]
    .reverse()
    .map(({ who, method, score, seconds, attempts, path_m }) => ({ driver: who, method, setup, score, seconds, attempts, path: path_m }));
}

/** What simulated people reach in the task and set-up of a page; empty where nobody has tried. */
export function simulatedTrials({ setup, briefing, arm }: PageContent, who: string): TrialScore[] {
  const known = simulated.find((batch) => batch.setup === setup);
  // They moved the four blocks of the modified test with a right arm.
  if (!known || briefing.most !== 4 || briefing.score_name !== "blocks on target" || arm.side !== "right") return [];
  return (known.rows as Row[]).map(([method, score, seconds, attempts, path]) => ({ driver: who, method, setup, score, seconds, attempts, path }));
}

/** A measure over trials by one method. */
export function measureInterval(trials: TrialScore[], method: string, measure: Measure, most: number | null): ConfidenceInterval | null {
  const values = trials.filter((trial) => trial.method === method).map((trial) => trial[measure]);
  return confidenceInterval(values.filter((value): value is number => value !== null), 0, measure === "score" ? (most ?? Infinity) : Infinity);
}

/** The methods that there is something of, in order. */
export function methodsOf(...lists: TrialScore[][]): string[] {
  return [...new Set(lists.flat().map(({ method }) => method))].sort();
}

/** A row a trial, as RFC 4180 has it. */
export function toCsv(trials: TrialScore[]): string {
  const cell = (value: string | number | null) => {
    const text = value === null ? "" : String(value);
    return /[",\r\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text;
  };
  const rows = trials.map(({ driver: who, method, setup, score, seconds, attempts, path }) => [who, method, setup, score, seconds, attempts, path]);
  return [["who", "method", "setup", "score", "seconds", "attempts", "path_m"], ...rows].map((row) => `${row.map(cell).join(",")}\r\n`).join("");
}
