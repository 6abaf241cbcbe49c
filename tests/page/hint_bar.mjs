// A newcomer with method B: reads the strip at the bottom of the page, does what it says with the keys that it names, and knows
// nothing else. Acts as fast as people do.

/** From what is seen to what the fingers do, ms. */
const REACTION_MS = 200;
/** A tap, ms. */
const TAP_MS = 150;
/** What is so near is tapped at, centimetres and degrees. */
const NEAR = { cm: 2, "°": 6 };

export async function driveByHints(page, { limitMs, log }) {
  const end = Date.now() + limitMs;
  let last = "";
  const hint = () => page.textContent(".hint");
  const wait = (ms) => page.waitForTimeout(ms);
  const press = async (key, ms) => {
    await page.keyboard.down(`Key${key}`);
    await wait(ms);
    await page.keyboard.up(`Key${key}`);
    await page.waitForFunction(() => window.__proact.frame.gesture === "no_motion");
  };
  while (Date.now() < end) {
    if ((await page.evaluate(() => window.__proact.frame.score)) > 0) return;
    await wait(REACTION_MS);
    const said = await hint();
    if (said !== last) log(`${((await page.evaluate(() => window.__proact.frame.time)) / 1000).toFixed(1)} s: ${said}`);
    last = said;
    const hold = /^Hold wrist (extension|flexion) \((.)\): (\d+) ?(cm|°) (.*)\.$/.exec(said);
    const key = /\((.)\)/.exec(said)?.[1];
    if (hold) {
      const [, , letter, far, unit, direction] = hold;
      if (Number(far) <= NEAR[unit]) {
        await press(letter, TAP_MS);
        continue;
      }
      await page.keyboard.down(`Key${letter}`);
      // Until the way is done, or the page says something else.
      const done = ([direction, near]) => {
        const now = /: (\d+) ?(?:cm|°) (.*)\.$/.exec(document.querySelector(".hint").textContent);
        return !now || now[2] !== direction || Number(now[1]) <= near;
      };
      await page.waitForFunction(done, [direction, NEAR[unit]], { timeout: 15_000, polling: 30 }).catch(() => {});
      await page.keyboard.up(`Key${letter}`);
      await page.waitForFunction(() => window.__proact.frame.gesture === "no_motion");
    } else if (/^Wait/.test(said)) {
      await wait(300);
    } else if (key) {
      await press(key, TAP_MS);
      if (/^Hand close/.test(said)) await wait(1200);
    } else {
      await wait(300);
    }
  }
  throw new Error(`no block on target within ${limitMs / 1000} s; the strip said last: ${last}`);
}
