// What the screens of a study say to whoever takes part, on the page and in a headset. Pure.

import type { ParticipantScreen, PromptScreen } from "./generated/types";
import { gestureInstruction } from "./hand";
import { strings } from "./strings";

const texts = strings.forms;

/** The end of a break is put off only by messages that differ from the clock here by more than this, ms: they take time too. */
const CLOCK_TOLERANCE_MS = 1000;

export interface Sentence {
  title: string;
  text: string;
}

/** What a screen says; none where there is more to it than words. `leftSecs`: of a break. */
export function sentenceOf(screen: ParticipantScreen, leftSecs = 0): Sentence | null {
  switch (screen.show) {
    case "wait":
      return { title: texts.wait, text: texts.waitAbout };
    case "listen":
      return { title: texts.listen, text: texts.listenAbout };
    case "rest":
      return leftSecs > 0
        ? { title: texts.rest, text: texts.restAbout }
        : { title: texts.restOver, text: texts.restOverAbout };
    case "thanks":
      return { title: texts.thanks, text: texts.over };
    default:
      return null;
  }
}

/** Tells whether another screen is another thing to do, such as the next questionnaire. */
export function screenKey(screen: ParticipantScreen): string {
  return screen.show === "form" ? `form ${screen.step} ${screen.form.name}` : screen.show;
}

/** How the test of the gestures goes, in a few words each. */
export function promptTexts({ recognised, in_a_row, wanted, passed, recording }: PromptScreen): { recognised: string; row: string } {
  const row = wanted === null ? (in_a_row > 0 ? texts.inARow(in_a_row) : "") : texts.inARowOf(in_a_row, wanted);
  return {
    recognised: recognised === null ? (recording ? texts.recording : "") : texts.recognised(gestureInstruction(recognised)),
    row: passed ? texts.passed : row,
  };
}

/** Minutes and seconds, such as `4:05`; the last second counts until it is over. */
export function clockText(secs: number): string {
  const whole = Math.ceil(Math.max(secs, 0));
  return `${Math.floor(whole / 60)}:${String(whole % 60).padStart(2, "0")}`;
}

/** A break's end by the clock here, which goes on between messages. */
export class Countdown {
  private endMs: number | null = null;

  /** Takes a message. */
  set(leftSecs: number, nowMs: number): void {
    const end = nowMs + 1000 * leftSecs;
    if (this.endMs === null || Math.abs(end - this.endMs) > CLOCK_TOLERANCE_MS) this.endMs = end;
  }

  clear(): void {
    this.endMs = null;
  }

  /** Seconds until the end; zero from then on. */
  left(nowMs: number): number {
    return this.endMs === null ? 0 : Math.max((this.endMs - nowMs) / 1000, 0);
  }
}
