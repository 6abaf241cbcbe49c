// A questionnaire that the experimenter fills in for the participant, in a dialog over the page.

import { Dialog } from "./dialog";
import { button, element, setText } from "./dom";
import { FormView } from "./formView";
import type { FormAnswer, FormScreen } from "./generated/types";
import { strings } from "./strings";

export interface FillInHandlers {
  answer(step: number, key: string, answer: FormAnswer | null): void;
  submit(step: number): void;
}

export class FillInDialog {
  private readonly title = element("h2");
  private readonly dialog = new Dialog("fillin", this.title, () => {});
  private readonly view: FormView;
  /** For whom and which step it was opened: no other questionnaire takes its place unasked. */
  private requestedForm = "";

  constructor(handlers: FillInHandlers) {
    this.view = new FormView(handlers);
    this.dialog.root.append(
      element("div", "dialoghead", this.title, button(strings.fillIn.close, () => this.dialog.close(), "plain close")),
      this.view.root,
    );
  }

  get root(): HTMLElement {
    return this.dialog.root;
  }

  get open(): boolean {
    return this.dialog.open;
  }

  /** Opens it for the questionnaire that is on. */
  show(whose: string, screen: FormScreen): void {
    const wanted = `${whose} ${screen.step}`;
    // Nobody gets answers that somebody else gave.
    if (wanted !== this.requestedForm) this.view.clear();
    this.requestedForm = wanted;
    this.view.show(screen);
    setText(this.title, strings.fillIn.whose(whose));
    this.dialog.show();
  }

  /** Takes each new screen; none if the step is no questionnaire. */
  update(whose: string, screen: FormScreen | null): void {
    if (!this.dialog.open) return;
    if (screen && this.requestedForm === `${whose} ${screen.step}`) this.view.show(screen);
    else this.close();
  }

  /** What could not be sent meanwhile goes out again. */
  reconnected(): void {
    this.view.draft.resend();
  }

  private close(): void {
    this.dialog.close();
    this.view.clear();
  }
}
