// The buttons of a study: those that may be pressed now, the most likely one first.

import { beginLabel, nextLabel } from "./conductwords";
import { element, giveBack, setClass, setText } from "./dom";
import type { ExperimenterScreen, StudyButton } from "./generated/types";
import { strings } from "./strings";

const texts = strings.study;

/** After a press of the first button, and after it has come to mean something else, it takes no other press for so long, ms:
 * a double click ends one step and does not begin the next, and nobody presses what another side has changed just now. */
const SETTLING_MS = 600;

const LABELS: Record<StudyButton, string> = {
  begin: texts.beginSession,
  next: texts.nextStep,
  start_anyway: texts.startAnyway,
  pause: texts.pauseTrial,
  redo: texts.redo,
  retrain: texts.retrain,
  recalibrate: texts.recalibrate,
  skip: texts.skip,
  abort: texts.abort,
  leave: texts.leave,
};
/** Those that are large. */
const FIRST: StudyButton[] = ["begin", "next", "start_anyway", "pause"];
export const KEYS: Partial<Record<StudyButton, string>> = { next: "N", pause: "P" };

interface Part {
  node: HTMLButtonElement;
  label: HTMLElement;
}

export class ConductBar {
  readonly root = element("div", "conductbar");
  /** Less often needed. */
  readonly others = element("div", "others");
  private readonly parts = new Map<StudyButton, Part>();
  private connected = true;
  private can: StudyButton[] = [];
  private meaning = "";
  private settled = true;
  private timer = 0;

  constructor(private readonly pressed: (what: StudyButton) => void) {
    const first = element("div", "first");
    for (const what of Object.keys(LABELS) as StudyButton[]) {
      const label = element("span", "", LABELS[what]);
      const node = element("button", what, label);
      node.type = "button";
      const key = KEYS[what];
      if (key) {
        const hint = element("kbd", "", key);
        // Its name for screen readers is the label alone; the key is told in its own attribute.
        hint.setAttribute("aria-hidden", "true");
        node.append(hint);
        node.setAttribute("aria-keyshortcuts", key);
      }
      node.addEventListener("click", (event) => {
        this.press(what);
        giveBack(event, node);
      });
      this.parts.set(what, { node, label });
      (FIRST.includes(what) ? first : this.others).append(node);
    }
    this.root.append(first, this.others);
    this.refresh();
  }

  show({ can, next, session }: ExperimenterScreen): void {
    this.can = can;
    const now = session?.now;
    const meaning = JSON.stringify([session?.id, session?.session, now?.step, now?.running, next, can.includes("next")]);
    if (meaning !== this.meaning) this.settle();
    this.meaning = meaning;
    this.label("begin", beginLabel(next));
    this.label("next", nextLabel(now ?? null));
    this.refresh();
  }

  showPaused(paused: boolean): void {
    this.label("pause", paused ? texts.resume : texts.pauseTrial);
    const pause = this.parts.get("pause");
    if (pause) setClass(pause.node, "now", paused);
  }

  showConnected(connected: boolean): void {
    this.connected = connected;
    this.refresh();
  }

  /** As a click on it; it does nothing while the button is not there. */
  press(what: StudyButton): void {
    if (!this.usable(what)) return;
    if (what === "next" || what === "begin") this.settle();
    this.pressed(what);
  }

  private usable(what: StudyButton): boolean {
    const waits = what === "next" || what === "begin" || what === "start_anyway";
    return this.connected && this.can.includes(what) && (this.settled || !waits);
  }

  private settle(): void {
    this.settled = false;
    window.clearTimeout(this.timer);
    this.timer = window.setTimeout(() => {
      this.settled = true;
      this.refresh();
    }, SETTLING_MS);
    this.refresh();
  }

  private label(what: StudyButton, text: string): void {
    const part = this.parts.get(what);
    if (part) setText(part.label, text);
  }

  private refresh(): void {
    // Without a step to go on with, whatever is left is the next thing to do.
    const primary = FIRST.find((what) => this.can.includes(what));
    for (const [what, { node }] of this.parts) {
      node.hidden = !this.can.includes(what);
      setClass(node, "primary", what === primary && what !== "pause");
      // Not `disabled`: the button would lose the focus each time.
      node.setAttribute("aria-disabled", String(!this.usable(what)));
    }
  }
}
