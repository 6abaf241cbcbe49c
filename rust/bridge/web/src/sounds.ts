// What is heard: short tones made here, or spoken words, each with a caption for those who do not hear it. A browser lets a page sound
// only after a first touch.
//
// Sounds differ in timbre and course and not in pitch alone: ticks for locks, buzzes for what cannot be, a bell with an overtone for what
// counts, tones that glide for the hand.

import type { Cue as Occasion, DisplayFrame, FeedbackCue, Tone, TrialEvent } from "./generated/types";
import { element, setText } from "./dom";
import type { Cues } from "./settings";
import { strings } from "./strings";

/** Notes as [frequency in hertz, start in seconds, length in seconds]. */
type Note = [number, number, number];
export interface Cue {
  notes: Note[];
  timbre: OscillatorType;
  words: string;
  caption: string;
}

/** A caption stays for so long, ms. */
const CAPTION_MS = 1800;
const { captions } = strings;

/** What the testbed's own cues are in words. Those that go on are heard as tones only. */
export const SPOKEN_CUES: Partial<Record<Occasion, string>> = {
  contact_made: "contact",
  contact_lost: "contact lost",
  on_target: "on target",
  off_target: "off target",
};

/** The page's own sounds: what is locked, planned and over. What hand and blocks do is the testbed's to say. */
export function cueOf(event: TrialEvent): Cue | null {
  switch (event.event) {
    case "locked":
      return { notes: [[1568, 0, 0.05]], timbre: "square", words: "locked", caption: captions.locked };
    case "unlocked":
      return { notes: [[622, 0, 0.05], [466, 0.06, 0.06]], timbre: "square", words: "free", caption: captions.unlocked };
    case "plan_finished":
      return event.status === "ok" || event.status === "intermediate" || event.status === "cancelled"
        ? null
        : { notes: [[147, 0, 0.12], [147, 0.17, 0.16]], timbre: "sawtooth", words: "no plan", caption: captions.no_plan };
    case "trial_finished":
      return {
        notes: [[523, 0, 0.15], [659, 0.14, 0.15], [784, 0.28, 0.15], [1047, 0.42, 0.4]],
        timbre: "triangle",
        words: "trial over",
        caption: captions.trial_over,
      };
    default:
      return null;
  }
}

export class Sounds {
  cues: Cues = "chimes";
  /** Captions are shown, whatever is heard. */
  showsCaptions = false;
  readonly caption = element("div", "caption");
  /** Cues given so far. */
  cueCount = 0;
  private captionTimer = 0;
  private context: AudioContext | null = null;
  private held: { tone: OscillatorNode; volume: GainNode; until: number } | null = null;

  constructor() {
    this.caption.hidden = true;
    // What happens is announced already.
    this.caption.setAttribute("aria-hidden", "true");
    const wake = () => {
      this.context ??= new AudioContext();
      void this.context.resume();
    };
    for (const touch of ["pointerdown", "keydown"] as const) window.addEventListener(touch, wake);
  }

  updateFromFrame(frame: DisplayFrame): void {
    for (const event of frame.events) {
      const cue = cueOf(event);
      if (!cue) continue;
      this.playCue(cue.caption);
      if (this.cues === "off") continue;
      this.cueCount += 1;
      if (this.cues === "speech") this.speak(cue.words);
      else this.play(cue);
    }
    for (const { cue, sound } of frame.feedback) if (sound || SPOKEN_CUES[cue]) this.playCue(captions[cue]);
    if (this.cues === "off") return;
    for (const cue of frame.feedback) this.playFeedbackCue(cue);
  }

  /** A cue of the testbed. */
  private playFeedbackCue({ cue, sound }: FeedbackCue): void {
    const words = SPOKEN_CUES[cue];
    if (this.cues === "speech" && words) {
      this.cueCount += 1;
      this.speak(words);
    } else if (cue === "grip") {
      this.playContinuous(sound);
    } else if (sound) {
      this.cueCount += 1;
      this.glide(sound);
    }
  }

  private playCue(text: string): void {
    if (!this.showsCaptions) return;
    setText(this.caption, `♪ ${text}`);
    this.caption.hidden = false;
    window.clearTimeout(this.captionTimer);
    this.captionTimer = window.setTimeout(() => (this.caption.hidden = true), CAPTION_MS);
  }

  private speak(words: string): void {
    if (!("speechSynthesis" in window)) return;
    window.speechSynthesis.cancel();
    window.speechSynthesis.speak(new SpeechSynthesisUtterance(words));
  }

  private play({ notes, timbre }: Cue): void {
    const context = this.context;
    if (!context || context.state !== "running") return;
    for (const [hertz, start, seconds] of notes) {
      const { tone, volume } = createOscillator(context, hertz, timbre);
      const from = context.currentTime + start;
      // Square and saw are louder at the same height.
      const loud = timbre === "triangle" ? 0.16 : 0.07;
      // Soft edges: a tone that is cut off clicks.
      volume.gain.setValueAtTime(0, from);
      volume.gain.linearRampToValueAtTime(loud, from + 0.012);
      volume.gain.exponentialRampToValueAtTime(0.001, from + seconds);
      tone.start(from);
      tone.stop(from + seconds + 0.02);
    }
  }

  private glide({ hz: [from, to], ms }: Tone): void {
    const context = this.context;
    if (!context || context.state !== "running") return;
    const now = context.currentTime;
    const { tone, volume } = createOscillator(context, from);
    tone.frequency.linearRampToValueAtTime(to, now + ms / 1000);
    volume.gain.setValueAtTime(0, now);
    volume.gain.linearRampToValueAtTime(0.16, now + 0.012);
    volume.gain.exponentialRampToValueAtTime(0.001, now + ms / 1000 + 0.05);
    tone.start(now);
    tone.stop(now + ms / 1000 + 0.07);
  }

  /** A tone that goes on until the next one, or for as long as it says. */
  private playContinuous(sound: Tone | null): void {
    const context = this.context;
    if (!context || context.state !== "running") return;
    const now = context.currentTime;
    if (this.held === null || this.held.until < now) {
      if (!sound) return;
      const held = { ...createOscillator(context, sound.hz[0]), until: 0 };
      held.volume.gain.setValueAtTime(0, now);
      held.tone.start(now);
      this.held = held;
    }
    const { tone, volume } = this.held;
    const ms = sound ? sound.ms : 0;
    if (sound) tone.frequency.setTargetAtTime(sound.hz[1], now, 0.01);
    this.held.until = now + ms / 1000;
    volume.gain.cancelScheduledValues(now);
    volume.gain.setTargetAtTime(sound ? 0.06 : 0, now, 0.01);
    volume.gain.setTargetAtTime(0, this.held.until, 0.01);
    // A later stop takes the place of this one.
    tone.stop(this.held.until + 0.1);
  }
}

function createOscillator(context: AudioContext, hertz: number, timbre: OscillatorType = "triangle"): { tone: OscillatorNode; volume: GainNode } {
  const tone = context.createOscillator();
  const volume = context.createGain();
  tone.type = timbre;
  tone.frequency.value = hertz;
  tone.connect(volume).connect(context.destination);
  return { tone, volume };
}
