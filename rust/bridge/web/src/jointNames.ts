// Joints as people call them: the arm's settings say so.

import type { ArmModel } from "./generated/types";

/** Names are given in full, or by what follows their last `__`. */
export function jointDisplayName({ settings }: ArmModel, joint: string): string {
  const short = joint.split("__").pop() ?? joint;
  const entry = settings.joints.find((each) => each.joint === joint || each.joint === short);
  return (entry?.name ?? short).replaceAll("_", " ");
}
