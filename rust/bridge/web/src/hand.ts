// Pictures of the five gestures of a right hand, seen from the side: forearm, hand and fingers as strokes. Other gestures
// that a model tells apart have their name in place of a picture.

import type { Command, Gesture } from "./generated/types";
import { strings } from "./strings";

const NAMES: Record<Command, string> = strings.gestures.instructions;

function isDrawn(gesture: Gesture): gesture is Command {
  return Object.hasOwn(NAMES, gesture);
}

/** What the person is told to do. */
export function gestureInstruction(gesture: Gesture): string {
  return isDrawn(gesture) ? NAMES[gesture] : gesture.replaceAll("_", " ");
}

/** Angle of the hand at the wrist in degrees (back is up), and how far the fingers are spread and closed, 0 to 1. */
export type HandPose = { wrist: number; spread: number; closed: number };

const POSES: Record<Command, HandPose> = {
  hand_close: { wrist: 0, spread: 0, closed: 1 },
  hand_open: { wrist: 0, spread: 1, closed: 0 },
  no_motion: { wrist: 6, spread: 0.25, closed: 0.35 },
  wrist_extension: { wrist: -55, spread: 0.2, closed: 0.3 },
  wrist_flexion: { wrist: 55, spread: 0.2, closed: 0.3 },
};

/** An SVG of the gesture; it is labelled, so that it is read aloud too. */
export function handPicture(gesture: Gesture): SVGSVGElement {
  const picture = svgElement("svg", { viewBox: "0 0 240 160", role: "img", "aria-label": gestureInstruction(gesture) });
  if (!isDrawn(gesture)) {
    const text = svgElement("text", { x: 120, y: 88, "text-anchor": "middle", "font-size": 22, fill: "#e8b48a" });
    text.textContent = gestureInstruction(gesture);
    picture.append(text);
    return picture;
  }
  picture.append(...handDrawing(POSES[gesture], 0));
  return picture;
}

/** Forearm and hand, from (10, 80) to the right, with strokes `thicker` than those of a hand. */
export function handDrawing({ wrist, spread, closed }: HandPose, thicker: number): SVGElement[] {
  const line = (x1: number, y1: number, x2: number, y2: number, width: number) =>
    svgElement("line", { x1, y1, x2, y2, stroke: "#e8b48a", "stroke-width": width + thicker, "stroke-linecap": "round" });
  const hand = svgElement("g", { transform: `rotate(${wrist} 110 80)` });
  hand.append(line(112, 80, 150, 80, 42));
  for (let finger = 0; finger < 4; finger += 1) {
    const side = (finger - 1.5) / 1.5;
    const knuckle = { x: 158, y: 80 + 15 * side };
    const angle = (side * 26 * spread * Math.PI) / 180;
    const length = 46 * (1 - 0.75 * closed);
    hand.append(
      line(knuckle.x, knuckle.y, knuckle.x + length * Math.cos(angle), knuckle.y + length * Math.sin(angle), 10),
    );
  }
  const thumb = (-35 - 40 * spread + 30 * closed) * (Math.PI / 180);
  hand.append(line(128, 62, 128 + 34 * Math.cos(thumb), 62 + 34 * Math.sin(thumb), 11));
  return [line(10, 80, 110, 80, 34), hand];
}

/** An element of a drawing. */
export function svgElement<K extends keyof SVGElementTagNameMap>(
  tag: K,
  attributes: Record<string, string | number>,
): SVGElementTagNameMap[K] {
  const node = document.createElementNS("http://www.w3.org/2000/svg", tag);
  for (const [name, value] of Object.entries(attributes)) node.setAttribute(name, String(value));
  return node;
}
