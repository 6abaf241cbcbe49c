// What the display says, on a board behind the box: a headset shows the scene alone.

import { CanvasTexture, Matrix4, Mesh, MeshBasicMaterial, PlaneGeometry, SRGBColorSpace, Vector3 } from "three";
import type { TaskScene } from "./scene";

const [WIDTH, HEIGHT] = [1024, 256];
/** Size in the world and distance behind the box, metres. */
const SIZE_M = 0.8;
const DISTANCE_M = 0.25;

export class Board {
  readonly root: Mesh;
  private readonly canvas = document.createElement("canvas");
  private readonly texture: CanvasTexture;
  private shown = "";

  constructor() {
    this.canvas.width = WIDTH;
    this.canvas.height = HEIGHT;
    this.texture = new CanvasTexture(this.canvas);
    this.texture.colorSpace = SRGBColorSpace;
    const material = new MeshBasicMaterial({ map: this.texture, transparent: true });
    this.root = new Mesh(new PlaneGeometry(SIZE_M, (SIZE_M * HEIGHT) / WIDTH), material);
    // Upright, facing the person, who looks along x: text runs to the right, which is -y.
    const axes = new Matrix4().makeBasis(new Vector3(0, -1, 0), new Vector3(0, 0, 1), new Vector3(-1, 0, 0));
    this.root.quaternion.setFromRotationMatrix(axes);
    this.root.visible = false;
  }

  place(room: TaskScene): void {
    this.root.position.set(room.tableCenter.x + room.tableHalfSize.x + DISTANCE_M, room.tableCenter.y, room.tableHeight + 0.35);
  }

  show(title: string, hint: string, worn: boolean): void {
    this.root.visible = worn;
    const text = `${title}\n${hint}`;
    if (!worn || text === this.shown) return;
    this.shown = text;
    const context = this.canvas.getContext("2d");
    if (!context) return;
    context.clearRect(0, 0, WIDTH, HEIGHT);
    context.fillStyle = "rgba(255,255,255,0.92)";
    context.beginPath();
    context.roundRect(4, 4, WIDTH - 8, HEIGHT - 8, 36);
    context.fill();
    context.fillStyle = "#17212b";
    context.textBaseline = "middle";
    context.font = "700 54px system-ui, sans-serif";
    context.fillText(title, 48, 78, WIDTH - 96);
    context.fillStyle = "#0b6fb8";
    context.font = "600 44px system-ui, sans-serif";
    context.fillText(hint, 48, 174, WIDTH - 96);
    this.texture.needsUpdate = true;
  }
}
