// Why the arm is stopped, where nobody overlooks it.

import { element, setText } from "./dom";
import type { Stop } from "./generated/types";
import { stopText } from "./protocol";

export const STOPPED = "The arm is stopped";

export class StopBanner {
  readonly root = element("div", "stop-banner");
  private readonly reason = element("span");

  constructor() {
    this.root.setAttribute("role", "alert");
    this.root.hidden = true;
    this.root.append(element("strong", "", STOPPED), this.reason);
  }

  show(stop: Stop | null): void {
    if (stop) setText(this.reason, stopText(stop));
    this.root.hidden = stop === null;
  }
}
