// Height and distance made visible for methods that move one joint or axis after the other: a line from the hand's grip straight
// down to the table, a ring where it meets it, and a line from there to where the hand has to be.

import { BufferAttribute, BufferGeometry, Group, Line, LineBasicMaterial, Mesh, MeshBasicMaterial, RingGeometry } from "three";
import type { JogGoal } from "./jogGoal";

const COLOR = "#ffb000";
/** Above the table top, metres: enough for the depth buffer. */
const TABLE_OFFSET_M = 0.002;

export class HeightLine {
  readonly root = new Group();
  private readonly verticalLine = line();
  private readonly horizontalLine = line();
  private readonly ring = new Mesh(
    new RingGeometry(0.02, 0.026, 48),
    new MeshBasicMaterial({ color: COLOR, depthTest: false, transparent: true }),
  );

  constructor() {
    this.ring.renderOrder = 9;
    this.root.add(this.verticalLine, this.horizontalLine, this.ring);
  }

  update(aim: JogGoal | null, tableHeight: number): void {
    this.root.visible = aim !== null;
    if (!aim) return;
    const [x, y, z] = aim.from;
    const table = tableHeight + TABLE_OFFSET_M;
    setLine(this.verticalLine, [x, y, z], [x, y, table]);
    setLine(this.horizontalLine, [x, y, table], [aim.to[0], aim.to[1], table]);
    this.ring.position.set(x, y, table);
  }
}

function line(): Line<BufferGeometry, LineBasicMaterial> {
  const geometry = new BufferGeometry().setAttribute("position", new BufferAttribute(new Float32Array(6), 3));
  const made = new Line(geometry, new LineBasicMaterial({ color: COLOR, depthTest: false, transparent: true }));
  made.frustumCulled = false;
  made.renderOrder = 9;
  return made;
}

function setLine({ geometry }: Line, from: readonly number[], to: readonly number[]): void {
  const points = geometry.getAttribute("position");
  points.setXYZ(0, from[0] ?? 0, from[1] ?? 0, from[2] ?? 0);
  points.setXYZ(1, to[0] ?? 0, to[1] ?? 0, to[2] ?? 0);
  points.needsUpdate = true;
}
