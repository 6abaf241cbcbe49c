// What the page tells of itself.

import type { CameraKind } from "./cameras";
import type { ScriptTime } from "./frameCount";
import type { DisplayFrame, GhostArm, ObjectId, PageContent } from "./generated/types";
import type { Triple } from "./protocol";
import type { LazySignalsDrawer } from "./lazySignalsDrawer";

/** What tests and the curious can look at from the browser's console. */
export interface Debug {
  frame: DisplayFrame | null;
  framesReceived: number;
  framesDrawn: number;
  framesDropped: number;
  cues: number;
  worn: boolean;
  ghost: GhostArm | null;
  connected: boolean;
  /** What the page's script takes for a picture, ms: without and with the drawing of the scene. */
  script: ScriptTime;
  whole: ScriptTime;
  /** Of the last picture. */
  drawCalls: number;
  triangles: number;
  /** Parts of the arm that are seen through. */
  faded: number;
  signals: LazySignalsDrawer;
  content: PageContent | null;
  camera: CameraKind;
  chooseCamera(kind: CameraKind): void;
  /** Where an object or its target is on the screen, CSS pixels from the window's left top. */
  project(what: "object" | "target", id: ObjectId): { x: number; y: number } | null;
  /** Where the point of the gaze check is on the screen. */
  gazePoint(): { x: number; y: number } | null;
  /** What can be chosen on the headset's board, and where it is as the headset counts, metres. */
  boardCells(): { label: string; chosen: boolean; at: Triple }[];
  /** Middle of the table top in `world`, metres. */
  tableMiddle(): Triple | null;
}
