// Everything except the arm: what is fixed, objects, targets.

import {
  CanvasTexture,
  CircleGeometry,
  Group,
  Mesh,
  MeshBasicMaterial,
  MeshStandardMaterial,
  Object3D,
  RepeatWrapping,
  RingGeometry,
  SphereGeometry,
  SRGBColorSpace,
  ShadowMaterial,
  Vector3,
} from "three";
import { InstanceGroup } from "./instancing";
import { LARGE_ONLY } from "./insets";
import type { DrawnPose } from "./frameInterpolation";
import type { ObjectId, Scene, Shape, TaskGoal } from "./generated/types";
import { setSceneObjects, objectColor, objectLabel } from "./objects";
import { drawnTexture, setPose, shapeGeometry, writeText } from "./shapes";

/** The disc has this share of the radius in which an object counts, as in the original's display. */
const DISC_RADIUS_FRACTION = 0.6;
/** Height of flat things above the table, metres: enough for the depth buffer, too little to see. */
const TABLE_OFFSET_M = 0.0006;

export class TaskScene {
  readonly root = new Group();
  readonly objects: { id: ObjectId; group: Group; body: Mesh; shape: Shape }[] = [];
  readonly targets: { object: ObjectId; centre: Vector3; group: Group; glow: MeshBasicMaterial }[] = [];
  private readonly instanceGroups: InstanceGroup[];
  /** The ball that the hand is asked into. */
  private readonly ball = new Mesh(
    new SphereGeometry(1, 48, 24),
    new MeshBasicMaterial({ color: "#1d8f5a", transparent: true, opacity: 0.3, depthWrite: false }),
  );
  /** Objects that have a target, or several. */
  readonly objectsWithTarget: ObjectId[];
  private taskGoal: TaskGoal | null = null;
  readonly tableHeight: number;
  /** Middle of the table top. */
  readonly tableCenter: Vector3;
  /** Half sizes of the table top along x and y. */
  readonly tableHalfSize: { x: number; y: number };

  constructor(scene: Scene) {
    setSceneObjects(scene);
    this.tableHeight = scene.table_height;
    const table = scene.fixed.find((object) => object.name === "table" && object.shape.type === "box");
    const middle = table?.pose.translation ?? [0, 0, scene.table_height];
    this.tableCenter = new Vector3(middle[0], middle[1], scene.table_height);
    const size = table?.shape.type === "box" ? table.shape.size : [0.4, 0.6, 0.03];
    this.tableHalfSize = { x: (size[0] ?? 0.4) / 2, y: (size[1] ?? 0.6) / 2 };
    for (const object of scene.fixed) this.root.add(fixedObject(object));
    this.ball.visible = false;
    this.root.add(this.ball);
    scene.objects.forEach(({ shape, pose }, id) => {
      const { group, body } = labeledObject(id, shape);
      setPose(group, pose);
      this.objects.push({ id, group, body, shape });
      this.root.add(group);
    });
    // Objects with something painted on them are drawn one by one.
    const kind = ({ id, shape }: { id: ObjectId; shape: Shape }) =>
      objectLabel(id) === "" ? JSON.stringify([shape, objectColor(id)]) : null;
    this.instanceGroups = InstanceGroup.groupByKind(this.objects, kind);
    for (const { mesh } of this.instanceGroups) this.root.add(mesh);
    for (const target of scene.targets) {
      const { group, glow } = targetDisc(target.object, target.radius);
      const centre = new Vector3(...target.centre);
      group.position.copy(centre);
      this.targets.push({ object: target.object, centre, group, glow });
      this.root.add(group);
    }
    this.objectsWithTarget = [...new Set(scene.targets.map(({ object }) => object))];
  }

  /** The disc under the table; in a real room it is in the way. */
  showFloor(on: boolean): void {
    for (const part of this.root.children) if (part.name === "floor") part.visible = on;
  }

  update(objects: DrawnPose[], holds: ObjectId | null, asked: TaskGoal | null, seconds: number): void {
    this.objects.forEach(({ group }, k) => {
      const pose = objects[k];
      if (!pose) return;
      group.position.copy(pose.position);
      group.quaternion.copy(pose.rotation);
    });
    for (const crowd of this.instanceGroups) crowd.update();
    this.taskGoal = asked;
    for (const { object, centre, glow } of this.targets) {
      // The target of the carried object calls for it; of several, the one that is asked for.
      const calls = object === holds && isAsked(centre, asked);
      glow.opacity = calls ? 0.5 + 0.2 * Math.sin(5 * seconds) : 0.16;
      // And is seen through the arm, which often is in the way.
      glow.depthTest = !calls;
    }
    this.ball.visible = asked?.type === "ball";
    if (asked?.type === "ball") {
      this.ball.position.set(...asked.centre);
      this.ball.scale.setScalar(asked.radius);
    }
  }

  /** Where the target of an object is; of several, the one that is asked for. */
  target(id: ObjectId): Vector3 | undefined {
    const own = this.targets.filter(({ object }) => object === id);
    return (own.find(({ centre }) => isAsked(centre, this.taskGoal)) ?? own[0])?.centre;
  }

  object(id: ObjectId): Group | undefined {
    return this.objects[id]?.group;
  }
}

/** Whether a target is the one that the task asks for, where it asks for one after the other. */
function isAsked(centre: Vector3, asked: TaskGoal | null): boolean {
  return asked?.type !== "disc" || centre.distanceTo(new Vector3(...asked.centre)) < 1e-3;
}

function fixedObject(object: { name: string; shape: Shape; pose: Parameters<typeof setPose>[1] }): Object3D {
  if (object.name === "floor" && object.shape.type === "box") {
    return floor(object.pose.translation[2] + object.shape.size[2] / 2);
  }
  const mesh = new Mesh(shapeGeometry(object.shape), woodMaterial(object.name));
  if (object.name.startsWith("leg")) mesh.layers.set(LARGE_ONLY);
  setPose(mesh, object.pose);
  mesh.castShadow = true;
  mesh.receiveShadow = true;
  return mesh;
}

function woodMaterial(name: string): MeshStandardMaterial {
  const [colour, grain] = name.startsWith("table")
    ? ["#d9b98c", "#c6a170"]
    : name.startsWith("leg")
      ? ["#54402f", "#473526"]
      : name === "partition"
        ? ["#5f4230", "#4e3526"]
        : ["#84603f", "#6f4f33"];
  return new MeshStandardMaterial({ map: grainTexture(colour ?? "", grain ?? ""), roughness: 0.72 });
}

/** Wood: long soft streaks, drawn from a fixed sequence so that every visit looks the same. */
function grainTexture(colour: string, grain: string): CanvasTexture {
  const canvas = document.createElement("canvas");
  canvas.width = 512;
  canvas.height = 256;
  const context = canvas.getContext("2d");
  if (!context) throw new Error("this browser cannot draw on a canvas");
  context.fillStyle = colour;
  context.fillRect(0, 0, 512, 256);
  context.strokeStyle = grain;
  let state = 12345;
  const random = () => (state = (state * 16807) % 2147483647) / 2147483647;
  for (let streak = 0; streak < 110; streak++) {
    const y = random() * 256;
    const bend = (random() - 0.5) * 14;
    context.globalAlpha = 0.06 + 0.22 * random();
    context.lineWidth = 0.6 + 2.2 * random();
    context.beginPath();
    context.moveTo(0, y);
    context.bezierCurveTo(170, y + bend, 340, y - bend, 512, y);
    context.stroke();
  }
  const texture = new CanvasTexture(canvas);
  texture.colorSpace = SRGBColorSpace;
  texture.wrapS = texture.wrapT = RepeatWrapping;
  texture.anisotropy = 8;
  return texture;
}

/** A disc that fades into the background, and the shadows on it. */
function floor(height: number): Object3D {
  const group = new Group();
  group.name = "floor";
  const fade = drawnTexture((context) => {
    const gradient = context.createRadialGradient(0, 0, 0.1, 0, 0, 1);
    gradient.addColorStop(0, "rgba(255,255,255,0.95)");
    gradient.addColorStop(0.55, "rgba(255,255,255,0.45)");
    gradient.addColorStop(1, "rgba(255,255,255,0)");
    context.fillStyle = gradient;
    context.fillRect(-1, -1, 2, 2);
  });
  const disc = new Mesh(
    new CircleGeometry(3, 64),
    new MeshBasicMaterial({ map: fade, transparent: true, depthWrite: false, color: "#c9d1d8" }),
  );
  const shadow = new Mesh(new CircleGeometry(3, 64), new ShadowMaterial({ opacity: 0.16 }));
  shadow.receiveShadow = true;
  disc.layers.set(LARGE_ONLY);
  shadow.layers.set(LARGE_ONLY);
  disc.position.z = height - 0.002;
  shadow.position.z = height;
  group.add(disc, shadow);
  return group;
}

function labeledObject(id: ObjectId, shape: Shape): { group: Group; body: Mesh } {
  const group = new Group();
  const colour = objectColor(id);
  const body = new Mesh(shapeGeometry(shape), new MeshStandardMaterial({ color: colour, roughness: 0.42 }));
  body.castShadow = true;
  body.receiveShadow = true;
  group.add(body);
  const radius = shape.type === "cylinder" ? shape.radius : shape.type === "box" ? shape.size[0] / 2 : 0;
  const height = shape.type === "cylinder" ? shape.length : shape.type === "box" ? shape.size[2] : 0;
  if (radius > 0 && objectLabel(id) !== "") {
    const label = drawnTexture((context) => {
      context.fillStyle = colour;
      context.fillRect(-1, -1, 2, 2);
      context.strokeStyle = "rgba(255,255,255,0.9)";
      context.lineWidth = 0.09;
      context.beginPath();
      context.arc(0, 0, 0.9, 0, 2 * Math.PI);
      context.stroke();
      writeText(context, objectLabel(id), textHeight(objectLabel(id), 1.3), "#ffffff");
    });
    const material = new MeshStandardMaterial({ map: label, roughness: 0.5 });
    // On top and underneath: it may have tipped over. The person looks along x, so x is up in the text.
    for (const side of [1, -1]) {
      const disc = new Mesh(new CircleGeometry(0.86 * radius, 48), material);
      disc.position.z = side * (height / 2 + 0.0003);
      if (side < 0) disc.rotation.x = Math.PI;
      disc.rotateZ(-Math.PI / 2);
      disc.receiveShadow = true;
      group.add(disc);
    }
  }
  return { group, body };
}

/** Two figures need a smaller letter than one. */
function textHeight(text: string, one: number): number {
  return text.length > 1 ? one / (0.35 + 0.55 * text.length) : one;
}

function targetDisc(id: ObjectId, success: number): { group: Group; glow: MeshBasicMaterial } {
  const group = new Group();
  const colour = objectColor(id);
  const radius = DISC_RADIUS_FRACTION * success;
  const face = drawnTexture((context) => {
    context.fillStyle = "#fbf8f2";
    context.beginPath();
    context.arc(0, 0, 1, 0, 2 * Math.PI);
    context.fill();
    context.strokeStyle = colour;
    context.lineWidth = 0.2;
    context.beginPath();
    context.arc(0, 0, 0.89, 0, 2 * Math.PI);
    context.stroke();
    writeText(context, objectLabel(id), textHeight(objectLabel(id), 1.05), colour);
  });
  const disc = new Mesh(
    new CircleGeometry(radius, 64),
    new MeshStandardMaterial({ map: face, transparent: true, roughness: 0.9 }),
  );
  disc.rotation.z = -Math.PI / 2;
  disc.position.z = TABLE_OFFSET_M;
  disc.receiveShadow = true;
  const glow = new MeshBasicMaterial({ color: colour, transparent: true, opacity: 0.16, depthWrite: false });
  const ring = new Mesh(new RingGeometry(radius + 0.002, success, 64), glow);
  ring.position.z = TABLE_OFFSET_M / 2;
  group.add(disc, ring);
  return { group, glow };
}
