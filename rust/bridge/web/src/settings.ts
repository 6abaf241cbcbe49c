// What a person has chosen, kept by the browser from visit to visit.

import type { Command } from "./generated/types";

export type GestureKey = Exclude<Command, "no_motion">;
export type LeanKey = "turn_left" | "ahead" | "turn_right" | "left" | "back" | "right";
export type ActionKey = "upright" | "camera" | "signals" | "views" | "scores" | "restart";
export type KeyCommand = GestureKey | LeanKey | ActionKey;

export type Palette = "standard" | "colour-blind";
export type Cues = "chimes" | "speech" | "off";

export interface Settings {
  /** Values of KeyboardEvent.code for each command: places on the keyboard, whatever its layout prints on them. */
  keys: Record<KeyCommand, string[]>;
  palette: Palette;
  cues: Cues;
  /** Each sound is named on the page. */
  captions: boolean;
  /** Shows the scene mirrored, as someone with a left prosthesis meets it. */
  leftArm: boolean;
  /** The tutorial was done or skipped. */
  welcomed: boolean;
  /** On the scene the mouse's buttons and wheel make gestures. */
  mouseGestures: boolean;
  /** A pointer that rests for so long makes a gesture, ms; zero if it never does. */
  dwellMs: number;
  /** Choices are offered to a single switch for so long each, ms; zero without one. */
  scanMs: number;
  /** What the others see when this page drives; empty for the name of the browser. */
  name: string;
}

export const DEFAULT_KEYS: Settings["keys"] = {
  wrist_extension: ["KeyW", "ArrowUp"],
  hand_close: ["KeyA", "ArrowLeft"],
  wrist_flexion: ["KeyS", "ArrowDown"],
  hand_open: ["KeyD", "ArrowRight"],
  turn_left: ["KeyU"],
  ahead: ["KeyI"],
  turn_right: ["KeyO"],
  left: ["KeyJ"],
  back: ["KeyK"],
  right: ["KeyL"],
  upright: ["KeyP"],
  camera: ["KeyC"],
  signals: ["KeyG"],
  views: ["KeyV"],
  scores: ["KeyB"],
  restart: ["KeyR"],
};
export const COMMANDS = Object.keys(DEFAULT_KEYS) as KeyCommand[];

const SETTINGS_STORAGE_KEY = "proact.settings";
const LANGUAGE_STORAGE_KEY = "proact.language";
/** Longest name, characters. */
export const MAX_NAME_CHARS = 40;

/** Times that may be chosen, ms. */
export const DWELL_CHOICES_MS = [0, 600, 1000, 1600];
export const SCAN_CHOICES_MS = [0, 800, 1500, 2500];

function oneOf(times: number[], stored: unknown): number {
  return times.find((time) => time === stored) ?? 0;
}

/** What was stored, with everything that is missing or malformed taken from the defaults. */
export function parseSettings(text: string | null): Settings {
  let stored: Partial<Record<keyof Settings, unknown>> = {};
  try {
    const parsed: unknown = JSON.parse(text ?? "{}");
    if (typeof parsed === "object" && parsed !== null) stored = parsed;
  } catch {
    // Unreadable is as good as nothing.
  }
  const keys = structuredClone(DEFAULT_KEYS);
  const given = (typeof stored.keys === "object" && stored.keys !== null ? stored.keys : {}) as Record<string, unknown>;
  for (const command of COMMANDS) {
    const codes = given[command];
    if (Array.isArray(codes) && codes.every((code) => typeof code === "string")) keys[command] = codes;
  }
  return {
    keys,
    palette: stored.palette === "colour-blind" ? "colour-blind" : "standard",
    cues: stored.cues === "speech" || stored.cues === "off" ? stored.cues : "chimes",
    captions: stored.captions === true,
    leftArm: stored.leftArm === true,
    welcomed: stored.welcomed === true,
    mouseGestures: stored.mouseGestures !== false,
    dwellMs: oneOf(DWELL_CHOICES_MS, stored.dwellMs),
    scanMs: oneOf(SCAN_CHOICES_MS, stored.scanMs),
    name: typeof stored.name === "string" ? stored.name.slice(0, MAX_NAME_CHARS) : "",
  };
}

/** `command` gets this key and no other; whatever had it gets the one that `command` had first. */
export function remap(keys: Settings["keys"], command: KeyCommand, code: string): Settings["keys"] {
  const next = structuredClone(keys);
  const before = next[command][0];
  for (const other of COMMANDS) {
    if (other === command || !next[other].includes(code)) continue;
    next[other] = next[other].filter((held) => held !== code);
    if (next[other].length === 0 && before) next[other].push(before);
  }
  next[command] = [code];
  return next;
}

/** What stands on a key, such as `W` or `↑`. */
export function keyName(code: string): string {
  const arrows: Record<string, string> = { ArrowUp: "↑", ArrowDown: "↓", ArrowLeft: "←", ArrowRight: "→" };
  return arrows[code] ?? code.replace(/^(Key|Digit)/, "").replace(/^Numpad/, "Num ");
}

export function loadSettings(): Settings {
  try {
    return parseSettings(localStorage.getItem(SETTINGS_STORAGE_KEY));
  } catch {
    // Storage may be forbidden.
    return parseSettings(null);
  }
}

export function storeSettings(settings: Settings): void {
  try {
    localStorage.setItem(SETTINGS_STORAGE_KEY, JSON.stringify(settings));
  } catch {
    // Then the choice lasts as long as the page.
  }
}

/** The language that was chosen for questionnaires; empty if none was. */
export function loadLanguage(): string {
  try {
    return localStorage.getItem(LANGUAGE_STORAGE_KEY) ?? "";
  } catch {
    return "";
  }
}

export function storeLanguage(language: string): void {
  try {
    localStorage.setItem(LANGUAGE_STORAGE_KEY, language);
  } catch {
    // Then the choice lasts as long as the questionnaire.
  }
}
