// Where the person looks when the mouse is the eye: what you point at is what you look at.

import { Camera, Object3D, Plane, Raycaster, Vector2, Vector3 } from "three";
import type { ObjectId } from "./generated/types";
import type { TaskScene } from "./scene";

/** Nothing further than this is looked at, metres. */
const MAX_DISTANCE_M = 4;

export class GazePicker {
  private readonly ray = new Raycaster();

  /**
   * The point in `world` under the cursor (device coordinates, -1 to 1): on an object, else on the plane of the
   * table top. Arm, walls and a carried object are looked through, or nothing behind them could be chosen.
   */
  pickAtCursor(cursor: Vector2, camera: Camera, room: TaskScene, holds: ObjectId | null): Vector3 {
    this.ray.setFromCamera(cursor, camera);
    return this.intersect(room, holds);
  }

  /** The same along any ray: a headset's. */
  pickAlongRay(origin: Vector3, direction: Vector3, room: TaskScene, holds: ObjectId | null): Vector3 {
    this.ray.set(origin, direction);
    return this.intersect(room, holds);
  }

  private intersect(room: TaskScene, holds: ObjectId | null): Vector3 {
    if (holds === null) {
      const bodies: Object3D[] = room.objects.map((object) => object.body);
      const hit = this.ray.intersectObjects(bodies, false)[0];
      if (hit) return hit.point;
    }
    const table = new Plane(new Vector3(0, 0, 1), -room.tableHeight);
    const point = this.ray.ray.intersectPlane(table, new Vector3());
    // Above the horizon: some place far ahead.
    if (!point || point.distanceTo(room.tableCenter) > MAX_DISTANCE_M) return this.ray.ray.at(MAX_DISTANCE_M, new Vector3());
    return point;
  }
}
