// The scoreboard: methods side by side, what was reached in this visit and what simulated people reach, as a picture and as a table.
// It comes with its first opening.

import { Dialog } from "./dialog";
import { button, element } from "./dom";
import type { PageContent, ResultCard } from "./generated/types";
import type { ConfidenceInterval } from "./confidenceInterval";
import { toCsv, MEASURES, methodsOf, simulatedTrials, measureInterval, visitTrials, type Measure, type TrialScore } from "./scores";
import { strings } from "./strings";
import { fixed } from "./numbers";

const words = strings.scores;
/** Of a picture of one measure, in its own units. */
const PLOT_SIZE = { width: 230, row: 30, left: 26, right: 10, top: 8, bottom: 20 };
const SVG = "http://www.w3.org/2000/svg";

export class Scoreboard {
  private readonly title = element("h2", "", words.title);
  private readonly body = element("div");
  private readonly dialog = new Dialog("scoreboard", this.title, () => this.close());
  private trials: TrialScore[] = [];

  constructor(private readonly closed: () => void) {
    this.dialog.root.append(
      element("div", "dialoghead", this.title, button(words.csv, () => this.save(), "plain save"), button(words.close, () => this.close(), "plain close")),
      this.body,
    );
  }

  get root(): HTMLElement {
    return this.dialog.root;
  }

  get open(): boolean {
    return this.dialog.open;
  }

  show(results: ResultCard[], content: PageContent): void {
    const [own, people] = [visitTrials(results, content), simulatedTrials(content, words.simulated)];
    this.trials = [...own, ...people];
    const methods = methodsOf(own, people);
    const { most, score_name } = content.briefing;
    const name = (measure: Measure) => (measure === "score" ? score_name : words.measures[measure]);
    const of = (trials: TrialScore[], method: string, measure: Measure) => measureInterval(trials, method, measure, most);
    const titles = new Map([content.method, ...content.methods].map((method) => [method.name, method.title]));
    this.body.replaceChildren(
      element("p", "note", own.length > 0 ? words.about(own.length) : words.none, people.length > 0 ? ` ${words.aboutPeople(people.length / Math.max(methodsOf(people).length, 1))}` : ` ${words.noPeople}`),
      element("div", "plots", ...MEASURES.map((measure) => plot(name(measure), methods, (method) => [of(own, method, measure), of(people, method, measure)]))),
      element("p", "legend", element("i", "own"), words.you, element("i", "people"), words.simulated, element("span", "", words.legend)),
      table(methods, titles, name, (method, measure) => [of(own, method, measure), of(people, method, measure)]),
    );
    this.dialog.show();
  }

  close(): void {
    this.dialog.close();
    this.closed();
  }

  private save(): void {
    const address = URL.createObjectURL(new Blob([toCsv(this.trials)], { type: "text/csv" }));
    const link = element("a");
    link.href = address;
    link.download = "proact-scores.csv";
    link.click();
    window.setTimeout(() => URL.revokeObjectURL(address), 1000);
  }
}

/** Two dots with intervals for each method: this visit above, simulated people below. */
function plot(label: string, methods: string[], of: (method: string) => [ConfidenceInterval | null, ConfidenceInterval | null]): HTMLElement {
  const { width, row, left, right, top, bottom } = PLOT_SIZE;
  const height = top + row * methods.length + bottom;
  const all = methods.flatMap((method) => of(method)).filter((interval) => interval !== null);
  const most = roundUp(Math.max(...all.map(({ mean, bounds: ends }) => ends?.[1] ?? mean), 0.5));
  const x = (value: number) => left + ((width - left - right) * value) / most;
  const svg = svgNode("svg", { viewBox: `0 0 ${width} ${height}`, role: "img", "aria-label": words.plot(label) });
  for (const tick of [0, 0.5, 1]) {
    svg.append(svgNode("line", { class: "grid", x1: x(tick * most), x2: x(tick * most), y1: top, y2: height - bottom }));
    svg.append(svgNode("text", { x: x(tick * most), y: height - 6, "text-anchor": tick === 1 ? "end" : "middle" }, shortText(tick * most)));
  }
  methods.forEach((method, k) => {
    const middle = top + (k + 0.5) * row;
    svg.append(svgNode("text", { class: "method", x: 4, y: middle + 4 }, method));
    of(method).forEach((interval, who) => {
      if (!interval) return;
      const y = middle + (who === 0 ? -6 : 6);
      const kind = who === 0 ? "own" : "people";
      if (interval.bounds) svg.append(svgNode("line", { class: kind, x1: x(interval.bounds[0]), x2: x(interval.bounds[1]), y1: y, y2: y }));
      svg.append(
        who === 0
          ? svgNode("circle", { class: kind, cx: x(interval.mean), cy: y, r: 4.5 })
          : svgNode("rect", { class: kind, x: x(interval.mean) - 4, y: y - 4, width: 8, height: 8 }),
      );
    });
  });
  return element("figure", "", element("figcaption", "", label), svg as unknown as HTMLElement);
}

function table(
  methods: string[],
  titles: Map<string, string>,
  name: (measure: Measure) => string,
  of: (method: string, measure: Measure) => [ConfidenceInterval | null, ConfidenceInterval | null],
): HTMLElement {
  const head = (text: string, scope: string) => {
    const cell = element("th", "", text);
    cell.scope = scope;
    return cell;
  };
  const rows = methods.flatMap((method) =>
    [words.you, words.simulated].map((who, k) => {
      const title = titles.get(method);
      const cells = MEASURES.map((measure) => element("td", "", cellText(of(method, measure)[k] ?? null)));
      const count = of(method, "score")[k]?.count ?? 0;
      return element("tr", k === 0 ? "first" : "", head(k === 0 ? [method, title].filter(Boolean).join(": ") : method, "row"), element("td", "", who), element("td", "", String(count)), ...cells);
    }),
  );
  const columns = [words.method, words.who, words.trials, ...MEASURES.map(name)].map((text) => head(text, "col"));
  const box = element("div", "tablebox", element("table", "figures-table", element("thead", "", element("tr", "", ...columns)), element("tbody", "", ...rows)));
  // In a narrow window it scrolls, also by keys.
  box.tabIndex = 0;
  box.setAttribute("role", "group");
  box.setAttribute("aria-label", words.table);
  return box;
}

function cellText(interval: ConfidenceInterval | null): string {
  if (!interval) return "–";
  const { mean, bounds: ends } = interval;
  return ends ? `${shortText(mean)} (${shortText(ends[0])} to ${shortText(ends[1])})` : shortText(mean);
}

function shortText(value: number): string {
  return value >= 20 || Number.isInteger(value) ? fixed(value) : fixed(value, 1);
}

/** A round number that is not smaller. */
function roundUp(value: number): number {
  const unit = 10 ** Math.floor(Math.log10(value));
  return ([1, 2, 4, 5, 6, 8, 10].find((step) => step * unit >= value - 1e-9) ?? 10) * unit;
}

function svgNode(tag: string, attributes: Record<string, string | number>, text = ""): SVGElement {
  const made = document.createElementNS(SVG, tag);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, String(value));
  made.textContent = text;
  return made;
}
