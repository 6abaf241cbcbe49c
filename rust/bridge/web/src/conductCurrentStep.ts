// The step of a session that is to be done, or is being done: what to say, what is answered, what is ready.

import { ageText, answerCounts, BreakClock, breakText, clockText, readableName } from "./conductText";
import { button, element, setClass, setText, setWidth } from "./dom";
import { conditionName, textInLanguage } from "./forms";
import type { ReadinessCheck, CurrentStepScreen, StepActivity, StudyAction } from "./generated/types";
import { gestureInstruction, handPicture } from "./hand";
import { capitalize } from "./protocol";
import { strings } from "./strings";

const texts = strings.study;

/** Mean error up to which neighbouring blocks can be told apart, degrees; as in the gaze check. */
const MAX_GAZE_ERROR_DEG = 2;

export interface CurrentStepHandlers {
  /** Opens the questionnaire on this page. */
  fillIn(): void;
  action(action: StudyAction): void;
}

/** A step on display. It stays in place while its figures change, so that focus and scrolling are kept. */
interface StepContent<What> {
  nodes: HTMLElement[];
  update(what: What, now: CurrentStepScreen): void;
  /** Called several times a second. */
  tick?(wall: number): void;
}
type ActivityOf<Kind extends StepActivity["is"]> = Extract<StepActivity, { is: Kind }>;

export class CurrentStepView {
  readonly root = element("div", "now");
  private readonly since = element("span", "since");
  /** State, time and score of the trial. */
  private readonly trialFigures = element("p", "livetrial");
  private content: StepContent<StepActivity> | null = null;
  private shown = "";
  private began: number | null = null;

  constructor(private readonly handlers: CurrentStepHandlers) {}

  show(now: CurrentStepScreen | null, wall = performance.now()): void {
    if (!now) {
      this.root.replaceChildren();
      this.shown = "";
      return;
    }
    const kind = `${now.step} ${now.what.is} ${now.running}`;
    if (kind !== this.shown) {
      this.shown = kind;
      this.content = this.make(now.what.is);
      this.root.replaceChildren(...this.content.nodes, this.since);
    }
    this.began = now.running ? wall - 1000 * now.since_secs : null;
    this.content?.update(now.what, now);
    this.tick(wall);
  }

  /** What the rest of the page knows of the trial. */
  showTrial(text: string, paused: boolean): void {
    setText(this.trialFigures, text);
    setClass(this.trialFigures, "paused", paused);
  }

  tick(wall = performance.now()): void {
    this.content?.tick?.(wall);
    setText(this.since, this.began === null ? "" : texts.begunAgo(clockText((wall - this.began) / 1000)));
  }

  private make(kind: StepActivity["is"]): StepContent<StepActivity> {
    const parts: { [Kind in StepActivity["is"]]: () => StepContent<ActivityOf<Kind>> } = {
      say: speechContent,
      form: () => formContent(this.handlers),
      train: trainingContent,
      calibrate_gaze: () => gazeCalibrationContent(this.handlers),
      demonstrate: () => demonstrationContent(this.trialFigures),
      practise: () => practiceContent(this.trialFigures),
      rest: breakContent,
      trial: () => trialContent(this.trialFigures),
    };
    return parts[kind]() as StepContent<StepActivity>;
  }
}

function speechContent(): StepContent<ActivityOf<"say">> {
  const text = element("p", "speech");
  return { nodes: [text], update: (what) => setText(text, what.text.trim()) };
}

function formContent({ fillIn }: CurrentStepHandlers): StepContent<ActivityOf<"form">> {
  const title = element("h3");
  const about = element("p", "small");
  const bar = new ProgressBar();
  const answered = element("p");
  return {
    nodes: [title, about, bar.root, answered, element("div", "buttons", button(texts.fillIn, fillIn))],
    update(what) {
      setText(title, textInLanguage(what.form.title, navigator.language).text);
      setText(about, what.about === null ? "" : conditionName(what.about));
      const [kept, of] = answerCounts(what);
      setText(answered, of > 0 ? texts.answered(kept, of) : texts.nothingAsked);
      bar.show(of > 0 ? kept / of : 1);
    },
  };
}

function trainingContent(): StepContent<ActivityOf<"train">> {
  const picture = element("div", "picture");
  const gesture = element("h3");
  const text = element("p");
  const bar = new ProgressBar();
  const found = element("p", "found");
  let drawn = "";
  return {
    nodes: [element("div", "prompted", picture, element("div", "", gesture, text)), bar.root, found],
    update(what) {
      if (what.gesture !== drawn) picture.replaceChildren(handPicture(what.gesture));
      drawn = what.gesture;
      setText(gesture, gestureInstruction(what.gesture));
      setText(text, what.recording ? `Recording: ${what.text}` : capitalize(what.text));
      bar.show(what.share);
      const wanted = what.wanted === null ? "" : ` of ${what.wanted}`;
      const row = what.wanted === null && what.in_a_row === 0 ? "" : `${what.in_a_row}${wanted} without a mistake`;
      const seen = what.recognised === null ? "" : `Recognised: ${gestureInstruction(what.recognised).toLowerCase()}`;
      setText(found, [what.passed ? texts.passed : "", row, seen].filter(Boolean).join(" · "));
      setClass(found, "good", what.passed);
    },
  };
}

function gazeCalibrationContent({ action }: CurrentStepHandlers): StepContent<ActivityOf<"calibrate_gaze">> {
  const error = element("p");
  const calibrate = button(texts.calibrate, () => action("calibrate_gaze"));
  const check = button(texts.check, () => action("check_gaze"));
  return {
    nodes: [
      element("p", "", texts.fivePoints),
      error,
      element("div", "buttons", calibrate, check),
    ],
    update({ error_deg }, { running }) {
      calibrate.disabled = check.disabled = !running;
      setText(error, error_deg === null ? texts.notChecked : texts.gazeError(error_deg));
      setClass(error, "good", error_deg !== null && error_deg <= MAX_GAZE_ERROR_DEG);
      setClass(error, "bad", error_deg !== null && error_deg > MAX_GAZE_ERROR_DEG);
    },
  };
}

function demonstrationContent(live: HTMLElement): StepContent<ActivityOf<"demonstrate">> {
  return {
    nodes: [element("p", "", texts.demonstration), live],
    update: (_, { running }) => (live.hidden = !running),
  };
}

function practiceContent(live: HTMLElement): StepContent<ActivityOf<"practise">> {
  const bar = new ProgressBar();
  const carried = element("h3");
  return {
    nodes: [carried, bar.root, live],
    update(what, { running }) {
      setText(carried, `${what.carried} of ${what.transfers} carried`);
      bar.show(what.carried / Math.max(what.transfers, 1));
      live.hidden = !running;
    },
  };
}

function breakContent(): StepContent<ActivityOf<"rest">> {
  const clock = new BreakClock();
  const left = element("p", "countdown");
  let begun = false;
  return {
    nodes: [left],
    update(what, { step, running }) {
      begun = running;
      clock.take(step, what.left_secs, performance.now());
      if (!running) setText(left, `${clockText(what.left_secs)} planned`);
    },
    tick(wall) {
      if (!begun) return;
      const { text, over } = breakText(clock.leftSecs(wall));
      setText(left, text);
      setClass(left, "over", over);
    },
  };
}

function trialContent(live: HTMLElement): StepContent<ActivityOf<"trial">> {
  const number = element("p", "small");
  const before = element("p", "small");
  const checks = new CheckTable();
  return {
    nodes: [number, live, checks.root, before],
    update(what, { running }) {
      setText(number, texts.trialNumber(what.number[0], what.number[1]));
      setText(before, what.before ? texts.trialBefore(what.before) : "");
      live.hidden = !running;
      checks.show(what.checks);
    },
    tick: (wall) => checks.tick(wall),
  };
}

/** How much of something is over; the same stands beside it in words. */
class ProgressBar {
  private readonly fill = element("div");
  readonly root = element("div", "bar", this.fill);

  show(share: number): void {
    setWidth(this.fill, share);
  }
}

/** What is ready for a trial, and what is not. Ages go on while no message comes. */
class CheckTable {
  private readonly body = element("tbody");
  readonly root = element("table", "checks");
  private ages: { cell: HTMLElement; since: number }[] = [];
  private shown = "";

  constructor() {
    const head = [texts.check, texts.ready, texts.found, texts.age].map((name) => {
      const cell = element("th", "", name);
      cell.scope = "col";
      return cell;
    });
    this.root.append(element("thead", "", element("tr", "", ...head)), this.body);
  }

  show(checks: ReadinessCheck[]): void {
    this.root.hidden = checks.length === 0;
    const text = JSON.stringify(checks);
    if (text === this.shown) return;
    this.shown = text;
    this.ages = [];
    this.body.replaceChildren(...checks.map((check) => this.row(check)));
  }

  tick(wall: number): void {
    for (const { cell, since } of this.ages) setText(cell, ageText((wall - since) / 1000));
  }

  private row({ name, ready, found, age_secs }: ReadinessCheck): HTMLElement {
    const title = element("th", "", capitalize(readableName(name)));
    title.scope = "row";
    const age = element("td", "age");
    if (typeof age_secs === "number") this.ages.push({ cell: age, since: performance.now() - 1000 * age_secs });
    return element("tr", ready ? "" : "unready", title, element("td", `ready ${ready ? "yes" : "no"}`, ready ? texts.yes : texts.no), element("td", "", found), age);
  }
}
