// Three ways of looking: over the shoulder, through the participant's eyes, and freely.

import { Group, PerspectiveCamera, Vector3 } from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import { LARGE_ONLY } from "./insets";
import type { InterpolatedFrame } from "./frameInterpolation";
import type { TaskScene } from "./scene";
import { strings } from "./strings";

export const CAMERA_KINDS = ["shoulder", "eyes", "free"] as const;
export type CameraKind = (typeof CAMERA_KINDS)[number];
export const CAMERA_NAMES: Record<CameraKind, string> = strings.views.cameras;

const UP = new Vector3(0, 0, 1);
/** Opening of the cameras that look from outside, degrees: the box and a raised hand, and not the table's feet. */
const FOV_DEG = 33;
/** Further off than this from where the head points, the box is turned to, rad: heads tilt, trackers may not. */
const MAX_HEADING_ERROR_RAD = 0.45;
/** The eyes turn so far to the sides, and up and down, rad. */
const MAX_LOOK_RAD = { yaw: 1.2, pitch: 0.7 };
/** A key turns by so much, and a pixel of a drag, rad. */
const TURN_PER_KEY_RAD = 0.12;
const TURN_PER_PIXEL_RAD = 0.004;

export class Cameras {
  readonly camera = new PerspectiveCamera(FOV_DEG, 1, 0.02, 30);
  /** Carries the camera; a headset's floor stands on it, and it is the world's frame otherwise. */
  readonly rig = new Group();
  /** A headset decides where to look from. */
  inHeadset = false;
  private readonly orbit: OrbitControls;
  private kindChosen: CameraKind = "shoulder";
  private readonly eye = new Vector3();
  private readonly aim = new Vector3();
  private settled = false;
  /** Where the eyes look beside what is ahead, rad. */
  private readonly lookAngles = { yaw: 0, pitch: 0 };
  /** Which shoulder: -1 the right one, 1 the left one. */
  side: -1 | 1 = -1;

  constructor(element: HTMLElement) {
    this.rig.add(this.camera);
    this.camera.layers.enable(LARGE_ONLY);
    this.camera.up.set(0, 0, 1);
    this.orbit = new OrbitControls(this.camera, element);
    this.orbit.enableDamping = true;
    this.orbit.minDistance = 0.15;
    this.orbit.maxDistance = 4;
    this.orbit.enabled = false;
  }

  get kind(): CameraKind {
    return this.kindChosen;
  }

  choose(kind: CameraKind, room: TaskScene | null): void {
    this.kindChosen = kind;
    this.orbit.enabled = kind === "free";
    this.settled = false;
    Object.assign(this.lookAngles, { yaw: 0, pitch: 0 });
    if (kind === "free" && room) {
      // From where the eye is now, around the middle of the box.
      this.orbit.target.copy(room.tableCenter);
      this.orbit.update();
    }
    this.camera.fov = kind === "eyes" ? 58 : FOV_DEG;
    this.camera.updateProjectionMatrix();
  }

  /** Shift and an arrow key turn the view; true if they did. Over the shoulder there is nothing to turn. */
  key(code: string): boolean {
    const turns: Record<string, [number, number]> = { ArrowLeft: [1, 0], ArrowRight: [-1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
    const turn = turns[code];
    if (!turn || this.kindChosen === "shoulder") return false;
    this.turn(turn[0] * TURN_PER_KEY_RAD, turn[1] * TURN_PER_KEY_RAD);
    return true;
  }

  /** Shift and the mouse, dragged by so many pixels, look around in first person; the free view turns by itself. */
  drag(x: number, y: number): void {
    if (this.kindChosen === "eyes") this.turn(x * TURN_PER_PIXEL_RAD, y * TURN_PER_PIXEL_RAD);
  }

  /** To the left and up, rad. */
  private turn(yaw: number, pitch: number): void {
    if (this.kindChosen === "eyes") {
      const within = (value: number, most: number) => Math.min(Math.max(value, -most), most);
      this.lookAngles.yaw = within(this.lookAngles.yaw + yaw, MAX_LOOK_RAD.yaw);
      this.lookAngles.pitch = within(this.lookAngles.pitch + pitch, MAX_LOOK_RAD.pitch);
      return;
    }
    const from = this.camera.position.clone().sub(this.orbit.target);
    const [radius, across] = [from.length(), Math.hypot(from.x, from.y)];
    const azimuth = Math.atan2(from.y, from.x) - yaw;
    const height = Math.min(Math.max(Math.atan2(from.z, across) + pitch, -1.4), 1.4);
    from.set(radius * Math.cos(height) * Math.cos(azimuth), radius * Math.cos(height) * Math.sin(azimuth), radius * Math.sin(height));
    this.camera.position.copy(this.orbit.target).add(from);
  }

  /** Where the free camera is and what it looks at, metres; none while another one is chosen. */
  get freeCameraPose(): { eye: number[]; at: number[] } | null {
    if (this.kindChosen !== "free") return null;
    return { eye: this.camera.position.toArray(), at: this.orbit.target.toArray() };
  }

  /** Puts the free camera there. */
  placeFreeCamera(eye: readonly number[], at: readonly number[]): void {
    this.camera.position.fromArray([...eye]);
    this.orbit.target.fromArray([...at]);
    this.orbit.update();
  }

  next(): CameraKind {
    return CAMERA_KINDS[(CAMERA_KINDS.indexOf(this.kindChosen) + 1) % CAMERA_KINDS.length] ?? "shoulder";
  }

  /** A picture of this size, CSS pixels, in whose part `free` the scene is to be seen: without it, in the whole. */
  resize(width: number, height: number, free: DOMRect | null): void {
    const { left, top, width: across, height: down } = free ?? { left: 0, top: 0, width, height };
    const aspect = Math.max(across, 1) / Math.max(down, 1);
    // Another window is seen rightly at once; going there softly takes seconds where pictures are slow.
    if (aspect !== this.camera.aspect) this.settled = false;
    this.camera.aspect = aspect;
    // The picture goes beyond the free part on all sides, as if that were a window in it.
    this.camera.setViewOffset(Math.max(across, 1), Math.max(down, 1), -left, -top, Math.max(width, 1), Math.max(height, 1));
  }

  update(drawn: InterpolatedFrame, room: TaskScene, seconds: number): void {
    if (this.inHeadset) return;
    if (this.kindChosen === "free") {
      this.orbit.update();
      return;
    }
    const eye = new Vector3();
    const aim = new Vector3();
    if (this.kindChosen === "eyes") {
      eye.copy(drawn.head.position);
      const ahead = new Vector3(1, 0, 0).applyQuaternion(drawn.head.rotation);
      const toBox = room.tableCenter.clone().sub(eye).normalize();
      aim.copy(eye).add(ahead.angleTo(toBox) > MAX_HEADING_ERROR_RAD ? toBox : ahead);
    } else {
      // Behind and above the shoulder, a little outside it, so that arm and whole box are in sight. A narrow
      // window needs more distance.
      const base = drawn.base.position;
      const away = Math.max(1, 1.6 / this.camera.aspect);
      const gap = Math.min(Math.max(room.tableCenter.x - base.x, 0.35), 0.8);
      aim.copy(room.tableCenter);
      aim.x -= 0.3 * gap;
      aim.z = room.tableHeight + 0.17;
      eye.copy(aim).add(new Vector3(-0.9 * away, this.side * 0.5 * away, 1.08 * away));
    }
    // Soft, because the shoulder moves with every breath of the tracking; the eyes are exact.
    const share = this.settled && this.kindChosen !== "eyes" ? 1 - Math.exp(-4 * Math.min(seconds, 0.1)) : 1;
    this.settled = true;
    this.eye.lerp(eye, share);
    this.aim.lerp(aim, share);
    this.camera.position.copy(this.eye);
    this.camera.lookAt(this.aim);
    if (this.kindChosen === "eyes") this.camera.rotateOnWorldAxis(UP, this.lookAngles.yaw).rotateX(this.lookAngles.pitch);
  }
}
