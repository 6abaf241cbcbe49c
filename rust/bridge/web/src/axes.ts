// Which joint or axis WE and WF move, in methods A and B: the axes of the shoulder frame with the chosen one
// highlighted, at the shoulder and once more at the hand, or a ring about the chosen joint.

import { ConeGeometry, CylinderGeometry, Group, Mesh, MeshBasicMaterial, TorusGeometry, Vector3 } from "three";
import type { Arm } from "./arm";
import type { InterpolatedFrame } from "./frameInterpolation";
import type { DisplayFrame, ControlledDof } from "./generated/types";

/** Length of an axis at the shoulder and at the hand, metres. */
const AXIS_LENGTH_M = 0.22;
const HAND_AXIS_SCALE = 0.7;
const SELECTED_COLOR = "#ffb000";
const UNSELECTED_COLOR = "#6f7d8a";
const UP = new Vector3(0, 1, 0);

export class AxisDisplay {
  readonly root = new Group();
  private readonly triads = [new Triad(), new Triad()] as const;
  private readonly ring = rotationArrow();
  private readonly place = new Vector3();
  private readonly forward = new Vector3();

  constructor(private readonly arm: Arm) {
    this.triads[1].root.scale.setScalar(HAND_AXIS_SCALE);
    this.root.add(this.triads[0].root, this.triads[1].root, this.ring);
  }

  update(frame: DisplayFrame, drawn: InterpolatedFrame): void {
    const { mode, gesture } = frame;
    this.root.visible = mode !== null && !frame.finished;
    if (!mode) return;
    const sign = mode.we_sign < 0 ? -1 : 1;
    const moves = gesture === "wrist_extension" ? sign : gesture === "wrist_flexion" ? -sign : 0;
    const chosenMove = mode.moves;
    const joint = "joint" in chosenMove;
    for (const triad of this.triads) triad.root.visible = !joint;
    this.ring.visible = joint;
    if (joint) {
      const chosen = this.arm.joint(chosenMove.joint);
      this.ring.visible = chosen !== undefined;
      if (!chosen) return;
      chosen.turn.getWorldPosition(this.place);
      this.forward.copy(chosen.axis).transformDirection(chosen.turn.matrixWorld);
      this.ring.position.copy(this.place);
      this.ring.quaternion.setFromUnitVectors(UP, this.forward.multiplyScalar(moves === 0 ? sign : moves));
      this.ring.scale.setScalar(moves === 0 ? 1 : 1.12);
      return;
    }
    this.triads[0].root.position.copy(drawn.base.position);
    this.triads[1].root.position.copy(drawn.tip.position);
    for (const triad of this.triads) {
      triad.root.quaternion.copy(drawn.base.rotation);
      triad.select(chosenMove, moves === 0 ? sign : moves, moves !== 0);
    }
  }
}

/** Three arrows; the chosen one stands out in colour and thickness, and says in which direction it moves. */
class Triad {
  readonly root = new Group();
  private readonly arrows = [new Vector3(1, 0, 0), new Vector3(0, 1, 0), new Vector3(0, 0, 1)].map((axis) => {
    const line = arrow(0.004, UNSELECTED_COLOR);
    line.quaternion.setFromUnitVectors(UP, axis);
    this.root.add(line);
    return line;
  });
  private readonly selected = arrow(0.009, SELECTED_COLOR);
  private readonly turn = rotationArrow();

  constructor() {
    this.root.add(this.selected, this.turn);
  }

  select(what: Exclude<ControlledDof, { joint: number }>, sign: number, moving: boolean): void {
    const turns = "rotation" in what;
    const axis = turns ? what.rotation : what.translation;
    const direction = new Vector3().setComponent(axis, sign);
    this.arrows.forEach((line, k) => (line.visible = turns || k !== axis));
    this.selected.visible = !turns;
    this.turn.visible = turns;
    const shown = turns ? this.turn : this.selected;
    shown.quaternion.setFromUnitVectors(UP, direction);
    shown.scale.setScalar(moving ? 1.15 : 1);
  }
}

/** Seen through everything: it tells of what is inside the arm. */
function material(colour: string): MeshBasicMaterial {
  return new MeshBasicMaterial({ color: colour, depthTest: false, transparent: true, opacity: 0.92 });
}

/** An arrow along y from the origin. */
function arrow(radius: number, colour: string): Group {
  const group = new Group();
  const paint = material(colour);
  const head = 6 * radius;
  const shaft = new Mesh(new CylinderGeometry(radius, radius, AXIS_LENGTH_M - head, 16), paint);
  shaft.position.y = (AXIS_LENGTH_M - head) / 2;
  const tip = new Mesh(new ConeGeometry(2.6 * radius, head, 24), paint);
  tip.position.y = AXIS_LENGTH_M - head / 2;
  group.add(shaft, tip);
  for (const part of group.children) part.renderOrder = 8;
  return group;
}

/** Three quarters of a ring about y with a head, as a right-handed turn goes. */
function rotationArrow(): Group {
  const group = new Group();
  const paint = material(SELECTED_COLOR);
  const radius = 0.085;
  const sweep = 1.5 * Math.PI;
  // Torus lies in x, y about z: turned so that z becomes y and the sense of the turn stays.
  const ring = new Mesh(new TorusGeometry(radius, 0.006, 12, 48, sweep), paint);
  const head = new Mesh(new ConeGeometry(0.02, 0.045, 24), paint);
  head.position.set(radius * Math.cos(sweep), radius * Math.sin(sweep), 0);
  head.rotation.z = sweep;
  const flat = new Group();
  flat.add(ring, head);
  flat.rotation.x = -Math.PI / 2;
  const axis = new Mesh(new CylinderGeometry(0.003, 0.003, 0.2, 12), material(UNSELECTED_COLOR));
  group.add(flat, axis);
  group.traverse((part) => (part.renderOrder = 8));
  return group;
}
