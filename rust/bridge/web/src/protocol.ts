// What the page says of the types that the server gives it.

import type { DisplayFrame, Command, MethodInfo, PageContent, Stop } from "./generated/types";
import { strings } from "./strings";

/** x, y, z. */
export type Triple = [number, number, number];

const { names } = strings.gestures;

/** The testbed's short forms come in its messages; a person reads names. */
export const GESTURE_NAMES: Record<Command, { short: string; name: string }> = {
  wrist_extension: { short: "WE", name: names.wrist_extension },
  wrist_flexion: { short: "WF", name: names.wrist_flexion },
  hand_close: { short: "HC", name: names.hand_close },
  hand_open: { short: "HO", name: names.hand_open },
  no_motion: { short: "NM", name: names.no_motion },
};

/** A gesture as a person reads it at the beginning of a line; models have names of their own. */
export function gestureTitle(name: string): string {
  return GESTURE_NAMES[name as Command]?.name ?? capitalize(name.replaceAll("_", " "));
}

export function gestureOfCode(code: string): Exclude<Command, "no_motion"> | null {
  for (const gesture of ["wrist_extension", "wrist_flexion", "hand_close", "hand_open"] as const) {
    if (GESTURE_NAMES[gesture].short === code) return gesture;
  }
  return null;
}

/** Why the arm is stopped, as a sentence on display. */
export function stopText({ reason }: Pick<Stop, "reason">): string {
  return `${capitalize(reason.replace(/\.$/, ""))}.`;
}

export function capitalize(text: string): string {
  return `${text.slice(0, 1).toUpperCase()}${text.slice(1)}`;
}

/** What is told of the method by which the frame was made. */
export function methodOf(content: PageContent | null, frame: DisplayFrame): MethodInfo | undefined {
  return content ? [content.method, ...content.methods].find(({ name }) => name === frame.method) : undefined;
}
