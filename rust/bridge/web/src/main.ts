// The page: scene, display and controls around one live connection.

import "./style.css";
import {
  DirectionalLight,
  HemisphereLight,
  NeutralToneMapping,
  PCFShadowMap,
  PMREMGenerator,
  Scene as World,
  Vector2,
  Vector3,
  WebGLRenderer,
} from "three";
import { RoomEnvironment } from "three/addons/environments/RoomEnvironment.js";
import { STLLoader } from "three/addons/loaders/STLLoader.js";
import { Arm } from "./arm";
import { CAMERA_NAMES, Cameras, type CameraKind } from "./cameras";
import { Controls } from "./controls";
import { element } from "./dom";
import { Guide } from "./guide";
import { Hud } from "./hud";
import { Live } from "./live";
import { Markers } from "./markers";
import { Motion } from "./motion";
import { Pointing } from "./pointing";
import type { BlockId, Content } from "./protocol";
import { Room } from "./room";
import { dispose } from "./shapes";

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
const canvas = document.getElementById("scene") as HTMLCanvasElement;
const overlay = document.getElementById("overlay") as HTMLDivElement;

/** What tests and the curious can look at from the browser's console. */
interface Debug {
  frame: unknown;
  framesReceived: number;
  framesDrawn: number;
  connected: boolean;
  content: Content | null;
  camera: CameraKind;
  chooseCamera(kind: CameraKind): void;
  /** Where a block or the target of a block is on the screen, CSS pixels from the window's left top. */
  project(what: "block" | "target", id: BlockId): { x: number; y: number } | null;
}

function start(): void {
  let quality = Math.min(Math.max(Number(parameters.get("quality") ?? 0) || 0, 0), QUALITY.length - 1);
  const fixedQuality = parameters.has("quality");
  const renderer = new WebGLRenderer({ canvas, antialias: quality < 2, alpha: true, powerPreference: "high-performance" });
  renderer.toneMapping = NeutralToneMapping;
  renderer.toneMappingExposure = 1.02;
  renderer.shadowMap.type = PCFShadowMap;
  renderer.setClearColor(0x000000, 0);

  const world = new World();
  const environment = new PMREMGenerator(renderer);
  const surroundings = environment.fromScene(new RoomEnvironment(), 0.04).texture;
  world.environmentIntensity = 0.45;
  environment.dispose();
  const ambient = new HemisphereLight("#f4f8ff", "#b39f86", 0.75);
  world.add(ambient);
  const sun = new DirectionalLight("#fff4e2", 2.3);
  sun.castShadow = true;
  sun.shadow.mapSize.set(2048, 2048);
  sun.shadow.bias = -0.0004;
  sun.shadow.normalBias = 0.004;
  sun.shadow.radius = 5;
  Object.assign(sun.shadow.camera, { left: -0.9, right: 0.9, top: 0.9, bottom: -0.9, near: 0.2, far: 5 });
  const fill = new DirectionalLight("#dbe9ff", 0.55);
  world.add(sun, sun.target, fill, fill.target);

  const cameras = new Cameras(canvas);
  const pointing = new Pointing();
  const motion = new Motion();
  const hud = new Hud();
  const guide = new Guide();
  const stl = new STLLoader();
  let content: Content | null = null;
  let room: Room | null = null;
  let arm: Arm | null = null;
  let markers: Markers | null = null;
  let everConnected = false;
  let cursor: Vector2 | null = null;
  const received = { count: 0, drawn: 0, since: performance.now(), countThen: 0, drawnThen: 0 };

  const debug: Debug = {
    frame: null,
    framesReceived: 0,
    framesDrawn: 0,
    connected: false,
    content: null,
    camera: cameras.kind,
    chooseCamera,
    project(what, id) {
      const point =
        what === "block"
          ? room?.block(id)?.position.clone()
          : room?.targets.find((target) => target.block === id)?.centre.clone();
      if (!point) return null;
      const seen = point.project(cameras.camera);
      const bounds = canvas.getBoundingClientRect();
      return {
        x: bounds.left + ((seen.x + 1) / 2) * bounds.width,
        y: bounds.top + ((1 - seen.y) / 2) * bounds.height,
      };
    },
  };
  (window as unknown as { __proact: Debug }).__proact = debug;

  const controls = new Controls({
    gesture: (gesture) => content?.interactive && live.send({ type: "gesture", gesture }),
    alive: () => live.send({ type: "alive" }),
    trunk: (posture) => live.send({ type: "trunk", ...posture }),
    restart: () => live.send({ type: "restart" }),
    camera: () => chooseCamera(cameras.next()),
  });
  const live = new Live({
    reset() {
      motion.clear();
      hud.startTrial();
    },
    content: show,
    frame(frame) {
      motion.push(frame, performance.now());
      received.count += 1;
      debug.frame = frame;
      debug.framesReceived = received.count;
      hud.update(frame, content?.interactive ?? false);
      controls.setMethod(frame.method);
      guide.update(frame, (block) => {
        const target = room?.targets.find((candidate) => candidate.block === block);
        return target ? { x: target.centre.x, y: target.centre.y } : null;
      }, content?.lean ?? false);
    },
    events: (events) => hud.addEvents(events),
    connected(connected) {
      everConnected ||= connected;
      debug.connected = connected;
      hud.setConnected(connected, everConnected);
      if (!connected) controls.releaseAll();
    },
    refused: (message) => console.warn(`ProACT: ${message}`),
  });
  overlay.append(hud.root);
  hud.bottom.append(guide.root, controls.root);
  hud.setConnected(false, false);

  function chooseCamera(kind: CameraKind): void {
    cameras.choose(kind, room);
    debug.camera = kind;
    hud.say(`Camera: ${CAMERA_NAMES[kind]}${kind === "free" ? " — drag to turn, wheel to zoom" : ""}`);
  }

  function show(next: Content): void {
    const sameThings =
      content !== null &&
      JSON.stringify([content.arm, content.scene]) === JSON.stringify([next.arm, next.scene]);
    content = next;
    debug.content = next;
    hud.setContent(next);
    controls.setMode(next.interactive, next.lean);
    canvas.classList.toggle("gaze", next.interactive);
    // A new trial in the same room keeps what is drawn: nothing flickers.
    if (sameThings) return;
    for (const old of [arm?.root, room?.root, markers?.root]) if (old) dispose(old);
    room = new Room(next.scene);
    arm = new Arm(next.arm, stl, (message) => console.warn(`ProACT: ${message}`));
    // No frame, no pose: it appears with the first one.
    arm.root.visible = false;
    markers = new Markers(room);
    cameras.side = next.arm.name.includes("left") ? 1 : -1;
    world.add(room.root, arm.root, markers.root);
    sun.position.copy(room.centre).add(new Vector3(-0.55, -0.75, 1.9));
    sun.target.position.copy(room.centre);
    fill.position.copy(room.centre).add(new Vector3(-1.4, 1.2, 0.7));
    fill.target.position.copy(room.centre);
  }

  function applyQuality(): void {
    const { pixels, shadows, reflections } = QUALITY[quality] ?? QUALITY[0];
    renderer.setPixelRatio(pixels < 1 ? pixels : Math.min(window.devicePixelRatio, pixels));
    renderer.shadowMap.enabled = shadows;
    sun.castShadow = shadows;
    // Reflections cost most where there is no graphics card.
    world.environment = reflections ? surroundings : null;
    ambient.intensity = reflections ? 0.75 : 1.6;
    resize();
  }

  function resize(): void {
    renderer.setSize(window.innerWidth, window.innerHeight, false);
    cameras.resize(window.innerWidth, window.innerHeight);
  }

  window.addEventListener("resize", resize);
  window.addEventListener("pointermove", (event) => look(event));
  canvas.addEventListener("pointerdown", (event) => look(event));
  function look(event: PointerEvent): void {
    // Over a card the eyes stay where they were.
    if (event.target !== canvas) return;
    cursor ??= new Vector2();
    cursor.set((event.clientX / window.innerWidth) * 2 - 1, 1 - (event.clientY / window.innerHeight) * 2);
  }

  let before = performance.now();
  let slowSeconds = 0;
  function draw(wall: number): void {
    const seconds = Math.max((wall - before) / 1000, 0);
    before = wall;
    controls.update(seconds);
    const drawn = motion.at(wall);
    const frame = motion.latest;
    if (drawn && frame && room && arm && markers) {
      arm.root.visible = true;
      arm.update(drawn.base, drawn.joints);
      room.update(drawn.blocks, frame.hand.holds, wall / 1000);
      markers.update(frame, wall / 1000);
      cameras.update(drawn, room, seconds);
      cameras.camera.updateMatrixWorld();
      if (content?.interactive && cursor) {
        const point = pointing.point(cursor, cameras.camera, room, frame.hand.holds);
        const eye = new Vector3(...frame.world_from_head.translation);
        if (point) {
          const direction = point.sub(eye).normalize();
          live.send({ type: "gaze", origin: eye.toArray(), direction: direction.toArray() });
        }
      }
      renderer.render(world, cameras.camera);
      received.drawn += 1;
      debug.framesDrawn = received.drawn;
    }
    if (wall - received.since > 1000) measure(wall);
    requestAnimationFrame(draw);
  }

  function measure(wall: number): void {
    const span = (wall - received.since) / 1000;
    const drawnRate = (received.drawn - received.drawnThen) / span;
    hud.setRate((received.count - received.countThen) / span, drawnRate);
    // Slow for three seconds, and not because the page is hidden or nothing comes in.
    slowSeconds = drawnRate < SLOW && drawnRate > 0 && !document.hidden ? slowSeconds + 1 : 0;
    if (slowSeconds >= 3 && !fixedQuality && quality < QUALITY.length - 1) {
      quality += 1;
      slowSeconds = 0;
      applyQuality();
    }
    Object.assign(received, { since: wall, countThen: received.count, drawnThen: received.drawn });
  }

  applyQuality();
  requestAnimationFrame(draw);
}

try {
  start();
} catch (error) {
  const reason = error instanceof Error ? error.message : String(error);
  overlay.append(
    element(
      "div",
      "banner",
      `The scene cannot be drawn: ${reason}. ProACT's page needs WebGL 2; try a current Firefox, Chrome or Edge, ` +
        "with hardware acceleration switched on.",
    ),
  );
}
