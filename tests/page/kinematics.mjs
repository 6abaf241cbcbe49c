// What a practised person knows of the arm, for the scripts that jog it: where the hand is, and how the joints
// would have to stand for it to be elsewhere. Vectors [x, y, z], quaternions [x, y, z, w], metres, rad.

export const add = (a, b) => a.map((value, k) => value + b[k]);
export const sub = (a, b) => a.map((value, k) => value - b[k]);
export const scale = (a, factor) => a.map((value) => value * factor);
export const norm = (a) => Math.hypot(...a);
export const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];

function multiply([ax, ay, az, aw], [bx, by, bz, bw]) {
  return [
    aw * bx + ax * bw + ay * bz - az * by,
    aw * by - ax * bz + ay * bw + az * bx,
    aw * bz + ax * by - ay * bx + az * bw,
    aw * bw - ax * bx - ay * by - az * bz,
  ];
}

/** Turns a vector by a quaternion. */
export function rotate([x, y, z, w], v) {
  const t = scale(cross([x, y, z], v), 2);
  return add(add(v, scale(t, w)), cross([x, y, z], t));
}

/** Axis times angle, rad, of a quaternion. */
export function rotationVector([x, y, z, w]) {
  const sign = w < 0 ? -1 : 1;
  const sine = Math.hypot(x, y, z);
  return scale([x, y, z], sine < 1e-9 ? 2 : (sign * 2 * Math.atan2(sine, sign * w)) / sine);
}

/** A point of one frame in the other: `pose` is other_from_one. */
export const apply = (pose, point) => add(pose.translation, rotate(pose.rotation, point));

export function compose(a, b) {
  return { rotation: multiply(a.rotation, b.rotation), translation: apply(a, b.translation) };
}

export function inverse(pose) {
  const [x, y, z, w] = pose.rotation;
  const rotation = [-x, -y, -z, w];
  return { rotation, translation: scale(rotate(rotation, pose.translation), -1) };
}

/** base_from_tip at the arm angles `q`. */
export function forwardKinematics(arm, q) {
  return linkPoses(arm, q).pose;
}

/** The same, and point and axis of each arm joint, in the base. */
function linkPoses(arm, q) {
  const links = [];
  // Joint `link - 1` moves `link`.
  for (let link = arm.tip; link > 0; link = arm.joints[link - 1].parent) links.unshift(link - 1);
  let pose = { rotation: [0, 0, 0, 1], translation: [0, 0, 0] };
  const axes = [];
  for (const index of links) {
    const joint = arm.joints[index];
    pose = compose(pose, joint.origin);
    const place = arm.arm.indexOf(index);
    if (place < 0) continue;
    axes[place] = { origin: pose.translation, about: rotate(pose.rotation, joint.axis) };
    const half = q[place] / 2;
    const turned = [...scale(joint.axis, Math.sin(half)), Math.cos(half)];
    pose = compose(pose, { rotation: turned, translation: [0, 0, 0] });
  }
  return { pose, axes };
}

/** One radian of tilt counts as this many metres, unless the goal has a `tiltWeight` of its own. */
const TILT_WEIGHT = 0.15;
/** Damping of a step, m; the search ends when a step is shorter than this, rad. */
const DAMPING = 0.03;
const STEP_MIN = 1e-4;

/** How far a goal's point is off at the angles `q`, metres, one too high `highCounts`, and its axis from upright, rad. */
export function poseError(arm, q, goal) {
  const pose = forwardKinematics(arm, q);
  const axis = rotate(pose.rotation, goal.axis);
  const cosine = axis.reduce((sum, value, k) => sum + value * goal.up[k], 0);
  const left = sub(goal.target, apply(pose, goal.point));
  const high = -left.reduce((sum, value, k) => sum + value * goal.up[k], 0);
  const counted = high > 0 ? high * (goal.highCounts ?? 1) : high;
  return {
    off: Math.hypot(norm(add(left, scale(goal.up, high))), counted),
    tilt: Math.atan2(norm(cross(axis, goal.up)), cosine),
  };
}

/** What is left to the goal: metres, then weighted tilt. `goal`: point and axis of the tip, target and up of the base. */
function goalResidual(pose, goal) {
  const tilt = cross(rotate(pose.rotation, goal.axis), goal.up);
  return [...sub(goal.target, apply(pose, goal.point)), ...scale(tilt, goal.tiltWeight ?? TILT_WEIGHT)];
}

/**
 * Angles near `from` that bring point and axis of the hand to the goal by turning some joints, or all, and how far
 * off they leave it, metres.
 */
export function inverseKinematics(arm, from, goal, joints = from.map((_, k) => k), steps = 60) {
  let q = [...from];
  let best = null;
  for (let step = 0; step <= steps; step++) {
    const { pose, axes } = linkPoses(arm, q);
    const error = goalResidual(pose, goal);
    if (!best || norm(error) < best.left) best = { q, left: norm(error) };
    if (step === steps) break;
    const point = apply(pose, goal.point);
    const axis = rotate(pose.rotation, goal.axis);
    const columns = joints.map((k) => {
      const { origin, about } = axes[k];
      // How the point moves, and how the lack of tilt shrinks.
      const leans = scale(cross(cross(about, axis), goal.up), -(goal.tiltWeight ?? TILT_WEIGHT));
      return [...cross(about, sub(point, origin)), ...leans];
    });
    const square = error.map((_, i) =>
      error.map((_, j) => columns.reduce((sum, column) => sum + column[i] * column[j], i === j ? DAMPING ** 2 : 0)),
    );
    const weights = solveLinear(square, error);
    const next = [...q];
    joints.forEach((k, place) => {
      const move = columns[place].reduce((sum, value, i) => sum + value * weights[i], 0);
      const { lower, upper } = arm.joints[arm.arm[k]].limits;
      next[k] = Math.min(Math.max(q[k] + Math.min(Math.max(move, -0.2), 0.2), lower), upper);
    });
    const longest = Math.max(...next.map((angle, k) => Math.abs(angle - q[k])));
    q = next;
    if (longest < STEP_MIN) break;
  }
  return best;
}

/** Solves a small symmetric positive definite system. */
function solveLinear(matrix, vector) {
  const rows = matrix.map((row, k) => [...row, vector[k]]);
  const size = rows.length;
  for (let pivot = 0; pivot < size; pivot++) {
    for (let row = pivot + 1; row < size; row++) {
      const factor = rows[row][pivot] / rows[pivot][pivot];
      for (let k = pivot; k <= size; k++) rows[row][k] -= factor * rows[pivot][k];
    }
  }
  const solution = Array(size).fill(0);
  for (let row = size - 1; row >= 0; row--) {
    let rest = rows[row][size];
    for (let k = row + 1; k < size; k++) rest -= rows[row][k] * solution[k];
    solution[row] = rest / rows[row][row];
  }
  return solution;
}
