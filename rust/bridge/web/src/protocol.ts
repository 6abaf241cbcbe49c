// What the server sends and takes, as the Rust types of proact-types write it. Metres, rad, frame `world`;
// quaternions x, y, z, w.

export type Triple = [number, number, number];

export interface Pose {
  rotation: [number, number, number, number];
  translation: Triple;
}

export type Shape =
  | { type: "box"; size: Triple }
  | { type: "sphere"; radius: number }
  | { type: "cylinder"; radius: number; length: number }
  | { type: "capsule"; radius: number; length: number };

export type VisualGeometry = { shape: Shape } | { mesh: { file: string; scale: Triple } };

export interface Link {
  name: string;
  collisions: { pose: Pose; shape: Shape }[];
  visuals: { pose: Pose; geometry: VisualGeometry; colour: [number, number, number, number] }[];
}

export interface Joint {
  name: string;
  kind: "fixed" | "revolute";
  parent: number;
  child: number;
  origin: Pose;
  axis: Triple;
}

export interface ArmModel {
  name: string;
  links: Link[];
  joints: Joint[];
  arm: number[];
  hand: number[];
  tip: number;
  grasp_centre: Triple;
}

export type BlockId = "red1" | "red2" | "blue1" | "blue2";
export const BLOCKS: readonly BlockId[] = ["red1", "red2", "blue1", "blue2"];

export type Gesture = "hand_close" | "hand_open" | "no_motion" | "wrist_extension" | "wrist_flexion";

export interface Scene {
  fixed: { name: string; shape: Shape; pose: Pose }[];
  blocks: { id: BlockId; shape: Shape; pose: Pose }[];
  targets: { block: BlockId; centre: Triple }[];
  table_height: number;
}

export interface Content {
  title: string;
  setup: string;
  arm: ArmModel;
  scene: Scene;
  interactive: boolean;
  lean: boolean;
}

export type Planner =
  | { state: "idle" }
  | { state: "planning" }
  | { state: "executing"; progress: number; intermediate: boolean }
  | { state: "arrived"; intermediate: boolean }
  | { state: "failed"; status: string; reason: string };

export interface TrialEvent {
  time: number;
  event: string;
  gesture?: Gesture;
  block?: BlockId | null;
  status?: string;
  distance?: number;
  source?: Stop["source"];
  cause?: Stop["cause"];
  reason?: string;
}

/** Why the arm is stopped: something that moves it died or froze. It goes on only after a relaxed gesture. */
export interface Stop {
  source: "armband" | "gesture_topic" | "page" | "eye_tracker" | "shoulder_tracker" | "limb_tracker" | "stage";
  cause: "silent" | "closed" | "frozen" | "flat" | "railed" | "noiseless" | "lossy" | "wrong_rate" | "lost";
  /** Milliseconds since the start of the trial. */
  since: number;
  /** A sentence for the person, without capital and full stop. */
  reason: string;
}

export interface Mode {
  /** 0 to 6 are joints, 7 to 9 translations, 10 to 12 rotations about x, y, z of the shoulder frame. */
  number: number;
  name: string;
  /** What WE does, and what WF does. */
  directions: [string, string];
  /** 1 if WE is the positive direction, else -1. */
  we_sign: number;
  /** Seconds until a held HO moves on. */
  next_in_secs: number | null;
}

/** Whether the trial goes on. */
export interface Status {
  paused: boolean;
  aborted: boolean;
  can_pause: boolean;
  seed: number;
  record: string | null;
  /** What gives gaze instead of this page; none if the page does. */
  gaze_source: string | null;
  /** How often the experimenter asked for a gaze check. */
  gaze_checks: number;
  /** And for a new calibration of the gaze. */
  gaze_calibrations: number;
}

/** What the experimenter watches beside the scene. */
export interface Signals {
  time: number;
  /** [n_samples][n_channels] since the message before. */
  emg: number[][];
  emg_rate_hz: number;
  lights: string[];
  faults: (string | null)[];
  emg_lost_share: number;
  gaze_age_ms: number | null;
  gaze_hz: number;
  tracking_hz: number;
  tick_mean_us: number;
  tick_max_us: number;
  pace: number;
  pages: number;
}

/** How well a gaze source follows known points. */
export interface GazeCheck {
  source: string;
  points: {
    accuracy_deg: number | null;
    precision_deg: number | null;
    /** Mean of gaze minus point: to the left, upwards. */
    offset_deg: [number, number] | null;
    lost_share: number;
    blinks: number;
    samples: number;
  }[];
  /** What is to be taken off the gaze from now on: to the left, upwards. None: it stays as it is. */
  correction_deg: [number, number] | null;
}

export interface Frame {
  /** Milliseconds since the start of the trial. */
  time: number;
  method: string;
  joints: number[];
  world_from_base: Pose;
  world_from_tip: Pose;
  world_from_head: Pose;
  blocks: Pose[];
  hand: { state: "open" | "closing" | "closed" | "opening"; holds: BlockId | null };
  gaze: { origin: Triple; direction: Triple; valid: boolean } | null;
  target: { block: BlockId | null; place: Triple | null; locked: boolean; posterior: number[] };
  planner: Planner;
  /** Arm joints at the end of the plan that is followed, rad. */
  goal: number[] | null;
  /** The joint or axis that WE and WF move, in methods A and B. */
  mode: Mode | null;
  gesture: Gesture;
  confidence: number;
  /** How hard the gesture is made, 0 to 1; one for keys. */
  effort: number;
  emg_source: string;
  /** None while nothing is wrong; frames recorded before there were stops do not have it. */
  stop?: Stop | null;
  time_left_secs: number;
  next_block: BlockId | null;
  on_target: number;
  finished: boolean;
  events: TrialEvent[];
}

export type ServerMessage =
  | { type: "hello"; page_version: string; revision: number }
  | { type: "content"; revision: number }
  | ({ type: "frame" } & Frame)
  | { type: "events"; events: TrialEvent[] }
  | ({ type: "status" } & Status)
  | ({ type: "signals" } & Signals)
  | { type: "pong"; id: number }
  | { type: "error"; message: string };

export type ClientMessage =
  | { type: "gesture"; gesture: Gesture }
  /** `measured`: a tracker gives it, and one that repeats itself is broken. A mouse or a stick may rest. */
  | { type: "gaze"; origin: Triple; direction: Triple; measured?: boolean }
  | { type: "trunk"; forward: number; lateral: number; axial: number }
  | { type: "head"; position: Triple; quaternion: [number, number, number, number] }
  | { type: "restart"; method?: string; again?: boolean }
  | { type: "study"; action: "pause" | "resume" | "abort" | "check_gaze" | "calibrate_gaze" }
  | ({ type: "gaze_check" } & GazeCheck)
  | { type: "ping"; id: number }
  | { type: "alive" };

export const GESTURE_NAMES: Record<Gesture, { short: string; name: string }> = {
  wrist_extension: { short: "WE", name: "Wrist extension" },
  wrist_flexion: { short: "WF", name: "Wrist flexion" },
  hand_close: { short: "HC", name: "Hand close" },
  hand_open: { short: "HO", name: "Hand open" },
  no_motion: { short: "NM", name: "No motion" },
};

/** Why the arm is stopped, as a sentence on display. */
export function stopText({ reason }: Pick<Stop, "reason">): string {
  return `${capitalised(reason.replace(/\.$/, ""))}.`;
}

export function capitalised(text: string): string {
  return `${text.slice(0, 1).toUpperCase()}${text.slice(1)}`;
}

export function colourOf(block: BlockId): "red" | "blue" {
  return block.startsWith("red") ? "red" : "blue";
}

export function numberOf(block: BlockId): string {
  return block.slice(-1);
}
