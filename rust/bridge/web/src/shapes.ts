// Geometry that arm, room and markers share.

import {
  BoxGeometry,
  BufferGeometry,
  CanvasTexture,
  CapsuleGeometry,
  CylinderGeometry,
  Material,
  Mesh,
  Object3D,
  SphereGeometry,
  SRGBColorSpace,
  Texture,
} from "three";
import type { Pose, Shape } from "./generated/types";

let textIsMirrored = false;

/** Text is drawn mirrored from now on, for a scene that is shown mirrored. */
export function setTextMirrored(on: boolean): void {
  textIsMirrored = on;
}

/** A shape in its own frame, axes along z as everywhere in ProACT (three.js has them along y). */
export function shapeGeometry(shape: Shape, segments = 48): BufferGeometry {
  switch (shape.type) {
    case "box":
      return new BoxGeometry(...shape.size);
    case "sphere":
      return new SphereGeometry(shape.radius, segments, segments / 2);
    case "cylinder":
      return new CylinderGeometry(shape.radius, shape.radius, shape.length, segments).rotateX(Math.PI / 2);
    case "capsule":
      return new CapsuleGeometry(shape.radius, shape.length, 12, segments).rotateX(Math.PI / 2);
  }
}

export function setPose(object: Object3D, pose: Pose): void {
  object.position.set(...pose.translation);
  object.quaternion.set(...pose.rotation);
}

/** Frees what the graphics card holds for this object and all below it. */
export function dispose(object: Object3D): void {
  object.traverse((part) => {
    if (!(part instanceof Mesh)) return;
    (part.geometry as BufferGeometry).dispose();
    const materials: Material[] = Array.isArray(part.material) ? part.material : [part.material];
    for (const material of materials) {
      for (const value of Object.values(material)) if (value instanceof Texture) value.dispose();
      material.dispose();
    }
  });
  object.removeFromParent();
}

/** A square texture drawn by `draw` in units of its half width: from -1 to 1, y upwards. */
export function drawnTexture(draw: (context: CanvasRenderingContext2D) => void, pixels = 256): CanvasTexture {
  const canvas = document.createElement("canvas");
  canvas.width = canvas.height = pixels;
  const context = canvas.getContext("2d");
  if (!context) throw new Error("this browser cannot draw on a canvas");
  context.scale(pixels / 2, pixels / 2);
  context.translate(1, 1);
  draw(context);
  const texture = new CanvasTexture(canvas);
  texture.colorSpace = SRGBColorSpace;
  texture.anisotropy = 8;
  return texture;
}

/** Writes `text` in the middle, `height` half widths high. */
export function writeText(context: CanvasRenderingContext2D, text: string, height: number, colour: string): void {
  context.fillStyle = colour;
  context.font = `700 ${height}px system-ui, "Segoe UI", Roboto, "DejaVu Sans", sans-serif`;
  context.textAlign = "center";
  context.textBaseline = "middle";
  context.save();
  if (textIsMirrored) context.scale(-1, 1);
  context.fillText(text, 0, 0.05 * height);
  context.restore();
}
