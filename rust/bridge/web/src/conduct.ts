// Conducting a study: whose turn it is, the session step by step, its buttons and its notes. Everything on display comes with
// each message. What was asked for is shown once the server shows it: a terminal or another page may conduct too.

import "./conduct.css";
import { ConductBar } from "./conductBar";
import { BeginView } from "./conductBegin";
import { NotesView } from "./conductNotes";
import { CurrentStepView } from "./conductCurrentStep";
import { StepList } from "./conductSteps";
import { subjectText, leftText, participantText } from "./conductText";
import { element, setClass, setText, setWidth } from "./dom";
import { FillInDialog } from "./fillInDialog";
import type { ClientMessage, ExperimenterScreen, FormScreen, StudyButton, StudyRequest } from "./generated/types";
import { capitalize } from "./protocol";
import { ReasonDialog, type ConfirmedRequest } from "./reasons";
import { strings } from "./strings";

const texts = strings.study;

/** Countdowns and ages are written again so often, ms. */
const TICK_MS = 250;
/** Where the browser keeps whether single keys act. */
const SHORTCUTS_STORAGE_KEY = "proact.conduct.keys";

export class Conduct {
  readonly root: HTMLElement;
  readonly dialogs: HTMLElement[];
  readonly notes = new NotesView((text) => this.ask({ ask: "note", text }));
  readonly bar = new ConductBar((what) => this.press(what));
  private readonly title = element("h2");
  private readonly trials = element("span", "small");
  private readonly progress = element("div");
  private readonly participant = element("strong");
  private readonly remaining = element("span", "small");
  private readonly notice = element("p", "notice");
  private readonly step = element("p", "only-heard");
  private readonly connectionNotice = element("div", "lost");
  private readonly currentStep = new CurrentStepView({
    fillIn: () => this.fillIn(),
    action: (action) => this.send({ type: "study", action }),
  });
  private readonly steps = new StepList(this.currentStep.root);
  private readonly begin = new BeginView((id, isNew) => this.ask({ ask: "begin", id, ...(isNew ? { new: true } : {}) }));
  private readonly reasons = new ReasonDialog((what, reason) => this.onReasonGiven(what, reason));
  private readonly form = new FillInDialog({
    answer: (step, key, answer) => this.send({ type: "answer", step, key, answer }),
    submit: (step) => this.send({ type: "submit", step }),
  });
  private screen: ExperimenterScreen | null = null;
  private paused = false;
  private shortcutsEnabled = true;
  /** What a dialog that is open is about. */
  private dialogSubject = "";

  constructor(private readonly send: (message: ClientMessage) => void) {
    this.notice.setAttribute("role", "status");
    this.step.setAttribute("aria-live", "polite");
    this.connectionNotice.setAttribute("role", "alert");
    this.bar.secondaryButtons.append(this.shortcutSetting());
    this.root = element(
      "section",
      "pane conduct",
      element(
        "div", "conducthead",
        element("div", "", this.title, this.trials), element("div", "bar", this.progress), element("div", "", this.participant, this.remaining),
      ),
      this.connectionNotice,
      this.notice,
      this.step,
      this.begin.root,
      this.steps.root,
      this.bar.root,
    );
    this.root.setAttribute("aria-label", texts.title);
    this.dialogs = [this.reasons.root, this.form.root];
    window.addEventListener("keydown", (event) => this.key(event));
    window.setInterval(() => this.currentStep.tick(), TICK_MS);
  }

  /** The arm moves, or may: there is a scene to watch. */
  get showsScene(): boolean {
    const now = this.screen?.session?.now;
    return now?.running === true && ["trial", "practise", "demonstrate", "calibrate_gaze"].includes(now.what.is);
  }

  show(screen: ExperimenterScreen): void {
    this.screen = screen;
    const { session, trials, next } = screen;
    setText(this.title, screen.title || screen.study);
    setText(this.trials, `${trials[0]} of ${trials[1]} trials`);
    setWidth(this.progress, trials[0] / Math.max(trials[1], 1));
    setText(this.participant, session ? participantText(session) : "");
    setText(this.remaining, session ? leftText(session.minutes_left) : "");
    this.showNotice(screen.notice);
    this.begin.root.hidden = session !== null;
    this.steps.root.hidden = session === null;
    this.notes.root.hidden = session === null;
    this.currentStep.show(session?.now ?? null);
    if (session) {
      this.steps.show(session);
      this.begin.clear();
    } else {
      this.begin.show(screen);
    }
    this.bar.show(next ? screen : { ...screen, can: screen.can.filter((what) => what !== "begin") });
    this.notes.show(screen.notes);
    const now = session?.now;
    setText(this.step, now ? `Now: ${now.label}` : "");
    // A reason that was asked for one step is none for the next.
    const about = `${session?.id} ${session?.session} ${now?.step} ${now?.running}`;
    if (about !== this.dialogSubject) this.reasons.close();
    this.dialogSubject = about;
    this.form.update(session?.id ?? "", this.currentForm());
  }

  /** What the rest of the page knows of the trial. */
  showTrial(state: string, overview: string, paused: boolean): void {
    this.paused = paused;
    this.bar.showPaused(paused);
    this.currentStep.showTrial([state, overview].filter(Boolean).join(" · "), paused);
  }

  showConnected(connected: boolean): void {
    setText(this.connectionNotice, connected ? "" : texts.lost);
    setClass(this.root, "offline", !connected);
    this.bar.showConnected(connected);
    this.begin.showConnected(connected);
    this.notes.showConnected(connected);
    if (connected) this.form.reconnected();
    else this.reasons.close();
  }

  /** Says what came of a request, or that a message was ignored. */
  showNotice(text: string): void {
    setText(this.notice, capitalize(text));
  }

  private ask(request: StudyRequest): void {
    this.send({ type: "conduct", ...request });
  }

  private press(what: StudyButton): void {
    const { next, session } = this.screen ?? {};
    switch (what) {
      case "begin":
        // By name, where there is one: whoever is shown is who begins.
        this.ask(next?.id ? { ask: "begin", id: next.id } : { ask: "begin" });
        break;
      case "next":
        this.ask({ ask: "next" });
        break;
      case "pause":
        this.send({ type: "study", action: this.paused ? "resume" : "pause" });
        break;
      default:
        if (session) this.reasons.ask(what, subjectText(what, session));
    }
  }

  private onReasonGiven(what: ConfirmedRequest, reason: string): void {
    if (what !== "abort" && what !== "leave") {
      this.ask({ ask: what, reason });
      return;
    }
    // The server asks no reason for these: one that was given is kept as a note.
    if (reason) this.ask({ ask: "note", text: texts.reason(what === "abort", reason) });
    if (what === "abort") this.send({ type: "study", action: "abort" });
    else this.ask({ ask: "leave" });
  }

  private currentForm(): FormScreen | null {
    const what = this.screen?.session?.now?.what;
    return what?.is === "form" ? what : null;
  }

  private fillIn(): void {
    const form = this.currentForm();
    if (form) this.form.show(this.screen?.session?.id ?? "", form);
  }

  private key(event: KeyboardEvent): void {
    const typing = event.target instanceof Element && event.target.closest("input, textarea, select, [contenteditable]");
    if (typing || event.repeat || event.ctrlKey || event.altKey || event.metaKey) return;
    if (!this.screen || !this.shortcutsEnabled || this.reasons.open || this.form.open) return;
    const key = event.key.toLowerCase();
    if (key === "n") this.bar.press("next");
    else if (key === "p") this.bar.press("pause");
    else if (key === "t" && !this.notes.root.hidden) {
      event.preventDefault();
      this.notes.focus();
    }
  }

  /** Single keys can be turned off: speech input and a slipped hand press them too. */
  private shortcutSetting(): HTMLElement {
    const box = element("input");
    box.type = "checkbox";
    box.addEventListener("change", () => {
      this.shortcutsEnabled = box.checked;
      storeShortcuts(SHORTCUTS_STORAGE_KEY, box.checked);
    });
    this.shortcutsEnabled = box.checked = loadShortcuts(SHORTCUTS_STORAGE_KEY);
    return element("label", "check", box, texts.keys);
  }
}

function loadShortcuts(place: string): boolean {
  try {
    return localStorage.getItem(place) !== "off";
  } catch {
    // Storage may be forbidden.
    return true;
  }
}

function storeShortcuts(place: string, on: boolean): void {
  try {
    localStorage.setItem(place, on ? "on" : "off");
  } catch {
    // Then the choice lasts as long as the page.
  }
}
