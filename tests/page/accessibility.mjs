// Who has no mouse, no keyboard, one hand or one switch drives too, and the pages keep to WCAG 2.2 AA as far as axe-core sees.

import { readFile } from "node:fs/promises";
import { driveBlocks } from "./drive.mjs";

const RULES = ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa"];
const KEYS = { wrist_extension: "KeyW", wrist_flexion: "KeyS", hand_close: "KeyA", hand_open: "KeyD" };

export async function accessibility(page, tools) {
  const { url, check } = tools;
  const open = async (path = "?quality=3&tutorial=0&pictures=10") => {
    await page.goto(new URL(path, url).href);
    await page.waitForFunction(() => window.__proact?.framesDrawn > 3);
  };
  await checkAxeRules(page, tools, open);
  await dialogs(page, check, open);
  await checkLiveRegions(page, check, open);
  await dwellClicking(page, check, open);
  for (const [name, make] of [["the keyboard alone", keyboard], ["the mouse alone", mouse], ["one switch", oneSwitch]]) {
    await open();
    // Another trial: what the one before has brought to its target does not count.
    await page.keyboard.press("KeyR");
    await page.waitForFunction(() => window.__proact.frame.score === 0 && window.__proact.frame.time < 2000);
    await page.mouse.move(5, 5);
    const hands = await make(page);
    const before = Date.now();
    await driveBlocks(page, { wanted: 1, limitMs: tools.limitMs, log: (text) => console.log(`    ${name}: ${text}`), screenshot: async () => {}, hands });
    await tools.screenshot(name.replaceAll(" ", "-"));
    check(true, `a block reaches its target by ${name}, in ${Math.round((Date.now() - before) / 1000)} s`);
  }
}

/** Looks at what is on the page with axe-core: `look(what)`. */
export async function checkWithAxe(page, { axe, check, screenshot }) {
  const source = await readFile(axe, "utf8");
  return async (what) => {
    // The pages' own policy lets no foreign script in: it comes by way of the debugger.
    await page.evaluate(source);
    const found = await page.evaluate(async (tags) => {
      const { violations } = await window.axe.run(document, { runOnly: { type: "tag", values: tags } });
      return violations.map(({ id, nodes }) => `${id}: ${nodes.slice(0, 3).map(({ target, any }) => `${target} ${any[0]?.message ?? ""}`).join(", ")}`);
    }, RULES);
    if (found.length > 0) await screenshot(`axe-${what.replaceAll(" ", "-")}`);
    check(found.length === 0, `${what}: ${found.length ? found.join("; ") : "nothing against WCAG 2.2 AA"}`);
  };
}

/** axe-core on each page and state, in both colours. */
async function checkAxeRules(page, tools, open) {
  const { url } = tools;
  const look = await checkWithAxe(page, tools);
  await open();
  for (const scheme of ["light", "dark"]) {
    await page.emulateMedia({ colorScheme: scheme });
    await page.evaluate(() => localStorage.clear());
    await page.goto(new URL("?quality=3&pictures=10", url).href);
    await page.locator(".welcome:not([hidden])").first().waitFor();
    await look(`greeting, ${scheme}`);
    await page.keyboard.press("Escape");
    await open();
    await look(`driving, ${scheme}`);
    const block = await page.evaluate(() => window.__proact.project("object", window.__proact.frame.next));
    await page.mouse.move(block.x, block.y);
    await page.waitForFunction(() => document.querySelector(".steps li.past"));
    await look(`with passed steps, ${scheme}`);
    await page.click('button:text-is("Settings")');
    await look(`settings, ${scheme}`);
    await page.keyboard.press("Escape");
    await page.setViewportSize({ width: 390, height: 844 });
    await page.waitForTimeout(500);
    await look(`on a telephone, ${scheme}`);
    await page.setViewportSize({ width: 1280, height: 720 });
    await open("experimenter?quality=3");
    await page.waitForFunction(() => window.__proact?.framesDrawn > 3);
    await look(`experimenter, ${scheme}`);
    await page.goto(new URL("reference-board", url).href);
    await look(`reference board, ${scheme}`);
  }
  await page.emulateMedia({ colorScheme: null });
}

/** A dialog is named, has the focus, keeps it, and is closed by Escape. */
async function dialogs(page, check, open) {
  await open();
  await page.focus('button:text-is("Settings")');
  await page.keyboard.press("Enter");
  const inside = () => page.evaluate(() => document.activeElement?.closest('dialog[aria-labelledby="' + document.querySelector(".settings")?.getAttribute("aria-labelledby") + '"]') !== null);
  check((await page.getByRole("dialog", { name: "Settings" }).count()) === 1, "the settings are a dialog by that name");
  check(await inside(), "which has the focus");
  for (let k = 0; k < 60; k++) await page.keyboard.press("Tab");
  check(await page.evaluate(() => document.activeElement === document.body || document.activeElement?.closest("dialog") !== null), "and keeps it");
  const held = await page.waitForFunction(() => document.querySelector(".clock")?.classList.contains("waits")).then(() => true);
  check(held, "time stands still meanwhile");
  await page.keyboard.press("Escape");
  check(await page.locator(".settings").isHidden(), "Escape closes it");
}

/** What happens is said where a screen reader hears it. */
async function checkLiveRegions(page, check, open) {
  await open();
  const block = await page.evaluate(() => window.__proact.project("object", window.__proact.frame.next));
  await page.mouse.move(block.x, block.y);
  await page.waitForFunction(() => window.__proact.frame.target.object === window.__proact.frame.next);
  // Another word may follow at once, and take its place.
  await page.evaluate(() => {
    window.__announced = [];
    const region = document.querySelector(".only-heard[aria-live=polite]");
    new MutationObserver(() => window.__announced.push(region.textContent)).observe(region, { childList: true, characterData: true, subtree: true });
  });
  await page.keyboard.press("KeyS", { delay: 200 });
  await page.waitForFunction(() => window.__announced.some((text) => text.includes("Locked")));
  check(true, "a lock is announced");
  check((await page.getAttribute(".hint", "aria-live")) === "polite", "and so is the next thing to do");
}

/** A pointer that rests on the block locks it, and on a button makes its gesture until it leaves. */
async function dwellClicking(page, check, open) {
  await choose(page, "resting", "0.6 s");
  await open();
  const block = await page.evaluate(() => window.__proact.project("object", window.__proact.frame.next));
  await page.mouse.move(block.x, block.y);
  await page.waitForFunction(() => window.__proact.frame.target.locked);
  check(true, "a pointer that rests on a block locks it");
  const { x, y, width, height } = await page.locator(".gesture.hand_close").boundingBox();
  await page.mouse.move(x + width / 2, y + height / 2);
  await page.waitForFunction(() => window.__proact.frame.gesture === "hand_close");
  await page.mouse.move(5, 5);
  await page.waitForFunction(() => window.__proact.frame.gesture === "no_motion");
  check(true, "and on a button makes its gesture until it leaves");
  await choose(page, "resting", "off");
}

async function choose(page, name, value) {
  await page.click('button:text-is("Settings")');
  await page.selectOption(`select[name="${name}"]`, value);
  await page.keyboard.press("Escape");
}

/** Tab goes from place to place; letters are gestures. */
async function keyboard(page) {
  const focus = async (label) => {
    for (let k = 0; k < 60; k++) {
      if ((await page.evaluate(() => document.activeElement?.getAttribute("aria-label"))) === label) return;
      await page.keyboard.press("Tab");
    }
    throw new Error(`Tab never came to ${label}`);
  };
  return {
    look: async (page, what, id) => focus(await labelOf(page, what, id)),
    down: (page, gesture) => page.keyboard.down(KEYS[gesture]),
    up: (page, gesture) => page.keyboard.up(KEYS[gesture]),
  };
}

function labelOf(page, what, id) {
  return page.evaluate(
    ([what, id]) => {
      const plain = window.__proact.content.scene.objects[id].name.replace(/([a-z])(\d+)$/i, "$1 $2");
      return what === "object" ? plain[0].toUpperCase() + plain.slice(1) : `Target of ${plain}`;
    },
    [what, id],
  );
}

/** Buttons and wheel of the mouse, over the scene. */
async function mouse() {
  const wheel = { hand_close: 120, hand_open: -120 };
  return {
    async look(page, what, id) {
      const at = await page.evaluate(([what, id]) => window.__proact.project(what, id), [what, id]);
      await page.mouse.move(at.x, at.y);
    },
    async down(page, gesture) {
      if (gesture in wheel) await page.mouse.wheel(0, wheel[gesture]);
      else await page.mouse.down({ button: gesture === "wrist_flexion" ? "right" : "left" });
    },
    async up(page, gesture) {
      if (!(gesture in wheel)) await page.mouse.up({ button: gesture === "wrist_flexion" ? "right" : "left" });
    },
  };
}

/** Nothing but the space bar, when what is wanted is offered. */
async function oneSwitch(page) {
  await choose(page, "one", "0.8 s");
  const press = () => page.keyboard.press("Space");
  const offered = (text) => page.waitForFunction((text) => document.querySelector(".scan b")?.textContent === text, text, { polling: 30 });
  const names = { wrist_extension: "Wrist extension", wrist_flexion: "Wrist flexion", hand_close: "Hand close", hand_open: "Hand open" };
  return {
    async look(page, what, id) {
      await offered("Look at …");
      await press();
      await offered(await labelOf(page, what, id));
      await press();
    },
    async down(page, gesture) {
      await offered(names[gesture]);
      await press();
    },
    async up(page, gesture) {
      if (gesture === "wrist_extension") await press();
    },
  };
}
