// Why something departs from the plan: reasons to choose from, and a dialog that asks for one.

import { Dialog } from "./dialog";
import { button, element, setText } from "./dom";
import type { StudyRequest } from "./generated/types";

/** What the server takes only with a reason. */
export type Reasoned = Extract<StudyRequest, { reason: string }>["ask"];
/** What is asked about first: beside these, whatever ends a trial or the day by a single click. */
export type Asked = Reasoned | "abort" | "leave";

interface Question {
  title: string;
  /** On the button that does it. */
  act: string;
  reasons: string[];
  /** Goes ahead without a reason too. */
  optional?: boolean;
}

export const QUESTIONS: Record<Asked, Question> = {
  start_anyway: {
    title: "Start although something is not ready?",
    act: "Start trial",
    reasons: ["checked by hand just now", "not needed for this condition", "equipment cannot be repaired now", "participant cannot wait"],
  },
  skip: {
    title: "Skip this step?",
    act: "Skip",
    reasons: ["participant declined", "no time left", "equipment failed", "already done before"],
  },
  redo: {
    title: "Do the last trial again?",
    act: "Redo trial",
    reasons: ["participant misunderstood", "armband slipped", "tracking lost", "experimenter's mistake", "interrupted from outside"],
  },
  retrain: {
    title: "Train the gestures again now?",
    act: "Train again",
    reasons: ["armband slipped", "armband taken off", "gestures are not recognised", "participant is tired"],
  },
  recalibrate: {
    title: "Calibrate the gaze again now?",
    act: "Calibrate again",
    reasons: ["eye tracker slipped", "gaze is off", "participant moved", "glasses put on or taken off"],
  },
  abort: {
    title: "End this trial?",
    act: "End trial",
    reasons: ["participant wants to stop", "participant is tired", "equipment failed", "interrupted from outside"],
    optional: true,
  },
  leave: {
    title: "End for today?",
    act: "End for today",
    reasons: ["participant wants to stop", "no time left", "equipment failed"],
    optional: true,
  },
};
/** Longest reason in free words, characters. */
const MOST_WORDS = 300;

export class ReasonDialog {
  private readonly title = element("h2");
  private readonly form = element("form", "reasons");
  private readonly dialog = new Dialog("ask", this.title, () => {});

  constructor(private readonly decided: (what: Asked, reason: string) => void) {
    this.dialog.root.append(this.title, this.form);
  }

  get root(): HTMLElement {
    return this.dialog.root;
  }

  get open(): boolean {
    return this.dialog.open;
  }

  close(): void {
    this.dialog.close();
  }

  /** Asks; `about` is the step that it is about. */
  ask(what: Asked, about: string): void {
    const { title, act, reasons, optional } = QUESTIONS[what];
    setText(this.title, title);
    const words = element("input", "words");
    words.type = "text";
    words.maxLength = MOST_WORDS;
    words.setAttribute("aria-label", "Another reason");
    const radios = [...reasons, ""].map((reason) => {
      const radio = element("input");
      radio.type = "radio";
      radio.name = "reason";
      radio.value = reason;
      return radio;
    });
    const other = radios[reasons.length];
    const choices = radios.map((radio) =>
      radio === other
        ? element("div", "reason", element("label", "", radio, "Other"), words)
        : element("label", "reason", radio, radio.value),
    );
    const confirm = element("button", what === "abort" ? "primary ends" : "primary", act);
    confirm.type = "submit";
    const reason = () => {
      const chosen = radios.find(({ checked }) => checked);
      return (chosen === other ? words.value : (chosen?.value ?? "")).trim();
    };
    const check = () => (confirm.disabled = !optional && reason() === "");
    words.addEventListener("input", () => {
      if (other) other.checked = true;
    });
    this.form.oninput = check;
    this.form.onsubmit = (event) => {
      event.preventDefault();
      if (confirm.disabled) return;
      const why = reason();
      this.close();
      this.decided(what, why);
    };
    this.form.replaceChildren(
      element("p", "about", about),
      element("fieldset", "", element("legend", "label", optional ? "Reason, if there is one to keep" : "Reason"), ...choices),
      element("div", "buttons", confirm, button("Cancel", () => this.close(), "plain")),
    );
    check();
    this.dialog.show();
  }
}
