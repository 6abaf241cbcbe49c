// The result card: times, errors and path of the trial that is over, beside the trials before it, and what may come next.

import { Dialog } from "./dialog";
import { button, element, setText } from "./dom";
import { strings } from "./strings";
import type { PostTrialAction, ResultCard, TrialStatus } from "./generated/types";
import { fixed } from "./numbers";
import { capitalize } from "./protocol";

/** What became of an object, in words. */
const words = strings.result;
const OUTCOMES: Record<string, string> = words.outcomes;
const ACTION_LABELS: Record<PostTrialAction, string> = words.offers;
/** Trials that are compared, this one included. */
const MAX_COMPARED_TRIALS = 4;

const seconds = (value: number | null) => (value === null ? "–" : `${fixed(value, 1)} s`);
const centimeters = (value: number | null) => (value === null ? "–" : `${fixed(100 * value, 1)} cm`);

/** Score, time, mean error of what was put down, and path of a trial, as a person reads them. */
export function summary(card: ResultCard): { who: string; score: string; time: string; error: string; path: string } {
  const placed = card.objects.filter(({ place_s, error_m }) => place_s !== null && error_m !== null);
  const error = placed.reduce((sum, { error_m }) => sum + (error_m ?? 0), 0) / Math.max(placed.length, 1);
  return {
    who: words.who(card.who, card.method),
    score: card.most === null ? `${card.score}` : words.scoreOf(card.score, card.most),
    time: seconds(card.seconds),
    error: centimeters(placed.length > 0 ? error : null),
    path: `${fixed(card.path_m, 1)} m`,
  };
}

/** How the newest trial compares with the one before it, in a sentence; empty without one. */
export function comparison([now, before]: ResultCard[]): string {
  if (!now || !before || now.score_name !== before.score_name) return "";
  const who = words.compared(before.who === now.who ? words.trialBefore : before.who.toLowerCase(), before.method);
  const [more, faster] = [now.score - before.score, before.seconds - now.seconds];
  const time = Math.abs(faster) < 0.05 ? words.sameTime : (faster > 0 ? words.lessTime : words.moreTime)(fixed(Math.abs(faster), 1));
  return words.comparison(more, now.score_name, who, time);
}

function table(classes: string, head: string[], rows: string[][]): HTMLElement {
  const line = (tag: "td" | "th", cells: string[]) =>
    element("tr", "", ...cells.map((cell, k) => {
      const node = element(k === 0 ? "th" : tag, "", cell);
      if (tag === "th") node.setAttribute("scope", "col");
      else if (k === 0) node.setAttribute("scope", "row");
      return node;
    }));
  return element("table", classes, element("thead", "", line("th", head)), element("tbody", "", ...rows.map((row) => line("td", row))));
}

export class ResultView {
  private readonly title = element("h2");
  private readonly body = element("div");
  private readonly dialog: Dialog;
  private readonly buttons = element("div", "buttons");
  private shown = "";
  private dismissed = "";

  constructor(
    private readonly onAction: (ask: PostTrialAction) => void,
    private readonly restart: (again: boolean) => void,
  ) {
    this.dialog = new Dialog("result", this.title, () => (this.dismissed = this.shown), false);
    this.dialog.root.append(this.title, this.body, this.buttons);
  }

  get root(): HTMLElement {
    return this.dialog.root;
  }

  /** Takes each status. `drives`: this page may begin another trial. */
  show(status: TrialStatus, finished: boolean, drives: boolean): void {
    const [card] = status.results;
    if (!card || !(finished || status.aborted)) {
      this.dialog.close();
      this.dismissed = "";
      return;
    }
    const text = JSON.stringify([status.results.slice(0, MAX_COMPARED_TRIALS), status.offers, drives]);
    if (text !== this.shown) this.fill(status, card, drives);
    this.shown = text;
    if (this.dismissed !== text) this.dialog.show();
  }

  hide(): void {
    this.dialog.close();
  }

  private fill({ results, offers }: TrialStatus, card: ResultCard, drives: boolean): void {
    setText(this.title, `${summary(card).score} ${card.score_name}`);
    const objects = card.objects.map(({ name, outcome, pick_s, place_s, error_m }) => [
      name.replace(/([a-z])(\d+)$/i, "$1 $2"),
      OUTCOMES[outcome] ?? outcome.replaceAll("_", " "),
      seconds(pick_s),
      seconds(place_s),
      centimeters(error_m),
    ]);
    const rows = results.slice(0, MAX_COMPARED_TRIALS).map((each, k) => {
      const { who, score, time, error, path } = summary(each);
      return [k === 0 ? words.thisTrial(who) : who, score, time, error, path];
    });
    this.body.replaceChildren(
      ...(objects.length > 0 ? [table("figures-table", words.blockColumns, objects)] : []),
      table("figures-table", ["", capitalize(card.score_name), ...words.trialColumns], rows),
      element("p", "verdict", comparison(results)),
      ...card.faults.map((fault) => element("p", "verdict bad", capitalize(fault))),
      ...card.norms.map((norm) => element("p", "norm", capitalize(norm))),
    );
    this.buttons.replaceChildren(
      ...offers.map((offer) => button(ACTION_LABELS[offer], () => this.onAction(offer), offer === "drive" ? "primary" : "plain")),
      ...(drives
        ? [button(words.newTrial, () => this.restart(false), "primary"), button(words.again, () => this.restart(true), "plain")]
        : []),
      button(words.look, () => {
        this.dismissed = this.shown;
        this.dialog.close();
      }, "plain"),
    );
  }
}
