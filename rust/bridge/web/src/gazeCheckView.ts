// The five-point gaze check as the participant sees it: a point in the scene, then the next, then the figures.

import { Sprite, SpriteMaterial, Vector3 } from "three";
import { button, element, setText } from "./dom";
import { correction, scorePoint, summarize, type GazeFrame, type PointResult } from "./gazeCheck";
import type { DisplayFrame, GazeCheck } from "./generated/types";
import type { TaskScene } from "./scene";
import { drawnTexture } from "./shapes";
import { strings } from "./strings";
import { fixed } from "./numbers";

const words = strings.gazeCheck;

/** The eye has this long to arrive at a point, ms. */
const SETTLE_MS = 900;
/** And is measured for this long, ms. */
const MEASURE_MS = 1300;
/** The points, as shares of the half table top along x and y. */
const POINT_POSITIONS = [
  [0, 0],
  [0.75, 0.8],
  [0.75, -0.8],
  [-0.75, -0.8],
  [-0.75, 0.8],
] as const;
/** Mean error up to which blocks can be told apart, degrees: neighbours stand 5 to 10 degrees apart. */
const MAX_GAZE_ERROR_DEG = 2;

export class GazeCheckView {
  readonly root = element("div", "dialog gazecheck");
  readonly mark: Sprite;
  private readonly title = element("h2");
  private readonly body = element("div");
  private room: TaskScene | null = null;
  private source = "mouse";
  private calibrates = false;
  private done: PointResult[] = [];
  private frames: GazeFrame[] = [];
  /** Since when the point is on the screen; none until a picture of it was made, which may take seconds for the first one. */
  private began: number | null = null;
  private pictures = 0;
  private running = false;
  /** The gaze is where the ring is: there is neither a mouse nor an eye tracker. */
  private gazeFollowsPoint = false;
  private last: Vector3 | null = null;
  /** Whoever takes part in a study need not judge figures: the experimenter has them. */
  hidesFigures = false;

  constructor(private readonly finished: (check: GazeCheck) => void) {
    const texture = drawnTexture((context) => {
      for (const [radius, colour] of [[1, "#17212b"], [0.86, "#ffffff"], [0.5, "#17212b"], [0.2, "#ffffff"]] as const) {
        context.fillStyle = colour;
        context.beginPath();
        context.arc(0, 0, radius, 0, 2 * Math.PI);
        context.fill();
      }
    }, 128);
    this.mark = new Sprite(new SpriteMaterial({ map: texture, depthTest: false, sizeAttenuation: false }));
    this.mark.renderOrder = 20;
    this.mark.visible = false;
    this.root.hidden = true;
    this.root.append(this.title, this.body);
  }

  private get what(): string {
    return this.calibrates ? words.titles.calibration : words.titles.check;
  }

  get active(): boolean {
    return this.running;
  }

  /** The point that is to be looked at now, in `world`. */
  get point(): Vector3 | null {
    const share = POINT_POSITIONS[this.done.length];
    if (!this.running || !share || !this.room) return null;
    const { tableCenter: centre, tableHalfSize: half } = this.room;
    return new Vector3(centre.x + share[0] * half.x, centre.y + share[1] * half.y, centre.z);
  }

  /** Where the gaze is of whoever has no mouse. */
  get followedPoint(): Vector3 | null {
    if (!this.gazeFollowsPoint || this.root.hidden) return null;
    // Until the figures are put away it stays where it was: a gaze that ends stops the arm.
    this.last = this.point ?? this.last;
    return this.last;
  }

  /** Begins a check, or with `calibrates` one whose error is taken off the gaze from then on. */
  start(room: TaskScene, source: string, calibrates = false): void {
    Object.assign(this, { room, source, calibrates, done: [], frames: [], running: true, gazeFollowsPoint: false, began: null, pictures: 0 });
    this.root.hidden = false;
    this.body.replaceChildren(element("p", "", words.look));
    if (source !== "mouse") return;
    const follow = button(words.follow, () => this.follow(), "plain follow");
    this.body.append(follow);
    follow.focus({ preventScroll: true });
  }

  private follow(): void {
    Object.assign(this, { source: "keys", gazeFollowsPoint: true, done: [], frames: [], began: null, pictures: 0 });
  }

  stop(): void {
    this.running = false;
    this.mark.visible = false;
    this.root.hidden = true;
  }

  /** Takes each new frame. */
  addFrame(frame: DisplayFrame): void {
    const point = this.point;
    if (!point || this.began === null) return;
    const elapsed = performance.now() - this.began;
    if (elapsed > SETTLE_MS) this.frames.push({ time: frame.time, gaze: frame.gaze });
    if (elapsed < SETTLE_MS + MEASURE_MS) return;
    this.done.push(scorePoint(this.frames, point.toArray()));
    this.frames = [];
    [this.began, this.pictures] = [null, 0];
    if (this.done.length === POINT_POSITIONS.length) this.show();
  }

  /** Called once per picture. */
  update(): void {
    const point = this.point;
    this.mark.visible = point !== null;
    if (!point) return;
    const now = performance.now();
    // The second picture comes when the first one has been drawn.
    this.pictures += 1;
    if (this.pictures > 1) this.began ??= now;
    const settling = Math.max(1 - (now - (this.began ?? now)) / SETTLE_MS, 0);
    this.mark.position.copy(point);
    this.mark.scale.setScalar(0.03 + 0.05 * settling);
    setText(this.title, words.pointOf(this.what, this.done.length + 1, POINT_POSITIONS.length));
  }

  private show(): void {
    this.running = false;
    this.mark.visible = false;
    const found = this.calibrates ? correction(this.done) : null;
    const check: GazeCheck = { source: this.source, points: this.done, correction_deg: Array.isArray(found) ? found : null };
    this.finished(check);
    const { accuracy, precision, lost, blinks } = summarize(this.done);
    const degrees = (value: number | null) => (value === null ? "–" : `${fixed(value, 2)}°`);
    const row = (name: string, ...cells: string[]) =>
      element("tr", "", element("th", "", name), ...cells.map((cell) => element("td", "", cell)));
    const rows = this.done.map((point, k) =>
      row(
        words.point(k + 1),
        degrees(point.accuracy_deg),
        degrees(point.precision_deg),
        `${Math.round(100 * point.lost_share)} %`,
        String(point.blinks),
      ),
    );
    const good = accuracy !== null && accuracy <= MAX_GAZE_ERROR_DEG && lost < 0.2;
    const close = button(words.done, () => this.stop(), "primary");
    const focused = this.body.contains(document.activeElement);
    const verdict = good
      ? words.good(degrees(accuracy))
      : words.bad(degrees(accuracy));
    setText(this.title, words.titleOf(this.what, this.source));
    if (this.hidesFigures) {
      const well = Array.isArray(found) || (found === null && good);
      setText(this.title, well ? words.thanks : words.tell);
      this.body.replaceChildren(
        element("p", well ? "verdict good" : "verdict bad", well ? words.measured : words.notFollowed),
        close,
      );
      if (focused) close.focus({ preventScroll: true });
      return;
    }
    this.body.replaceChildren(
      Array.isArray(found)
        ? element("p", "verdict good", words.calibrated(offsetText(found)))
        : typeof found === "string"
          ? element("p", "verdict bad", words.notCalibrated(found))
          : element("p", good ? "verdict good" : "verdict bad", verdict),
      element(
        "table",
        "",
        element("thead", "", row("", ...words.heads)),
        element("tbody", "", ...rows, row(words.all, degrees(accuracy), degrees(precision), `${Math.round(100 * lost)} %`, String(blinks))),
      ),
      element("p", "note", words.stored),
      close,
    );
    if (focused) close.focus({ preventScroll: true });
  }
}

/** An offset in words. */
function offsetText([left, up]: [number, number]): string {
  return words.offset(fixed(Math.abs(left), 2), left >= 0, fixed(Math.abs(up), 2), up < 0);
}
