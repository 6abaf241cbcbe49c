// Drives method D by mouse and keys as the guide on the page says: look, lock, hold to reach, grip, look, lock,
// hold to carry, release. It sees only what a person sees: the frame that is drawn, and where things are on the
// screen. It acts only through the mouse and the keyboard.

const KEYS = { wrist_extension: "KeyW", wrist_flexion: "KeyS", hand_close: "KeyA", hand_open: "KeyD" };

/** A gesture that should have had its effect by then is let go and tried again, ms. */
const TAP_MS = 4_000;

/** How most people act: the mouse is the gaze, keys are gestures. */
export const mouseAndKeys = {
  async look(page, what, id) {
    const at = await page.evaluate(([what, id]) => window.__proact.project(what, id), [what, id]);
    if (!at) throw new Error(`${what} ${id} is not on the page`);
    await page.mouse.move(at.x, at.y);
  },
  down: (page, gesture) => page.keyboard.down(KEYS[gesture]),
  up: (page, gesture) => page.keyboard.up(KEYS[gesture]),
};

/** `hands`: how to look, press and let go. */
export async function driveBlocks(page, { wanted, limitMs, log, screenshot, hands = mouseAndKeys }) {
  const end = Date.now() + limitMs;
  let last = "";
  const taken = new Set();
  while (Date.now() < end) {
    const view = await readState(page);
    if (view.onTarget >= wanted || view.finished) return;
    const { name, act } = chooseAction(page, view, hands);
    if (name !== last) {
      log(`${(view.time / 1000).toFixed(1)} s: ${name}`);
      last = name;
      const shot = name.split(" ")[0];
      if (!taken.has(shot)) {
        taken.add(shot);
        await screenshot(`step-${shot}`);
      }
    }
    await act();
  }
  throw new Error(`${wanted} blocks on target within ${limitMs / 1000} s; the last step was: ${last}`);
}

function readState(page) {
  return page.evaluate(() => {
    const { frame } = window.__proact;
    return {
      time: frame.time,
      onTarget: frame.score,
      finished: frame.finished,
      next: frame.next,
      hand: frame.hand,
      target: frame.target,
      planner: frame.planner,
    };
  });
}

/** What the guide's strip would say. */
function chooseAction(page, { next, hand, target, planner }, hands) {
  const there = planner.state === "arrived" && !planner.intermediate;
  if (hand.holds !== null) {
    if (there && target.locked) return { name: "release", act: () => hold(page, hands, "hand_open", () => window.__proact.frame.hand.holds === null) };
    if (target.locked) return { name: "carry", act: () => carry(page, hands) };
    return { name: `place ${hand.holds}`, act: () => lookAndLock(page, hands, "target", hand.holds) };
  }
  if (hand.state === "closed") {
    return { name: "open", act: () => hold(page, hands, "hand_open", () => window.__proact.frame.hand.state === "open") };
  }
  if (there && target.locked) {
    return { name: "grip", act: () => hold(page, hands, "hand_close", () => window.__proact.frame.hand.holds !== null) };
  }
  if (target.locked) return { name: "reach", act: () => carry(page, hands) };
  return { name: `look ${next}`, act: () => lookAndLock(page, hands, "object", next) };
}

/** Points at it, waits for the highlight to come, and locks. */
async function lookAndLock(page, hands, what, id) {
  await hands.look(page, what, id);
  const selected = await page
    .waitForFunction(
      ([what, id]) => {
        const { frame, content } = window.__proact;
        if (what === "object") return frame.target.object === id;
        const goal = content.scene.targets.find((target) => target.object === id).centre;
        const place = frame.target.place;
        return place !== null && Math.hypot(place[0] - goal[0], place[1] - goal[1]) < 0.03;
      },
      [what, id],
      { timeout: TAP_MS },
    )
    .then(() => true, () => false);
  if (selected) await hold(page, hands, "wrist_flexion", () => window.__proact.frame.target.locked);
}

/**
 * Holds WE until the motion ends, one way or the other, or until the program lets go: it does when the browser is
 * too busy for a sign of life, and the key then has to be pressed anew.
 */
function carry(page, hands) {
  const ended = () => {
    const { gesture, planner } = window.__proact.frame;
    return ["arrived", "failed"].includes(planner.state) || gesture !== "wrist_extension";
  };
  return hold(page, hands, "wrist_extension", ended, 30_000);
}

/** Holds a gesture's key until it is in force and its effect is seen, then relaxes. */
async function hold(page, hands, gesture, until, limitMs = TAP_MS) {
  await hands.down(page, gesture);
  try {
    const inForce = (name) => window.__proact.frame.gesture === name;
    await page.waitForFunction(inForce, gesture, { timeout: TAP_MS }).catch(() => {});
    // A motion that ended earlier is still on display for the time of a plan.
    if (gesture === "wrist_extension") await page.waitForTimeout(300);
    await page.waitForFunction(until, null, { timeout: limitMs }).catch(() => {});
  } finally {
    await hands.up(page, gesture);
  }
  await page.waitForFunction(() => window.__proact.frame.gesture === "no_motion").catch(() => {});
}
