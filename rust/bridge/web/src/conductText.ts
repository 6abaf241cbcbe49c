// What the experimenter's page says of a study: labels of buttons, states of steps, times. No elements in here.

import { questionsOf } from "./forms";
import type { Deviation, FormScreen, NextSession, CurrentStepScreen, StepActivity, ParticipantRow, SessionScreen, StepRow } from "./generated/types";
import { capitalize } from "./protocol";
import { strings } from "./strings";

const texts = strings.study;

/** The button `next` while a step has not begun. */
const BEGIN_LABELS: Record<StepActivity["is"], string> = texts.begins;
/** The button `next` while a step goes on. */
const END_LABELS: Record<StepActivity["is"], string> = texts.ends;
const DEVIATIONS: Record<Deviation, string> = texts.deviations;

/** Where a step stands, as the list shows it. */
export type StepState = "done" | "aborted" | "interrupted" | "skipped" | "now" | "to_do";
export const STATES: Record<StepState, { mark: string; word: string }> = {
  done: { mark: "✓", word: texts.states.done },
  aborted: { mark: "■", word: texts.states.aborted },
  interrupted: { mark: "!", word: texts.states.interrupted },
  skipped: { mark: "–", word: texts.states.skipped },
  now: { mark: "▶", word: texts.states.now },
  to_do: { mark: "○", word: texts.states.toDo },
};

export function nextLabel(now: CurrentStepScreen | null): string {
  if (!now) return texts.finishSession;
  return (now.running ? END_LABELS : BEGIN_LABELS)[now.what.is];
}

export function beginLabel(next: NextSession | null): string {
  return next?.begun ? texts.continueSession : texts.beginSession;
}

export function stepState({ step, outcome }: StepRow, now: CurrentStepScreen | null): StepState {
  return step === now?.step ? "now" : (outcome ?? "to_do");
}

/** The deviations of a step as a sentence; empty without any. */
export function deviationText(deviations: Deviation[]): string {
  return capitalize(deviations.map((deviation) => DEVIATIONS[deviation]).join("; "));
}

/** Hours and minutes. */
function spanText(minutes: number): string {
  const hours = Math.floor(minutes / 60);
  return hours > 0 ? `${hours} h ${minutes % 60} min` : `${minutes} min`;
}

/** The rest of a session by the plan, rounded up. */
export function leftText(minutes: number): string {
  return texts.atMost(spanText(Math.ceil(Math.max(minutes, 0))));
}

export function ageText(secs: number): string {
  const whole = Math.max(Math.floor(secs), 0);
  return whole < 60 ? `${whole} s` : spanText(Math.floor(whole / 60));
}

/** Minutes and seconds, such as `4:05`. */
export function clockText(secs: number): string {
  const whole = Math.max(Math.floor(secs), 0);
  return `${Math.floor(whole / 60)}:${String(whole % 60).padStart(2, "0")}`;
}

/** Whose turn it is, as a title. */
export function participantText(who: { participant: number; id: string | null; session: string }): string {
  const place = texts.participant(who.participant);
  return texts.session(who.id === null ? place : `${who.id} · ${place}`, who.session);
}

/** A pseudonym for the first free place, as the server would give it; empty if all are taken. */
export function suggestedId(participants: ParticipantRow[]): string {
  const free = participants.find(({ id }) => id === null);
  return free ? `P${String(free.participant).padStart(2, "0")}` : "";
}

/** Of the questions that should be answered, how many are, and how many there are. */
export function answerCounts(screen: FormScreen): [number, number] {
  const wanted = questionsOf(screen).filter(({ optional }) => !optional).length;
  return [wanted - screen.missing.length, wanted];
}

/** What a dialog about a step is about: the last trial where it is done again, else what is on now. */
export function subjectText(asked: string, { steps, now }: Pick<SessionScreen, "steps" | "now">): string {
  if (asked === "leave") return texts.continues;
  if (asked === "redo") {
    const trials = steps.filter(({ label, outcome }) => label.startsWith("trial") && outcome !== null);
    return capitalize(trials[trials.length - 1]?.label ?? "");
  }
  if (asked === "start_anyway" && now?.what.is === "trial") {
    const unready = now.what.checks.filter(({ ready }) => !ready);
    return texts.notReady(unready.map(({ name, found }) => `${readableName(name)} (${found})`).join(", "));
  }
  return asked === "skip" || asked === "abort" ? capitalize(now?.label ?? "") : "";
}

/** A name of the program, such as `eye_tracker`, as words. */
export function readableName(name: string): string {
  return name.replaceAll("_", " ");
}

/** How often each note is there: one that was sent has come through once it is there once more. */
export function noteCounts(notes: string[], text: string): number {
  // The server may put a time before the words.
  return notes.filter((note) => note.endsWith(text)).length;
}

/** A break by the page's own clock, milliseconds. The server says zero once it is over. For how long it is over follows from
 * what the server said before. */
export class BreakClock {
  private step = 0;
  private endsAt: number | null = null;

  take(step: number, leftSecs: number, now: number): void {
    if (step !== this.step) this.endsAt = null;
    this.step = step;
    if (leftSecs > 0) this.endsAt = now + 1000 * leftSecs;
    else if (this.endsAt !== null) this.endsAt = Math.min(this.endsAt, now);
  }

  /** Seconds to the end, negative after it; none if it is over and nobody knows since when. */
  leftSecs(now: number): number | null {
    return this.endsAt === null ? null : (this.endsAt - now) / 1000;
  }
}

/** What a break's clock shows. */
export function breakText(leftSecs: number | null): { text: string; over: boolean } {
  if (leftSecs === null) return { text: texts.over, over: true };
  if (leftSecs > 0) return { text: `${clockText(Math.ceil(leftSecs))} left`, over: false };
  return { text: texts.overTime(clockText(-leftSecs)), over: true };
}
