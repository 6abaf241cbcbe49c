// Why something departs from the plan: reasons to choose from, and a dialog that asks for one.

import { Dialog } from "./dialog";
import { button, element, setText } from "./dom";
import type { StudyRequest } from "./generated/types";
import { strings } from "./strings";

/** What the server takes only with a reason. */
export type RequestWithReason = Extract<StudyRequest, { reason: string }>["ask"];
/** What is asked about first: beside these, whatever ends a trial or the day by a single click. */
export type ConfirmedRequest = RequestWithReason | "abort" | "leave";

interface ReasonQuestion {
  title: string;
  /** On the button that does it. */
  act: string;
  reasons: string[];
  /** Goes ahead without a reason too. */
  optional?: boolean;
}

const words = strings.reasons;

export const QUESTIONS: Record<ConfirmedRequest, ReasonQuestion> = words.questions;
/** Longest reason in free words, characters. */
const MAX_REASON_CHARS = 300;

export class ReasonDialog {
  private readonly title = element("h2");
  private readonly form = element("form", "reasons");
  private readonly dialog = new Dialog("ask", this.title, () => {});

  constructor(private readonly decided: (what: ConfirmedRequest, reason: string) => void) {
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
  ask(what: ConfirmedRequest, about: string): void {
    const { title, act, reasons, optional } = QUESTIONS[what];
    setText(this.title, title);
    const own = element("input", "words");
    own.type = "text";
    own.maxLength = MAX_REASON_CHARS;
    own.setAttribute("aria-label", words.another);
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
        ? element("div", "reason", element("label", "", radio, words.other), own)
        : element("label", "reason", radio, radio.value),
    );
    const confirm = element("button", what === "abort" ? "primary ends" : "primary", act);
    confirm.type = "submit";
    const reason = () => {
      const chosen = radios.find(({ checked }) => checked);
      return (chosen === other ? own.value : (chosen?.value ?? "")).trim();
    };
    const check = () => (confirm.disabled = !optional && reason() === "");
    own.addEventListener("input", () => {
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
      element("fieldset", "", element("legend", "label", optional ? words.mayReason : words.reason), ...choices),
      element("div", "buttons", confirm, button(words.cancel, () => this.close(), "plain")),
    );
    check();
    this.dialog.show();
  }
}
