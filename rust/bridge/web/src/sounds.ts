// What is heard: short tones made here, or spoken words. A browser lets a page sound only after a first touch.

import type { TrialEvent } from "./generated/types";
import type { Cues } from "./settings";

/** Notes as [frequency in hertz, start in seconds, length in seconds]. */
type Note = [number, number, number];
interface Cue {
  notes: Note[];
  words: string;
}

/** Rising for what is gained, falling for what is lost. */
export function cueOf(event: TrialEvent): Cue | null {
  switch (event.event) {
    case "block_attached":
      return { notes: [[523, 0, 0.12], [784, 0.09, 0.2]], words: "contact" };
    case "block_released":
      return { notes: [[784, 0, 0.12], [523, 0.09, 0.2]], words: "contact lost" };
    case "locked":
      return { notes: [[1175, 0, 0.06]], words: "locked" };
    case "unlocked":
      return { notes: [[880, 0, 0.06]], words: "free" };
    case "block_on_target":
      return { notes: [[523, 0, 0.12], [659, 0.1, 0.12], [1047, 0.2, 0.3]], words: "on target" };
    case "block_off_target":
      return { notes: [[330, 0, 0.15], [262, 0.14, 0.25]], words: "off target" };
    case "plan_finished":
      return event.status === "ok" || event.status === "intermediate" || event.status === "cancelled"
        ? null
        : { notes: [[196, 0, 0.12], [196, 0.17, 0.16]], words: "no plan" };
    case "trial_finished":
      return { notes: [[523, 0, 0.15], [659, 0.14, 0.15], [784, 0.28, 0.15], [1047, 0.42, 0.4]], words: "trial over" };
    default:
      return null;
  }
}

export class Sounds {
  cues: Cues = "chimes";
  /** Cues given so far. */
  given = 0;
  private context: AudioContext | null = null;

  constructor() {
    const wake = () => {
      this.context ??= new AudioContext();
      void this.context.resume();
    };
    for (const touch of ["pointerdown", "keydown"] as const) window.addEventListener(touch, wake);
  }

  take(events: TrialEvent[]): void {
    for (const event of events) {
      const cue = this.cues === "off" ? null : cueOf(event);
      if (!cue) continue;
      this.given += 1;
      if (this.cues === "speech") this.speak(cue.words);
      else this.play(cue.notes);
    }
  }

  private speak(words: string): void {
    if (!("speechSynthesis" in window)) return;
    window.speechSynthesis.cancel();
    window.speechSynthesis.speak(new SpeechSynthesisUtterance(words));
  }

  private play(notes: Note[]): void {
    const context = this.context;
    if (!context || context.state !== "running") return;
    for (const [hertz, start, seconds] of notes) {
      const tone = context.createOscillator();
      const volume = context.createGain();
      tone.type = "triangle";
      tone.frequency.value = hertz;
      const from = context.currentTime + start;
      // Soft edges: a tone that is cut off clicks.
      volume.gain.setValueAtTime(0, from);
      volume.gain.linearRampToValueAtTime(0.16, from + 0.012);
      volume.gain.exponentialRampToValueAtTime(0.001, from + seconds);
      tone.connect(volume).connect(context.destination);
      tone.start(from);
      tone.stop(from + seconds + 0.02);
    }
  }
}
