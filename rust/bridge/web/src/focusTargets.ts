// The blocks and targets of the scene as places that the focus can go to: what has the focus is looked at. Arrow keys then
// move the gaze from there. For people without a mouse, with a screen reader, or with a switch.

import { Vector3 } from "three";
import { element } from "./dom";
import type { DisplayFrame, ObjectId } from "./generated/types";
import { objectName, plainName } from "./objects";
import type { TaskScene } from "./scene";
import { strings } from "./strings";

/** More places than these would be in the way of the focus; the middle of the table is one then. */
const MAX_FOCUS_TARGETS = 24;
/** A press of an arrow key moves the gaze by so much, metres: less than half a block. */
const GAZE_STEP_M = 0.02;

export type FocusTarget = { what: "object" | "target"; id: ObjectId };

/** Where on the screen something is, CSS pixels. */
type Project = (what: "object" | "target", id: ObjectId) => { x: number; y: number } | null;

export class FocusTargets {
  readonly root = element("div", "marks-over-scene");
  private readonly nodes = new Map<HTMLButtonElement, FocusTarget | null>();
  private room: TaskScene | null = null;
  /** What is looked at, and how far beside it, metres along x and y of `world`. */
  private focused: FocusTarget | null = null;
  private isActive = false;
  private names = "";
  private offsetM: [number, number] = [0, 0];

  constructor(
    /** The gaze went somewhere. */
    private readonly onGazeMoved: () => void,
    /** Enter or Space on a place. */
    private readonly onActivated: () => void,
    /** The scene is mirrored. */
    private readonly isMirrored: () => boolean,
  ) {
    this.root.setAttribute("role", "group");
    this.root.setAttribute("aria-label", strings.marks.label);
  }

  /** The places of another scene. */
  show(room: TaskScene): void {
    this.room = room;
    const places: FocusTarget[] = [
      ...room.objects.map(({ id }): FocusTarget => ({ what: "object", id })),
      ...room.objectsWithTarget.map((id): FocusTarget => ({ what: "target", id })),
    ];
    // The same ones again keep the focus.
    const names = places.map(focusTargetLabel).join();
    if (names === this.names) return;
    this.names = names;
    this.release();
    this.nodes.clear();
    const few = places.length <= MAX_FOCUS_TARGETS;
    for (const place of few ? places : [null]) {
      const node = element("button", "mark");
      node.type = "button";
      node.setAttribute("aria-label", place ? focusTargetLabel(place) : strings.marks.middle);
      node.addEventListener("focus", () => this.focusOn(place));
      node.addEventListener("click", () => this.onActivated());
      this.nodes.set(node, place);
    }
    this.root.replaceChildren(...this.nodes.keys());
  }

  /** Looks at a place, or at the middle of the table. */
  focusOn(place: FocusTarget | null): void {
    this.focused = place;
    this.offsetM = [0, 0];
    this.isActive = true;
    this.onGazeMoved();
  }

  /** The gaze is elsewhere: at the mouse. */
  release(): void {
    this.isActive = false;
    if (document.activeElement instanceof HTMLButtonElement && this.nodes.has(document.activeElement)) document.activeElement.blur();
  }

  /** What is looked at, in `world`; none if the gaze is the mouse's. */
  gazePoint(): Vector3 | null {
    if (!this.isActive || !this.room) return null;
    const { room, focused: place } = this;
    const found =
      place === null
        ? room.tableCenter
        : place.what === "object"
          ? room.object(place.id)?.position
          : room.target(place.id);
    return found ? found.clone().add(new Vector3(this.offsetM[0], this.offsetM[1], 0)) : null;
  }

  /** Takes an arrow key while a place has the focus. True if it was one. */
  onArrowKey(code: string): boolean {
    const active = document.activeElement;
    if (!(active instanceof HTMLButtonElement) || !this.nodes.has(active)) return false;
    // x is away from the person, y to the left.
    const side = this.isMirrored() ? -GAZE_STEP_M : GAZE_STEP_M;
    const ways: Record<string, [number, number]> = {
      ArrowUp: [GAZE_STEP_M, 0],
      ArrowDown: [-GAZE_STEP_M, 0],
      ArrowLeft: [0, side],
      ArrowRight: [0, -side],
    };
    const way = ways[code];
    if (!way) return false;
    this.offsetM = [this.offsetM[0] + way[0], this.offsetM[1] + way[1]];
    this.isActive = true;
    this.onGazeMoved();
    return true;
  }

  /** Puts the places where the scene has them. */
  updatePositions(project: Project): void {
    for (const [node, place] of this.nodes) {
      const at = place ? project(place.what, place.id) : { x: window.innerWidth / 2, y: window.innerHeight / 2 };
      node.hidden = at === null;
      if (at) node.style.transform = `translate(${Math.round(at.x)}px, ${Math.round(at.y)}px)`;
    }
  }
}

export function focusTargetLabel({ what, id }: FocusTarget): string {
  return what === "object" ? objectName(id) : strings.marks.target(plainName(id));
}

/** What one may want to look at, the likeliest first: with an object in hand its target, else what is next. */
export function likelyFocusTargets({ hand: { holds }, next }: DisplayFrame, room: TaskScene): FocusTarget[] {
  const likeliest = holds ?? next;
  const all: FocusTarget[] =
    holds !== null ? room.objectsWithTarget.map((id) => ({ what: "target", id })) : room.objects.map(({ id }) => ({ what: "object", id }));
  return [...all.filter(({ id }) => id === likeliest), ...all.filter(({ id }) => id !== likeliest)];
}
