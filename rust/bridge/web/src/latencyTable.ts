// What the way from muscle to light takes, stage by stage, as a table.

import { element, setText } from "./dom";
import type { LatencyRow, LatencyStage } from "./generated/types";
import { strings } from "./strings";
import { fixed } from "./numbers";

const texts = strings.latency;

/** Two digits that count. */
function twoDigits(ms: number): string {
  return fixed(ms, ms < 0.1 ? 4 : ms < 10 ? 2 : 0);
}

export class LatencyTable {
  readonly root = element("table", "latencies");
  private readonly body = element("tbody");
  /** The stages that are shown, and the cells of each. */
  private shown = "";
  private cells: HTMLElement[][] = [];

  constructor() {
    const heads = texts.columns.map((text) => {
      const head = element("th", "", text);
      head.scope = "col";
      return head;
    });
    this.root.append(element("caption", "", texts.about), element("thead", "", element("tr", "", ...heads)), this.body);
  }

  /** Rows in the order of the way; another stage makes the table anew. */
  show(rows: LatencyRow[]): void {
    const stages = rows.map((row) => row.stage);
    if (stages.join() !== this.shown) {
      this.shown = stages.join();
      this.cells = stages.map(() => [0, 1, 2].map(() => element("td")));
      this.body.replaceChildren(...stages.map((stage, k) => element("tr", stage, rowHeader(stage), ...(this.cells[k] ?? []))));
    }
    rows.forEach((row, k) => {
      const times = [row.median_ms, row.p99_ms, row.worst_ms];
      this.cells[k]?.forEach((cell, column) => setText(cell, twoDigits(times[column] ?? NaN)));
    });
  }
}

function rowHeader(stage: LatencyStage): HTMLElement {
  const [name, about] = texts.stages[stage];
  const head = element("th", "", name);
  head.scope = "row";
  head.title = about ?? "";
  return head;
}
