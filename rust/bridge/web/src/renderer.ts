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
import { Arm, MeshCache } from "./arm";
import { jogGoal } from "./jogGoal";
import { AxisDisplay } from "./axes";
import { Cameras } from "./cameras";
import { DepthCues } from "./depthCues";
import { OcclusionFading } from "./occlusion";
import { Insets } from "./insets";
import { Markers } from "./markers";
import type { InterpolatedFrame } from "./frameInterpolation";
import type { DisplayFrame, GhostArm, ObjectId, PageContent } from "./generated/types";
import { HeightLine } from "./heightLine";
import { TaskScene } from "./scene";
import { dispose } from "./shapes";
import { strings } from "./strings";

/** Pictures per second below which the scene is drawn more cheaply. */
const SLOW_FRAME_RATE_HZ = 28;
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
function drawnContent({ arm, meshes, scene }: PageContent): string {
  return JSON.stringify([arm, meshes, scene]);
}

export class SceneRenderer {
  readonly renderer: WebGLRenderer;
  readonly world = new World();
  /** Everything that stands in the world; a headset moves it. */
  readonly worldContent = new Group();
  readonly cameras: Cameras;
  content: PageContent | null = null;
  taskScene: TaskScene | null = null;
  /** Pictures drawn so far. */
  frameCount = 0;
  /** What the graphics library took for the last picture, ms. */
  drawTimeMs = 0;
  /** The room is drawn without the arm, which would be in the way of something to read. */
  hidesArm = false;
  private arm: Arm | null = null;
  private planGhost: Arm | null = null;
  /** A second arm that is asked for from outside, and where it is to be; none while nobody asks. */
  private externalGhost: Arm | null = null;
  private externalGhostRequest: GhostArm | null = null;
  private markers: Markers | null = null;
  private axes: AxisDisplay | null = null;
  private heightLine: HeightLine | null = null;
  private depthCues: DepthCues | null = null;
  readonly occlusion = new OcclusionFading();
  readonly insets = new Insets();
  private readonly meshes = new MeshCache();
  private readonly sun = new DirectionalLight("#fff4e2", 2.3);
  private readonly fill = new DirectionalLight("#dbe9ff", 0.55);
  private readonly ambient = new HemisphereLight("#f4f8ff", "#b39f86", 0.75);
  private readonly environmentMap;
  private quality = firstQuality();
  private slowSeconds = 0;
  private visibleArea: DOMRect | null = null;

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
    this.environmentMap = environment.fromScene(new RoomEnvironment(), 0.04).texture;
    environment.dispose();
    this.world.environmentIntensity = 0.45;
    const { sun, fill } = this;
    sun.castShadow = true;
    sun.shadow.mapSize.set(2048, 2048);
    sun.shadow.bias = -0.0004;
    sun.shadow.normalBias = 0.004;
    sun.shadow.radius = 5;
    Object.assign(sun.shadow.camera, { left: -0.9, right: 0.9, top: 0.9, bottom: -0.9, near: 0.2, far: 5 });
    this.world.add(this.ambient, sun, sun.target, fill, fill.target, this.worldContent);
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
      drawnContent(this.content) === drawnContent(next);
    this.content = next;
    if (same) return;
    for (const old of [...this.worldContent.children]) dispose(old);
    this.meshes.clear();
    this.taskScene = new TaskScene(next.scene);
    const failed = (message: string) => console.warn(`ProACT: ${message}`);
    this.arm = new Arm(next.arm, next.meshes, this.meshes, failed);
    this.planGhost = new Arm(next.arm, next.meshes, this.meshes, failed, "hand");
    this.externalGhost = null;
    // No frame, no pose: they appear with the first one.
    this.arm.root.visible = this.planGhost.root.visible = false;
    this.markers = new Markers(this.taskScene);
    this.axes = new AxisDisplay(this.arm);
    this.cameras.side = next.arm.side === "left" ? 1 : -1;
    this.heightLine = new HeightLine();
    this.depthCues = new DepthCues(next.arm);
    this.occlusion.clear();
    this.insets.show(next.arm);
    this.worldContent.add(this.taskScene.root, this.arm.root, this.planGhost.root, this.markers.root, this.axes.root, this.heightLine.root, this.depthCues.root);
    const { tableCenter: centre } = this.taskScene;
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
  draw(drawn: InterpolatedFrame | null, frame: DisplayFrame | null, seconds: number, wall: number): boolean {
    const { taskScene: room, arm, planGhost: ghost, markers, axes } = this;
    if (!drawn || !frame || !room || !arm || !ghost || !markers || !axes) return false;
    arm.root.visible = true;
    arm.update(drawn.base, drawn.joints);
    const ghosted = ghostPosture(frame, drawn.joints);
    ghost.root.visible = ghosted !== null;
    if (ghosted) ghost.update(drawn.base, ghosted);
    this.drawExternalGhost(drawn);
    room.update(drawn.objects, frame.hand.holds, frame.asked ?? null, wall / 1000);
    markers.update(frame, wall / 1000);
    axes.update(frame, drawn);
    const aimed = frame.mode && !frame.finished && this.content ? jogGoal(frame, this.content.arm, this.content.scene) : null;
    this.heightLine?.update(aimed, room.tableHeight);
    this.depthCues?.update(frame, drawn, room, aimed !== null);
    markers.root.visible = !this.hidesArm;
    if (this.hidesArm) {
      for (const part of [arm, ghost, this.externalGhost, axes, this.heightLine, this.depthCues]) if (part) part.root.visible = false;
    }
    this.cameras.update(drawn, room, seconds);
    this.cameras.camera.updateMatrixWorld();
    this.occlusion.update(arm.root, this.cameras.camera, this.cameras.inHeadset ? null : visualTarget(frame, room), seconds);
    const began = performance.now();
    this.renderer.info.reset();
    this.renderer.render(this.world, this.cameras.camera);
    if (!this.cameras.inHeadset) this.insets.draw(this.renderer, this.world, drawn, room);
    this.drawTimeMs = performance.now() - began;
    this.frameCount += 1;
    return true;
  }

  /** A second arm beside the trial's, to be seen through; none for none. */
  showGhost(asked: GhostArm | null): void {
    this.externalGhostRequest = asked;
  }

  /** It is made when it is first asked for: most trials have none. */
  private drawExternalGhost(drawn: InterpolatedFrame): void {
    const { externalGhostRequest: asked, content } = this;
    if (asked && content && !this.externalGhost) {
      this.externalGhost = new Arm(content.arm, content.meshes, this.meshes, (message) => console.warn(`ProACT: ${message}`), "shade");
      this.worldContent.add(this.externalGhost.root);
    }
    if (!this.externalGhost) return;
    this.externalGhost.root.visible = asked !== null;
    if (!asked) return;
    this.externalGhost.setColor(asked.colour, asked.alpha);
    this.externalGhost.update(drawn.base, asked.joints);
  }

  /** Where an object or its target is on the screen, CSS pixels from the window's left top. */
  project(what: "object" | "target", id: ObjectId, mirrored = false): { x: number; y: number } | null {
    const point =
      what === "object"
        ? this.taskScene?.object(id)?.position.clone()
        : this.taskScene?.target(id)?.clone();
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
    this.cameras.resize(clientWidth, clientHeight, this.visibleArea);
  }

  /** The scene is to be seen in this part of the window; what is left of the canvas shows what lies around. */
  setVisibleArea(free: DOMRect, mirrored: boolean): void {
    const canvas = this.canvas.getBoundingClientRect();
    const left = mirrored ? canvas.right - free.right : free.left - canvas.left;
    this.visibleArea = new DOMRect(left, free.top - canvas.top, free.width, free.height);
    this.resize();
  }

  /** To be told once a second how many pictures were drawn in it. */
  adaptQuality(drawnPerSecond: number): void {
    // Slow for three seconds, and not because the page is hidden or nothing comes in.
    this.slowSeconds = drawnPerSecond < SLOW_FRAME_RATE_HZ && drawnPerSecond > 0 && !document.hidden ? this.slowSeconds + 1 : 0;
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
    this.world.environment = reflections ? this.environmentMap : null;
    this.ambient.intensity = reflections ? 0.75 : 1.6;
    this.resize();
  }
}

/** What to tell someone whose browser cannot draw the scene. */
export function drawErrorText(error: unknown): string {
  const reason = error instanceof Error ? error.message : String(error);
  return strings.notDrawn(reason);
}

/** What the hand is to go to and the eye has to see: what is selected, else what is next. */
function visualTarget({ hand, target, next, finished }: DisplayFrame, room: TaskScene): Vector3 | null {
  if (finished) return null;
  if (hand.holds !== null) return target.place ? new Vector3(...target.place) : (room.target(hand.holds) ?? null);
  const object = target.object ?? next;
  return object === null ? null : (room.object(object)?.position ?? null);
}

/** Angles of the ghost: where the plan ends, or the posture that is asked for; none if there is neither. */
function ghostPosture({ goal, asked }: DisplayFrame, now: readonly number[]): number[] | null {
  if (goal) return [...goal, ...now.slice(goal.length)];
  if (asked?.type !== "posture") return null;
  const angles = [...now];
  for (const { joint, angle } of asked.joints) angles[joint] = angle;
  return angles;
}
