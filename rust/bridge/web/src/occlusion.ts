// The arm is seen through where it hides what the hand is to go to.

import { Box3, type Material, type Mesh, type Object3D, type PerspectiveCamera, Ray, Vector3, Matrix4 } from "three";

const FADED_OPACITY = 0.3;
/** Of the rest of the way to the wanted opacity, a second. */
const FADE_RATE_PER_S = 7;
/** Nearer to the target than this nothing fades: the fingers that take it are to be seen, metres. */
const MIN_TARGET_DISTANCE_M = 0.09;

interface FadedMesh {
  mesh: Mesh;
  /** Its own copy, made when it first fades: others share the original. */
  transparentMaterial: Material | null;
  originalMaterial: Material;
  opacity: number;
}

export class OcclusionFading {
  private readonly parts = new Map<Mesh, FadedMesh>();
  private readonly ray = new Ray();
  private readonly local = new Ray();
  private readonly inverse = new Matrix4();
  private readonly box = new Box3();
  private readonly hit = new Vector3();

  /** How many parts are seen through now. */
  get count(): number {
    return [...this.parts.values()].filter(({ mesh, transparentMaterial: clear }) => mesh.material === clear).length;
  }

  /** Forgets the arm before. */
  clear(): void {
    for (const { transparentMaterial: clear } of this.parts.values()) clear?.dispose();
    this.parts.clear();
  }

  /** Fades what of `arm` lies between the camera and `target`; none: nothing fades. */
  update(arm: Object3D, camera: PerspectiveCamera, target: Vector3 | null, seconds: number): void {
    if (target) {
      camera.getWorldPosition(this.ray.origin);
      this.ray.direction.copy(target).sub(this.ray.origin);
    }
    const distance = this.ray.direction.length();
    this.ray.direction.normalize();
    const share = 1 - Math.exp(-FADE_RATE_PER_S * Math.min(seconds, 0.1));
    arm.traverse((node) => {
      const mesh = node as Mesh;
      if (!mesh.isMesh || Array.isArray(mesh.material)) return;
      const hides = target !== null && this.isOccluding(mesh, target, distance);
      const known = this.parts.get(mesh);
      if (!hides && !known) return;
      const part = known ?? { mesh, transparentMaterial: null, originalMaterial: mesh.material, opacity: 1 };
      this.parts.set(mesh, part);
      part.opacity += ((hides ? FADED_OPACITY : 1) - part.opacity) * share;
      this.applyOpacity(part);
    });
  }

  private applyOpacity(part: FadedMesh): void {
    if (part.opacity > 0.98) {
      part.mesh.material = part.originalMaterial;
      return;
    }
    part.transparentMaterial ??= Object.assign(part.originalMaterial.clone(), { transparent: true });
    part.transparentMaterial.opacity = part.opacity;
    part.mesh.material = part.transparentMaterial;
  }

  /** Whether the line of sight goes through the mesh's box, short of the target. */
  private isOccluding(mesh: Mesh, target: Vector3, distance: number): boolean {
    const { geometry } = mesh;
    if (!geometry.boundingBox) geometry.computeBoundingBox();
    if (!geometry.boundingBox) return false;
    this.inverse.copy(mesh.matrixWorld).invert();
    this.local.copy(this.ray).applyMatrix4(this.inverse);
    const hit = this.local.intersectBox(this.box.copy(geometry.boundingBox), this.hit);
    if (!hit) return false;
    hit.applyMatrix4(mesh.matrixWorld);
    return hit.distanceTo(this.ray.origin) < distance && hit.distanceTo(target) > MIN_TARGET_DISTANCE_M;
  }
}
