// The steps of a session as a list. The one that is to be done now is open, and in sight.

import { deviationText, STATES, stepState } from "./conductText";
import { element } from "./dom";
import type { SessionScreen, StepRow } from "./generated/types";
import { capitalize } from "./protocol";
import { strings } from "./strings";

const texts = strings.study;

export class StepList {
  readonly root = element("ol", "steplist");
  private shown: string[] = [];
  private current = "";

  /** `currentStep` is put into the step that is to be done now. */
  constructor(private readonly currentStep: HTMLElement) {
    this.root.tabIndex = 0;
    this.root.setAttribute("aria-label", texts.stepsLabel);
    window.addEventListener("resize", () => this.reveal());
  }

  show({ participant, session, steps, now }: SessionScreen): void {
    while (this.root.children.length > steps.length) this.root.lastElementChild?.remove();
    this.shown.length = steps.length;
    steps.forEach((line, k) => {
      const isNow = line.step === now?.step;
      const text = JSON.stringify([line, isNow]);
      if (text === this.shown[k]) return;
      this.shown[k] = text;
      const item = this.root.children[k] ?? this.root.appendChild(element("li"));
      this.fill(item, line, stepState(line, now));
      if (!isNow) return item.removeAttribute("aria-current");
      item.setAttribute("aria-current", "step");
      item.append(this.currentStep);
    });
    const current = `${participant} ${session} ${now?.step}`;
    // Only when the step changes: whoever looks at other steps is not taken away from them.
    if (current !== this.current) this.reveal();
    this.current = current;
  }

  private fill(item: Element, line: StepRow, state: keyof typeof STATES): void {
    const { mark, word } = STATES[state];
    const sign = element("span", "mark", mark);
    sign.setAttribute("aria-hidden", "true");
    const deviations = deviationText(line.deviations);
    const plain = state === "done" || state === "to_do" || state === "now";
    item.className = state;
    item.replaceChildren(
      element(
        "div",
        "stepline",
        sign,
        element("span", "what", capitalize(line.label), deviations ? element("span", "star", " *") : null),
        element("span", plain ? "only-heard" : "word", word),
        line.attempts > 1 ? element("span", "word", `${line.attempts} attempts`) : null,
        line.condition === null ? null : element("span", "chip", line.condition),
      ),
      ...(deviations ? [element("div", "deviations", `* ${deviations}`)] : []),
    );
  }

  /** Scrolls so that the current step is at the top, below the one before it. */
  private reveal(): void {
    const item = this.currentStep.parentElement;
    if (!item || !this.root.contains(item)) return;
    const before = (item.previousElementSibling as HTMLElement | null) ?? item;
    this.root.scrollTop = before.offsetTop;
    // Whoever writes a note meanwhile is left where the note is.
    const writes = document.activeElement instanceof HTMLElement && document.activeElement.matches("textarea, input[type=text]");
    if (!writes) item.firstElementChild?.scrollIntoView({ block: "nearest" });
  }
}
