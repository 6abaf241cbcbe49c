// The page that guides a calibration, and shows the tests after it. It holds no state of the session: everything that
// it shows comes with each message, so that a reload loses nothing.

import "./calibrate.css";
import { element, setClass, setText, setWidth } from "./dom";
import type { CalibrationCommand, CalibrationMessage, CalibrationReport, CalibrationScreen, DriveScore, Gesture, TestKind } from "./generated/types";
import { gestureInstruction, handPicture } from "./hand";
import { OutcomeFlash, MotionView, TacView } from "./limbTests";
import { limbResults } from "./limbResults";
import { strings } from "./strings";
import { fixed } from "./numbers";

const words = strings.calibration;

/** What there is to show, of one kind. */
type Screen<Kind extends CalibrationScreen["type"]> = Extract<CalibrationScreen, { type: Kind }>;

const connection = element("span", "muted", words.connecting);
const source = element("span", "muted");
const picture = element("div", "picture");
const name = element("div", "name");
const count = element("div", "count muted");
const fill = element("div");
const bar = element("div", "bar", fill);
const prompt = element("section", "card prompt", picture, name, count, bar);
const canvas = element("canvas");
const figures = element("p", "muted");
const cursor = element("section", "card", element("h2", "", words.cursorTask), canvas, figures);
const flash = new OutcomeFlash();
const motion = new MotionView(flash);
const tac = new TacView(flash);
const lightList = element("div", "lights");
const lights = element("section", "card", element("h2", "", words.electrodes), lightList);
const verdictNode = element("div");
const judgement = element("section", "card", verdictNode);
const buttons = element("div", "buttons");
const notes = element("div", "muted");
const handlers = element("section", "card", buttons, notes);
document
  .getElementById("page")
  ?.append(
    element("header", "", element("h1", "", words.title), source, connection),
    flash.root,
    prompt,
    motion.root,
    tac.root,
    cursor,
    handlers,
    lights,
    judgement,
  );

let socket: WebSocket | null = null;
let shownPicture = "";
let shownReport = "";
let shownButtons = "";

function send(message: CalibrationCommand): void {
  socket?.send(JSON.stringify(message));
}

function connect(): void {
  const opened = new WebSocket(`${location.origin.replace("http", "ws")}/calibration`);
  socket = opened;
  opened.addEventListener("open", () => setText(connection, words.connected));
  opened.addEventListener("message", (event) => show(JSON.parse(String(event.data)) as CalibrationMessage));
  opened.addEventListener("close", () => {
    setText(connection, words.gone);
    setTimeout(connect, 1000);
  });
}

function show(message: CalibrationMessage): void {
  // For tests in a browser, as on the main page.
  Object.assign(window, { __calibration: message });
  if (message.type === "error") {
    setText(notes, message.message);
    return;
  }
  if (message.type === "nothing") return;
  setText(source, message.source);
  setText(notes, message.messages.join("\n"));
  notes.style.whiteSpace = "pre-line";
  // Nothing to press and nothing to read.
  handlers.hidden = !["calibration", "ready"].includes(message.type) && message.messages.length === 0;
  prompt.hidden = ["cursor", "motion", "tac"].includes(message.type);
  motion.root.hidden = message.type !== "motion";
  tac.root.hidden = message.type !== "tac";
  cursor.hidden = message.type !== "cursor";
  lights.hidden = message.type !== "calibration";
  if (message.type !== "calibration") judgement.hidden = message.type !== "end";
  if (message.type === "calibration") showCalibration(message);
  else if (message.type === "ready") showReady(message);
  else if (message.type === "test") showTest(message);
  else if (message.type === "motion" || message.type === "tac") {
    setButtons("none", () => []);
    if (message.type === "motion") motion.show(message);
    else tac.show(message);
  }
  else if (message.type === "cursor") showCursor(message);
  else if (message.type === "end") showEnd(message);
}

function showPrompt(gesture: Gesture, text: string, share: number, recording: boolean): void {
  if (shownPicture !== gesture) {
    shownPicture = gesture;
    picture.replaceChildren(handPicture(gesture));
  }
  setText(name, gestureInstruction(gesture));
  setText(count, text);
  setClass(bar, "recording", recording);
  setWidth(fill, share);
}

function showCalibration(message: Screen<"calibration">): void {
  const { phase, position } = message;
  const arm = position ? `arm: ${position}; ` : "";
  if (!message.begun) {
    showPrompt("no_motion", words.before, 0, false);
  } else if (phase.name === "preparing") {
    showPrompt(phase.prompt.gesture, words.recordingIn(arm, Math.ceil(phase.left_secs)), 0, false);
  } else if (phase.name === "recording") {
    showPrompt(phase.prompt.gesture, `${arm}hold`, phase.share, true);
  } else if (phase.name === "blocked") {
    showPrompt(phase.prompt.gesture, words.waiting(arm), 0, false);
  } else {
    showPrompt("no_motion", words.recorded(message.rounds), 1, false);
  }
  const wanted = message.channels.map(({ light, fault }, k) => ({ light, text: `${k + 1} ${fault ?? ""}`.trim() }));
  const { stream } = message;
  const rate = stream.rate_hz === null ? "" : ` ${fixed(stream.rate_hz)} Hz`;
  wanted.push({ light: stream.light, text: words.stream(rate, stream.lost_share > 0) });
  while (lightList.children.length < wanted.length) lightList.append(element("span", "light"));
  wanted.forEach(({ light, text }, k) => {
    const node = lightList.children[k];
    if (!node) return;
    setText(node, text);
    setClass(node, "amber", light === "amber");
    setClass(node, "red", light === "red");
  });
  showReport(message.report, message.target_accuracy, message.target_r2);
  showButtons(message);
}

/** How far each degree of freedom of a regressor follows what was asked for. */
function regressorTable(drives: DriveScore[]): HTMLElement {
  const head = element("tr", "", ...[words.drive, words.r2, words.meanError].map((text) => element("th", "", text)));
  const rows = drives.map(({ drive, r2, mean_absolute_error: off }) =>
    element("tr", "", element("th", "", drive), element("td", "", fixed(r2, 3)), element("td", "", fixed(off, 3))),
  );
  return element("div", "scroll", element("table", "drives", head, ...rows));
}

function showReport(report: CalibrationReport | null, target: number, targetR2: number): void {
  judgement.hidden = report === null;
  const key = JSON.stringify(report);
  if (report === null || key === shownReport) return;
  shownReport = key;
  const percent = (share: number) => `${fixed(100 * share, 1)} %`;
  const head = element("tr", "", element("th", "", words.asked), ...report.classes.map((g) => element("th", "", gestureInstruction(g))));
  head.append(element("th", "", words.recognised));
  const rows = report.classes.map((gesture, row) => {
    const cells = (report.confusion[row] ?? []).map((n) => element("td", "", String(n)));
    return element("tr", "", element("th", "", gestureInstruction(gesture)), ...cells, element("td", "", percent(report.recall[row] ?? 0)));
  });
  const drives = report.drives ?? [];
  const aim = drives.length > 0 ? words.aimR2(fixed(targetR2, 2)) : words.aim(percent(target));
  const verdict = report.good_enough ? words.goodEnough : aim;
  const warnings = report.repetitions
    .filter((r) => r.outlier)
    .map((r) => element("p", "warning", words.differs(r.repetition + 1, gestureInstruction(r.gesture))));
  verdictNode.replaceChildren(
    element("h2", "accuracy", words.round(report.rounds, percent(report.accuracy), verdict)),
    ...warnings,
    typeof report.accuracy_without_imu === "number" ? element("p", "small withoutimu", words.withoutImu(percent(report.accuracy_without_imu))) : "",
    drives.length > 0 ? regressorTable(drives) : "",
    element("div", "scroll", element("table", "", head, ...rows)),
  );
}

/** What a training drew, as it is saved beside the model. */
interface Figure {
  title: string;
  caption: string;
  drawing: string;
}

function figureView({ title, caption, drawing }: Figure): HTMLElement {
  const parsed = new DOMParser().parseFromString(drawing, "image/svg+xml").documentElement;
  parsed.setAttribute("role", "img");
  parsed.setAttribute("aria-label", title);
  const node = element("figure", "", element("h3", "", title));
  node.append(document.importNode(parsed, true), element("figcaption", "muted", caption));
  return node;
}

function button(text: string, classes: string, enabled: boolean, act: () => void): HTMLButtonElement {
  const node = element("button", classes, text);
  node.type = "button";
  node.disabled = !enabled;
  node.addEventListener("click", act);
  return node;
}

/** Made anew only when they change, or a click that takes a moment would be lost. */
function setButtons(key: string, make: () => HTMLButtonElement[]): void {
  if (key === shownButtons) return;
  shownButtons = key;
  buttons.replaceChildren(...make());
}

/** The button that begins; it has the focus, so that a key presses it. */
function showBegin(): void {
  setButtons("begin", () => {
    const begin = button(words.begin, "main", true, () => send({ type: "begin" }));
    queueMicrotask(() => begin.focus());
    return [begin];
  });
}

function showButtons(message: Screen<"calibration">): void {
  if (!message.begun) {
    showBegin();
    return;
  }
  const { reviewing, rounds, most_rounds: most, report } = message;
  setButtons(JSON.stringify([reviewing, rounds, report?.good_enough]), () => [
    button(words.another, report?.good_enough ? "" : "main", reviewing && rounds < most, () => send({ type: "proceed" })),
    button(words.finish, report?.good_enough ? "main" : "", reviewing, () => send({ type: "finish" })),
    ...message.gestures.map((gesture) =>
      button(`Again: ${gestureInstruction(gesture)}`, "", reviewing, () => send({ type: "record_again", gesture })),
    ),
  ]);
}

/** What comes, said before it begins. */
const NEXT: Record<TestKind, string> = {
  sequence: words.sequence,
  trial: words.trial,
  motion: words.motion,
  tac1: words.tac1,
  tac3: words.tac3,
  cursor: words.cursor,
};

function showReady(message: Screen<"ready">): void {
  flash.reset();
  showPrompt("no_motion", words.ready(NEXT[message.next]), 0, false);
  showBegin();
}

function showTest(message: Screen<"test">): void {
  setButtons("none", () => []);
  const progress =
    message.test === "sequence"
      ? words.inARow(message.report.in_a_row)
      : words.prompts(message.report.prompts, `${fixed(100 * message.report.accuracy)} %`);
  showPrompt(message.prompt ?? "no_motion", words.inForce(gestureInstruction(message.in_force), progress), 0, false);
}

function showCursor(message: Screen<"cursor">): void {
  setButtons("none", () => []);
  const size = Math.round(canvas.clientWidth * devicePixelRatio) || 1;
  if (canvas.width !== size) {
    canvas.width = size;
    canvas.height = size;
  }
  const context = canvas.getContext("2d");
  if (!context) return;
  const half = size / 2;
  const disc = ([x, y]: [number, number], radius: number, colour: string) => {
    context.beginPath();
    context.arc(half * (1 + x), half * (1 - y), half * radius, 0, 2 * Math.PI);
    context.fillStyle = colour;
    context.fill();
  };
  context.clearRect(0, 0, size, size);
  disc(message.target, message.width / 2, message.dwelt > 0 ? "#2f8f55" : "#2a7fd0");
  disc(message.target, (message.width / 2) * message.dwelt, "#3fb76a");
  disc(message.cursor, 0.025, getComputedStyle(document.body).color);
  const { report } = message;
  setText(
    figures,
    words.cursorFigures(
      report.movements.length,
      report.asked,
      fixed(report.throughput_bits_per_s, 2),
      fixed(100 * report.path_efficiency),
      fixed(report.overshoots, 2),
      fixed(100 * report.completion_rate),
      gestureInstruction(message.in_force),
    ),
  );
}

function showEnd(message: Screen<"end">): void {
  setButtons("none", () => []);
  const done = words.done;
  showPrompt("no_motion", done, 1, false);
  judgement.hidden = false;
  shownReport = "";
  const { figures: drawn, ...result } = message.result ?? {};
  const pictures = Array.isArray(drawn) ? (drawn as Figure[]).map(figureView) : [];
  const driven = Array.isArray(result.drives) ? (result.drives as DriveScore[]) : [];
  const tables = limbResults(result);
  const all = element("pre", "scroll", JSON.stringify(result, null, 1));
  all.tabIndex = 0;
  const figures = element("details", "", element("summary", "", words.figures), all);
  prompt.hidden = tables.length > 0;
  // A test names the model that it was given, a calibration the one that it wrote.
  const model = String(result.model ?? "");
  const heading = "passed" in result ? words.resultsWith(model) : model ? words.modelIn(model) : words.result;
  figures.open = tables.length === 0 && pictures.length === 0;
  verdictNode.replaceChildren(
    element("h2", "accuracy", heading),
    tables.length > 0 ? element("p", "", done) : "",
    ...tables,
    driven.length > 0 ? regressorTable(driven) : "",
    element("div", "figures", ...pictures),
    figures,
  );
}

for (const card of [motion.root, tac.root]) card.hidden = true;
cursor.hidden = true;
lights.hidden = true;
judgement.hidden = true;
connect();
