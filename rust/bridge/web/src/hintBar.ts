// The strip that tells a newcomer what to do next. What it says follows from the frame alone: `hints.ts`.

import { element, setClass, setText } from "./dom";
import type { DisplayFrame, MethodHelp, MethodInfo } from "./generated/types";
import { nextHint, STEPS, type HintContext } from "./hints";
import { GESTURE_NAMES } from "./protocol";
import type { GestureKey } from "./settings";
import { strings } from "./strings";

const words = strings.guide;

const GESTURES: GestureKey[] = ["hand_open", "wrist_extension", "wrist_flexion", "hand_close"];

export class HintBar {
  readonly root = element("section", "card guide");
  private readonly keys: { gesture: GestureKey; node: HTMLElement }[] = [];
  private readonly steps = STEPS.map(({ gesture, text }) => element("li", "", this.key(gesture), element("span", "", text)));
  private readonly hint = element("p", "hint");
  private readonly list = element("ol", "steps", ...this.steps);
  private readonly moves = GESTURES.map((gesture) => {
    const text = element("span");
    return { gesture, text, item: element("li", "", this.key(gesture), text) };
  });
  private readonly modes = element("ol", "steps", ...this.moves.map(({ item }) => item));

  constructor() {
    this.root.append(this.list, this.modes, this.hint);
    this.root.setAttribute("aria-label", words.label);
    this.hint.setAttribute("aria-live", "polite");
    this.root.hidden = true;
  }

  update(frame: DisplayFrame, method: MethodInfo | undefined, now: HintContext): void {
    const stepwise = method?.style === "jogging";
    this.root.hidden = method === undefined;
    this.list.hidden = stepwise;
    this.modes.hidden = !stepwise;
    for (const { gesture, node } of this.keys) {
      setText(node, now.key(gesture));
      node.hidden = node.textContent === "";
    }
    if (stepwise) this.showMode(frame, method.help);
    const { step, hint } = nextHint(frame, now);
    this.steps.forEach((item, k) => {
      setClass(item, "now", k === step);
      setClass(item, "past", step !== null && k < step);
    });
    setText(this.hint, hint);
  }

  /** Such methods have no selection: the strip says what each gesture does now. */
  private showMode(frame: DisplayFrame, help: MethodHelp): void {
    const texts: Record<GestureKey, string> = {
      hand_open: words.nextOrBack(help.hand_open || words.next),
      wrist_extension: frame.mode?.directions[0] ?? (help.wrist_extension || "+"),
      wrist_flexion: frame.mode?.directions[1] ?? (help.wrist_flexion || "−"),
      hand_close: frame.hand.state === "open" ? words.closeHand : words.openHand,
    };
    for (const { gesture, text, item } of this.moves) {
      setText(text, texts[gesture]);
      setClass(item, "now", frame.gesture === gesture);
    }
  }

  private key(gesture: GestureKey | null): HTMLElement | null {
    if (!gesture) return null;
    const node = element("kbd");
    node.title = GESTURE_NAMES[gesture].name;
    this.keys.push({ gesture, node });
    return node;
  }
}
