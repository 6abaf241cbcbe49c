// What the method and the eyes do: highlight, place marker, gaze point, and which object comes next.

import {
  BoxGeometry,
  Color,
  ConeGeometry,
  CylinderGeometry,
  DoubleSide,
  Group,
  Mesh,
  MeshBasicMaterial,
  Object3D,
  Raycaster,
  RingGeometry,
  Sprite,
  SpriteMaterial,
  TorusGeometry,
  Vector3,
} from "three";
import { selectionState, type SelectionState } from "./selectionState";
import type { DisplayFrame, Shape } from "./generated/types";
import { objectColor } from "./objects";
import type { TaskScene } from "./scene";
import { drawnTexture, shapeGeometry } from "./shapes";

/** The states differ in brightness and in form, not in hue alone. */
export const FREE = new Color("#ffe98a");
export const LOCKED = new Color("#4cc3ff");
export const REACHABLE = new Color("#00c48c");
export const UNREACHABLE = new Color("#ff5d8f");

const UNLOCKED_PLACE = new Color("#2b2f33");
const COLORS: Record<SelectionState, Color> = { free: FREE, locked: LOCKED, reachable: REACHABLE, unreachable: UNREACHABLE };

export class Markers {
  readonly root = new Group();
  private readonly shell: Mesh;
  private readonly shellMaterial = new MeshBasicMaterial({ transparent: true, depthWrite: false, side: DoubleSide });
  private readonly clasp = new Group();
  private readonly halo: Mesh;
  private readonly bar: Mesh;
  private readonly ghostMaterial = new MeshBasicMaterial({ transparent: true, depthWrite: false });
  private readonly haloMaterial = new MeshBasicMaterial({ color: FREE, transparent: true, depthWrite: false });
  private readonly solid = new MeshBasicMaterial({ color: LOCKED });
  private readonly placeMarker = new Group();
  /** Seen through arm and hand, which often are in the way of the place. */
  private readonly placeMaterial = new MeshBasicMaterial({
    transparent: true,
    depthTest: false,
    depthWrite: false,
    side: DoubleSide,
  });
  private readonly placeCross: Mesh;
  private readonly gaze: Sprite;
  /** Above an object's middle the pointer to it, metres. */
  private readonly pointerHeight: number;
  private readonly next: Mesh;
  private readonly nextMaterial = new MeshBasicMaterial({ transparent: true, opacity: 0.9 });
  private readonly ray = new Raycaster();

  constructor(private readonly room: TaskScene) {
    const shape: Shape = room.objects[0]?.shape ?? { type: "cylinder", radius: 0.025, length: 0.05 };
    const [radius, height] = outline(shape);
    this.pointerHeight = height / 2 + 0.03;
    // Open at both ends: the number on top stays readable.
    this.shell = new Mesh(
      new CylinderGeometry(radius * 1.16, radius * 1.16, height * 1.04, 64, 1, true).rotateX(Math.PI / 2),
      this.shellMaterial,
    );
    // Locked: two solid rings clasp the block.
    for (const z of [-height / 2, height / 2]) {
      const ring = new Mesh(new TorusGeometry(radius * 1.17, 0.0028, 12, 64), this.solid);
      ring.position.z = z;
      this.clasp.add(ring);
    }
    // Free: a flat halo around its foot.
    this.halo = new Mesh(new RingGeometry(radius * 1.2, radius * 1.6, 64), this.haloMaterial);
    this.halo.position.z = 0.002 - height / 2;
    // Out of reach: a bar across.
    this.bar = new Mesh(new BoxGeometry(radius * 3.2, radius * 0.5, height * 0.16), this.solid);
    this.bar.position.z = height * 0.6;
    this.bar.rotation.z = Math.PI / 4;
    this.shell.add(this.clasp, this.halo, this.bar);
    const ring = new Mesh(new RingGeometry(radius * 0.86, radius * 1.08, 64), this.placeMaterial);
    this.placeCross = new Mesh(new RingGeometry(0, radius * 0.3, 32), this.placeMaterial);
    // The block as it will stand there.
    const ghost = new Mesh(shapeGeometry(shape), this.ghostMaterial);
    ghost.position.z = height / 2;
    this.placeMarker.add(ring, this.placeCross, ghost);
    this.gaze = new Sprite(
      new SpriteMaterial({ map: gazeTexture(), transparent: true, depthTest: false, sizeAttenuation: false }),
    );
    this.gaze.scale.setScalar(0.042);
    this.gaze.renderOrder = 10;
    this.next = new Mesh(new ConeGeometry(0.011, 0.022, 32).rotateX(-Math.PI / 2), this.nextMaterial);
    this.root.add(this.shell, this.placeMarker, this.gaze, this.next);
    for (const part of this.root.children) part.visible = false;
  }

  update(frame: DisplayFrame, seconds: number): void {
    const { target, hand } = frame;
    const pulse = 0.5 + 0.5 * Math.sin(4.5 * seconds);
    const state = selectionState(frame);
    const colour = COLORS[state];

    // The highlighted object.
    const block = target.object !== null && hand.holds === null ? this.room.object(target.object) : undefined;
    this.shell.visible = block !== undefined;
    if (block) {
      this.shell.position.copy(block.position);
      this.shell.quaternion.copy(block.quaternion);
      this.shellMaterial.color.copy(colour);
      this.solid.color.copy(colour);
      this.shellMaterial.opacity = target.locked ? 0.45 : 0.45 + 0.25 * pulse;
      this.clasp.visible = target.locked;
      this.bar.visible = state === "unreachable";
      this.halo.visible = !target.locked;
      this.haloMaterial.opacity = 0.55 + 0.4 * pulse;
    }

    // The place marker.
    this.placeMarker.visible = target.place !== null && hand.holds !== null;
    if (target.place) {
      this.placeMarker.position.set(target.place[0], target.place[1], target.place[2] + 0.0015);
      this.placeMaterial.color.copy(target.locked ? colour : UNLOCKED_PLACE);
      this.placeMaterial.opacity = target.locked ? 0.95 : 0.55 + 0.25 * pulse;
      this.placeCross.visible = target.locked;
      this.ghostMaterial.color.copy(target.locked ? colour : UNLOCKED_PLACE);
      this.ghostMaterial.opacity = target.locked ? 0.34 : 0.14;
    }

    // The gaze point.
    const point = frame.gaze?.valid ? this.gazePoint(frame) : null;
    this.gaze.visible = point !== null;
    if (point) this.gaze.position.copy(point);

    // The object that the task asks for next, while the hand is free for it.
    const next = frame.next !== null && hand.holds === null ? this.room.object(frame.next) : undefined;
    this.next.visible = next !== undefined && frame.next !== target.object;
    if (next && frame.next !== null) {
      this.next.position.copy(next.position);
      this.next.position.z += this.pointerHeight + 0.008 * pulse;
      this.nextMaterial.color.set(objectColor(frame.next));
    }
  }

  /** Where the measured gaze meets an object or the table; none if it meets neither. */
  private gazePoint(frame: DisplayFrame): Vector3 | null {
    if (!frame.gaze) return null;
    const origin = new Vector3(...frame.gaze.origin);
    const direction = new Vector3(...frame.gaze.direction).normalize();
    this.ray.set(origin, direction);
    const bodies: Object3D[] = this.room.objects.map((object) => object.body);
    const hit = this.ray.intersectObjects(bodies, false)[0];
    if (hit) return hit.point;
    const fall = (this.room.tableHeight - origin.z) / direction.z;
    if (!(fall > 0 && fall < 3)) return null;
    return origin.addScaledVector(direction, fall);
  }
}

/** Radius of an upright shape, that of a box to its corners, and its height. */
function outline(shape: Shape): [number, number] {
  switch (shape.type) {
    case "box":
      return [Math.hypot(shape.size[0], shape.size[1]) / 2, shape.size[2]];
    case "sphere":
      return [shape.radius, 2 * shape.radius];
    case "cylinder":
      return [shape.radius, shape.length];
    case "capsule":
      return [shape.radius, shape.length + 2 * shape.radius];
  }
}

function gazeTexture() {
  return drawnTexture((context) => {
    const circle = (radius: number, width: number, colour: string) => {
      context.strokeStyle = colour;
      context.lineWidth = width;
      context.beginPath();
      context.arc(0, 0, radius, 0, 2 * Math.PI);
      context.stroke();
    };
    // Dark under light: seen on any ground.
    circle(0.7, 0.3, "rgba(20,30,40,0.55)");
    circle(0.7, 0.16, "#7fe3ff");
    context.fillStyle = "#7fe3ff";
    context.beginPath();
    context.arc(0, 0, 0.14, 0, 2 * Math.PI);
    context.fill();
  }, 128);
}
