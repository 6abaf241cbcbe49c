// The scene on a canvas: lights, arm, room, markers and cameras. The pages differ in what surrounds it.

import {
  DirectionalLight,
  Group,
  HemisphereLight,
  NeutralToneMapping,
  PCFShadowMap,
  PMREMGenerator,
  Scene as World,
  Vector3,
  WebGLRenderer,
} from "three";
import { RoomEnvironment } from "three/addons/environments/RoomEnvironment.js";
import { Arm, Meshes } from "./arm";
import { aim } from "./aim";
import { AxisDisplay } from "./axes";
import { Cameras } from "./cameras";
import { Depth } from "./depth";
import { Fading } from "./fading";
import { Insets } from "./insets";
import { Markers } from "./markers";
import type { Drawn } from "./motion";
import type { DisplayFrame, GhostArm, ObjectId, PageContent } from "./generated/types";
import { Plumb } from "./plumb";
import { Room } from "./room";
import { dispose } from "./shapes";
import { strings } from "./strings";

/** Pictures per second below which the scene is drawn more cheaply. */
const SLOW = 28;
/** Sharpness, shadows and reflections, from best to cheapest. */
const QUALITY = [
  { pixels: 2, shadows: true, reflections: true },
  { pixels: 1, shadows: true, reflections: true },
  { pixels: 1, shadows: false, reflections: false },
  { pixels: 0.6, shadows: false, reflections: false },
] as const;

const parameters = new URLSearchParams(location.search);

/** Whether the processor computes the pictures: then they are plain from the start, since smooth edges cannot be given up later. */
function drawsInSoftware(): boolean {
  const context = document.createElement("canvas").getContext("webgl2");
  if (!context) return false;
  const info = context.getExtension("WEBGL_debug_renderer_info");
  const name = String(context.getParameter(info ? info.UNMASKED_RENDERER_WEBGL : context.RENDERER));
  context.getExtension("WEBGL_lose_context")?.loseContext();
  return /swiftshader|llvmpipe|softpipe|software|basic render/i.test(name);
}

/** From the best, 0, to the cheapest. */
function firstQuality(): number {
  const worst = QUALITY.length - 1;
  const asked = parameters.get("quality");
  if (asked === null) return drawsInSoftware() ? worst : 0;
  return Math.min(Math.max(Number(asked) || 0, 0), worst);
}

/** What is drawn of a page's content. */
function pictured({ arm, meshes, scene }: PageContent): string {
  return JSON.stringify([arm, meshes, scene]);
}

export class Stage {
  readonly renderer: WebGLRenderer;
  readonly world = new World();
  /** Everything that stands in the world; a headset moves it. */
  readonly things = new Group();
  readonly cameras: Cameras;
  content: PageContent | null = null;
  room: Room | null = null;
  /** Pictures drawn so far. */
  drawn = 0;
  /** What the graphics library took for the last picture, ms. */
  drawingMs = 0;
  /** The room is drawn without the arm, which would be in the way of something to read. */
  roomOnly = false;
  private arm: Arm | null = null;
  private ghost: Arm | null = null;
  /** A second arm that is asked for from outside, and where it is to be; none while nobody asks. */
  private shade: Arm | null = null;
  private shadeAsked: GhostArm | null = null;
  private markers: Markers | null = null;
  private axes: AxisDisplay | null = null;
  private plumb: Plumb | null = null;
  private depth: Depth | null = null;
  readonly fading = new Fading();
  readonly insets = new Insets();
  private readonly meshes = new Meshes();
  private readonly sun = new DirectionalLight("#fff4e2", 2.3);
  private readonly fill = new DirectionalLight("#dbe9ff", 0.55);
  private readonly ambient = new HemisphereLight("#f4f8ff", "#b39f86", 0.75);
  private readonly surroundings;
  private quality = firstQuality();
  private slowSeconds = 0;
  private free: DOMRect | null = null;

  constructor(
    readonly canvas: HTMLCanvasElement,
    keepPicture = false,
  ) {
    const antialias = this.quality < 2;
    const powerPreference = "high-performance";
    this.renderer = new WebGLRenderer({ canvas, antialias, alpha: true, powerPreference, preserveDrawingBuffer: keepPicture });
    this.renderer.toneMapping = NeutralToneMapping;
    this.renderer.toneMappingExposure = 1.02;
    this.renderer.shadowMap.type = PCFShadowMap;
    this.renderer.setClearColor(0x000000, 0);
    // A picture may take several passes, which count together.
    this.renderer.info.autoReset = false;

    const environment = new PMREMGenerator(this.renderer);
    this.surroundings = environment.fromScene(new RoomEnvironment(), 0.04).texture;
    environment.dispose();
    this.world.environmentIntensity = 0.45;
    const { sun, fill } = this;
    sun.castShadow = true;
    sun.shadow.mapSize.set(2048, 2048);
    sun.shadow.bias = -0.0004;
    sun.shadow.normalBias = 0.004;
    sun.shadow.radius = 5;
    Object.assign(sun.shadow.camera, { left: -0.9, right: 0.9, top: 0.9, bottom: -0.9, near: 0.2, far: 5 });
    this.world.add(this.ambient, sun, sun.target, fill, fill.target, this.things);
    this.cameras = new Cameras(canvas);
    this.world.add(this.cameras.rig);
    window.addEventListener("resize", () => this.resize());
    this.applyQuality();
  }

  /** Shows another arm and room. The same ones again stay as they are: nothing flickers. */
  show(next: PageContent, rebuild = false): void {
    const same =
      !rebuild &&
      this.content !== null &&
      pictured(this.content) === pictured(next);
    this.content = next;
    if (same) return;
    for (const old of [...this.things.children]) dispose(old);
    this.meshes.forget();
    this.room = new Room(next.scene);
    const failed = (message: string) => console.warn(`ProACT: ${message}`);
    this.arm = new Arm(next.arm, next.meshes, this.meshes, failed);
    this.ghost = new Arm(next.arm, next.meshes, this.meshes, failed, "hand");
    this.shade = null;
    // No frame, no pose: they appear with the first one.
    this.arm.root.visible = this.ghost.root.visible = false;
    this.markers = new Markers(this.room);
    this.axes = new AxisDisplay(this.arm);
    this.cameras.side = next.arm.side === "left" ? 1 : -1;
    this.plumb = new Plumb();
    this.depth = new Depth(next.arm);
    this.fading.clear();
    this.insets.show(next.arm);
    this.things.add(this.room.root, this.arm.root, this.ghost.root, this.markers.root, this.axes.root, this.plumb.root, this.depth.root);
    const { centre } = this.room;
    this.sun.position.copy(centre).add(new Vector3(-0.55, -0.75, 1.9));
    this.sun.target.position.copy(centre);
    this.fill.position.copy(centre).add(new Vector3(-1.4, 1.2, 0.7));
    this.fill.target.position.copy(centre);
  }

  /** Of the last picture, shadows included. */
  get drawCalls(): number {
    return this.renderer.info.render.calls;
  }

  get triangles(): number {
    return this.renderer.info.render.triangles;
  }

  /** Draws one picture; false if there is nothing to draw yet. */
  draw(drawn: Drawn | null, frame: DisplayFrame | null, seconds: number, wall: number): boolean {
    const { room, arm, ghost, markers, axes } = this;
    if (!drawn || !frame || !room || !arm || !ghost || !markers || !axes) return false;
    arm.root.visible = true;
    arm.update(drawn.base, drawn.joints);
    const ghosted = posture(frame, drawn.joints);
    ghost.root.visible = ghosted !== null;
    if (ghosted) ghost.update(drawn.base, ghosted);
    this.drawShade(drawn);
    room.update(drawn.objects, frame.hand.holds, frame.asked ?? null, wall / 1000);
    markers.update(frame, wall / 1000);
    axes.update(frame, drawn);
    const aimed = frame.mode && !frame.finished && this.content ? aim(frame, this.content.arm, this.content.scene) : null;
    this.plumb?.update(aimed, room.tableHeight);
    this.depth?.update(frame, drawn, room, aimed !== null);
    markers.root.visible = !this.roomOnly;
    if (this.roomOnly) {
      for (const part of [arm, ghost, this.shade, axes, this.plumb, this.depth]) if (part) part.root.visible = false;
    }
    this.cameras.update(drawn, room, seconds);
    this.cameras.camera.updateMatrixWorld();
    this.fading.update(arm.root, this.cameras.camera, this.cameras.worn ? null : wanted(frame, room), seconds);
    const began = performance.now();
    this.renderer.info.reset();
    this.renderer.render(this.world, this.cameras.camera);
    if (!this.cameras.worn) this.insets.draw(this.renderer, this.world, drawn, room);
    this.drawingMs = performance.now() - began;
    this.drawn += 1;
    return true;
  }

  /** A second arm beside the trial's, to be seen through; none for none. */
  showGhost(asked: GhostArm | null): void {
    this.shadeAsked = asked;
  }

  /** It is made when it is first asked for: most trials have none. */
  private drawShade(drawn: Drawn): void {
    const { shadeAsked: asked, content } = this;
    if (asked && content && !this.shade) {
      this.shade = new Arm(content.arm, content.meshes, this.meshes, (message) => console.warn(`ProACT: ${message}`), "shade");
      this.things.add(this.shade.root);
    }
    if (!this.shade) return;
    this.shade.root.visible = asked !== null;
    if (!asked) return;
    this.shade.shade(asked.colour, asked.alpha);
    this.shade.update(drawn.base, asked.joints);
  }

  /** Where an object or its target is on the screen, CSS pixels from the window's left top. */
  project(what: "object" | "target", id: ObjectId, mirrored = false): { x: number; y: number } | null {
    const point =
      what === "object"
        ? this.room?.object(id)?.position.clone()
        : this.room?.target(id)?.clone();
    if (!point) return null;
    const seen = point.project(this.cameras.camera);
    const bounds = this.canvas.getBoundingClientRect();
    return {
      x: bounds.left + ((mirrored ? 1 - seen.x : seen.x + 1) / 2) * bounds.width,
      y: bounds.top + ((1 - seen.y) / 2) * bounds.height,
    };
  }

  resize(): void {
    const { clientWidth, clientHeight } = this.canvas;
    this.renderer.setSize(clientWidth, clientHeight, false);
    this.cameras.resize(clientWidth, clientHeight, this.free);
  }

  /** The scene is to be seen in this part of the window; what is left of the canvas shows what lies around. */
  fit(free: DOMRect, mirrored: boolean): void {
    const canvas = this.canvas.getBoundingClientRect();
    const left = mirrored ? canvas.right - free.right : free.left - canvas.left;
    this.free = new DOMRect(left, free.top - canvas.top, free.width, free.height);
    this.resize();
  }

  /** To be told once a second how many pictures were drawn in it. */
  rate(drawnPerSecond: number): void {
    // Slow for three seconds, and not because the page is hidden or nothing comes in.
    this.slowSeconds = drawnPerSecond < SLOW && drawnPerSecond > 0 && !document.hidden ? this.slowSeconds + 1 : 0;
    if (this.slowSeconds < 3 || parameters.has("quality") || this.quality === QUALITY.length - 1) return;
    this.quality += 1;
    this.slowSeconds = 0;
    this.applyQuality();
  }

  /** Shows or hides the small pictures. They take the place of the lamp's shadows: both together are too much to draw. */
  toggleInsets(): void {
    this.insets.toggle();
    this.applyQuality();
  }

  private applyQuality(): void {
    const { pixels, shadows: allowed, reflections } = QUALITY[this.quality] ?? QUALITY[0];
    const shadows = allowed && !this.insets.on;
    this.renderer.setPixelRatio(pixels < 1 ? pixels : Math.min(window.devicePixelRatio, pixels));
    this.renderer.shadowMap.enabled = shadows;
    this.sun.castShadow = shadows;
    // Reflections cost most where there is no graphics card.
    this.world.environment = reflections ? this.surroundings : null;
    this.ambient.intensity = reflections ? 0.75 : 1.6;
    this.resize();
  }
}

/** What to tell someone whose browser cannot draw the scene. */
export function whyNotDrawn(error: unknown): string {
  const reason = error instanceof Error ? error.message : String(error);
  return strings.notDrawn(reason);
}

/** What the hand is to go to and the eye has to see: what is selected, else what is next. */
function wanted({ hand, target, next, finished }: DisplayFrame, room: Room): Vector3 | null {
  if (finished) return null;
  if (hand.holds !== null) return target.place ? new Vector3(...target.place) : (room.target(hand.holds) ?? null);
  const object = target.object ?? next;
  return object === null ? null : (room.object(object)?.position ?? null);
}

/** Angles of the ghost: where the plan ends, or the posture that is asked for; none if there is neither. */
function posture({ goal, asked }: DisplayFrame, now: readonly number[]): number[] | null {
  if (goal) return [...goal, ...now.slice(goal.length)];
  if (asked?.type !== "posture") return null;
  const angles = [...now];
  for (const { joint, angle } of asked.joints) angles[joint] = angle;
  return angles;
}
