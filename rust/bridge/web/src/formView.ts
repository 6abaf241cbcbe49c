// A questionnaire on a page. Every answer goes out at once and counts when it comes back.

import { button, element, setClass, setText, setWidth } from "./dom";
import { FormState, type FormHandlers } from "./formState";
import { controlOf, localizedElement, type Control } from "./formItems";
import { chooseLanguage, conditionName, languagesOf, itemName, numbersText, sameAnswer, textInLanguage, type Question } from "./forms";
import type { FormAnswer, FormScreen } from "./generated/types";
import { loadLanguage, storeLanguage } from "./settings";
import { strings } from "./strings";

const texts = strings.forms;

/** Who types is done after so long without a key, ms. */
const TYPING_PAUSE_MS = 400;
/** A second click on "Done" must not end the next questionnaire, ms. */
const DOUBLE_CLICK_MS = 700;

/** What belongs to a question on the page. */
interface Row {
  question: Question;
  root: HTMLElement;
  control: Control;
  mark: HTMLElement;
  clear: HTMLElement;
  refusal: HTMLElement;
}

let views = 0;

export class FormView {
  readonly root = element("section", "questionnaire");
  readonly draft: FormState;
  /** In which its texts are shown. */
  language = "en";
  private readonly title = element("h2");
  private readonly about = element("p", "about");
  private readonly languages = element("select");
  private readonly languageChoice = element("label", "language", element("span", "label", texts.language), this.languages);
  private readonly body = element("div", "questions");
  private readonly progressFill = element("i", "fill");
  private readonly progressBar = element("div", "rail", this.progressFill);
  private readonly progress = element("span", "tally");
  private readonly message = element("p", "notice");
  private readonly liveRegion = element("p", "only-heard");
  private readonly done: HTMLButtonElement;
  private readonly id: string;
  private rows: Row[] = [];
  private built = "";
  /** Since when it is shown untouched. */
  private freshSince: number | null = null;
  private screen: FormScreen | null = null;
  /** "Done" was pressed although something was missing. */
  private submitAttempted = false;
  private timer = 0;

  constructor(handlers: FormHandlers) {
    this.draft = new FormState(handlers);
    views += 1;
    this.id = `questionnaire-${views}`;
    this.title.id = `${this.id}-title`;
    this.title.tabIndex = -1;
    this.done = button(texts.done, () => this.submit(), "primary done");
    this.message.setAttribute("role", "alert");
    this.liveRegion.setAttribute("role", "status");
    this.root.setAttribute("aria-labelledby", this.title.id);
    this.root.append(
      element("header", "head", element("div", "", this.about, this.title), this.languageChoice),
      this.body,
      element("footer", "foot", this.message, element("div", "progress", this.progressBar, this.progress), this.done),
      this.liveRegion,
    );
    this.root.hidden = true;
    this.languages.addEventListener("change", () => {
      this.language = this.languages.value;
      storeLanguage(this.language);
      this.build();
    });
    window.addEventListener("pagehide", () => this.draft.flush());
  }

  /** Shows a questionnaire, or what has changed in it. */
  show(screen: FormScreen): void {
    this.screen = screen;
    this.draft.setScreen(screen);
    this.root.hidden = false;
    const { step, form, pairs, conditions, about } = screen;
    const asked = JSON.stringify([step, form, pairs, conditions, about]);
    if (asked !== this.built) {
      this.built = asked;
      this.freshSince = performance.now();
      this.chooseLanguage(screen);
      this.build();
    }
    this.update();
  }

  clear(): void {
    if (this.screen === null) return;
    this.screen = null;
    this.built = "";
    this.rows = [];
    this.draft.clear();
    this.body.replaceChildren();
    this.root.hidden = true;
  }

  /** Puts the focus where reading begins. */
  focus(): void {
    this.title.focus({ preventScroll: true });
  }

  private chooseLanguage({ form }: FormScreen): void {
    const known = languagesOf(form);
    this.language = chooseLanguage(known, [loadLanguage(), ...navigator.languages].filter(Boolean));
    this.languages.replaceChildren(
      ...known.map((language) => {
        const option = element("option", "", languageName(language));
        option.value = option.lang = language;
        return option;
      }),
    );
    this.languages.value = this.language;
    this.languageChoice.hidden = known.length < 2;
  }

  private build(): void {
    const { screen } = this;
    if (!screen) return;
    this.submitAttempted = false;
    const title = textInLanguage(screen.form.title, this.language);
    setText(this.title, title.text);
    this.title.lang = title.language;
    setText(this.about, screen.about === null ? "" : conditionName(screen.about));
    this.about.hidden = screen.about === null;
    this.rows = this.draft.questions.map((question) => this.row(question, screen));
    const [items, pairs] = (["item", "pair"] as const).map((kind) => this.rows.filter(({ question }) => question.kind === kind));
    this.body.replaceChildren(
      ...(items ?? []).map(({ root }) => root),
      ...(pairs?.length
        ? [
            element("h3", "", texts.pairs),
            element("p", "", texts.pairsAbout),
            element("div", "pairs", ...pairs.map(({ root }) => root)),
          ]
        : []),
    );
    this.update();
  }

  private row(question: Question, screen: FormScreen): Row {
    const { key, number, optional } = question;
    const id = `${this.id}-${key}`;
    const text = element("p", "question", this.draft.questions.length > 1 ? element("span", "number", `${number}. `) : null);
    text.id = id;
    if (question.kind === "pair") {
      const names = [question.first, question.second].map((item) => textInLanguage(itemName(item), this.language).text);
      text.append(element("span", "only-heard", texts.more(names)));
    } else if (question.item.kind === "consent") {
      // What is agreed to stands beside the box.
      text.append(texts.consent);
    } else {
      text.append(localizedElement("span", "", question.item.text, this.language));
      if (optional) text.append(" ", element("span", "optional", "(optional)"));
    }
    const mark = element("span", "mark-saved");
    mark.id = `${id}-state`;
    const refusal = element("p", "refusal");
    refusal.id = `${id}-refusal`;
    refusal.setAttribute("role", "alert");
    refusal.hidden = true;
    const control = controlOf(question, {
      language: this.language,
      conditions: screen.conditions,
      label: id,
      description: `${mark.id} ${refusal.id}`,
      changed: (answer, later) => this.setAnswer(key, answer, later),
      settled: () => this.flush(),
    });
    const clear = button(texts.clear, () => this.clearAnswer(key, control), "clear");
    clear.tabIndex = -1;
    clear.title = texts.clearAbout;
    clear.hidden = true;
    const root = element("div", "item", text, element("div", "status", mark, clear), control.root, refusal);
    root.dataset["kind"] = question.kind === "pair" ? "pair" : question.item.kind;
    root.dataset["key"] = key;
    if (hasClearButton(question)) {
      control.root.setAttribute("aria-keyshortcuts", "Delete");
      root.addEventListener("keydown", (event) => {
        if ((event.code !== "Delete" && event.code !== "Backspace") || this.draft.answer(key) === null) return;
        event.preventDefault();
        this.clearAnswer(key, control);
      });
    }
    return { question, root, control, mark, clear, refusal };
  }

  private setAnswer(key: string, answer: FormAnswer | null, later = false): void {
    this.freshSince = null;
    this.draft.setAnswer(key, answer, later);
    setText(this.liveRegion, "");
    window.clearTimeout(this.timer);
    if (later) this.timer = window.setTimeout(() => this.flush(), TYPING_PAUSE_MS);
    this.update();
  }

  /** Takes the answer back. */
  private clearAnswer(key: string, control: Control): void {
    control.set(null);
    this.setAnswer(key, null);
  }

  private flush(): void {
    window.clearTimeout(this.timer);
    this.draft.flush();
  }

  private submit(): void {
    if (this.freshSince !== null && performance.now() - this.freshSince < DOUBLE_CLICK_MS) return;
    this.flush();
    const [first] = this.draft.submit();
    this.submitAttempted = first !== undefined;
    this.update();
    this.rows.find(({ question }) => question.key === first?.key)?.control.focus();
  }

  private update(): void {
    const missing = this.draft.missing();
    const { kept, of } = this.draft.progress();
    const progress = of > 0 ? texts.progress(kept, of) : "";
    for (const { question, root, control, mark, clear, refusal } of this.rows) {
      const { key } = question;
      const answer = this.draft.answer(key);
      if (!sameAnswer(control.value, answer)) control.set(answer);
      const state = this.draft.state(key);
      const open = this.submitAttempted && missing.some((other) => other.key === key);
      const marks = { none: open ? texts.notAnswered : "", sending: texts.saving, saved: texts.saved, refused: "" };
      setText(mark, marks[state]);
      // An answer that was kept before the page came is no news.
      if (state === "saved" && root.dataset["state"] === "sending") setText(this.liveRegion, texts.announceSaved(progress));
      root.dataset["state"] = state;
      setClass(root, "missing", open);
      clear.hidden = answer === null || !hasClearButton(question);
      const reason = this.draft.reason(key);
      const news = refusal.hidden && reason !== "";
      setText(refusal, reason && texts.refused(reason));
      refusal.hidden = reason === "";
      if (news && root.contains(document.activeElement)) refusal.scrollIntoView({ block: "nearest" });
    }
    setText(this.progress, progress);
    this.progressBar.hidden = of === 0;
    setWidth(this.progressFill, of > 0 ? kept / of : 0);
    this.submitAttempted &&= missing.length > 0;
    setText(this.message, this.submitAttempted ? texts.missing(missing.length, numbersText(missing)) : "");
    this.message.hidden = !this.submitAttempted;
  }
}

/** There is a button that takes the answer back. A box that is ticked and a text have no need of it. */
function hasClearButton(question: Question): boolean {
  return question.kind === "pair" || !["consent", "text"].includes(question.item.kind);
}

function languageName(language: string): string {
  return new Intl.DisplayNames([language], { type: "language" }).of(language) ?? language;
}
