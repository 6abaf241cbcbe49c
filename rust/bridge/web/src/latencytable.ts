// What the way from muscle to light takes, stage by stage, as a table.

import { element, setText } from "./dom";
import type { LatencyRow, LatencyStage } from "./generated/types";
import { strings } from "./strings";

const texts = strings.latency;

/** Two digits that count. */
function shortly(ms: number): string {
  return ms.toFixed(ms < 0.1 ? 4 : ms < 10 ? 2 : 0);
}

export class LatencyTable {
  readonly root = element("table", "latencies");
  private readonly body = element("tbody");
  private readonly rows = new Map<LatencyStage, HTMLElement[]>();

  constructor() {
    const heads = texts.columns.map((text) => {
      const head = element("th", "", text);
      head.scope = "col";
      return head;
    });
    this.root.append(element("caption", "", texts.about), element("thead", "", element("tr", "", ...heads)), this.body);
  }

  show(rows: LatencyRow[]): void {
    if (rows.length < this.rows.size) this.clear();
    for (const row of rows) {
      const cells = this.rows.get(row.stage) ?? this.add(row.stage);
      [row.median_ms, row.p99_ms, row.worst_ms].forEach((ms, k) => setText(cells[k]!, shortly(ms)));
    }
  }

  clear(): void {
    this.body.replaceChildren();
    this.rows.clear();
  }

  private add(stage: LatencyStage): HTMLElement[] {
    const [name, about] = texts.stages[stage];
    const head = element("th", "", name);
    head.scope = "row";
    head.title = about ?? "";
    const cells = [0, 1, 2].map(() => element("td"));
    this.rows.set(stage, cells);
    // In the order of the way, whatever was measured first.
    const order = Object.keys(texts.stages);
    const place = [...this.rows.keys()].filter((known) => order.indexOf(known) < order.indexOf(stage)).length;
    this.body.insertBefore(element("tr", stage, head, ...cells), this.body.children[place] ?? null);
    return cells;
  }
}
