// Why what was chosen on the page did not begin: it stays until it is closed, or something else begins.

import { button, element, setText } from "./dom";
import { capitalize } from "./protocol";
import { strings } from "./strings";

export class StartErrorView {
  readonly root = element("div", "card not-begun");
  private readonly text = element("p");
  private reason: string | null = null;

  constructor() {
    this.root.hidden = true;
    this.root.setAttribute("role", "alert");
    this.root.append(this.text, button(strings.refused.close, () => (this.root.hidden = true), "plain"));
  }

  /** Takes each status. */
  show(reason: string | null): void {
    if (reason === this.reason) return;
    this.reason = reason;
    this.root.hidden = reason === null;
    setText(this.text, capitalize(reason ?? ""));
  }
}
