// What is plotted of a recorded trial: signals by name, over seconds of the trial.

import type { DisplayFrame, Joint, RecordedEmg, RecordedTrial } from "./generated/types";
import { readableName } from "./objects";
import { GESTURE_NAMES, capitalize } from "./protocol";
import type { SignalData, SignalLine, SignalRow, SignalSpan } from "./signalData";
import { strings } from "./strings";

export const LANES = ["emg", "decoder", "gesture", "gaze", "intent", "plan", "joints"] as const;
export type LaneName = (typeof LANES)[number];

export interface Lane {
  name: LaneName;
  title: string;
  note: string;
  data: SignalData;
}

const words = strings.replay;

/** To be told apart on white and on dark grey, also by who sees colours differently (after Okabe and Ito). */
const COLORS = ["#0b7fc7", "#d55e00", "#00946b", "#b8608f", "#a07c00", "#4b9fd6", "#7b5fd0", "#7b8894"];
const GESTURE_COLORS: Record<string, string> = {
  no_motion: "#7b8894",
  wrist_extension: "#0b7fc7",
  wrist_flexion: "#d55e00",
  hand_close: "#00946b",
  hand_open: "#b8608f",
};
const PLAN_COLORS = { idle: "", planning: "#a07c00", executing: "#0b7fc7", arrived: "#00946b", failed: "#d0342c" };
const LOCKED_COLOR = "#4b9fd6";
const STRIP_HEIGHT_PX = 30;
const TALL_LANE_HEIGHT_PX = 110;
/** A channel's row is lower the more there are, CSS pixels. */
const CHANNEL_ROW = 24;
const CHANNELS_HEIGHT = 320;
const JOINT_ROW = 44;
/** Gaze further off than this from the table's middle is drawn at the edge, metres. */
const MAX_GAZE_DISTANCE_M = 0.7;
const DEG = 180 / Math.PI;

const colorOf = (k: number) => COLORS[k % COLORS.length] ?? "#7b8894";

/** The lanes of a trial; those of which it has nothing are left out. */
export function lanesOf(record: RecordedTrial): Lane[] {
  const { frames, emg } = record;
  const times = frames.map((frame) => frame.time / 1000);
  const made: Record<LaneName, () => [SignalData, string] | null> = {
    emg: () => (emg ? emgLane(emg) : null),
    decoder: () => (emg && emg.windows.length > 0 ? [posteriorLane(emg), ""] : null),
    gesture: () => [spansLane(times, gestureLane(frames, times)), ""],
    gaze: () => (frames.some((frame) => frame.gaze) ? [gazeLane(record, times), words.notes.gaze] : null),
    intent: () => (frames.some((frame) => frame.target.posterior.length > 0) ? [intentLane(record, times), words.notes.intent] : null),
    plan: () => (frames.some((frame) => frame.planner.state !== "idle") ? [planLane(frames, times), words.notes.plan] : null),
    joints: () => [jointLane(record, times), words.notes.joints],
  };
  return LANES.flatMap((name) => {
    const lane = made[name]();
    return lane ? [{ name, title: words.lanes[name], data: lane[0], note: lane[1] }] : [];
  });
}

export function gestureText(name: string): string {
  return name in GESTURE_NAMES ? GESTURE_NAMES[name as keyof typeof GESTURE_NAMES].name : capitalize(readableName(name));
}

function gestureColor(name: string, k: number): string {
  return GESTURE_COLORS[name] ?? colorOf(k + 4);
}

/** Each channel about its mean, all on one scale; lowest and highest values in turn. */
function emgLane(emg: RecordedEmg): [SignalData, string] {
  const count = emg.lowest.find((row) => row.length > 0)?.length ?? 0;
  const times = emg.lowest.flatMap((_, k) => [(k * emg.step_ms) / 1000, ((k + 0.5) * emg.step_ms) / 1000]);
  const values = Array.from({ length: count }, (_, channel) =>
    emg.lowest.flatMap((row, k) => [row[channel] ?? null, emg.highest[k]?.[channel] ?? null]),
  );
  const centred = values.map((channel) => {
    const known = channel.filter((value) => value !== null);
    const mean = known.reduce((sum, value) => sum + value, 0) / Math.max(known.length, 1);
    return channel.map((value) => (value === null ? null : value - mean));
  });
  const most = centred.reduce((peak, channel) => channel.reduce<number>((m, value) => Math.max(m, Math.abs(value ?? 0)), peak), 1e-12);
  const rows = centred.map((_, k): SignalRow => ({ label: words.lines.channel(k + 1), minimum: -most, maximum: most }));
  const lines = centred.map((line, row): SignalLine => {
    return { label: words.lines.channel(row + 1), unit: "", digits: 0, color: colorOf(row), row, values: line };
  });
  const rowHeight = Math.min(CHANNEL_ROW, CHANNELS_HEIGHT / Math.max(count, 1));
  return [{ times, rows, lines, spans: [], rowHeight }, words.notes.emg(emg.step_ms, emg.rate_hz)];
}

function posteriorLane({ gestures: names, windows }: RecordedEmg): SignalData {
  const line = (label: string, colour: string, values: number[], dashed = false): SignalLine => {
    return { label, unit: "", digits: 2, color: colour, row: 0, values, stepped: true, dashed };
  };
  const times = windows.map((window) => window.time / 1000);
  return {
    times,
    rows: [{ label: "", minimum: 0, maximum: 1 }],
    lines: [
      ...names.map((name, k) => line(gestureText(name), gestureColor(name, k), windows.map((window) => window.posterior[k] ?? 0))),
      line(words.lines.effort, COLORS[4] ?? "", windows.map((window) => window.effort), true),
    ],
    spans: [],
    rowHeight: TALL_LANE_HEIGHT_PX,
  };
}

/** A strip that has nothing but spans. */
function spansLane(times: number[], spans: SignalSpan[]): SignalData {
  return { times, rows: [{ label: "", minimum: 0, maximum: 0 }], lines: [], spans, rowHeight: STRIP_HEIGHT_PX };
}

/** For how long each state held; null is no state. */
export function spansOf<T>(times: number[], states: (T | null)[], look: (state: T) => { label: string; color: string }): SignalSpan[] {
  const spans: SignalSpan[] = [];
  let begun = 0;
  states.forEach((state, k) => {
    if (k + 1 < states.length && states[k + 1] === state) return;
    const end = times[Math.min(k + 1, times.length - 1)] ?? 0;
    if (state !== null) spans.push({ from: times[begun] ?? 0, to: end, ...look(state) });
    begun = k + 1;
  });
  return spans;
}

function gestureLane(frames: DisplayFrame[], times: number[]): SignalSpan[] {
  const names = frames.map((frame) => frame.recognised);
  const known = [...new Set(names)];
  return spansOf(times, names, (name) => ({
    label: name === "no_motion" ? "" : gestureText(name),
    color: gestureColor(name, known.indexOf(name)),
  }));
}

function lockLane(frames: DisplayFrame[], times: number[]): SignalSpan[] {
  const states = frames.map((frame) => (frame.target.locked ? true : null));
  return spansOf(times, states, () => ({ label: words.locked, color: LOCKED_COLOR }));
}

/** Where the gaze meets the height of the table top, from the middle of the place where things are put down. */
function gazeLane({ frames, content }: RecordedTrial, times: number[]): SignalData {
  const height = content.scene.table_height;
  const hit = ({ gaze: sample }: DisplayFrame, axis: 0 | 1): number | null => {
    if (!sample?.valid || sample.direction[2] >= -1e-6) return null;
    const value = sample.origin[axis] + (sample.direction[axis] * (height - sample.origin[2])) / sample.direction[2];
    return Math.min(Math.max(value, -MAX_GAZE_DISTANCE_M), MAX_GAZE_DISTANCE_M);
  };
  const line = (label: string, colour: string, values: (number | null)[], dashed = false): SignalLine => {
    return { label, unit: " m", digits: 2, color: colour, row: 0, values, dashed };
  };
  const place = (axis: 0 | 1) => frames.map((frame) => frame.target.place?.[axis] ?? null);
  return {
    times,
    rows: [{ label: "", minimum: -MAX_GAZE_DISTANCE_M, maximum: MAX_GAZE_DISTANCE_M }],
    lines: [
      line(words.lines.gazeX, COLORS[0] ?? "", frames.map((frame) => hit(frame, 0))),
      line(words.lines.gazeY, COLORS[1] ?? "", frames.map((frame) => hit(frame, 1))),
      line(words.lines.placeX, COLORS[0] ?? "", place(0), true),
      line(words.lines.placeY, COLORS[1] ?? "", place(1), true),
    ],
    spans: lockLane(frames, times),
    rowHeight: TALL_LANE_HEIGHT_PX,
  };
}

function intentLane({ frames, content }: RecordedTrial, times: number[]): SignalData {
  const seen = new Map<string, number>();
  const lines = content.scene.objects.map((thing, k): SignalLine => {
    const colour = `rgb(${thing.colour.map((share) => Math.round(255 * share)).join(", ")})`;
    const before = seen.get(colour) ?? 0;
    seen.set(colour, before + 1);
    const values = frames.map((frame) => frame.target.posterior[k] ?? null);
    // The second of a colour is dashed.
    return { label: capitalize(readableName(thing.name)), unit: "", digits: 2, color: colour, row: 0, values, dashed: before % 2 === 1 };
  });
  return { times, rows: [{ label: "", minimum: 0, maximum: 1 }], lines, spans: lockLane(frames, times), rowHeight: TALL_LANE_HEIGHT_PX };
}

function planLane(frames: DisplayFrame[], times: number[]): SignalData {
  const states = frames.map(({ planner }) => (planner.state === "idle" ? null : planner.state));
  const values = frames.map(({ planner }) => (planner.state === "executing" ? planner.progress : null));
  return {
    times,
    rows: [{ label: "", minimum: 0, maximum: 1 }],
    lines: [{ label: words.lines.progress, unit: "", digits: 2, color: COLORS[0] ?? "", row: 0, values }],
    spans: spansOf(times, states, (state) => ({ label: words.plans[state], color: PLAN_COLORS[state] })),
    rowHeight: 60,
  };
}

/** As the arm's settings call it, or else by its own name. */
function jointText(record: RecordedTrial, joint: Joint): string {
  const short = joint.name.split("__").pop() ?? joint.name;
  const entry = record.content.arm.settings.joints.find(({ joint: name }) => name === joint.name || name === short);
  return capitalize(readableName(entry?.name ?? short));
}

/** A row a joint of the arm, from its lower to its upper limit; of one that turns without end, as far as it went. */
function jointLane(record: RecordedTrial, times: number[]): SignalData {
  const { frames, content } = record;
  const lines: SignalLine[] = [];
  const rows = content.arm.arm.flatMap((index, row): SignalRow[] => {
    const joint = content.arm.joints[index];
    if (!joint) return [];
    const label = jointText(record, joint);
    const [unit, factor] = joint.kind === "prismatic" ? ["mm", 1000] : ["°", DEG];
    const values = frames.map((frame) => (frame.joints[row] ?? 0) * factor);
    const line = { unit, digits: 1, color: colorOf(row), row };
    lines.push({ ...line, label, values });
    const goals = frames.map(({ goal }) => (goal ? (goal[row] ?? 0) * factor : null));
    if (goals.some((goal) => goal !== null)) lines.push({ ...line, label: words.lines.goal(label), values: goals, dashed: true, isSecondary: true });
    const [lower, upper] = [joint.limits.lower * factor, joint.limits.upper * factor];
    if (joint.kind !== "continuous") return [{ label, minimum: lower, maximum: upper, edges: true }];
    const [least, most] = values.reduce(([low, high], value) => [Math.min(low, value), Math.max(high, value)], [0, 0]);
    return [{ label, minimum: least, maximum: most }];
  });
  return { times, rows, lines, spans: [], rowHeight: JOINT_ROW };
}
