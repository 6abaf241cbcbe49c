// The blocks and targets of the scene as places that the focus can go to: what has the focus is looked at. Arrow keys then
// move the gaze from there. For people without a mouse, with a screen reader, or with a switch.

import { Vector3 } from "three";
import { element } from "./dom";
import type { DisplayFrame, ObjectId } from "./generated/types";
import { objectName, plainName } from "./objects";
import type { Room } from "./room";
import { strings } from "./strings";

/** More places than these would be in the way of the focus; the middle of the table is one then. */
const MOST_MARKS = 24;
/** A press of an arrow key moves the gaze by so much, metres: less than half a block. */
const STEP = 0.02;

export type Place = { what: "object" | "target"; id: ObjectId };

/** Where on the screen something is, CSS pixels. */
type Project = (what: "object" | "target", id: ObjectId) => { x: number; y: number } | null;

export class Marks {
  readonly root = element("div", "marks-over-scene");
  private readonly nodes = new Map<HTMLButtonElement, Place | null>();
  private room: Room | null = null;
  /** What is looked at, and how far beside it, metres along x and y of `world`. */
  private place: Place | null = null;
  private looking = false;
  private names = "";
  private beside: [number, number] = [0, 0];

  constructor(
    /** The gaze went somewhere. */
    private readonly looked: () => void,
    /** Enter or Space on a place. */
    private readonly chosen: () => void,
    /** The scene is mirrored. */
    private readonly mirrored: () => boolean,
  ) {
    this.root.setAttribute("role", "group");
    this.root.setAttribute("aria-label", strings.marks.label);
  }

  /** The places of another scene. */
  show(room: Room): void {
    this.room = room;
    const places: Place[] = [
      ...room.objects.map(({ id }): Place => ({ what: "object", id })),
      ...room.placed.map((id): Place => ({ what: "target", id })),
    ];
    // The same ones again keep the focus.
    const names = places.map(labelOf).join();
    if (names === this.names) return;
    this.names = names;
    this.leave();
    this.nodes.clear();
    const few = places.length <= MOST_MARKS;
    for (const place of few ? places : [null]) {
      const node = element("button", "mark");
      node.type = "button";
      node.setAttribute("aria-label", place ? labelOf(place) : strings.marks.middle);
      node.addEventListener("focus", () => this.look(place));
      node.addEventListener("click", () => this.chosen());
      this.nodes.set(node, place);
    }
    this.root.replaceChildren(...this.nodes.keys());
  }

  /** Looks at a place, or at the middle of the table. */
  look(place: Place | null): void {
    this.place = place;
    this.beside = [0, 0];
    this.looking = true;
    this.looked();
  }

  /** The gaze is elsewhere: at the mouse. */
  leave(): void {
    this.looking = false;
    if (document.activeElement instanceof HTMLButtonElement && this.nodes.has(document.activeElement)) document.activeElement.blur();
  }

  /** What is looked at, in `world`; none if the gaze is the mouse's. */
  point(): Vector3 | null {
    if (!this.looking || !this.room) return null;
    const { room, place } = this;
    const found =
      place === null
        ? room.centre
        : place.what === "object"
          ? room.object(place.id)?.position
          : room.target(place.id);
    return found ? found.clone().add(new Vector3(this.beside[0], this.beside[1], 0)) : null;
  }

  /** Takes an arrow key while a place has the focus. True if it was one. */
  key(code: string): boolean {
    const active = document.activeElement;
    if (!(active instanceof HTMLButtonElement) || !this.nodes.has(active)) return false;
    // x is away from the person, y to the left.
    const side = this.mirrored() ? -STEP : STEP;
    const ways: Record<string, [number, number]> = {
      ArrowUp: [STEP, 0],
      ArrowDown: [-STEP, 0],
      ArrowLeft: [0, side],
      ArrowRight: [0, -side],
    };
    const way = ways[code];
    if (!way) return false;
    this.beside = [this.beside[0] + way[0], this.beside[1] + way[1]];
    this.looking = true;
    this.looked();
    return true;
  }

  /** Puts the places where the scene has them. */
  follow(project: Project): void {
    for (const [node, place] of this.nodes) {
      const at = place ? project(place.what, place.id) : { x: window.innerWidth / 2, y: window.innerHeight / 2 };
      node.hidden = at === null;
      if (at) node.style.transform = `translate(${Math.round(at.x)}px, ${Math.round(at.y)}px)`;
    }
  }
}

export function labelOf({ what, id }: Place): string {
  return what === "object" ? objectName(id) : strings.marks.target(plainName(id));
}

/** What one may want to look at, the likeliest first: with an object in hand its target, else what is next. */
export function placesOf({ hand: { holds }, next }: DisplayFrame, room: Room): Place[] {
  const likeliest = holds ?? next;
  const all: Place[] =
    holds !== null ? room.placed.map((id) => ({ what: "target", id })) : room.objects.map(({ id }) => ({ what: "object", id }));
  return [...all.filter(({ id }) => id === likeliest), ...all.filter(({ id }) => id !== likeliest)];
}
