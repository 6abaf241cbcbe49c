// The buttons of a study: those that may be pressed now, the most likely one first.

import { beginLabel, nextLabel } from "./conductText";
import { element, returnFocus, setClass, setText } from "./dom";
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
const PRIMARY_BUTTONS: StudyButton[] = ["begin", "next", "start_anyway", "pause"];
export const KEYS: Partial<Record<StudyButton, string>> = { next: "N", pause: "P" };

interface BarButton {
  node: HTMLButtonElement;
  label: HTMLElement;
}

export class ConductBar {
  readonly root = element("div", "conductbar");
  /** Less often needed. */
  readonly secondaryButtons = element("div", "others");
  private readonly buttons = new Map<StudyButton, BarButton>();
  private connected = true;
  private available: StudyButton[] = [];
  private meaning = "";
  private settledAt = true;
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
        returnFocus(event, node);
      });
      this.buttons.set(what, { node, label });
      (PRIMARY_BUTTONS.includes(what) ? first : this.secondaryButtons).append(node);
    }
    this.root.append(first, this.secondaryButtons);
    this.refresh();
  }

  show({ can, next, session }: ExperimenterScreen): void {
    this.available = can;
    const now = session?.now;
    const meaning = JSON.stringify([session?.id, session?.session, now?.step, now?.running, next, can.includes("next")]);
    if (meaning !== this.meaning) this.startSettling();
    this.meaning = meaning;
    this.label("begin", beginLabel(next));
    this.label("next", nextLabel(now ?? null));
    this.refresh();
  }

  showPaused(paused: boolean): void {
    this.label("pause", paused ? texts.resume : texts.pauseTrial);
    const pause = this.buttons.get("pause");
    if (pause) setClass(pause.node, "now", paused);
  }

  showConnected(connected: boolean): void {
    this.connected = connected;
    this.refresh();
  }

  /** As a click on it; it does nothing while the button is not there. */
  press(what: StudyButton): void {
    if (!this.isUsable(what)) return;
    if (what === "next" || what === "begin") this.startSettling();
    this.pressed(what);
  }

  private isUsable(what: StudyButton): boolean {
    const waits = what === "next" || what === "begin" || what === "start_anyway";
    return this.connected && this.available.includes(what) && (this.settledAt || !waits);
  }

  private startSettling(): void {
    this.settledAt = false;
    window.clearTimeout(this.timer);
    this.timer = window.setTimeout(() => {
      this.settledAt = true;
      this.refresh();
    }, SETTLING_MS);
    this.refresh();
  }

  private label(what: StudyButton, text: string): void {
    const part = this.buttons.get(what);
    if (part) setText(part.label, text);
  }

  private refresh(): void {
    // Without a step to go on with, whatever is left is the next thing to do.
    const primary = PRIMARY_BUTTONS.find((what) => this.available.includes(what));
    for (const [what, { node }] of this.buttons) {
      node.hidden = !this.available.includes(what);
      setClass(node, "primary", what === primary && what !== "pause");
      // Not `disabled`: the button would lose the focus each time.
      node.setAttribute("aria-disabled", String(!this.isUsable(what)));
    }
  }
}
