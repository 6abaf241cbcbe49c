// What a participant of a study sees over the scene: one thing to do at a time. It holds nothing of the study, so that a reload
// loses nothing.

import { button, element, setClass, setText, setWidth } from "./dom";
import type { FormHandlers } from "./formState";
import { FormView } from "./formView";
import type { ParticipantScreen, PromptScreen } from "./generated/types";
import { gestureInstruction, handPicture } from "./hand";
import { clockText, Countdown, screenKey, promptTexts, sentenceOf } from "./participantScreens";
import { strings } from "./strings";

const texts = strings.forms;

/** A program that conducts a study says so within this time of a connection, ms. */
const STUDY_DETECTION_MS = 3000;

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
  private readonly instruction = element("p", "todo");
  private readonly fill = element("i", "fill");
  private readonly bar = element("div", "bar", this.fill);
  private readonly recognized = element("span");
  private readonly row = element("span", "inarow");
  private readonly prompt = element(
    "div",
    "prompt",
    this.picture,
    this.gesture,
    this.instruction,
    this.bar,
    element("p", "trainline", this.recognized, this.row),
    this.keys,
  );
  private readonly rest = new Countdown();
  private drawn = "";
  private place = "";
  /** The connection is new: what was on its way when the old one broke is sent again. */
  private reconnected = false;
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
  get coversScene(): boolean {
    return this.screen !== null && this.screen.show !== "scene";
  }

  /** Gestures are trained, and what is recognised is shown. */
  get isTraining(): boolean {
    return this.screen?.show === "train" && this.screen.recognised !== null;
  }

  /** Gestures are trained by this page's own keys. */
  get isTrainingKeys(): boolean {
    return this.screen?.show === "train" && this.screen.keys;
  }

  /** What stands above the scene. */
  get sceneTitle(): string {
    return this.screen?.show === "scene" ? this.screen.title : "";
  }

  /** The time that is left may be seen. */
  get showsTime(): boolean {
    return this.screen === null || (this.screen.show === "scene" && this.screen.countdown);
  }

  /** Seconds until the end of a break. */
  get breakRemainingSecs(): number {
    return this.rest.left(performance.now());
  }

  show(screen: ParticipantScreen): void {
    window.clearTimeout(this.timer);
    this.screen = screen;
    if (screen.show === "form") this.form.show(screen);
    else this.form.clear();
    if (this.reconnected) this.form.draft.resend();
    this.reconnected = false;
    if (screen.show === "rest") this.rest.set(screen.left_secs, performance.now());
    else this.rest.clear();
    this.prompt.hidden = screen.show !== "train";
    if (screen.show === "train") this.showPrompt(screen);
    this.update();
    this.root.hidden = !this.coversScene;
    this.handlers.changed();
    if (screenKey(screen) !== this.place) this.focusStart(screen);
  }

  /** The connection came or went. */
  connected(on: boolean): void {
    window.clearTimeout(this.timer);
    this.reconnected = on;
    if (on && this.active) this.timer = window.setTimeout(() => this.endStudy(), STUDY_DETECTION_MS);
  }

  /** Called once per picture. */
  update(): void {
    const sentence = this.screen && sentenceOf(this.screen, this.breakRemainingSecs);
    this.words.hidden = !sentence;
    setText(this.title, sentence?.title ?? "");
    setText(this.text, sentence?.text ?? "");
    this.clock.hidden = this.screen?.show !== "rest" || this.breakRemainingSecs === 0;
    setText(this.clock, clockText(this.breakRemainingSecs));
  }

  /** Another program is there, which conducts no study. */
  private endStudy(): void {
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
    setText(this.gesture, gestureInstruction(screen.gesture));
    setText(this.instruction, screen.text);
    setText(this.recognized, recognised);
    setText(this.row, row);
    setClass(this.row, "passed", screen.passed);
    setClass(this.bar, "recording", screen.recording);
    setWidth(this.fill, screen.share);
  }

  /** Reading begins at the top, and a screen reader says where one is. */
  private focusStart(screen: ParticipantScreen): void {
    this.place = screenKey(screen);
    this.root.scrollTop = 0;
    if (screen.show === "form") this.form.focus();
    else if (screen.show === "train") this.gesture.focus({ preventScroll: true });
    else if (this.coversScene) this.title.focus({ preventScroll: true });
    else if (document.activeElement instanceof HTMLElement && this.root.contains(document.activeElement)) document.activeElement.blur();
  }
}
