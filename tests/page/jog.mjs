// Drives methods A and B by keys alone: joint by joint, or the hand along and about the axes of the shoulder frame.
// Each movement is a key held for as long as seems right by the display; then it looks, and corrects.

import * as kinematics from "./kinematics.mjs";
import { chooseLean, obstacles, planTurns } from "./jog_planner.mjs";

const KEYS = { wrist_extension: "KeyW", wrist_flexion: "KeyS", hand_close: "KeyA", hand_open: "KeyD" };
/** Numbers of modes from which axes are moved instead of joints. */
const FIRST_AXIS = 7;

/** Joints from 0, axes to go along from 7, axes to turn about from 10. */
function numberOf({ moves: { joint, translation, rotation } }) {
  return joint ?? (translation !== undefined ? FIRST_AXIS + translation : FIRST_AXIS + 3 + rotation);
}

/** Speeds of the default profile: rad/s, m/s, rad/s. */
const SPEED = { joint: 0.4, slide: 0.08, turn: 0.4 };
/** What is left below this is not worth another movement: rad, m, rad. */
const JOG_TOLERANCE = { slide: 0.006, turn: 0.1 };
/** Joint by joint, a place is reached with the hand this near to it, m, and this near to upright, rad. */
const REACH_TOLERANCE = { pointDone: 0.012, tiltDone: 0.3, highCounts: 0.6, tiltWeight: 0.03 };
/** A joint that stops this much short of where it was turned has met something, rad. */
const CONTACT_SHORTFALL_RAD = 0.06;
/** From the frame that shows enough to the arm's stop, s: at first, and at most. Learnt from each movement. */
const STOP_LAG_SECS = { first: 0.035, most: 0.3 };
/** Share of what a movement went too far or too short by that is learnt from it. */
const LAG_LEARNING_RATE = 0.5;
/** Heights above the table, metres: over walls and partition; of the hand's grip; of a block let go. */
const TRANSIT_HEIGHT_M = 0.27;
/** Joint by joint: of a hand out of the blocks, and of hand or block over the place before they go down. */
const RETREAT_HEIGHT_M = 0.13;
const HOVER_HEIGHT_M = 0.13;
const GRASP_HEIGHT_M = 0.027;
const RELEASE_HEIGHT_M = 0.036;
/** Width of a block, metres. */
const BLOCK_WIDTH_M = 0.05;
/** Corrections of one place before it is good enough. */
const MAX_CORRECTIONS = 4;

/** A block is not where it should be: it was missed, or lost on the way. */
class BlockLostError extends Error {}

/** Moves the block that comes next to its target, in as many attempts as there is time for. */
export async function jogBlock(page, { limitMs, log }) {
  const end = Date.now() + limitMs;
  const { score: before } = await readState(page);
  for (;;) {
    try {
      await attempt(page, end, log);
      const counts = (before) => window.__proact.frame.score > before;
      await page.waitForFunction(counts, before, { timeout: 8_000, polling: 20 });
      return;
    } catch (error) {
      const lost = error instanceof BlockLostError || error.name === "TimeoutError";
      if (!lost || Date.now() > end) throw error;
      log(`again: ${error.message.split("\n")[0]}`);
    }
  }
}

async function attempt(page, end, log) {
  const { arm, scene } = await page.evaluate(() => window.__proact.content);
  const start = await readState(page);
  const block = start.hand.holds ?? start.next;
  if (block === null) throw new Error("no block is left to be moved");
  const index = block;
  const target = scene.targets.find((candidate) => candidate.object === block).centre;
  const high = (point, height) => [point[0], point[1], scene.table_height + height];

  const byJoint = numberOf(start.mode) < FIRST_AXIS;
  /** Brings the hand, or the block in it, to a place in the world; `loosely`: near it, and tilted as it comes. */
  let lean = 0;
  /** Leans the hand, joint by joint, so that the fingers have room at a place. */
  const leanFor = (seen, place) => {
    const q = seen.joints.slice(0, arm.arm.length);
    const goal = (angle) => ({ ...goalOf(arm, seen, index, place, angle), ...REACH_TOLERANCE });
    if (byJoint) lean = chooseLean(arm, q, goal, obstacles(arm, scene, seen, block));
  };
  const bring = async (name, place, { holding = false, rounds = MAX_CORRECTIONS, loosely = false }) => {
    const refused = [];
    for (let round = 0; round < (byJoint ? 2 : 1) * rounds; round++) {
      const seen = await readState(page);
      if (holding && seen.hand.holds !== block) throw new BlockLostError(`${block} was lost: ${name}`);
      // Who has tried for a while is content with less: the last shifts are shorter than a key can be pressed.
      const slack = Math.min(1 + round / 4, 2);
      const done = loosely ? { pointDone: 0.04, tiltDone: 4 } : { pointDone: slack * REACH_TOLERANCE.pointDone, tiltDone: slack * REACH_TOLERANCE.tiltDone };
      const goal = { ...goalOf(arm, seen, index, place(seen), lean), ...REACH_TOLERANCE, ...done };
      const { off, tilt } = kinematics.poseError(arm, seen.joints.slice(0, arm.arm.length), goal);
      log(`${(seen.time / 1000).toFixed(1)} s: ${name}, off by ${(100 * off).toFixed(1)} cm and ${tilt.toFixed(2)} rad`);
      const before = round > 0 || byJoint ? ["slide", "turn"] : ["turn", "slide"];
      const moved = byJoint
        ? await joints(page, { arm, scene, seen, goal, block, refused })
        : await axes(page, arm, index, place, before);
      if (!moved) return;
      if (Date.now() > end) throw new Error(`${block} not moved in time; the last step was: ${name}`);
    }
  };
  const at = (seen) => seen.objects[index].translation;
  if (start.hand.holds === null) {
    if (start.hand.state === "closed") {
      // Closed on nothing, down where the block was.
      await tap(page, "hand_close");
      if (byJoint) await bring("back up", (seen) => high(graspCenter(arm, seen), RETREAT_HEIGHT_M), { rounds: 1, loosely: true });
    }
    leanFor(start, high(at(start), GRASP_HEIGHT_M));
    await bring("over the block", (seen) => high(at(seen), byJoint ? HOVER_HEIGHT_M : TRANSIT_HEIGHT_M - 0.1), {});
    await bring("down", (seen) => high(at(seen), GRASP_HEIGHT_M), {});
    await tap(page, "hand_close");
    await page.waitForFunction((id) => window.__proact.frame.hand.holds === id, block, { timeout: 8_000, polling: 20 });
    log("grips");
  }
  const holding = true;
  await bring("up", (seen) => high(at(seen), byJoint ? RETREAT_HEIGHT_M : TRANSIT_HEIGHT_M), { holding, rounds: 2, loosely: byJoint });
  leanFor(await readState(page), high(target, RELEASE_HEIGHT_M));
  await bring("across", () => high(target, byJoint ? HOVER_HEIGHT_M : TRANSIT_HEIGHT_M), { holding });
  await bring("down", () => high(target, RELEASE_HEIGHT_M), { holding });
  await tap(page, "hand_close");
}

/** Where the hand takes a block, in the world. */
function graspCenter(arm, seen) {
  return kinematics.apply(seen.world_from_tip, graspOf(arm).centre);
}

/** How the hand takes a block: the first of its grasps that is wide enough. */
function graspOf(arm) {
  return arm.grasps.find(({ widths }) => BLOCK_WIDTH_M <= widths[1]) ?? arm.grasps.at(-1);
}

function readState(page) {
  return page.evaluate(() => window.__proact.frame);
}

/**
 * Where the hand has to be for its grasp centre, or the block in it, to be at `place` with the block upright, or leant
 * toward the shoulder by `lean`, rad.
 */
function goalOf(arm, seen, index, place, lean = 0) {
  const base = kinematics.inverse(seen.world_from_base);
  const held = seen.hand.holds !== null ? kinematics.compose(kinematics.inverse(seen.world_from_tip), seen.objects[index]) : null;
  const { centre, roll } = graspOf(arm);
  let axis = held ? kinematics.rotate(held.rotation, [0, 0, 1]) : [0, Math.sin(roll), Math.cos(roll)];
  // A block stands on either end.
  if (kinematics.rotate(seen.world_from_tip.rotation, axis)[2] < 0) axis = kinematics.scale(axis, -1);
  const [x, y] = kinematics.sub(seen.world_from_base.translation, place);
  const toward = kinematics.scale([x, y, 0], Math.sin(lean) / Math.max(Math.hypot(x, y), 1e-6));
  return {
    point: held ? held.translation : centre,
    axis,
    target: kinematics.apply(base, place),
    up: kinematics.rotate(base.rotation, [toward[0], toward[1], Math.cos(lean)]),
  };
}

/** One way with few joints, each turned once; false if the place is reached or no joint brings the hand nearer. */
async function joints(page, { arm, scene, seen, goal, block, refused }) {
  const q = seen.joints.slice(0, arm.arm.length);
  const { off, tilt } = kinematics.poseError(arm, q, goal);
  if (off <= goal.pointDone && tilt <= goal.tiltDone) return false;
  const way = planTurns(arm, q, goal, {
    mode: numberOf(seen.mode),
    depth: obstacles(arm, scene, seen, block),
    refused: (turn) => refused.some(({ joint, up }) => joint === turn.joint && up === turn.angle > 0),
  });
  for (const { joint, to } of way) {
    await choose(page, joint);
    const angle = async () => (await readState(page)).joints[joint];
    // A key that is let go too early is pressed again; a joint that then stays where it is has met something.
    let before = await angle();
    for (let press = 0; press < 2 && Math.abs(to - before) > (press ? CONTACT_SHORTFALL_RAD : 0); press++) {
      await move(page, to - before, SPEED.joint, { joint });
      const now = await angle();
      if (Math.abs(to - now) > CONTACT_SHORTFALL_RAD && Math.abs(now - before) < 0.5 * Math.abs(to - before)) {
        refused.push({ joint, up: to > before });
        return true;
      }
      before = now;
    }
    refused.length = 0;
  }
  return way.length > 0;
}

/** One round of turns and slides to how the arm would stand there; false if nothing is off. */
async function axes(page, arm, index, place, order) {
  let moved = false;
  const first = await readState(page);
  const { q, left } = kinematics.inverseKinematics(arm, first.joints.slice(0, arm.arm.length), goalOf(arm, first, index, place(first)));
  if (left > 0.03) throw new Error(`the place is out of reach by ${left.toFixed(3)} m`);
  const wanted = kinematics.forwardKinematics(arm, q);
  for (const kind of order) {
    const number = (axis) => FIRST_AXIS + axis + (kind === "turn" ? 3 : 0);
    for (const axis of [0, 1, 2]) {
      const seen = await readState(page);
      const goal = goalOf(arm, seen, index, place(seen));
      const tip = kinematics.compose(kinematics.inverse(seen.world_from_base), seen.world_from_tip);
      const off =
        kind === "turn"
          ? kinematics.rotationVector(kinematics.compose(wanted, kinematics.inverse(tip)).rotation)
          : kinematics.sub(goal.target, kinematics.apply(tip, goal.point));
      if (Math.abs(off[axis]) < JOG_TOLERANCE[kind]) continue;
      await choose(page, number(axis));
      await move(page, off[axis], SPEED[kind], { kind });
      moved = true;
    }
  }
  return moved;
}

/** Goes on to the joint or axis with this number. */
async function choose(page, number) {
  for (let step = 0; step < 14; step++) {
    const { mode } = await readState(page);
    if (numberOf(mode) === number) return;
    await tap(page, "hand_open");
  }
  throw new Error(`mode ${number} does not come up`);
}

/** What the movements on a page have taught of the lag. */
const lags = new WeakMap();

/** Moves the chosen joint or axis by `amount`, and learns from how far it went. `what`: a joint, or slide or turn. */
async function move(page, amount, speed, what) {
  const from = await readState(page);
  const gesture = amount * from.mode.we_sign > 0 ? "wrist_extension" : "wrist_flexion";
  const lag = lags.get(page) ?? STOP_LAG_SECS.first;
  const way = Math.abs(amount);
  // Shorter ways than the lag's are a tap, and most are too long then: half a lag off is left alone.
  if (way < 0.5 * speed * lag) return;
  await hold(page, gesture, { way: way - speed * lag, millis: (way / speed) * 1500 + 500, from, what });
  // The arm comes to rest.
  await page.waitForTimeout(150);
  const went = await page.evaluate(MOVE_PROGRESS, { from, what });
  const tooFar = (went - way) / speed;
  const learnt = way > speed * lag ? lag + LAG_LEARNING_RATE * tooFar : lag;
  lags.set(page, Math.min(Math.max(learnt, 0), STOP_LAG_SECS.most));
}

/** How far the joint, or the hand along or about its axis, went since a frame; runs on the page. */
const MOVE_PROGRESS = ({ from, what }) => {
  const { frame } = window.__proact;
  if (what.joint !== undefined) return Math.abs(frame.joints[what.joint] - from.joints[what.joint]);
  const [now, then] = [frame.world_from_tip, from.world_from_tip];
  if (what.kind === "slide") return Math.hypot(...now.translation.map((value, k) => value - then.translation[k]));
  const same = Math.abs(now.rotation.reduce((sum, value, k) => sum + value * then.rotation[k], 0));
  return 2 * Math.acos(Math.min(same, 1));
};

/**
 * Holds a key until the arm has gone its way, or for so many milliseconds of the trial, or until nothing moves. The
 * key is let go on the page itself: a busy test program would be late.
 */
async function hold(page, gesture, { way, millis, from, what }) {
  await page.keyboard.down(KEYS[gesture]);
  await page.evaluate(
    ([gesture, code, went, { way, millis, from, what }]) =>
      new Promise((resolve) => {
        let began = null;
        const gone = what ? new Function(`return (${went})`)() : () => Infinity;
        const pressed = window.__proact.frame.time;
        const timer = setInterval(() => {
          const { frame } = window.__proact;
          if (frame.gesture === gesture) began ??= frame.time;
          const held = began === null ? -1 : frame.time - began;
          // A key that has no effect by then was missed, or let go by a program that had no sign of life.
          const missed = began === null && frame.time - pressed > 1500;
          const over = held >= millis || (held >= 0 && gone({ from, what }) >= way);
          if (!over && !missed && !(frame.planner.state === "failed" && held > 200)) return;
          clearInterval(timer);
          window.dispatchEvent(new KeyboardEvent("keyup", { code }));
          resolve(null);
        }, 2);
      }),
    [gesture, KEYS[gesture], MOVE_PROGRESS.toString(), { way, millis, from, what }],
  );
  await relax(page, gesture);
}

function tap(page, gesture) {
  return hold(page, gesture, { way: 0, millis: 0 });
}

async function relax(page, gesture) {
  await page.keyboard.up(KEYS[gesture]);
  await page.waitForFunction(() => window.__proact.frame.gesture === "no_motion", null, { timeout: 4_000, polling: 8 });
}
