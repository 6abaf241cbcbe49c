// Three ways of looking: over the shoulder, through the participant's eyes, and freely.

import { Group, PerspectiveCamera, Vector3 } from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import type { Drawn } from "./motion";
import type { Room } from "./room";

export const CAMERA_KINDS = ["shoulder", "eyes", "free"] as const;
export type CameraKind = (typeof CAMERA_KINDS)[number];
export const CAMERA_NAMES: Record<CameraKind, string> = {
  shoulder: "Over the shoulder",
  eyes: "First person",
  free: "Free",
};

/** Opening of the cameras that look from outside, degrees: the box and a raised hand, and not the table's feet. */
const FOV = 33;
/** Further off than this from where the head points, the box is turned to, rad: heads tilt, trackers may not. */
const LOOK_AWAY_RAD = 0.45;

export class Cameras {
  readonly camera = new PerspectiveCamera(FOV, 1, 0.02, 30);
  /** Carries the camera; a headset's floor stands on it, and it is the world's frame otherwise. */
  readonly rig = new Group();
  /** A headset decides where to look from. */
  worn = false;
  private readonly orbit: OrbitControls;
  private chosen: CameraKind = "shoulder";
  private readonly eye = new Vector3();
  private readonly aim = new Vector3();
  private settled = false;
  /** Which shoulder: -1 the right one, 1 the left one. */
  side: -1 | 1 = -1;

  constructor(element: HTMLElement) {
    this.rig.add(this.camera);
    this.camera.up.set(0, 0, 1);
    this.orbit = new OrbitControls(this.camera, element);
    this.orbit.enableDamping = true;
    this.orbit.minDistance = 0.15;
    this.orbit.maxDistance = 4;
    this.orbit.enabled = false;
  }

  get kind(): CameraKind {
    return this.chosen;
  }

  choose(kind: CameraKind, room: Room | null): void {
    this.chosen = kind;
    this.orbit.enabled = kind === "free";
    this.settled = false;
    if (kind === "free" && room) {
      // From where the eye is now, around the middle of the box.
      this.orbit.target.copy(room.centre);
      this.orbit.update();
    }
    this.camera.fov = kind === "eyes" ? 58 : FOV;
    this.camera.updateProjectionMatrix();
  }

  /** Where the free camera is and what it looks at, metres; none while another one is chosen. */
  get place(): { eye: number[]; at: number[] } | null {
    if (this.chosen !== "free") return null;
    return { eye: this.camera.position.toArray(), at: this.orbit.target.toArray() };
  }

  /** Puts the free camera there. */
  put(eye: readonly number[], at: readonly number[]): void {
    this.camera.position.fromArray([...eye]);
    this.orbit.target.fromArray([...at]);
    this.orbit.update();
  }

  next(): CameraKind {
    return CAMERA_KINDS[(CAMERA_KINDS.indexOf(this.chosen) + 1) % CAMERA_KINDS.length] ?? "shoulder";
  }

  /** A picture of this size, CSS pixels, in whose part `free` the scene is to be seen: without it, in the whole. */
  resize(width: number, height: number, free: DOMRect | null): void {
    const { left, top, width: across, height: down } = free ?? { left: 0, top: 0, width, height };
    this.camera.aspect = Math.max(across, 1) / Math.max(down, 1);
    // The picture goes beyond the free part on all sides, as if that were a window in it.
    this.camera.setViewOffset(Math.max(across, 1), Math.max(down, 1), -left, -top, Math.max(width, 1), Math.max(height, 1));
  }

  update(drawn: Drawn, room: Room, seconds: number): void {
    if (this.worn) return;
    if (this.chosen === "free") {
      this.orbit.update();
      return;
    }
    const eye = new Vector3();
    const aim = new Vector3();
    if (this.chosen === "eyes") {
      eye.copy(drawn.head.position);
      const ahead = new Vector3(1, 0, 0).applyQuaternion(drawn.head.rotation);
      const toBox = room.centre.clone().sub(eye).normalize();
      aim.copy(eye).add(ahead.angleTo(toBox) > LOOK_AWAY_RAD ? toBox : ahead);
    } else {
      // Behind and above the shoulder, a little outside it, so that arm and whole box are in sight. A narrow
      // window needs more distance.
      const base = drawn.base.position;
      const away = Math.max(1, 1.6 / this.camera.aspect);
      const gap = Math.min(Math.max(room.centre.x - base.x, 0.35), 0.8);
      aim.copy(room.centre);
      aim.x -= 0.3 * gap;
      aim.z = room.tableHeight + 0.17;
      eye.copy(aim).add(new Vector3(-0.9 * away, this.side * 0.5 * away, 1.08 * away));
    }
    // Soft, because the shoulder moves with every breath of the tracking; the eyes are exact.
    const share = this.settled && this.chosen !== "eyes" ? 1 - Math.exp(-4 * Math.min(seconds, 0.1)) : 1;
    this.settled = true;
    this.eye.lerp(eye, share);
    this.aim.lerp(aim, share);
    this.camera.position.copy(this.eye);
    this.camera.lookAt(this.aim);
  }
}
