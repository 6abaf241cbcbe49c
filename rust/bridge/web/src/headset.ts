// The scene in a headset's browser (WebXR): "Enter AR", "Enter VR", the head's pose, and a ray of head or hand as
// gaze. Browsers give no eye gaze.

import { Matrix4, Quaternion, Vector3 } from "three";
import { element } from "./dom";
import type { DisplayFrame, Side } from "./generated/types";
import type { Triple } from "./protocol";
import { boardOptions, boardPose } from "./reference";
import type { GestureKey } from "./settings";
import type { SceneRenderer } from "./renderer";
import { strings } from "./strings";

/** From a headset's axes (x right, y up, -z ahead) to the world's (x ahead, y left, z up). */
const WORLD_FROM_XR = new Quaternion().setFromRotationMatrix(
  new Matrix4().makeBasis(new Vector3(0, -1, 0), new Vector3(0, 0, 1), new Vector3(-1, 0, 0)),
);
const UP = new Vector3(0, 0, 1);
/** The stick turns the world at this speed, rad/s. */
const TURN_SPEED_RAD_PER_S = 1;
/** Buttons of the standard controller: trigger, squeeze, first and second button above. */
const [TRIGGER, SQUEEZE, LOWER, UPPER] = [0, 1, 4, 5];
const STICK_X = 2;
/** So long after it was first seen the reference board places the world, seconds; then it may be taken away. */
const BOARD_SETTLE_SECS = 2;

export interface HeadsetHandlers {
  /** `world_from_head`: x ahead, y left, z up. */
  head(position: Triple, quaternion: [number, number, number, number]): void;
  /** Where the controller on the brace is in `world`, on the page's clock, ms; `tracked` while the headset sees it. */
  controller(hand: Side, timeMs: number, position: Triple, quaternion: [number, number, number, number], tracked: boolean): void;
  /** A ray in `world`, as tracked, that stands for the gaze. */
  ray(origin: Vector3, direction: Vector3, head: Vector3): void;
  hold(source: string, gesture: GestureKey, down: boolean): void;
  /** The trigger of either hand was pressed, or its fingers were pinched. */
  trigger(): void;
  showMessage(message: string): void;
}

export class Headset {
  readonly root = element("div", "headset");
  /** The controller that is strapped to the brace: it is a tracker, and neither gaze nor buttons. */
  brace: Side | null = null;
  private isPlaced = false;
  /** Seconds for which the reference board has been in use. */
  private boardSeenSecs = 0;
  private readonly board = boardOptions();
  private readonly dragged = new Map<XRInputSource, Vector3>();

  constructor(
    private readonly stage: SceneRenderer,
    private readonly handlers: HeadsetHandlers,
    private readonly overlay: HTMLElement,
  ) {
    this.root.hidden = true;
    void this.addEnterButton("immersive-ar", "Enter AR");
    void this.addEnterButton("immersive-vr", "Enter VR");
  }

  get inHeadset(): boolean {
    return this.stage.cameras.inHeadset;
  }

  /** The page lies over the picture, as on a telephone. */
  get hasDomOverlay(): boolean {
    return Boolean(this.stage.renderer.xr.getSession()?.domOverlayState);
  }

  /** Called once per picture, before it is drawn. */
  update(frame: DisplayFrame | null, seconds: number): void {
    // First of all: a hand must be able to let go while the head is lost.
    this.readButtons();
    const { xr } = this.stage.renderer;
    const space = xr.getReferenceSpace();
    const viewer = this.inHeadset && space ? xr.getFrame()?.getViewerPose(space) : null;
    if (!viewer || !space) return;
    const { rig } = this.stage.cameras;
    const eye = vector(viewer.transform.position);
    const turn = quaternion(viewer.transform.orientation);
    if (!this.isPlaced && frame) {
      const [x, y] = frame.world_from_head.translation;
      // Floors are the same.
      this.alignWorld(eye, new Vector3(0, 0, -1).applyQuaternion(turn), new Vector3(x, y, eye.y));
      this.isPlaced = true;
    }
    this.trackReferenceBoard(xr.getFrame(), space, seconds);
    this.dragWorld(space, seconds);
    rig.updateMatrixWorld();
    const head = eye.clone().applyMatrix4(rig.matrixWorld);
    const orientation = rig.quaternion.clone().multiply(turn).multiply(WORLD_FROM_XR.clone().invert());
    this.handlers.head(head.toArray(), orientation.toArray());

    this.sendBracePose(xr.getFrame(), space);

    // A hand that points is the gaze, of two the right one; without one, the head.
    const hands = this.handheldSources().filter(({ targetRayMode }) => targetRayMode === "tracked-pointer");
    const source = hands.find(({ handedness }) => handedness === "right") ?? hands[0];
    const pose = source ? xr.getFrame().getPose(source.targetRaySpace, space) : null;
    const from = pose ? vector(pose.transform.position).applyMatrix4(rig.matrixWorld) : head;
    const along = pose
      ? new Vector3(0, 0, -1).applyQuaternion(quaternion(pose.transform.orientation)).applyQuaternion(rig.quaternion)
      : new Vector3(1, 0, 0).applyQuaternion(orientation);
    this.handlers.ray(from, along, head);
  }

  private sources(): XRInputSource[] {
    return [...(this.stage.renderer.xr.getSession()?.inputSources ?? [])];
  }

  /** Those in hands. */
  private handheldSources(): XRInputSource[] {
    return this.sources().filter(({ handedness }) => this.brace === null || handedness !== this.brace);
  }

  private sendBracePose(frame: XRFrame, space: XRReferenceSpace): void {
    const hand = this.brace;
    // A bare hand of that side is no controller.
    const source = this.sources().find(({ handedness, gripSpace, hand: bare }) => hand !== null && handedness === hand && gripSpace && !bare);
    const pose = source?.gripSpace && frame.getPose(source.gripSpace, space);
    if (!pose || hand === null) return;
    const { rig } = this.stage.cameras;
    const place = vector(pose.transform.position).applyMatrix4(rig.matrixWorld);
    const turn = rig.quaternion.clone().multiply(quaternion(pose.transform.orientation));
    this.handlers.controller(hand, performance.now(), place.toArray(), turn.toArray(), !pose.emulatedPosition);
  }

  /** The point `here`, seen from which the way ahead is `ahead`, becomes `there` of the world, from which it is x. */
  private alignWorld(here: Vector3, ahead: Vector3, there: Vector3): void {
    const { rig } = this.stage.cameras;
    const way = ahead.clone().applyQuaternion(WORLD_FROM_XR);
    rig.quaternion.setFromAxisAngle(UP, -Math.atan2(way.y, way.x)).multiply(WORLD_FROM_XR);
    rig.position.copy(there).sub(here.clone().applyQuaternion(rig.quaternion));
  }

  /** The reference board lies on the table, in the middle of the box, its upper edge away from the person. */
  private trackReferenceBoard(frame: XRFrame, space: XRReferenceSpace, seconds: number): void {
    const { taskScene: room } = this.stage;
    const pose = room && this.boardSeenSecs < BOARD_SETTLE_SECS ? boardPose(frame, space) : null;
    if (!room || !pose) return;
    // Tables are level, so the edge to the right tells all; browsers differ in which axis leaves the picture.
    const right = new Vector3(1, 0, 0).applyQuaternion(quaternion(pose.orientation)).setY(0);
    if (right.length() < 0.5) return;
    if (this.boardSeenSecs === 0) this.handlers.showMessage(strings.headset.board);
    this.boardSeenSecs += Math.max(seconds, 1e-3);
    this.alignWorld(vector(pose.position), new Vector3(0, 1, 0).cross(right.normalize()), room.tableCenter);
  }

  /** Squeezing drags the world, the stick turns it about the person. */
  private dragWorld(space: XRReferenceSpace, seconds: number): void {
    const { rig } = this.stage.cameras;
    for (const source of this.handheldSources()) {
      const pad = source.gamepad;
      const grip = source.gripSpace && this.stage.renderer.xr.getFrame().getPose(source.gripSpace, space);
      const now = grip ? vector(grip.transform.position) : null;
      if (now && (pad?.buttons[SQUEEZE]?.pressed ?? false)) {
        const before = this.dragged.get(source);
        if (before) rig.position.sub(now.clone().sub(before).applyQuaternion(rig.quaternion));
        this.dragged.set(source, now);
      } else {
        this.dragged.delete(source);
      }
      const stick = pad?.axes[STICK_X] ?? 0;
      if (Math.abs(stick) > 0.3) {
        rig.quaternion.premultiply(new Quaternion().setFromAxisAngle(UP, -stick * TURN_SPEED_RAD_PER_S * Math.min(seconds, 0.1)));
      }
    }
  }

  /** Right hand: trigger or pinch WE, lower button WF, upper HO. Left trigger or pinch: HC. */
  private readButtons(): void {
    const read = new Map<string, { gesture: GestureKey; button: number; on: boolean }>();
    for (const { handedness, gamepad } of this.handheldSources()) {
      const note = (gesture: GestureKey, button: number) => {
        const source = `headset ${handedness} ${gesture}`;
        // A hand and what it holds may be two sources.
        const on = (gamepad?.buttons[button]?.pressed ?? false) || (read.get(source)?.on ?? false);
        read.set(source, { gesture, button, on });
      };
      note(handedness === "left" ? "hand_close" : "wrist_extension", TRIGGER);
      note("wrist_flexion", LOWER);
      note("hand_open", UPPER);
    }
    for (const [source, { gesture, button, on }] of read) {
      if (this.down.has(source) === on) continue;
      if (on) this.down.set(source, gesture);
      else this.down.delete(source);
      this.handlers.hold(source, gesture, on);
      if (on && button === TRIGGER) this.handlers.trigger();
    }
    // A hand that is gone lets go. It stays in `down`: a button still pressed when it is back is no new press.
    for (const [source, gesture] of this.down) {
      if (!read.has(source)) this.handlers.hold(source, gesture, false);
    }
  }
  /** The gestures whose buttons were pressed when they were last read. */
  private readonly down = new Map<string, GestureKey>();

  private async addEnterButton(mode: XRSessionMode, label: string): Promise<void> {
    const supported = await navigator.xr?.isSessionSupported(mode).catch(() => false);
    if (!supported) return;
    const button = element("button", "cog", label);
    button.type = "button";
    button.addEventListener("click", () => {
      button.blur();
      this.enter(mode).catch((error: unknown) => this.handlers.showMessage(`${label} failed: ${String(error)}`));
    });
    this.root.append(button);
    this.root.hidden = false;
  }

  private async enter(mode: XRSessionMode): Promise<void> {
    if (!navigator.xr || this.inHeadset) return;
    const { renderer, cameras, taskScene: room } = this.stage;
    const ar = mode === "immersive-ar";
    const board = ar ? await this.board : {};
    const session = await navigator.xr.requestSession(mode, {
      ...board,
      requiredFeatures: ["local-floor"],
      optionalFeatures: ["hand-tracking", "dom-overlay", ...(board.optionalFeatures ?? [])],
      ...(ar ? { domOverlay: { root: this.overlay } } : {}),
    });
    renderer.xr.enabled = true;
    renderer.xr.setReferenceSpaceType("local-floor");
    this.isPlaced = false;
    this.boardSeenSecs = 0;
    cameras.inHeadset = true;
    // The room that one stands in has a floor of its own.
    room?.showFloor(!ar);
    session.addEventListener("end", () => {
      cameras.inHeadset = false;
      renderer.xr.enabled = false;
      cameras.rig.position.set(0, 0, 0);
      cameras.rig.quaternion.identity();
      this.stage.taskScene?.showFloor(true);
      for (const [source, gesture] of this.down) this.handlers.hold(source, gesture, false);
      this.stage.resize();
    });
    await renderer.xr.setSession(session);
  }
}

function vector({ x, y, z }: DOMPointReadOnly): Vector3 {
  return new Vector3(x, y, z);
}

function quaternion({ x, y, z, w }: DOMPointReadOnly): Quaternion {
  return new Quaternion(x, y, z, w);
}
