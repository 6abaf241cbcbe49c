// Which few joints a practised person would turn, and in which order, for the hand to be somewhere without meeting
// anything: the same thoughts as the simulated participant's (`rust/participants/src/reach/ways.rs`).

import * as kinematics from "./kinematics.mjs";

/** Joints that are turned for one way, at most; no joint is turned by less, rad. */
const MAX_JOINTS = 5;
const MIN_TURN_RAD = 0.04;
/** Points looked at on the way of one joint. */
const SAMPLES = 8;
/** Costs, s: a metre of obstacle, a metre or rad short of the goal, another round, a joint, a step of the cycle, a rad. */
const COST = { blocked: 1000, off: 300, tilt: 20, again: 5, joint: 0.6, mode: 0.5, rad: 2.5 };
/** One joint may lift the hand by as much first and lower it last, rad, if that brings it this much higher, m. */
const LIFT_TURNS_RAD = [0.3, 0.6, 0.9, -0.3, -0.6, -0.9];
const MIN_LIFT_M = 0.05;
/** As many ways are thought of with such a lift. */
const MAX_LIFT_CANDIDATES = 6;
/** Obstacle that counts for nothing, m. */
const NEGLIGIBLE_DEPTH_M = 0.003;
/** Air about what the fingers pass, about the block that they are to take, and over the table, m. */
const CLEARANCE_M = { things: 0.015, block: 0.016, table: 0.004 };
/** Half of a block's height, and its radius, m. */
const BLOCK = 0.025;

/** The turns [{joint, to, angle}] from the angles `q` with joint `mode` selected; none if nothing brings the hand nearer. */
export function planTurns(arm, q, goal, { mode, depth, refused }) {
  const here = depth(kinematics.forwardKinematics(arm, q));
  const inTheWay = (angles) => Math.max(depth(kinematics.forwardKinematics(arm, angles)) - here, 0);
  const start = kinematics.apply(kinematics.forwardKinematics(arm, q), goal.point);
  let best = null;
  // A straight way when the whole one is blocked: half of it, a quarter of it.
  for (const share of [1, 0.5, 0.25]) {
    const target = kinematics.add(start, kinematics.scale(kinematics.sub(goal.target, start), share));
    const found = turnsToGoal(arm, q, { ...goal, target }, { mode, inTheWay, refused });
    if (found && (!best || found.blocked < best.blocked - NEGLIGIBLE_DEPTH_M)) best = found;
    if (best && best.blocked < 2 * NEGLIGIBLE_DEPTH_M) break;
  }
  return best ? best.turns : [];
}

function turnsToGoal(arm, q, goal, conditions) {
  const short = (angles) => {
    const { off, tilt } = kinematics.poseError(arm, angles, goal);
    const [far, aslant] = [Math.max(off - goal.pointDone, 0), Math.max(tilt - goal.tiltDone, 0)];
    return (far > 0 || aslant > 0 ? COST.again : 0) + COST.off * far + COST.tilt * aslant;
  };
  const now = short(q);
  const candidates = [];
  for (let set = 1; set < 1 << q.length; set++) {
    const joints = q.map((_, k) => k).filter((k) => (set >> k) & 1);
    if (joints.length > MAX_JOINTS) continue;
    const wanted = kinematics.inverseKinematics(arm, q, goal, joints).q;
    const list = joints.map((joint) => ({ joint, to: wanted[joint], angle: wanted[joint] - q[joint] }));
    const left = short(wanted);
    if (left >= now || list.some((turn) => Math.abs(turn.angle) < MIN_TURN_RAD || conditions.refused(turn))) continue;
    candidates.push({ secs: left + secsOf(list), list, end: wanted });
  }
  candidates.sort((a, b) => a.secs - b.secs);
  let [best, lifts] = [null, 0];
  const take = (found) => {
    if (!best || cost(found) < cost(best)) best = found;
  };
  for (const { secs, list, end } of candidates) {
    if (best && cost(best) <= secs) break;
    const direct = orderTurns(q, list, null, conditions);
    take({ ...direct, secs: direct.secs + secs });
    if (direct.blocked > NEGLIGIBLE_DEPTH_M && lifts++ < MAX_LIFT_CANDIDATES) turnsWithLift(arm, q, goal, { secs, list, end }, conditions, best, take);
  }
  return best;
}

/** Takes the ways on which one joint lifts the hand first, or on the way, and lowers it last. */
function turnsWithLift(arm, q, goal, { secs, list, end }, conditions, best, take) {
  const height = (angles) => dot(goal.up, kinematics.apply(kinematics.forwardKinematics(arm, angles), goal.point));
  for (let joint = 0; joint < q.length; joint++) {
    const { lower, upper } = arm.joints[arm.arm[joint]].limits;
    for (const lift of LIFT_TURNS_RAD) {
      const via = Math.min(Math.max(end[joint] + lift, lower), upper);
      const before = end.map((angle, k) => (k === joint ? via : angle));
      const first = { joint, to: via, angle: via - q[joint] };
      const last = { joint, to: end[joint], angle: end[joint] - via };
      const useless = (turn) => Math.abs(turn.angle) < MIN_TURN_RAD || conditions.refused(turn);
      if (useless(first) || useless(last) || height(before) < height(end) + MIN_LIFT_M) continue;
      const others = [...list.filter((turn) => turn.joint !== joint), first];
      const whole = secs - secsOf(list) + secsOf(others) + secsOf([last]);
      const lowering = penetrationDepth(before, last, conditions);
      if (cost(best) <= whole + COST.blocked * lowering) continue;
      const found = orderTurns(q, others, joint, conditions);
      take({ turns: [...found.turns, last], secs: found.secs + whole, blocked: Math.max(found.blocked, lowering) });
    }
  }
}

/** The turns in the order that is clear of obstacles and needs the fewest changes of joint, to joint `then` at last. */
function orderTurns(q, list, then, conditions) {
  const known = new Map();
  const from = (made) => q.map((angle, k) => list.find((turn, i) => (made >> i) & 1 && turn.joint === k)?.to ?? angle);
  const ways = new Map();
  const blockedBy = (made, k) => {
    const key = made * 8 + k;
    if (!ways.has(key)) ways.set(key, penetrationDepth(from(made), list[k], conditions));
    return ways.get(key);
  };
  const rest = (made, last) => {
    const key = made * 8 + last;
    if (known.has(key)) return known.get(key);
    const at = last < list.length ? list[last].joint : conditions.mode;
    let best = null;
    for (let k = 0; k < list.length; k++) {
      if ((made >> k) & 1) continue;
      const after = rest(made | (1 << k), k);
      const found = {
        turns: [list[k], ...after.turns],
        secs: after.secs + changeSecs(at, list[k].joint, q.length),
        blocked: Math.max(after.blocked, blockedBy(made, k)),
      };
      if (!best || cost(found) < cost(best)) best = found;
    }
    best ??= { turns: [], secs: then === null ? 0 : changeSecs(at, then, q.length), blocked: 0 };
    known.set(key, best);
    return best;
  };
  return rest(0, list.length);
}

/** How far the hand sticks in things while one joint turns, metres. */
function penetrationDepth(from, turn, { inTheWay }) {
  let most = 0;
  for (let sample = 1; sample <= SAMPLES; sample++) {
    const angle = from[turn.joint] + (turn.to - from[turn.joint]) * (sample / SAMPLES);
    most = Math.max(most, inTheWay(from.map((value, k) => (k === turn.joint ? angle : value))));
  }
  return most;
}

const dot = (a, b) => a.reduce((sum, value, k) => sum + value * b[k], 0);
const cost = ({ secs, blocked }) => secs + COST.blocked * blocked;
const secsOf = (list) => list.reduce((sum, { angle }) => sum + COST.joint + COST.rad * Math.abs(angle), 0);
const changeSecs = (from, to, count) => COST.mode * ((to + count - from) % count);

/** The hand may lean toward the shoulder by these angles, rad. */
const LEAN_CHOICES_RAD = [0, 0.2, 0.35, 0.5, -0.2];

/** The lean with which the fingers have most room where `goalOf` a lean puts the hand. */
export function chooseLean(arm, q, goalOf, depth) {
  const costs = LEAN_CHOICES_RAD.map((lean) => {
    const goal = goalOf(lean);
    const { q: end } = kinematics.inverseKinematics(arm, q, goal);
    const { off, tilt } = kinematics.poseError(arm, end, goal);
    const far = Math.max(off - goal.pointDone, 0) + 0.1 * Math.max(tilt - goal.tiltDone, 0);
    return 100 * (depth(kinematics.forwardKinematics(arm, end)) + far) + 0.3 * Math.abs(lean);
  });
  return LEAN_CHOICES_RAD[costs.indexOf(Math.min(...costs))];
}

/** How far the fingers, and the block in them, are in something for the hand at a base_from_tip, metres. */
export function obstacles(arm, scene, seen, block) {
  const points = fingers(arm, seen.joints);
  const held = seen.hand.holds ?? -1;
  if (held >= 0) {
    const tipFromBlock = kinematics.compose(kinematics.inverse(seen.world_from_tip), seen.objects[held]);
    for (const [x, y] of [[1, 0], [-1, 0], [0, 1], [0, -1]]) {
      for (const z of [1, -1]) points.push(kinematics.apply(tipFromBlock, [x * BLOCK, y * BLOCK, z * BLOCK]));
    }
  }
  const walls = scene.fixed
    .filter(({ shape }) => shape.type === "box")
    .map(({ shape, pose }) => ({ half: shape.size.map((side) => side / 2), at: pose.translation }))
    .filter(({ half, at }) => at[2] + half[2] > scene.table_height + 1e-3);
  const depthOf = ([x, y, z]) => {
    let most = scene.table_height + CLEARANCE_M.table - z;
    for (const { half, at } of walls) {
      const over = at[2] + half[2] + CLEARANCE_M.things - z;
      const aside = (value, k) => half[k] + CLEARANCE_M.things - Math.abs(value - at[k]);
      most = Math.max(most, Math.min(over, aside(x, 0), aside(y, 1)));
    }
    seen.objects.forEach(({ translation: at }, k) => {
      if (k === held) return;
      const air = k === block ? CLEARANCE_M.block : CLEARANCE_M.things;
      most = Math.max(most, Math.min(BLOCK + air - Math.hypot(x - at[0], y - at[1]), at[2] + BLOCK + air - z));
    });
    return most;
  };
  return (baseFromTip) => {
    const pose = kinematics.compose(seen.world_from_base, baseFromTip);
    return points.reduce((most, point) => Math.max(most, depthOf(kinematics.apply(pose, point))), 0);
  };
}

/** Joints, middles of the bones and tips of the fingers in the tip's frame. */
function fingers(arm, angles) {
  const moving = [...arm.arm, ...arm.hand];
  const poses = new Map([[arm.tip, { rotation: [0, 0, 0, 1], translation: [0, 0, 0] }]]);
  const points = [];
  arm.joints.forEach((joint, k) => {
    const parent = poses.get(joint.parent);
    if (!parent) return;
    const half = (angles[moving.indexOf(k)] ?? 0) / 2;
    const turned = { rotation: [...kinematics.scale(joint.axis, Math.sin(half)), Math.cos(half)], translation: [0, 0, 0] };
    const pose = kinematics.compose(parent, kinematics.compose(joint.origin, turned));
    poses.set(joint.child, pose);
    const [at, from] = [pose.translation, parent.translation];
    points.push(kinematics.scale(kinematics.add(at, from), 0.5), at);
    if (!arm.joints.some((next) => next.parent === joint.child)) {
      points.push(kinematics.add(at, kinematics.scale(kinematics.sub(at, from), 0.8)));
    }
  });
  return points;
}
