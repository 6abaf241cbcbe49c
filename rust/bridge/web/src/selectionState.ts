// What is known of the selection, which its marker shows.

import type { DisplayFrame } from "./generated/types";

export type SelectionState = "free" | "locked" | "reachable" | "unreachable";

/** What is known of the selection: whether it can be reached is known once the planner has answered. */
export function selectionState(frame: DisplayFrame): SelectionState {
  if (!frame.target.locked) return "free";
  const { planner } = frame;
  switch (planner.state) {
    case "executing":
    case "arrived":
      return planner.intermediate ? "unreachable" : "reachable";
    case "failed":
      return "unreachable";
    default:
      return "locked";
  }
}
