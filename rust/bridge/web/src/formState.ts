// The answers to a questionnaire as a person has given them, and what of them the server has kept. Pure: the page and the
// headset's board share one.

import { questionsOf, sameAnswer, type Question } from "./forms";
import type { FormAnswer, FormScreen } from "./generated/types";

export interface FormHandlers {
  /** Sends an answer; none takes it back. */
  answer(step: number, key: string, answer: FormAnswer | null): void;
  /** The questionnaire is filled in. */
  submit(step: number): void;
}

/** What became of an answer. */
export type AnswerState = "none" | "sending" | "saved" | "refused";

export class FormState {
  questions: Question[] = [];
  private screen: FormScreen | null = null;
  /** What was answered here and has not come back yet. */
  private readonly pendingAnswers = new Map<string, FormAnswer | null>();
  /** What of it was not even sent: somebody is typing. */
  private readonly unsent = new Set<string>();
  private readonly rejections = new Map<string, string>();

  constructor(private readonly handlers: FormHandlers) {}

  /** Takes what the server shows. */
  setScreen(screen: FormScreen): void {
    if (screen.step !== this.screen?.step || screen.form.name !== this.screen.form.name) this.clear();
    this.screen = screen;
    this.questions = questionsOf(screen);
    for (const [key, answer] of this.pendingAnswers) {
      if (sameAnswer(answer, screen.answers[key])) this.removePending(key);
    }
    const { refused } = screen;
    // What was typed stays: the person mends it.
    if (refused && this.pendingAnswers.has(refused.key)) this.rejections.set(refused.key, refused.reason);
  }

  clear(): void {
    this.screen = null;
    this.questions = [];
    this.pendingAnswers.clear();
    this.unsent.clear();
    this.rejections.clear();
  }

  /** Notes an answer and sends it; with `later` not before `flush`. */
  setAnswer(key: string, answer: FormAnswer | null, later = false): void {
    if (!this.screen) return;
    // The same again is refused for the same reason, which the server does not say twice.
    if (!sameAnswer(this.pendingAnswers.get(key), answer)) this.rejections.delete(key);
    this.pendingAnswers.set(key, answer);
    this.unsent.add(key);
    if (!later) this.flush();
  }

  /** Sends what is noted. */
  flush(): void {
    for (const key of this.unsent) this.send(key);
    this.unsent.clear();
  }

  /** Sends again what has not come back: the line was lost. */
  resend(): void {
    this.unsent.clear();
    for (const key of this.pendingAnswers.keys()) if (!this.rejections.has(key)) this.send(key);
  }

  /** Sends that all is answered. Returns what is missing; then nothing is sent. */
  submit(): Question[] {
    this.flush();
    const missing = this.missing();
    if (this.screen && missing.length === 0) this.handlers.submit(this.screen.step);
    return missing;
  }

  /** The answer as it stands here. */
  answer(key: string): FormAnswer | null {
    const given = this.pendingAnswers.get(key);
    return given !== undefined ? given : (this.screen?.answers[key] ?? null);
  }

  state(key: string): AnswerState {
    if (this.rejections.has(key)) return "refused";
    const kept = this.screen?.answers[key];
    // Who changes an answer and changes it back at once gets no message: for the server nothing is new.
    if (this.pendingAnswers.has(key) && !sameAnswer(this.pendingAnswers.get(key), kept)) return "sending";
    if (kept !== undefined) return "saved";
    return this.screen?.refused?.key === key ? "refused" : "none";
  }

  /** Why the answer was refused; empty if it was not. */
  reason(key: string): string {
    if (this.state(key) !== "refused") return "";
    return this.rejections.get(key) ?? this.screen?.refused?.reason ?? "";
  }

  /** What has no answer, or one that was refused, and should have one. */
  missing(): Question[] {
    return this.questions.filter(({ key, optional }) => this.state(key) === "refused" || (!optional && this.answer(key) === null));
  }

  /** Of the questions that should be answered, how many the server has an answer to. */
  progress(): { kept: number; of: number } {
    const wanted = this.questions.filter(({ optional }) => !optional);
    return { kept: wanted.filter(({ key }) => this.screen?.answers[key] !== undefined).length, of: wanted.length };
  }

  private send(key: string): void {
    if (this.screen) this.handlers.answer(this.screen.step, key, this.pendingAnswers.get(key) ?? null);
  }

  private removePending(key: string): void {
    this.pendingAnswers.delete(key);
    this.unsent.delete(key);
    this.rejections.delete(key);
  }
}
