// Where the hand has to go with methods that move one joint or axis after the other: how far, in which direction, and which
// way comes next. Pure. Vectors and quaternions as in frames; metres, rad.

import type { ArmModel, DisplayFrame, Grasp, ObjectId, Scene, Shape } from "./generated/types";

type Vector = readonly [number, number, number];
type Quaternion = readonly [number, number, number, number];

/** The hand passes this high over the table, as its grip or as the block in it: over walls, and over the partition. */
const WALL_CLEARANCE_M = 0.17;
const PARTITION_CLEARANCE_M = 0.25;
/** The block is let go of this high, and gripped this much above its middle. */
const RELEASE_HEIGHT_M = 0.037;
const GRASP_HEIGHT_M = 0.002;
/** So near is near enough: sideways before the hand goes down, and once it is down; in height; of a target. */
const LATERAL_TOLERANCE_M = { before: 0.012, below: 0.025 };
const HEIGHT_TOLERANCE_M = 0.012;
const TARGET_TOLERANCE_M = 0.02;
/** So little is left of a turn when the next one comes, rad. */
const TURN_TOLERANCE_RAD = 0.06;
/** Share of what a grasp allows in tilt that is used: the rest is for the way down. */
const TILT_FRACTION = 0.7;

/** One way: along or about an axis of the base. */
export interface JogMove {
  kind: "slide" | "turn";
  /** 0 x, 1 y, 2 z. */
  axis: 0 | 1 | 2;
  /** How far, with its sign: m or rad. */
  amount: number;
}

export interface JogGoal {
  /** What is to be gripped, or is in the hand. */
  object: ObjectId;
  /** The middle of the hand's grip, or of the block in it, in `world`. */
  from: Vector;
  /** Where that has to go in the end, in `world`. */
  to: Vector;
  /** From one to the other along the base's axes. */
  offset: Vector;
  /** What comes next; none when the hand is to close or to open. */
  nextMove: JogMove | null;
}

/** The axis that is chosen now: it is used up first, since going on to the next costs more than the way. */
interface SelectedAxes {
  slide: number | null;
  turn: number | null;
}

/** What to aim at now; none when no object is left, or the task gives no place to put it. */
export function jogGoal(frame: DisplayFrame, arm: ArmModel, scene: Scene): JogGoal | null {
  const held = frame.hand.holds;
  const object = held ?? frame.next;
  if (object === null) return null;
  const at = frame.objects[object];
  const shape = scene.objects[object]?.shape;
  const grasp = graspOf(arm, shape);
  if (!at || !grasp) return null;
  const base = frame.world_from_base.rotation as Quaternion;
  const moves = frame.mode?.moves;
  const chosen: SelectedAxes = {
    slide: moves && "translation" in moves ? moves.translation : null,
    turn: moves && "rotation" in moves ? moves.rotation : null,
  };
  const place = at.translation as Vector;
  if (held !== null) {
    const own = scene.targets.find((candidate) => candidate.object === held)?.centre;
    const target = (frame.asked?.type === "disc" ? frame.asked.centre : own) as Vector | undefined;
    if (!target) return null;
    const to: Vector = [target[0], target[1], target[2] + RELEASE_HEIGHT_M];
    const off = rotateInverse(base, minus(to, place));
    return { object, from: place, to, offset: off, nextMove: nextCarryMove(off, place[2] - scene.table_height, chosen) };
  }
  const tip = frame.world_from_tip;
  const from = plus(tip.translation as Vector, rotate(tip.rotation as Quaternion, grasp.centre as Vector));
  const to: Vector = [place[0], place[1], place[2] + GRASP_HEIGHT_M];
  const off = rotateInverse(base, minus(to, from));
  const tilt = tiltCorrection(tip.rotation as Quaternion, grasp);
  return { object, from, to, offset: off, nextMove: nextReachMove(off, from[2] - scene.table_height, tilt && rotateInverse(base, tilt), chosen) };
}

/** The grasp for an object of this shape: the first that is wide enough. */
function graspOf(arm: ArmModel, shape: Shape | undefined): Grasp | undefined {
  const width = shape === undefined ? 0.05 : shape.type === "box" ? Math.min(shape.size[0] ?? 0, shape.size[1] ?? 0) : 2 * shape.radius;
  return arm.grasps.find(({ widths }) => width <= (widths[1] ?? 0)) ?? arm.grasps[arm.grasps.length - 1];
}

/** Upright enough first, then high enough, then over the block, then down. */
function nextReachMove(off: Vector, height: number, tilt: Vector | null, chosen: SelectedAxes): JogMove | null {
  const beside = Math.hypot(off[0], off[1]);
  const low = height < WALL_CLEARANCE_M - 0.02;
  if (low && beside > 2 * LATERAL_TOLERANCE_M.below) return { kind: "slide", axis: 2, amount: WALL_CLEARANCE_M - height };
  if (tilt) {
    const axis = remainingSelectedAxis(tilt, chosen.turn, TURN_TOLERANCE_RAD) ?? largestAxis(tilt);
    return { kind: "turn", axis, amount: tilt[axis] };
  }
  const sideways = horizontalMove(off, low ? LATERAL_TOLERANCE_M.below : LATERAL_TOLERANCE_M.before, chosen);
  if (sideways) return sideways;
  return Math.abs(off[2]) > HEIGHT_TOLERANCE_M ? { kind: "slide", axis: 2, amount: off[2] } : null;
}

/** Up over the partition, across, then down. */
function nextCarryMove(off: Vector, height: number, chosen: SelectedAxes): JogMove | null {
  const sideways = horizontalMove(off, TARGET_TOLERANCE_M, chosen);
  if (sideways && height < PARTITION_CLEARANCE_M - 0.02 && Math.hypot(off[0], off[1]) > 2 * TARGET_TOLERANCE_M) {
    return { kind: "slide", axis: 2, amount: PARTITION_CLEARANCE_M - height };
  }
  if (sideways) return sideways;
  return Math.abs(off[2]) > HEIGHT_TOLERANCE_M ? { kind: "slide", axis: 2, amount: off[2] } : null;
}

/** What is left along the chosen one of x and y, else along the one with more. */
function horizontalMove(off: Vector, enough: number, chosen: SelectedAxes): JogMove | null {
  if (Math.max(Math.abs(off[0]), Math.abs(off[1])) <= enough) return null;
  const flat: Vector = [off[0], off[1], 0];
  const axis = remainingSelectedAxis(flat, chosen.slide, enough) ?? largestAxis(flat);
  return { kind: "slide", axis, amount: off[axis] };
}

/** The chosen axis, if more than `enough` is left along it. */
function remainingSelectedAxis(left: Vector, chosen: number | null, enough: number): 0 | 1 | 2 | null {
  return chosen !== null && Math.abs(left[chosen] ?? 0) > enough ? (chosen as 0 | 1 | 2) : null;
}

/** The turn in `world` that brings the hand upright, as far as its grasp asks for it; none if it is upright enough. */
function tiltCorrection(rotation: Quaternion, { roll, roll_range, lean }: Grasp): Vector | null {
  const up = rotateInverse(rotation, [0, 0, 1]);
  const nowLean = Math.asin(Math.min(Math.max(up[0], -1), 1));
  const nowRoll = Math.atan2(up[1], up[2]);
  const [least, most] = [roll_range[0] ?? roll, roll_range[1] ?? roll];
  const inside = (value: number, a: number, b: number) => value >= roll + TILT_FRACTION * (a - roll) && value <= roll + TILT_FRACTION * (b - roll);
  if (Math.abs(nowLean) <= TILT_FRACTION * lean && inside(nowRoll, least, most)) return null;
  // The shortest turn from where the hand's own up is to the world's.
  const own = rotate(rotation, [0, Math.sin(roll), Math.cos(roll)]);
  const axis: Vector = [own[1], -own[0], 0];
  const sine = Math.hypot(axis[0], axis[1]);
  const angle = Math.atan2(sine, own[2]);
  return sine < 1e-6 ? [angle, 0, 0] : [(axis[0] / sine) * angle, (axis[1] / sine) * angle, 0];
}

function largestAxis(v: Vector): 0 | 1 | 2 {
  const sizes = v.map(Math.abs);
  return sizes.indexOf(Math.max(...sizes)) as 0 | 1 | 2;
}

function plus(a: Vector, b: Vector): Vector {
  return [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
}

function minus(a: Vector, b: Vector): Vector {
  return [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
}

function rotate([x, y, z, w]: Quaternion, v: Vector): Vector {
  const cross = (a: Vector, b: Vector): Vector => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const q: Vector = [x, y, z];
  const t = cross(q, v).map((value) => 2 * value) as unknown as Vector;
  const u = cross(q, t);
  return [v[0] + w * t[0] + u[0], v[1] + w * t[1] + u[1], v[2] + w * t[2] + u[2]];
}

/** From `world` into the frame that is turned by `rotation`. */
function rotateInverse([x, y, z, w]: Quaternion, v: Vector): Vector {
  return rotate([-x, -y, -z, w], v);
}
