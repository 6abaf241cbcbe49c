// The tests of miniVIE on the calibration page: the motion test, and a virtual wrist and grasp that are brought to a target.

import { element, setClass, setText, setWidth } from "./dom";
import type { CalibrationScreen, Gesture, TacAxisState } from "./generated/types";
import { gestureInstruction, handDrawing, handPicture, type HandPose, svgElement } from "./hand";
import { strings } from "./strings";
import { fixed } from "./numbers";

const words = strings.limb;

type Motion = Extract<CalibrationScreen, { type: "motion" }>;
type Tac = Extract<CalibrationScreen, { type: "tac" }>;

/** How long the outcome of a motion or target is shown, ms. */
const FLASH_MS = 1500;

function meanText(seconds: number | null): string {
  return seconds === null ? "" : words.mean(fixed(seconds, 1));
}

/** A place on an axis, with its unit. */
export function withUnit(axis: string, value: number): string {
  return axis === "grasp" ? `${fixed(value)} %` : `${fixed(value)}°`;
}

/** How a motion or target ended, for a moment, over whatever follows. */
export class OutcomeFlash {
  readonly root = element("div", "flash");
  private counted: number | null = null;
  private timer = 0;

  constructor() {
    this.root.setAttribute("role", "status");
  }

  /** `done` of a test are over, and the last of them as `good` and `text` say. What was over at the first look is old. */
  showOutcome(done: number, good: boolean, text: string): void {
    const grown = this.counted !== null && done > this.counted;
    this.counted = done;
    if (!grown) return;
    this.root.className = `flash ${good ? "good" : "bad"}`;
    setText(this.root, `${good ? "✓" : "✗"} ${text}`);
    clearTimeout(this.timer);
    this.timer = window.setTimeout(() => this.root.replaceChildren(), FLASH_MS);
  }

  /** The next test counts anew. */
  reset(): void {
    this.counted = null;
  }
}

/** What both tests show of the time and of how far they are. */
class TestProgress {
  readonly count = element("h2");
  private readonly left = element("span", "left");
  private readonly fill = element("div");
  private readonly bar = element("div", "bar time", this.fill);
  private readonly recognized = element("p", "recognised");
  readonly head = element("div", "row", this.count, this.left);
  readonly foot = element("div", "", this.bar, this.recognized);

  show(left: number, limit: number, runs: boolean, gesture: Gesture, mark: string): void {
    setText(this.left, runs ? words.left(left < 10 ? fixed(left, 1) : fixed(left)) : words.each(limit));
    setWidth(this.fill, runs ? left / limit : 1);
    setClass(this.bar, "late", runs && left < 0.25 * limit);
    setText(this.recognized, words.recognised(gestureInstruction(gesture), mark));
  }
}

/** The motion test. */
export class MotionView {
  private readonly course = new TestProgress();
  private readonly picture = element("div", "picture");
  private readonly name = element("div", "name");
  private readonly dots = element("div", "dots");
  private readonly right = element("div", "count muted");
  readonly root = element("section", "card prompt", this.course.head, this.picture, this.name, this.dots, this.right, this.course.foot);
  private shown = "";

  constructor(private readonly flash: OutcomeFlash) {
    this.dots.setAttribute("aria-hidden", "true");
  }

  show(test: Motion): void {
    const { attempts, asked, mean_completion_secs: mean } = test.report;
    const complete = attempts.filter(({ completion_secs: secs }) => secs !== null).length;
    const { relaxing } = test;
    setText(
      this.course.count,
      words.motion(Math.min(attempts.length + 1, asked), asked) + (attempts.length > 0 ? words.complete(complete) + meanText(mean) : ""),
    );
    if (this.shown !== test.prompt) {
      this.shown = test.prompt;
      this.picture.replaceChildren(handPicture(test.prompt));
      setText(this.name, gestureInstruction(test.prompt));
    }
    while (this.dots.children.length < test.needed) this.dots.append(element("span"));
    [...this.dots.children].forEach((dot, k) => setClass(dot, "on", k < test.right));
    setText(this.right, relaxing ? words.next : words.decisions(test.right, test.needed));
    const mark = relaxing ? "" : test.in_force === test.prompt ? " ✓" : "";
    this.course.show(test.left_secs, test.limit_secs, !relaxing, test.in_force, mark);
    const last = attempts.at(-1);
    const secs = last?.completion_secs ?? null;
    const outcome = secs === null ? words.timeIsUp : words.completeIn(fixed(secs, 1));
    this.flash.showOutcome(attempts.length, secs !== null, words.ended(gestureInstruction(last?.prompt ?? ""), outcome));
  }
}

/** One axis: where it is, where it has to go, and which gesture leads where. */
class AxisGauge {
  private readonly name = element("span", "name");
  private readonly value = element("span", "value");
  private readonly band = element("div", "band");
  private readonly marker = element("div", "marker");
  private readonly track = element("div", "track", this.band, this.marker);
  private readonly down = element("span");
  private readonly up = element("span");
  readonly root = element("div", "gauge", element("div", "row", this.name, this.value), this.track, element("div", "row muted", this.down, this.up));

  constructor() {
    this.track.setAttribute("role", "meter");
  }

  show({ axis, position, target }: TacAxisState): void {
    const [low, high] = axis.range;
    const percent = (value: number) => (100 * (value - low)) / (high - low);
    const inside = isInside({ axis, position, target });
    const value = words.gauge(withUnit(axis.name, position), withUnit(axis.name, target), axis.tolerance);
    setText(this.name, axis.name);
    setText(this.value, `${inside ? "✓ " : ""}${value}`);
    this.band.style.left = `${percent(target - axis.tolerance)}%`;
    this.band.style.width = `${percent(low + 2 * axis.tolerance)}%`;
    this.marker.style.left = `${percent(position)}%`;
    setText(this.down, `← ${gestureInstruction(axis.down)}`);
    setText(this.up, `${gestureInstruction(axis.up)} →`);
    setClass(this.root, "inside", inside);
    for (const [attribute, said] of [
      ["aria-label", axis.name],
      ["aria-valuemin", String(low)],
      ["aria-valuemax", String(high)],
      ["aria-valuenow", fixed(position)],
      ["aria-valuetext", value],
    ] as const) {
      if (this.track.getAttribute(attribute) !== said) this.track.setAttribute(attribute, said);
    }
  }
}

function isInside({ axis, position, target }: TacAxisState): boolean {
  return Math.abs(position - target) <= axis.tolerance;
}

/** Target achievement control. */
export class TacView {
  private readonly course = new TestProgress();
  private readonly message = element("div", "name");
  private readonly limb = element("div", "picture");
  private readonly gauges = element("div", "gauges");
  private readonly shownAxes: AxisGauge[] = [];
  readonly root = element("section", "card prompt tac", this.course.head, this.message, this.limb, this.gauges, this.course.foot);

  constructor(private readonly flash: OutcomeFlash) {}

  show(test: Tac): void {
    const { trials, asked, mean_secs: mean } = test.report;
    const reached = trials.filter(({ secs }) => secs !== null).length;
    setText(
      this.course.count,
      words.target(Math.min(trials.length + 1, asked), asked) + (trials.length > 0 ? words.reached(reached) + meanText(mean) : ""),
    );
    const inside = test.axes.length > 0 && test.axes.every(isInside);
    setText(this.message, inside && test.phase === "moving" ? words.inTarget : words.phases[test.phase]);
    this.limb.replaceChildren(limbPicture(test.axes, test.dwelt, inside));
    while (this.shownAxes.length < test.axes.length) this.shownAxes.push(new AxisGauge());
    this.shownAxes.length = test.axes.length;
    test.axes.forEach((axis, k) => this.shownAxes[k]?.show(axis));
    this.gauges.replaceChildren(...this.shownAxes.map(({ root }) => root));
    this.course.show(test.left_secs, test.limit_secs, test.phase === "moving", test.in_force, "");
    const secs = trials.at(-1)?.secs ?? null;
    this.flash.showOutcome(trials.length, secs !== null, secs === null ? words.notReached : words.reachedIn(fixed(secs, 1)));
  }
}

/** The hand where it is, over its outline where it should be; around it a ring that closes while it stays there. */
function limbPicture(axes: TacAxisState[], dwelt: number, inside: boolean): SVGSVGElement {
  const place = (name: string, of: "position" | "target") => axes.find(({ axis }) => axis.name === name)?.[of];
  const bends = place("elbow flexion", "target") !== undefined;
  const turns = place("wrist rotation", "target") !== undefined;
  const [left, top, width, height] = bends ? [-160, -160, 410, 300] : [-15, -5, 255, 190];
  const picture = svgElement("svg", {
    viewBox: `${left} ${top} ${width + (turns ? 110 : 0)} ${height}`,
    role: "img",
    "aria-label": words.picture(inside),
  });
  const pose = (of: "position" | "target"): HandPose => {
    const grasp = place("grasp", of);
    const closed = grasp === undefined ? 0.3 : grasp / 100;
    return { wrist: place("wrist flexion", of) ?? 0, spread: grasp === undefined ? 0.2 : 1 - closed, closed };
  };
  const arm = (of: "position" | "target", thicker: number) => {
    // The elbow is where the forearm begins.
    const forearm = svgElement("g", { transform: `rotate(${-(place("elbow flexion", of) ?? 0)} 10 80)` });
    forearm.append(...handDrawing(pose(of), thicker));
    return forearm;
  };
  const outline = arm("target", 12);
  outline.setAttribute("class", `outline${inside ? " inside" : ""}`);
  picture.append(outline);
  if (bends) picture.append(svgElement("line", { x1: -130, y1: 80, x2: 10, y2: 80, stroke: "#c98f63", "stroke-width": 38, "stroke-linecap": "round" }));
  picture.append(arm("position", 0));
  // The wrist from its end: a hand turns about the forearm.
  if (turns) {
    const [x, y] = [left + width + 50, top + height / 2];
    const palm = (angle: number, attributes: Record<string, string | number>) => {
      const turned = svgElement("g", { transform: `rotate(${angle} ${x} ${y})`, ...attributes });
      turned.append(svgElement("ellipse", { cx: x, cy: y, rx: 14, ry: 36 }), svgElement("circle", { cx: x, cy: y - 42, r: 9 }));
      return turned;
    };
    picture.append(
      palm(place("wrist rotation", "target") ?? 0, { class: `outline end${inside ? " inside" : ""}` }),
      palm(place("wrist rotation", "position") ?? 0, { fill: "#e8b48a" }),
    );
  }
  const radius = 18;
  const around = 2 * Math.PI * radius;
  const ring = { cx: left + radius + 8, cy: top + radius + 8, r: radius, fill: "none", "stroke-width": 9 };
  picture.append(
    svgElement("circle", { ...ring, class: inside ? "ring" : "ring idle" }),
    svgElement("circle", {
      ...ring,
      class: "dwell",
      "stroke-dasharray": `${around * dwelt} ${around}`,
      transform: `rotate(-90 ${ring.cx} ${ring.cy})`,
    }),
  );
  return picture;
}
