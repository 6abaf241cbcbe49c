// What is meant, as gaze, task and both together have it: a table of bars, and small bars over the blocks in the scene.

import { element, setClass, setText, setWidth } from "./dom";
import type { IntentEstimate, MethodInfo, PageContent } from "./generated/types";
import { objectColor, objectName } from "./objects";
import { strings } from "./strings";

/** More than these have no bars of their own. */
const MAX_BARS = 16;

const words = strings.intent;

/** Whose an entry is: an object, or the target of one. */
interface Candidate {
  what: "object" | "target";
  id: number;
  name: string;
}

type Project = (what: "object" | "target", id: number) => { x: number; y: number } | null;

export function percent(share: number): string {
  return `${Math.round(100 * share)} %`;
}

export class IntentView {
  readonly root = element("section", "intentview");
  /** Over the scene. */
  readonly overlay = element("div", "intentbars");
  private readonly title = element("h3", "", words.title);
  private readonly usedByMethod = element("p", "note");
  private readonly body = element("tbody");
  private readonly table: HTMLElement;
  private readonly showsOver = element("input");
  private candidates: Candidate[] = [];
  private named = "";
  private intent: IntentEstimate | null = null;

  constructor() {
    const head = [words.column, words.gaze, words.task, words.both].map((text) => {
      const cell = element("th", "", text);
      cell.scope = "col";
      return cell;
    });
    this.table = element("table", "", element("thead", "", element("tr", "", ...head)), this.body);
    this.showsOver.type = "checkbox";
    this.showsOver.checked = true;
    this.overlay.setAttribute("aria-hidden", "true");
    this.root.append(this.title, this.usedByMethod, this.table, element("label", "note", this.showsOver, ` ${words.over}`));
  }

  clear(): void {
    this.show(null, null, undefined);
  }

  /** What was said at one instant; none if nothing was. */
  show(intent: IntentEstimate | null, content: PageContent | null, method: MethodInfo | undefined): void {
    this.intent = intent;
    const entries = intent && content ? candidatesOf(intent, content) : [];
    const named = JSON.stringify(entries);
    if (named !== this.named) this.fill(entries);
    this.named = named;
    this.candidates = entries;
    this.table.hidden = entries.length === 0;
    setText(this.title, intent?.over === "places" ? words.titlePlaces : words.title);
    setText(this.usedByMethod, intent === null ? words.nothing : entries.length === 0 ? words.tooMany : usedByMethodText(intent, method));
    if (!intent) return;
    const taken = method?.needs.prior ? intent.posterior : intent.likelihood;
    const likeliest = intent.over === "objects" ? taken.indexOf(Math.max(...taken)) : -1;
    [...this.body.children].forEach((row, k) => {
      setClass(row, "likeliest", k === likeliest);
      [intent.likelihood, intent.prior, intent.posterior].forEach((list, column) => {
        const cell = row.children[column + 1];
        const [bar, text] = [cell?.children[0]?.firstElementChild, cell?.children[1]];
        if (bar instanceof HTMLElement) setWidth(bar, list[k] ?? 0);
        if (text) setText(text, percent(list[k] ?? 0));
      });
    });
  }

  /** Puts the bars where the scene has the blocks; `shown` if they are to be seen at all. */
  updateOverlay(project: Project, shown: boolean): void {
    const { intent, overlay } = this;
    overlay.hidden = !shown || !this.showsOver.checked || intent === null || this.candidates.length === 0;
    if (overlay.hidden || !intent) return;
    this.candidates.forEach((entry, k) => {
      const node = overlay.children[k];
      const at = project(entry.what, entry.id);
      if (!(node instanceof HTMLElement)) return;
      node.hidden = at === null;
      if (!at) return;
      node.style.transform = `translate(${Math.round(at.x)}px, ${Math.round(at.y)}px)`;
      [intent.likelihood, intent.posterior].forEach((list, bar) => {
        const fill = node.children[bar]?.firstElementChild;
        const height = percent(list[k] ?? 0).replace(" ", "");
        if (fill instanceof HTMLElement && fill.style.height !== height) fill.style.height = height;
      });
    });
  }

  private fill(entries: Candidate[]): void {
    this.body.replaceChildren(
      ...entries.map(({ id, name }) => {
        const swatch = element("i", "swatch");
        swatch.style.background = objectColor(id);
        const label = element("th", "", swatch, name);
        label.scope = "row";
        const cell = (kind: string) => element("td", kind, element("div", "bar", element("i", "fill")), element("span", "small"));
        return element("tr", "", label, cell("gaze"), cell("task"), cell("both"));
      }),
    );
    this.overlay.replaceChildren(
      ...entries.map(() => element("div", "over-block", element("i", "gaze", element("b")), element("i", "both", element("b")))),
    );
  }
}

function candidatesOf(intent: IntentEstimate, { scene }: PageContent): Candidate[] {
  if (intent.likelihood.length > MAX_BARS) return [];
  return intent.over === "objects"
    ? scene.objects.map((_, id): Candidate => ({ what: "object", id, name: objectName(id) }))
    : scene.targets.map(({ object: id }): Candidate => ({ what: "target", id, name: objectName(id) }));
}

/** What of it the method goes by. */
function usedByMethodText(intent: IntentEstimate, method: MethodInfo | undefined): string {
  if (intent.over === "places") return words.placesAct;
  return method?.needs.prior ? words.bothAct : words.gazeActs;
}
