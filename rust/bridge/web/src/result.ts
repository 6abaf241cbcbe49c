// The result card: times, errors and path of the trial that is over, beside the trials before it, and what may come next.

import { Dialog } from "./dialog";
import { button, element, setText } from "./dom";
import type { AfterTrial, ResultCard, TrialStatus } from "./generated/types";

/** What became of an object, in words. */
const OUTCOMES: Record<string, string> = {
  on_target: "on target",
  crossed_off_target: "beside its target",
  dropped_table_side: "dropped on the table",
  dropped_floor: "dropped on the floor",
  moved_not_crossed: "moved, not across",
  not_attempted: "not moved",
};
const OFFERS: Record<AfterTrial, string> = { watch_again: "Watch again", drive: "Now you drive" };

const seconds = (value: number | null) => (value === null ? "–" : `${value.toFixed(1)} s`);
const centimetres = (value: number | null) => (value === null ? "–" : `${(100 * value).toFixed(1)} cm`);

/** Score, time, mean error of what was put down, and path of a trial, as a person reads them. */
export function summary(card: ResultCard): { who: string; score: string; time: string; error: string; path: string } {
  const placed = card.objects.filter(({ place_s, error_m }) => place_s !== null && error_m !== null);
  const error = placed.reduce((sum, { error_m }) => sum + (error_m ?? 0), 0) / Math.max(placed.length, 1);
  return {
    who: `${card.who}, method ${card.method}`,
    score: card.most === null ? `${card.score}` : `${card.score} of ${card.most}`,
    time: seconds(card.seconds),
    error: centimetres(placed.length > 0 ? error : null),
    path: `${card.path_m.toFixed(1)} m`,
  };
}

/** How the newest trial compares with the one before it, in a sentence; empty without one. */
export function comparison([now, before]: ResultCard[]): string {
  if (!now || !before || now.score_name !== before.score_name) return "";
  const who = `${before.who === now.who ? "the trial before" : before.who.toLowerCase()} (method ${before.method})`;
  const [more, faster] = [now.score - before.score, before.seconds - now.seconds];
  const score = more === 0 ? "As many" : more > 0 ? `${more} more` : `${-more} fewer`;
  const time = Math.abs(faster) < 0.05 ? "in the same time" : `in ${Math.abs(faster).toFixed(1)} s ${faster > 0 ? "less" : "more"}`;
  return `${score} ${now.score_name} ${more === 0 ? "as" : "than"} ${who}, ${time}.`;
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
    private readonly after: (ask: AfterTrial) => void,
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
    const text = JSON.stringify([status.results, status.offers, drives]);
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
      centimetres(error_m),
    ]);
    const rows = results.map((each, k) => {
      const { who, score, time, error, path } = summary(each);
      return [k === 0 ? `This trial: ${who}` : who, score, time, error, path];
    });
    this.body.replaceChildren(
      ...(objects.length > 0 ? [table("figures-table", ["Block", "", "To the grip", "To the release", "From its target"], objects)] : []),
      table("figures-table", ["", capital(card.score_name), "Time", "Mean error", "Path of the wrist"], rows),
      element("p", "verdict", comparison(results)),
      ...card.norms.map((norm) => element("p", "norm", capital(norm))),
    );
    this.buttons.replaceChildren(
      ...offers.map((offer) => button(OFFERS[offer], () => this.after(offer), offer === "drive" ? "primary" : "plain")),
      ...(drives
        ? [button("New trial", () => this.restart(false), "primary"), button("Same blocks again", () => this.restart(true), "plain")]
        : []),
      button("Look at the scene", () => {
        this.dismissed = this.shown;
        this.dialog.close();
      }, "plain"),
    );
  }
}

function capital(text: string): string {
  return `${text.slice(0, 1).toUpperCase()}${text.slice(1)}`;
}
