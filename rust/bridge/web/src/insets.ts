// Two small pictures in the corners of the scene's place: what the hand sees, and what the eyes see.

import { PerspectiveCamera, Vector3, type Scene, type WebGLRenderer } from "three";
import { element } from "./dom";
import type { ArmModel } from "./generated/types";
import type { InterpolatedFrame } from "./frameInterpolation";
import type { TaskScene } from "./scene";
import { strings } from "./strings";

/** Openings, degrees. */
const HAND_FOV_DEG = 75;
const EYES_FOV_DEG = 40;
/** The hand's camera looks from the palm, this share of the way from the wrist to the grip. */
const PALM_FRACTION = 0.3;
/** Drawn in the large picture alone. */
export const LARGE_ONLY = 1;

interface Inset {
  frame: HTMLElement;
  camera: PerspectiveCamera;
}

export class Insets {
  readonly root = element("div", "insets");
  private readonly hand: Inset;
  private readonly eyes: Inset;
  private grip = new Vector3();
  private readonly up = new Vector3();

  constructor() {
    const inset = (label: string, fov: number): Inset => {
      const frame = element("div", "inset", element("span", "", label));
      this.root.append(frame);
      const camera = new PerspectiveCamera(fov, 1, 0.01, 30);
      camera.up.set(0, 0, 1);
      return { frame, camera };
    };
    this.hand = inset(strings.views.hand, HAND_FOV_DEG);
    this.eyes = inset(strings.views.eyes, EYES_FOV_DEG);
    this.root.hidden = true;
  }

  get on(): boolean {
    return !this.root.hidden;
  }

  show(arm: ArmModel): void {
    this.grip = new Vector3(...(arm.grasps[arm.grasps.length - 1]?.centre ?? [0, 0, 0]));
  }

  toggle(): void {
    this.root.hidden = this.on;
  }

  /** Draws both over the picture that is on the canvas. */
  draw(renderer: WebGLRenderer, world: Scene, drawn: InterpolatedFrame, room: TaskScene): void {
    if (!this.on) return;
    const { tip, head } = drawn;
    const grip = this.grip.clone().applyQuaternion(tip.rotation).add(tip.position);
    // What the fingers are about to close around. Surfaces that it would look through from behind are not drawn.
    const along = grip.clone().sub(tip.position).normalize();
    this.hand.camera.position.copy(tip.position).lerp(grip, PALM_FRACTION);
    // Looking straight down there is no up but the person's ahead.
    this.hand.camera.up.copy(Math.abs(along.z) > 0.9 ? this.up.set(1, 0, 0) : this.up.set(0, 0, 1));
    this.hand.camera.lookAt(grip);
    this.eyes.camera.position.copy(head.position);
    this.eyes.camera.lookAt(room.tableCenter);
    const canvas = renderer.domElement.getBoundingClientRect();
    const mirrored = renderer.domElement.classList.contains("mirrored");
    renderer.setScissorTest(true);
    for (const { frame, camera } of [this.hand, this.eyes]) {
      const box = frame.getBoundingClientRect();
      if (box.width < 2 || box.height < 2) continue;
      const left = mirrored ? canvas.right - box.right : box.left - canvas.left;
      renderer.setViewport(left, canvas.bottom - box.bottom, box.width, box.height);
      renderer.setScissor(left, canvas.bottom - box.bottom, box.width, box.height);
      renderer.clear();
      camera.aspect = box.width / box.height;
      camera.updateProjectionMatrix();
      renderer.render(world, camera);
    }
    renderer.setScissorTest(false);
    renderer.setViewport(0, 0, canvas.width, canvas.height);
  }
}
