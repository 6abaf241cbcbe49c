// Depth made visible on a flat screen: a soft shadow straight below the hand and below the object in it, whatever the lights do, and
// a line from each down to it. Methods that move joints or axes have a plumb line of their own.

import { BufferAttribute, BufferGeometry, Group, Line, LineBasicMaterial, Mesh, MeshBasicMaterial, PlaneGeometry, Vector3 } from "three";
import type { InterpolatedFrame, DrawnPose } from "./frameInterpolation";
import type { ArmModel, DisplayFrame } from "./generated/types";
import type { TaskScene } from "./scene";
import { drawnTexture } from "./shapes";

const LINE_COLOR = "#20303c";
/** Above the table top, metres: enough for the depth buffer. */
const TABLE_OFFSET_M = 0.0015;
/** Radius of the shadow of what lies on the table, and by how much it grows a metre up, metres. */
const SHADOW_RADIUS_M = { hand: 0.045, object: 0.034 };
const SHADOW_GROWTH = 0.12;
/** It fades with the height, metres, and is this strong at the table. */
const FADE_M = 0.45;
const SHADOW_OPACITY = 0.55;

class DropShadow {
  readonly root = new Group();
  private readonly line: Line<BufferGeometry, LineBasicMaterial>;
  private readonly shadow: Mesh<PlaneGeometry, MeshBasicMaterial>;

  constructor(
    map: MeshBasicMaterial["map"],
    private readonly radius: number,
  ) {
    const geometry = new BufferGeometry().setAttribute("position", new BufferAttribute(new Float32Array(6), 3));
    this.line = new Line(geometry, new LineBasicMaterial({ color: LINE_COLOR, transparent: true, opacity: 0.45 }));
    this.line.frustumCulled = false;
    this.shadow = new Mesh(new PlaneGeometry(2, 2), new MeshBasicMaterial({ map, transparent: true, depthWrite: false }));
    this.shadow.renderOrder = 1;
    this.root.add(this.line, this.shadow);
  }

  /** Below `at`; the line only where it is asked for. */
  setPosition({ x, y, z }: Vector3, table: number, lined: boolean): void {
    const height = Math.max(z - table, 0);
    this.shadow.position.set(x, y, table + TABLE_OFFSET_M);
    this.shadow.scale.setScalar(this.radius + SHADOW_GROWTH * height);
    this.shadow.material.opacity = SHADOW_OPACITY * Math.exp(-height / FADE_M);
    this.line.visible = lined;
    const points = this.line.geometry.getAttribute("position");
    points.setXYZ(0, x, y, z);
    points.setXYZ(1, x, y, table + TABLE_OFFSET_M);
    points.needsUpdate = true;
  }
}

export class DepthCues {
  readonly root = new Group();
  private readonly hand: DropShadow;
  private readonly held: DropShadow;
  /** The middle of the widest grip, in the tip's frame. */
  private readonly grip: Vector3;

  constructor({ grasps }: ArmModel) {
    const soft = drawnTexture((context) => {
      const gradient = context.createRadialGradient(0, 0, 0, 0, 0, 1);
      gradient.addColorStop(0, "rgba(15,20,26,1)");
      gradient.addColorStop(0.5, "rgba(15,20,26,0.6)");
      gradient.addColorStop(1, "rgba(15,20,26,0)");
      context.fillStyle = gradient;
      context.fillRect(-1, -1, 2, 2);
    }, 128);
    this.hand = new DropShadow(soft, SHADOW_RADIUS_M.hand);
    this.held = new DropShadow(soft, SHADOW_RADIUS_M.object);
    this.grip = new Vector3(...(grasps[grasps.length - 1]?.centre ?? [0, 0, 0]));
    this.root.add(this.hand.root, this.held.root);
  }

  /** `plumbed`: another line goes down from the hand already. */
  update(frame: DisplayFrame, drawn: InterpolatedFrame, room: TaskScene, plumbed: boolean): void {
    const { holds } = frame.hand;
    const held = holds === null ? undefined : drawn.objects[holds];
    this.hand.root.visible = held === undefined;
    this.held.root.visible = held !== undefined;
    const at = held ? held.position : gripOf(drawn.tip, this.grip);
    (held ? this.held : this.hand).setPosition(at, room.tableHeight, !plumbed);
    // Beside the table there is nothing to fall on.
    const { tableCenter: centre, tableHalfSize: half } = room;
    this.root.visible = Math.abs(at.x - centre.x) < half.x && Math.abs(at.y - centre.y) < half.y;
  }
}

function gripOf({ position, rotation }: DrawnPose, grip: Vector3): Vector3 {
  return grip.clone().applyQuaternion(rotation).add(position);
}
