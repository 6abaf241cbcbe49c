// The arm: its link tree as nested groups, so that one angle per joint is all that changes.

import {
  type BufferGeometry,
  Color,
  Group,
  type Material,
  Mesh,
  MeshBasicMaterial,
  MeshStandardMaterial,
  Object3D,
  Quaternion,
  Vector3,
} from "three";
import { STLLoader } from "three/addons/loaders/STLLoader.js";
import { mergeVertices, toCreasedNormals } from "three/addons/utils/BufferGeometryUtils.js";
import type { DrawnPose } from "./frameInterpolation";
import type { ArmModel, Link, MeshFile } from "./generated/types";
import { setPose, shapeGeometry } from "./shapes";

/** Edges sharper than this stay sharp, rad. */
const CREASE_RAD = 0.6;
const DEFAULT_COLOR = [...new Color("#b9bec4").toArray(), 1] as [number, number, number, number];
const GHOST_COLOR = "#3aa7e0";

/** As it is; the hand alone, to be seen through; or the whole arm in a colour of its own. */
export type ArmStyle = "solid" | "hand" | "shade";

/** Mesh files, loaded once however many links and arms use them (fingers do). */
export class MeshCache {
  private readonly loader = new STLLoader();
  private readonly geometries = new Map<string, Promise<BufferGeometry>>();

  geometry(id: string): Promise<BufferGeometry> {
    let geometry = this.geometries.get(id);
    if (!geometry) {
      geometry = this.loader
        .loadAsync(`/meshes/${encodeURIComponent(id)}`)
        // Smooth where the surface is; shared corners are computed once.
        .then((loaded) => mergeVertices(toCreasedNormals(loaded, CREASE_RAD)));
      this.geometries.set(id, geometry);
    }
    return geometry;
  }

  /** What was handed out is disposed of with the arm that it belonged to. */
  clear(): void {
    this.geometries.clear();
  }
}

export class Arm {
  readonly root = new Group();
  private readonly moving: { turn: Object3D; axis: Vector3 }[];
  private readonly links: Object3D[];
  private readonly materials = new Map<string, Material>();
  private readonly scratchQuaternion = new Quaternion();

  constructor(
    private readonly model: ArmModel,
    private readonly files: MeshFile[],
    private readonly meshes: MeshCache,
    private readonly failed: (message: string) => void,
    private readonly look: ArmStyle = "solid",
  ) {
    this.root.name = model.name;
    this.links = [this.root];
    const turns: { turn: Object3D; axis: Vector3 }[] = [];
    // Parents stand before their children, and joint k moves link k + 1.
    for (const joint of model.joints) {
      const origin = new Group();
      setPose(origin, joint.origin);
      const turn = new Group();
      origin.add(turn);
      this.links[joint.parent]?.add(origin);
      this.links[joint.child] = turn;
      turns.push({ turn, axis: new Vector3(...joint.axis) });
    }
    // Below the tip is the hand: parents stand before their children.
    const inHand = new Set([model.tip]);
    for (const joint of model.joints) if (inHand.has(joint.parent)) inHand.add(joint.child);
    model.links.forEach((link, k) => {
      if (look !== "hand" || inHand.has(k)) this.addVisuals(this.links[k], link);
    });
    this.moving = [...model.arm, ...model.hand].flatMap((joint) => turns[joint] ?? []);
  }

  /** The group that turns with the k-th arm joint, and the joint's axis in it. */
  joint(k: number): { turn: Object3D; axis: Vector3 } | undefined {
    return k < this.model.arm.length ? this.moving[k] : undefined;
  }

  update(base: DrawnPose, joints: number[]): void {
    this.root.position.copy(base.position);
    this.root.quaternion.copy(base.rotation);
    this.moving.forEach(({ turn, axis }, k) => {
      const angle = joints[k];
      if (angle !== undefined && Number.isFinite(angle)) {
        turn.quaternion.copy(this.scratchQuaternion.setFromAxisAngle(axis, angle));
      }
    });
  }

  /** Colour and opacity of an arm that is a shade, 0 to 1. */
  setColor(colour: readonly [number, number, number], opacity: number): void {
    const material = this.material(DEFAULT_COLOR);
    if (!(material instanceof MeshBasicMaterial)) return;
    material.color.setRGB(...colour, "srgb");
    material.opacity = opacity;
  }

  private addVisuals(group: Object3D | undefined, link: Link): void {
    if (!group) return;
    for (const visual of link.visuals) {
      const material = this.material(visual.colour);
      if ("shape" in visual.geometry) {
        this.attach(group, new Mesh(shapeGeometry(visual.geometry.shape), material), visual.pose);
        continue;
      }
      const { file, scale } = visual.geometry.mesh;
      const missing = () => {
        this.failed(`mesh ${file} is missing; its link is drawn by its collision shapes`);
        this.addCollisionShapes(group, link);
      };
      const id = this.files.find(({ address }) => address === file)?.id;
      if (id === undefined) {
        missing();
        continue;
      }
      this.meshes.geometry(id).then(
        (geometry) => {
          const mesh = new Mesh(geometry, material);
          mesh.scale.set(...scale);
          this.attach(group, mesh, visual.pose);
        },
        missing,
      );
    }
    if (link.visuals.length === 0) this.addCollisionShapes(group, link);
  }

  private addCollisionShapes(group: Object3D, link: Link): void {
    const material = this.material(DEFAULT_COLOR);
    for (const { pose, shape } of link.collisions) {
      this.attach(group, new Mesh(shapeGeometry(shape), material), pose);
    }
  }

  private attach(group: Object3D, mesh: Mesh, pose: Parameters<typeof setPose>[1]): void {
    setPose(mesh, pose);
    mesh.castShadow = mesh.receiveShadow = this.look === "solid";
    group.add(mesh);
  }

  private material([r, g, b, a]: [number, number, number, number]): Material {
    const key = this.look === "solid" ? `${r} ${g} ${b} ${a}` : "seen through";
    let material = this.materials.get(key);
    if (!material && this.look !== "solid") {
      material = new MeshBasicMaterial({ color: GHOST_COLOR, transparent: true, opacity: 0.3, depthWrite: false });
      this.materials.set(key, material);
    } else if (!material) {
      const colour = new Color().setRGB(r, g, b, "srgb");
      const dark = colour.getHSL({ h: 0, s: 0, l: 0 }).l < 0.25;
      material = new MeshStandardMaterial({
        color: colour,
        // Dark parts are the joints: metal. Light ones are the shell: satin plastic.
        metalness: dark ? 0.55 : 0.05,
        roughness: dark ? 0.38 : 0.48,
        transparent: a < 1,
        opacity: a,
      });
      this.materials.set(key, material);
    }
    return material;
  }
}
