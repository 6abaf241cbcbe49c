// Many objects of one kind, drawn in one call: a heap of 150 cubes would need 150, and as many again for their shadows.

import { InstancedMesh, type Group, type Mesh } from "three";

/** Fewer of a kind are drawn one by one. */
const MIN_INSTANCES = 8;

interface InstancedObject {
  group: Group;
  body: Mesh;
}

export class InstanceGroup {
  readonly mesh: InstancedMesh;
  private readonly members: InstancedObject[];

  private constructor(first: InstancedObject, members: InstancedObject[]) {
    this.mesh = new InstancedMesh(first.body.geometry, first.body.material, members.length);
    this.mesh.castShadow = true;
    this.mesh.receiveShadow = true;
    // Its bounds are those of the first moment, and objects go everywhere.
    this.mesh.frustumCulled = false;
    this.members = members;
    // A ray still meets what is not drawn.
    for (const { body } of members) body.visible = false;
    this.update();
  }

  /** Those of `objects` that are worth it: of one kind, by what `kind` says; none where it says nothing. */
  static groupByKind<T extends InstancedObject>(objects: readonly T[], kind: (object: T) => string | null): InstanceGroup[] {
    const kinds = new Map<string, T[]>();
    for (const object of objects) {
      const name = kind(object);
      if (name !== null) kinds.set(name, [...(kinds.get(name) ?? []), object]);
    }
    return [...kinds.values()].flatMap((members) => {
      const first = members[0];
      return first && members.length >= MIN_INSTANCES ? [new InstanceGroup(first, members)] : [];
    });
  }

  /** Puts each where its group is. */
  update(): void {
    this.members.forEach(({ group }, k) => {
      group.updateMatrix();
      this.mesh.setMatrixAt(k, group.matrix);
    });
    this.mesh.instanceMatrix.needsUpdate = true;
  }
}
