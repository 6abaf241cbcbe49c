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
  /** The joint or axis that WE and WF move, in methods A and B. */
  mode: { number: number; name: string; directions: [string, string]; next_in_secs: number | null } | null;
  gesture: Gesture;
  confidence: number;
  emg_source: string;
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
  | { type: "error"; message: string };

export type ClientMessage =
  | { type: "gesture"; gesture: Gesture }
  | { type: "gaze"; origin: Triple; direction: Triple }
  | { type: "trunk"; forward: number; lateral: number; axial: number }
  | { type: "restart" }
  | { type: "alive" };

export const GESTURE_NAMES: Record<Gesture, { short: string; name: string }> = {
  wrist_extension: { short: "WE", name: "Wrist extension" },
  wrist_flexion: { short: "WF", name: "Wrist flexion" },
  hand_close: { short: "HC", name: "Hand close" },
  hand_open: { short: "HO", name: "Hand open" },
  no_motion: { short: "NM", name: "No motion" },
};

export function colourOf(block: BlockId): "red" | "blue" {
  return block.startsWith("red") ? "red" : "blue";
}

export function numberOf(block: BlockId): string {
  return block.slice(-1);
}
