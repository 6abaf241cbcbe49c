// Who is at the two pages of a study: whoever conducts it and whoever takes part, by keys, mouse or finger. What there is to do they
// take from what the server sends; whatever they do goes through the page.

import { answerByKeys, answerByPressing, tabTo } from "./questionnaire.mjs";

const TIMEOUT_MS = 20_000;
const KEYS = { wrist_extension: "KeyW", wrist_flexion: "KeyS", hand_close: "KeyA", hand_open: "KeyD" };
const PROMPTS = {
  "Close the hand": "hand_close",
  "Open the hand": "hand_open",
  "Bend the wrist back": "wrist_extension",
  "Bend the wrist in": "wrist_flexion",
  Relax: "no_motion",
};

/** A page whose newest message of a type is kept. */
class StudyPage {
  /** When a frame of the scene was the last of its trial, ms. */
  finishedAt = null;
  newest = null;

  constructor(page, type) {
    this.page = page;
    page.on("websocket", (socket) =>
      socket.on("framereceived", ({ payload }) => {
        const text = String(payload);
        const named = text.slice(0, 40);
        if (named.includes(`"${type}"`)) this.newest = JSON.parse(text);
        else if (named.includes('"frame"') && text.includes('"finished":true')) this.finishedAt ??= Date.now();
      }),
    );
  }

  async until(holds, what) {
    const end = Date.now() + TIMEOUT_MS;
    while (!(this.newest && holds(this.newest))) {
      if (Date.now() > end) throw new Error(`${what}: the newest message is ${JSON.stringify(this.newest)?.slice(0, 600)}`);
      await this.page.waitForTimeout(15);
    }
    return this.newest;
  }
}

/** Whoever conducts. */
export class ExperimenterPage extends StudyPage {
  constructor(page, hands) {
    super(page, "study");
    this.hands = hands;
  }

  get now() {
    return this.newest?.session?.now ?? null;
  }

  button(name) {
    return this.page.getByRole("button", { name, exact: true });
  }

  /** Presses a button by its name, once it can be pressed. */
  async press(name) {
    await this.ready(name);
    if (this.hands !== "keys") return this.button(name).click();
    for (let k = 0; k < 80; k++) {
      const focused = await this.page.evaluate(() => document.activeElement?.querySelector("span")?.textContent ?? document.activeElement?.textContent ?? "");
      if (focused === name) return this.page.keyboard.press("Enter");
      await this.page.keyboard.press("Tab");
    }
    throw new Error(`Tab never came to ${name}`);
  }

  /** Waits until a button is there and acts. */
  async ready(name) {
    const button = this.button(name);
    await button.waitFor({ timeout: TIMEOUT_MS });
    await this.page.waitForFunction((node) => node.getAttribute("aria-disabled") !== "true" && !node.disabled, await button.elementHandle(), { polling: 15 });
  }

  /** The next step, by its button or its key. */
  async next(name) {
    if (this.hands !== "keys") return this.press(name);
    await this.ready(name);
    await this.page.keyboard.press("n");
  }

  async note(text) {
    if (this.hands === "keys") await this.page.keyboard.press("t");
    else await this.page.getByLabel("Note", { exact: true }).click();
    await this.page.keyboard.type(text);
    if (this.hands === "keys") await this.page.keyboard.press("Control+Enter");
    else await this.button("Add note").click();
    await this.until(({ notes }) => notes.includes(text), "the note is kept");
    if (this.hands === "keys") await this.page.keyboard.press("Escape");
  }

  /** Gives a reason in the dialog that is open, from its list. */
  async reason(words, act) {
    const dialog = this.page.getByRole("dialog");
    await dialog.waitFor();
    if (this.hands === "keys") {
      await tabTo(this.page, "input[name=reason]");
      await this.page.keyboard.press("Space");
      while (!(await dialog.getByRole("radio", { name: words }).isChecked())) await this.page.keyboard.press("ArrowDown");
      await this.page.keyboard.press("Enter");
    } else {
      await dialog.getByRole("radio", { name: words }).click();
      await dialog.getByRole("button", { name: act, exact: true }).click();
    }
  }
}

/** Whoever takes part. */
export class ParticipantPage extends StudyPage {
  constructor(page, hands, line) {
    super(page, "participant");
    this.hands = hands;
    this.line = line;
    this.held = null;
    page.on("websocket", (socket) =>
      socket.on("framesent", ({ payload }) => {
        if (String(payload).startsWith('{"type":"gaze_check"')) this.measured = String(payload);
      }),
    );
  }

  get shows() {
    return this.newest?.show;
  }

  async answer(question, value, conditions) {
    if (this.hands === "keys") await answerByKeys(this.page, question, value, conditions);
    else await answerByPressing(this.page, question, value, conditions, (locator, options) => (this.hands === "finger" ? locator.tap(options) : locator.click(options)));
  }

  async done() {
    if (this.hands === "keys") {
      await tabTo(this.page, ".done");
      await this.page.keyboard.press("Enter");
    } else if (this.hands === "mouse") await this.page.click(".done");
    else await this.page.tap(".done");
  }

  async touch(type, points) {
    await this.line.send("Input.dispatchTouchEvent", { type, touchPoints: points });
  }

  /** Makes a gesture from now on. */
  async hold(gesture) {
    if (this.held === gesture) return;
    if (this.held) {
      if (this.hands === "keys") await this.page.keyboard.up(KEYS[this.held]);
      else if (this.hands === "mouse") await this.page.mouse.up();
      else await this.touch("touchEnd", []);
    }
    this.held = gesture === "no_motion" ? null : gesture;
    if (!this.held) return;
    if (this.hands === "keys") return this.page.keyboard.down(KEYS[gesture]);
    const button = this.page.locator(`.gesture.${gesture}:visible`);
    await button.scrollIntoViewIfNeeded();
    const { x, y, width, height } = await button.boundingBox();
    const at = { x: x + width / 2, y: y + height / 2 };
    if (this.hands === "finger") return this.touch("touchStart", [at]);
    await this.page.mouse.move(at.x, at.y);
    await this.page.mouse.down();
  }

  /** Makes what is prompted, until the test is passed. */
  async train() {
    const end = Date.now() + TIMEOUT_MS;
    for (;;) {
      if (Date.now() > end) throw new Error(`the gestures are not passed: ${JSON.stringify(this.newest)}`);
      if (this.newest.passed) break;
      const prompt = (await this.page.locator(".prompt h2").textContent()) ?? "";
      await this.hold(PROMPTS[prompt] ?? "no_motion");
      await this.page.waitForTimeout(30);
    }
    await this.hold("no_motion");
  }

  /** Looks at each point until the verdict is there, which it returns. `seen` is called where there is time for that. */
  async calibrate(seen) {
    await this.page.locator(".gazecheck:visible h2").waitFor({ timeout: TIMEOUT_MS });
    if (this.hands === "keys") {
      await this.page.keyboard.press("Enter");
      // The gaze is on the points by itself now; a hand has no time to spare.
      await seen();
    }
    const moved = (before) => {
      const verdict = document.querySelector(".gazecheck:not([hidden]) .verdict");
      if (verdict) return { verdict: verdict.textContent };
      const at = window.__proact.gazePoint();
      if (!at || (before && Math.hypot(at.x - before.x, at.y - before.y) < 2)) return null;
      return { ...at, over: document.elementFromPoint(at.x, at.y)?.id };
    };
    for (let at = null; ; ) {
      at = await (await this.page.waitForFunction(moved, at, { timeout: TIMEOUT_MS })).jsonValue();
      if ("verdict" in at) return at.verdict;
      if (at.over !== "scene") throw new Error(`a point at ${at.x}, ${at.y} is below ${at.over}`);
      if (this.hands === "mouse") await this.page.mouse.move(at.x, at.y);
      if (this.hands === "finger") await this.page.touchscreen.tap(at.x, at.y);
    }
  }

  async closeFigures() {
    const close = this.page.locator(".gazecheck:visible button");
    if (this.hands === "keys") {
      await tabTo(this.page, ".gazecheck button");
      await this.page.keyboard.press("Enter");
    } else if (this.hands === "mouse") await close.click();
    else await close.tap();
  }

  /** Looks at the block that is next and makes a gesture: enough for a clock to start. */
  async act() {
    await this.page.waitForFunction(() => window.__proact.frame !== null);
    const at = await this.page.evaluate(() => window.__proact.project("object", window.__proact.frame.next ?? 0));
    if (this.hands === "keys") await tabTo(this.page, ".mark");
    else if (this.hands === "mouse") await this.page.mouse.move(at.x, at.y);
    else await this.page.touchscreen.tap(at.x, at.y);
    await this.hold("wrist_extension");
    await this.page.waitForTimeout(400);
    await this.hold("no_motion");
  }
}
