// Leads a newcomer through moving a block with method D, one step at a time, with a pointer to what is meant.

import { Dialog } from "./dialog";
import { button, element, setClass, setText } from "./dom";
import { nextHint, STEPS, type HintContext } from "./hints";
import { objectName } from "./objects";
import type { DisplayFrame, MethodInfo, ObjectId } from "./generated/types";
import { keyName, type Settings } from "./settings";
import { strings } from "./strings";

const words = strings.tutorial;

/** One for each step of the guide, by whose gesture it is done. */
const LESSON_BY_STEP = words.lessons.map((lesson, k) => ({ ...lesson, gesture: STEPS[k]?.gesture ?? null }));

export interface TutorialHandlers {
  /** Begin a trial with this method. */
  choose(method: string): void;
  /** The tutorial was done or skipped. */
  ended(): void;
}

export class Tutorial {
  readonly root = element("div", "tutorial");
  private readonly welcome: Dialog;
  readonly card = element("div", "card lesson");
  private readonly number = element("span", "lessonnumber");
  private readonly title = element("b");
  private readonly text = element("span");
  private readonly key = element("kbd", "big");
  private readonly hint = element("p", "note");
  private readonly dots = LESSON_BY_STEP.map(() => element("i"));
  private readonly pointer = element("div", "pointer", "▼");
  private readonly done: Dialog;
  private readonly doneTitle = element("h2", "", words.done);
  private active = false;
  /** Name of the method that the lessons are about. */
  private lessonMethod: string | undefined;

  constructor(
    private readonly handlers: TutorialHandlers,
    private keys: Settings["keys"],
  ) {
    const title = element("h2", "", words.title);
    this.welcome = new Dialog("welcome", title, () => this.end());
    this.welcome.root.append(
      title,
      element("p", "", words.welcome),
      element(
        "div",
        "buttons",
        button(words.show, () => this.start(), "primary"),
        button(words.know, () => this.end(), "plain"),
      ),
    );
    this.done = new Dialog("welcome", this.doneTitle, () => this.end());
    this.card.append(
      element("div", "lessonhead", this.number, this.title, element("span", "dots", ...this.dots), button(words.skip, () => this.end(), "plain")),
      element("p", "lessontext", this.text, " ", this.key),
      this.hint,
    );
    this.card.hidden = this.pointer.hidden = true;
    this.root.append(this.pointer, this.welcome.root, this.done.root);
  }

  /** The methods that there are. The lessons are those of the one that selects and knows the task. */
  setMethods(methods: MethodInfo[]): void {
    const selecting = methods.filter(({ style }) => style === "selecting");
    this.lessonMethod = (selecting.find(({ needs }) => needs.prior) ?? selecting[0])?.name;
    const choice = ({ name, title }: MethodInfo) =>
      button(
        `${name} · ${title}`,
        () => {
          this.end();
          this.handlers.choose(name);
        },
        "plain",
      );
    this.done.root.replaceChildren(
      this.doneTitle,
      element("p", "", words.others(this.lessonMethod ?? "")),
      element("div", "choices", ...methods.filter(({ name }) => name !== this.lessonMethod).map(choice)),
      element("div", "buttons", button(words.goOn(this.lessonMethod ?? ""), () => this.end(), "primary")),
    );
  }

  /** True while the lessons run, and the guide's strip would say the same twice. */
  get running(): boolean {
    return this.active;
  }

  /** True while a dialogue waits for an answer. */
  get asking(): boolean {
    return this.welcome.open || this.done.open;
  }

  setKeys(keys: Settings["keys"]): void {
    this.keys = keys;
  }

  showWelcome(): void {
    this.welcome.show();
  }

  start(): void {
    if (this.lessonMethod === undefined) return;
    this.welcome.close();
    this.done.close();
    this.active = true;
    this.handlers.choose(this.lessonMethod);
  }

  /** Goes away without having been done or skipped. */
  close(): void {
    this.active = false;
    this.welcome.close();
    this.done.close();
    this.card.hidden = this.pointer.hidden = true;
  }

  private end(): void {
    this.close();
    this.handlers.ended();
  }

  update(
    frame: DisplayFrame,
    now: HintContext,
    project: (what: "object" | "target", id: ObjectId) => { x: number; y: number } | null,
  ): void {
    if (!this.active || frame.method !== this.lessonMethod) return;
    if (frame.score > 0) {
      this.active = false;
      this.card.hidden = this.pointer.hidden = true;
      this.done.show();
      return;
    }
    const { step, hint } = nextHint(frame, now);
    const lesson = LESSON_BY_STEP[step ?? -1];
    this.card.hidden = false;
    const block = frame.hand.holds ?? frame.next;
    setText(this.number, step === null ? "!" : String(step + 1));
    setText(this.title, lesson ? lesson.title : words.moment);
    setText(this.text, lesson ? lesson.text : hint);
    const code = lesson?.gesture ? this.keys[lesson.gesture][0] : undefined;
    this.key.hidden = !code;
    if (code) setText(this.key, (lesson?.gesture === "wrist_extension" ? words.hold : words.tap)(keyName(code)));
    const stuck = frame.planner.state === "failed" || (frame.planner.state === "arrived" && frame.planner.intermediate);
    setText(this.hint, stuck && lesson ? hint : block !== null && step === 0 ? words.next(objectName(block)) : "");
    this.dots.forEach((dot, k) => {
      setClass(dot, "now", k === step);
      setClass(dot, "past", step !== null && k < step);
    });
    const at = block !== null && step !== null && [0, 1, 4, 5].includes(step) ? project(step < 4 ? "object" : "target", block) : null;
    this.pointer.hidden = at === null;
    if (at) this.pointer.style.transform = `translate(${Math.round(at.x)}px, ${Math.round(at.y)}px)`;
  }
}
