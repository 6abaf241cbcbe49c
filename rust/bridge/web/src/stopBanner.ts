// Why the arm is stopped, and the way out of it, where nobody overlooks them.

import { element, setText } from "./dom";
import type { Stop } from "./generated/types";
import { stopText } from "./protocol";
import { strings } from "./strings";

export const STOPPED_TITLE = strings.hud.stopped;

export class StopBanner {
  readonly root = element("div", "stop-banner");
  private readonly reason = element("span");
  private readonly recovery = element("b");

  constructor() {
    this.root.setAttribute("role", "alert");
    this.root.hidden = true;
    this.root.append(element("strong", "", STOPPED_TITLE), this.reason, this.recovery);
  }

  /** `way`: what the person has to do; empty on pages of those who only watch. */
  show(stop: Stop | null, way = ""): void {
    if (stop) setText(this.reason, stopText(stop));
    setText(this.recovery, stop ? way : "");
    this.root.hidden = stop === null;
  }
}
