// The page that shows what tracking sources send: frames in space, rates, ages, noise, and what is wrong. It holds no state:
// everything comes with each report.

import "./tracking.css";
import {
  AxesHelper,
  BufferAttribute,
  BufferGeometry,
  DoubleSide,
  GridHelper,
  Group,
  Line,
  LineBasicMaterial,
  Mesh,
  MeshBasicMaterial,
  PerspectiveCamera,
  PlaneGeometry,
  RingGeometry,
  Scene,
  WebGLRenderer,
} from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import { element, setClass, setText } from "./dom";
import type { Pose, ReachGrid, PoseStreamStatistics, TrackingReport } from "./generated/types";
import { strings } from "./strings";
import { fixed } from "./numbers";

const words = strings.tracking;

/** From report to report, ms. */
const REPORT_INTERVAL_MS = 100;
/** Places of a body that its trail shows: three seconds. */
const TRAIL_LENGTH = 30;

const link = element("span", "muted", words.connecting);
const scene = element("div", "scene");
const canvas = element("canvas");
canvas.setAttribute("role", "img");
canvas.setAttribute("aria-label", words.pictureLabel);
const legend = element("p", "legend muted", words.legend);
scene.append(canvas, legend);
const cards = element("section");
cards.setAttribute("aria-label", words.sources);
document.getElementById("page")?.append(element("header", "", element("h1", "", words.title), link), scene, cards);

/** The figures of one source. */
class SourceCard {
  readonly root = element("article", "card");
  private readonly title = element("h2");
  private readonly verdict = element("p", "verdict");
  private readonly list = element("dl");
  private readonly cells = new Map<string, HTMLElement>();

  constructor() {
    this.verdict.setAttribute("role", "status");
    this.root.append(this.title, this.verdict, this.list);
  }

  show(report: TrackingReport): void {
    setText(this.title, report.source);
    setText(this.verdict, report.fault === null ? words.good : report.fault);
    setClass(this.verdict, "bad", report.fault !== null);
    this.set(words.body, report.body);
    this.set(words.rate, `${fixed(report.rate_hz)} Hz`);
    this.set(words.age, report.age_secs === null ? words.noPose : `${fixed(1000 * report.age_secs)} ms`);
    const { stream, noise_m, noise_rad } = report;
    this.set(words.lag, stream ? words.behind(ms(stream.lag_secs)) : words.unknown);
    this.set(words.jitter, stream ? ms(stream.jitter_secs) : words.unknown);
    this.set(words.dropoutsTitle, stream ? dropouts(stream) : words.unknown);
    this.set(words.noise, noise_m === null || noise_rad === null ? words.unknown : `${fixed(1000 * noise_m, 2)} mm, ${fixed((180 * noise_rad) / Math.PI, 2)} degrees`);
    this.set(words.inTracking, place(report.tracking_from_body));
    this.set(words.inWorld, place(report.world_from_shoulder));
    for (const { kind, line, usable } of report.calibrations) this.set(words.calibrated(kind), usable ? line : words.notUsed(line));
    if (report.calibrations.length === 0) this.set(words.calibration, words.noCalibration);
    if (report.headset !== null) this.set(words.headset, report.headset);
    if (report.posture !== null) this.set(words.posture, report.posture);
    if (report.reach !== null) this.set(words.inReach, report.reach.line);
    if (report.limb !== null) this.set(words.limb, report.limb);
    this.set(words.unreadable, String(report.malformed));
    this.set(words.bodies, report.bodies.join(", ") || "none");
  }

  private set(name: string, value: string): void {
    let cell = this.cells.get(name);
    if (!cell) {
      cell = element("dd");
      this.cells.set(name, cell);
      this.list.append(element("dt", "", name), cell);
    }
    setText(cell, value);
  }
}

function place(pose: Pose | null): string {
  return pose ? `${pose.translation.map((value) => fixed(value, 3)).join(", ")} m` : words.unknown;
}

function ms(secs: number): string {
  return `${fixed(1000 * secs)} ms`;
}

/** Of the last ten seconds. */
function dropouts({ dropouts: count, longest_secs: longest, missing }: PoseStreamStatistics): string {
  return count === 0 ? words.noDropouts : words.dropouts(count, ms(longest), 100 * missing);
}

/** The frames of one source in `world`. */
class FramesView {
  readonly root = new Group();
  private readonly tracking = new AxesHelper(0.3);
  private readonly body = new AxesHelper(0.18);
  private readonly ring = new Mesh(new RingGeometry(0.05, 0.06, 40), new MeshBasicMaterial({ color: "#0b6fb8", side: DoubleSide }));
  private readonly trail = new Line(
    new BufferGeometry().setAttribute("position", new BufferAttribute(new Float32Array(3 * TRAIL_LENGTH), 3)),
    new LineBasicMaterial({ color: "#0b6fb8" }),
  );
  private readonly places: number[][] = [];
  private readonly reach = new Group();
  private reached = "";

  constructor() {
    this.trail.frustumCulled = false;
    this.root.add(this.tracking, this.body, this.ring, this.trail, this.reach);
  }

  /** Places of the box, coloured by what it takes to get there. */
  private showReach(picture: ReachGrid | null): void {
    const key = JSON.stringify(picture);
    if (key === this.reached) return;
    this.reached = key;
    this.reach.clear();
    if (!picture) return;
    const tile = new PlaneGeometry(0.85 * picture.spacing_m, 0.85 * picture.spacing_m);
    const [still, leaning, never] = ["#00a070", "#d9a514", "#d03a2f"].map((color) => new MeshBasicMaterial({ color, side: DoubleSide, transparent: true, opacity: 0.7 }));
    for (const { x, y, lean_deg } of picture.spots) {
      const mesh = new Mesh(tile, lean_deg === null ? never : lean_deg < 0.5 ? still : leaning);
      mesh.position.set(x, y, picture.height_m);
      this.reach.add(mesh);
    }
  }

  show({ reach, world_from_tracking, world_from_shoulder, tracking_from_body, fault }: TrackingReport): void {
    this.showReach(reach);
    // Before a trial has placed the system in the world its own frame is all there is.
    const body = world_from_shoulder ?? tracking_from_body;
    set(this.tracking, world_from_tracking);
    set(this.body, body);
    set(this.ring, body);
    this.ring.material.color.set(fault === null ? "#00a070" : "#d03a2f");
    if (!body) return;
    this.places.push(body.translation);
    if (this.places.length > TRAIL_LENGTH) this.places.shift();
    const points = this.trail.geometry.getAttribute("position");
    for (let k = 0; k < TRAIL_LENGTH; k++) {
      const [x = 0, y = 0, z = 0] = this.places[Math.min(k, this.places.length - 1)] ?? [];
      points.setXYZ(k, x, y, z);
    }
    points.needsUpdate = true;
  }
}

function set(thing: AxesHelper | Mesh, pose: Pose | null): void {
  thing.visible = pose !== null;
  if (!pose) return;
  thing.position.fromArray(pose.translation);
  thing.quaternion.fromArray(pose.rotation);
}

function makeView(): { world: Scene; draw: () => void } | null {
  const world = new Scene();
  try {
    const renderer = new WebGLRenderer({ canvas, antialias: true, alpha: true });
    const camera = new PerspectiveCamera(45, 1, 0.05, 50);
    camera.up.set(0, 0, 1);
    camera.position.set(-2.6, 2.2, 2.4);
    const orbit = new OrbitControls(camera, canvas);
    orbit.target.set(-0.2, 0, 1.1);
    orbit.update();
    const floor = new GridHelper(4, 16, "#7b8894", "#b7c1ca");
    floor.rotation.x = Math.PI / 2;
    world.add(floor, new AxesHelper(0.5));
    const draw = (): void => {
      const { clientWidth: width, clientHeight: height } = scene;
      renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
      renderer.setSize(width, height, false);
      camera.aspect = width / Math.max(height, 1);
      camera.updateProjectionMatrix();
      renderer.render(world, camera);
    };
    orbit.addEventListener("change", draw);
    window.addEventListener("resize", draw);
    return { world, draw };
  } catch {
    scene.replaceChildren(element("p", "muted", words.noPicture));
    return null;
  }
}

const view = makeView();
const shown = new Map<string, { card: SourceCard; frames: FramesView }>();
const none = element("p", "card", words.none);

function show(reports: TrackingReport[]): void {
  none.hidden = reports.length > 0;
  for (const report of reports) {
    let parts = shown.get(report.source);
    if (!parts) {
      parts = { card: new SourceCard(), frames: new FramesView() };
      shown.set(report.source, parts);
      cards.append(parts.card.root);
      view?.world.add(parts.frames.root);
    }
    parts.card.show(report);
    parts.frames.show(report);
  }
  view?.draw();
}

async function ask(): Promise<void> {
  try {
    const answer = await fetch("/api/tracking", { signal: AbortSignal.timeout(2000) });
    if (!answer.ok) throw new Error(String(answer.status));
    show((await answer.json()) as TrackingReport[]);
    setText(link, words.live);
  } catch {
    setText(link, words.gone);
  }
  setTimeout(() => void ask(), REPORT_INTERVAL_MS);
}

cards.append(none);
void ask();
