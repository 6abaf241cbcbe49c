// Frames come at 60 Hz with the jitter of a network; the screen has its own rhythm. What is drawn lies a little
// in the past and between two frames, so that motion is smooth.

import { Quaternion, Vector3 } from "three";
import type { DisplayFrame, Pose } from "./generated/types";

/** How far behind the latest frame the picture is, ms of trial time: two frames at 60 Hz. */
const DELAY_MS = 34;
/** The picture jumps if it is further off than this, ms. */
const JUMP_MS = 300;
/** Frames kept, enough for the delay at any sensible rate. */
const MAX_FRAMES = 12;

export interface DrawnPose {
  position: Vector3;
  rotation: Quaternion;
}

/** What is drawn at one instant. */
export interface InterpolatedFrame {
  joints: number[];
  base: DrawnPose;
  tip: DrawnPose;
  head: DrawnPose;
  objects: DrawnPose[];
}

export class FrameInterpolator {
  private frames: DisplayFrame[] = [];
  private playhead = 0;
  private lastWallMs: number | null = null;
  /** Trial milliseconds per wall millisecond, as the frames arrive. */
  private rate = 1;
  private rateReference: { time: number; wall: number } | null = null;

  get latest(): DisplayFrame | null {
    return this.frames[this.frames.length - 1] ?? null;
  }

  /** The instant that was drawn last, ms of trial time. */
  get drawnTimeMs(): number {
    return this.playhead;
  }

  clear(): void {
    this.frames = [];
    this.rateReference = null;
    this.rate = 1;
  }

  push(frame: DisplayFrame, wallMs: number): void {
    const latest = this.latest;
    if (latest && frame.time < latest.time) this.clear();
    if (latest && frame.time === latest.time) this.frames.pop();
    this.frames.push(frame);
    if (this.frames.length > MAX_FRAMES) this.frames.shift();
    // The rate is measured over half a second, so that jitter does not show in it.
    if (!this.rateReference) {
      this.rateReference = { time: frame.time, wall: wallMs };
      this.playhead = frame.time - DELAY_MS;
    } else if (wallMs - this.rateReference.wall > 500) {
      const measured = (frame.time - this.rateReference.time) / (wallMs - this.rateReference.wall);
      this.rate += 0.5 * (Math.min(measured, 20) - this.rate);
      this.rateReference = { time: frame.time, wall: wallMs };
    }
  }

  /** The instant to draw now; none before the first frame. */
  interpolateAt(wallMs: number): InterpolatedFrame | null {
    const latest = this.latest;
    if (!latest) return null;
    const elapsed = this.lastWallMs === null ? 0 : Math.min(wallMs - this.lastWallMs, 200);
    this.lastWallMs = wallMs;
    const goal = latest.time - DELAY_MS * Math.max(this.rate, 0.2);
    this.playhead += elapsed * this.rate;
    // The playhead follows the frames gently; after a pause of the page it jumps.
    const off = goal - this.playhead;
    this.playhead = Math.abs(off) > JUMP_MS ? goal : this.playhead + off * Math.min(elapsed / 200, 1);
    this.playhead = Math.min(this.playhead, latest.time);
    let next = this.frames.findIndex((frame) => frame.time >= this.playhead);
    if (next < 0) next = this.frames.length - 1;
    const to = this.frames[next] ?? latest;
    const from = this.frames[Math.max(next - 1, 0)] ?? to;
    const span = to.time - from.time;
    const share = span > 0 ? Math.min(Math.max((this.playhead - from.time) / span, 0), 1) : 1;
    return interpolateFrames(from, to, share);
  }
}

/** What to draw a share of the way from one frame to the next. */
export function interpolateFrames(from: DisplayFrame, to: DisplayFrame, share: number): InterpolatedFrame {
  return {
    joints: to.joints.map((angle, k) => {
      const before = from.joints[k] ?? angle;
      return before + share * (angle - before);
    }),
    base: interpolatePose(from.world_from_base, to.world_from_base, share),
    tip: interpolatePose(from.world_from_tip, to.world_from_tip, share),
    head: interpolatePose(from.world_from_head, to.world_from_head, share),
    objects: to.objects.map((pose, k) => interpolatePose(from.objects[k] ?? pose, pose, share)),
  };
}

function interpolatePose(from: Pose, to: Pose, share: number): DrawnPose {
  return {
    position: new Vector3(...from.translation).lerp(new Vector3(...to.translation), share),
    rotation: new Quaternion(...from.rotation).slerp(new Quaternion(...to.rotation), share),
  };
}
