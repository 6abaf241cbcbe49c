// What a participant of a study sees over the scene: one thing to do at a time. It holds nothing of the study, so that a reload
// loses nothing.

import { button, element, setClass, setText, setWidth } from "./dom";
import type { FormHandlers } from "./draft";
import { FormView } from "./formview";
import type { ParticipantScreen, PromptScreen } from "./generated/types";
import { gestureText, handPicture } from "./hand";
import { clockText, Countdown, placeOf, promptTexts, sentenceOf } from "./participantscreens";
import { strings } from "./strings";

const texts = strings.forms;

/** A program that conducts a study says so within this time of a connection, ms. */
const SAYS_SO_MS = 3000;

export interface ParticipantHandlers extends FormHandlers {
  settings(): void;
  /** A study began or ended on this page, or shows something else. */
  changed(): void;
}

export class ParticipantView {
  readonly root = element("section", "participant");
  /** Buttons of the page itself, while it is over the scene. */
  readonly corner = element("div", "corner");
  readonly form: FormView;
  /** The keys of the gestures, where they are trained. */
  readonly keys = element("div", "keys");
  /** What is shown; none outside a study. */
  screen: ParticipantScreen | null = null;
  private readonly title = element("h2");
  private readonly text = element("p");
  private readonly clock = element("p", "restclock");
  private readonly words = element("div", "sentence", this.title, this.text, this.clock);
  private readonly picture = element("div", "picture");
  private readonly gesture = element("h2");
  private readonly todo = element("p", "todo");
  private readonly fill = element("i", "fill");
  private readonly bar = element("div", "bar", this.fill);
  private readonly recognised = element("span");
  private readonly row = element("span", "inarow");
  private readonly prompt = element(
    "div",
    "prompt",
    this.picture,
    this.gesture,
    this.todo,
    this.bar,
    element("p", "trainline", this.recognised, this.row),
    this.keys,
  );
  private readonly rest = new Countdown();
  private drawn = "";
  private place = "";
  /** The connection is new: what was on its way when the old one broke is sent again. */
  private returned = false;
  private timer = 0;

  constructor(private readonly handlers: ParticipantHandlers) {
    this.form = new FormView(handlers);
    this.clock.setAttribute("role", "timer");
    this.title.tabIndex = this.gesture.tabIndex = -1;
    this.corner.append(button(texts.settings, () => handlers.settings(), "cog"));
    this.root.setAttribute("aria-label", texts.study);
    this.root.append(
      element("header", "studyhead", element("div", "logo", element("strong", "", "ProACT")), this.corner),
      element("div", "studybody", this.words, this.prompt, this.form.root),
    );
    this.root.hidden = true;
  }

  /** This page is in a study: its person sees what a participant may see. */
  get active(): boolean {
    return this.screen !== null;
  }

  /** It is over the scene. */
  get covers(): boolean {
    return this.screen !== null && this.screen.show !== "scene";
  }

  /** Gestures are trained, and what is recognised is shown. */
  get trains(): boolean {
    return this.screen?.show === "train" && this.screen.recognised !== null;
  }

  /** Gestures are trained by this page's own keys. */
  get trainsKeys(): boolean {
    return this.screen?.show === "train" && this.screen.keys;
  }

  /** What stands above the scene. */
  get sceneTitle(): string {
    return this.screen?.show === "scene" ? this.screen.title : "";
  }

  /** The time that is left may be seen. */
  get timed(): boolean {
    return this.screen === null || (this.screen.show === "scene" && this.screen.countdown);
  }

  /** Seconds until the end of a break. */
  get restLeft(): number {
    return this.rest.left(performance.now());
  }

  show(screen: ParticipantScreen): void {
    window.clearTimeout(this.timer);
    this.screen = screen;
    if (screen.show === "form") this.form.show(screen);
    else this.form.clear();
    if (this.returned) this.form.draft.resend();
    this.returned = false;
    if (screen.show === "rest") this.rest.set(screen.left_secs, performance.now());
    else this.rest.clear();
    this.prompt.hidden = screen.show !== "train";
    if (screen.show === "train") this.showPrompt(screen);
    this.update();
    this.root.hidden = !this.covers;
    this.handlers.changed();
    if (placeOf(screen) !== this.place) this.arrive(screen);
  }

  /** The connection came or went. */
  connected(on: boolean): void {
    window.clearTimeout(this.timer);
    this.returned = on;
    if (on && this.active) this.timer = window.setTimeout(() => this.leave(), SAYS_SO_MS);
  }

  /** Called once per picture. */
  update(): void {
    const sentence = this.screen && sentenceOf(this.screen, this.restLeft);
    this.words.hidden = !sentence;
    setText(this.title, sentence?.title ?? "");
    setText(this.text, sentence?.text ?? "");
    this.clock.hidden = this.screen?.show !== "rest" || this.restLeft === 0;
    setText(this.clock, clockText(this.restLeft));
  }

  /** Another program is there, which conducts no study. */
  private leave(): void {
    this.screen = null;
    this.place = "";
    this.form.clear();
    this.root.hidden = true;
    this.handlers.changed();
  }

  private showPrompt(screen: PromptScreen): void {
    if (this.drawn !== screen.gesture) {
      this.drawn = screen.gesture;
      this.picture.replaceChildren(handPicture(screen.gesture));
    }
    const { recognised, row } = promptTexts(screen);
    setText(this.gesture, gestureText(screen.gesture));
    setText(this.todo, screen.text);
    setText(this.recognised, recognised);
    setText(this.row, row);
    setClass(this.row, "passed", screen.passed);
    setClass(this.bar, "recording", screen.recording);
    setWidth(this.fill, screen.share);
  }

  /** Reading begins at the top, and a screen reader says where one is. */
  private arrive(screen: ParticipantScreen): void {
    this.place = placeOf(screen);
    this.root.scrollTop = 0;
    if (screen.show === "form") this.form.focus();
    else if (screen.show === "train") this.gesture.focus({ preventScroll: true });
    else if (this.covers) this.title.focus({ preventScroll: true });
    else if (document.activeElement instanceof HTMLElement && this.root.contains(document.activeElement)) document.activeElement.blur();
  }
}
