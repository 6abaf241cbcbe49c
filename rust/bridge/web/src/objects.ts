// Names and colours of the objects of the scene that is on display.

import { Color } from "three";
import type { ObjectId, Scene, SceneThing } from "./generated/types";

/** Colours that differ in brightness too, for every kind of colour blindness (Okabe and Ito). */
const OKABE_ITO = ["#e69f00", "#0b4f8a", "#009e73", "#cc79a7", "#56b4e9", "#d55e00", "#f0e442"];

export type Palette = "standard" | "colour-blind";

let sceneObjects: SceneThing[] = [];
let palette: Palette = "standard";

/** From now on the objects of this scene are meant. */
export function setSceneObjects(scene: Scene): void {
  sceneObjects = scene.objects;
}

/** Takes effect on what is made from now on. */
export function setPalette(next: Palette): void {
  palette = next;
  document.documentElement.dataset["palette"] = next;
}

/** As read by a person: `red1` is "red 1". */
export function plainName(id: ObjectId): string {
  return readableName(sceneObjects[id]?.name ?? `object ${id}`);
}

/** A name as read by a person. */
export function readableName(name: string): string {
  return name.replace(/[_-]+/g, " ").replace(/([a-z])(\d+)$/i, "$1 $2");
}

/** The same at the beginning of a line. */
export function objectName(id: ObjectId): string {
  const name = plainName(id);
  return `${name.slice(0, 1).toUpperCase()}${name.slice(1)}`;
}

/** What is painted on it. */
export function objectLabel(id: ObjectId): string {
  return sceneObjects[id]?.label ?? "";
}

/** Its colour as CSS has it. */
export function objectColor(id: ObjectId): string {
  const own = sceneObjects[id]?.colour ?? [0.5, 0.5, 0.5];
  const css = ([r, g, b]: readonly number[]) => `#${new Color().setRGB(r ?? 0, g ?? 0, b ?? 0, "srgb").getHexString()}`;
  if (palette === "standard") return css(own);
  const different = [...new Set(sceneObjects.map(({ colour }) => css(colour)))];
  return OKABE_ITO[different.indexOf(css(own)) % OKABE_ITO.length] ?? css(own);
}
