// The arm stops when the page or the gamepad that moves it falls silent or dies, says why, and goes on only after a
// relaxed gesture. Times are trial time, by the frames that a third party gets; the wall clock, which all pages
// share, only tells which frame came first after something that was done.

import net from "node:net";

/** Number of the joint in method A: the elbow turns for four seconds before WE brings it to its limit. */
const ELBOW = 3;
/** The arm turns at 0.4 rad/s; a joint that is slower than this is at rest, rad/s. */
const REST = 0.01;
/** From the last sign of life to rest, ms of trial time. */
const SILENT_MS = 250;
/** From the end of the connection to rest. */
const CLOSED_MS = 100;
/** Delay of the line in each direction, ms: together more than the 250 ms that a trial allows by default. */
const ONE_WAY_MS = 150;
/** Nothing that happens later than this after a stop is still its doing. */
const OBSERVATION_MS = 600;
/** Right trigger of a gamepad: WE. */
const TRIGGER = 7;

export async function safety(page, { url, check, screenshot }) {
  const context = page.context();
  await page.addInitScript(recordInPage);
  await page.goto(new URL("?quality=3&tutorial=0&pictures=6", url).href);
  await page.waitForFunction(() => window.__proact?.connected && window.__proact.framesDrawn > 3);
  const watcher = await watch(context, url);
  await page.click('.methodbutton:text-is("A")');
  // Its clock waits for the first key.
  await watcher.until(() => window.seen.at(-1)?.method === "A");
  await selectElbow(page);

  const parts = { page, url, watcher, check, screenshot };
  await silentPage(parts);
  await unreadGamepad(parts);
  await closedPage(parts);
  await delayedPage(parts);
  await watcher.page.close();
}

/** The page goes on living and its key stays pressed, but nothing of it arrives any more. */
async function silentPage({ page, url, watcher, check, screenshot }) {
  const begun = Date.now();
  await hold(watcher, key(page));
  check(true, "a key held turns the elbow");
  await page.evaluate(() => (window.silence.wanted = true));
  await watcher.until(() => window.seen.at(-1).stop !== null);
  await watcher.passes(OBSERVATION_MS);
  const { source, cause, reason } = (await watcher.latest()).stop;
  check(source === "page" && cause === "silent", `a silent page stops the arm: ${source}, ${cause}`);
  checkRest(check, await watcher.since(begun), await page.evaluate(() => window.silence.since), SILENT_MS, "its last sign of life");
  await checkBanner(page, check, reason);
  await screenshot("stop-silent");
  const spectator = await page.context().newPage();
  await spectator.goto(new URL("spectator?quality=3", url).href);
  await checkBanner(spectator, check, reason, "a spectator's page");
  await spectator.close();

  const mark = Date.now();
  await page.evaluate(() => Object.assign(window.silence, { wanted: false, since: null }));
  await watcher.passes(OBSERVATION_MS);
  check(isElbowMoving(await watcher.since(mark)).length === 0, "a press held all through does not move the arm again");
  check((await watcher.latest()).stop !== null, "and the stop stays until the key is let go of");
  await page.keyboard.up("KeyW");
  await watcher.until(() => window.seen.at(-1).stop === null);
  await page.locator(".stop-banner").waitFor({ state: "hidden" });
  await hold(watcher, key(page));
  check(true, "a new press does");
  await page.keyboard.up("KeyW");
}

/** A gamepad is read with every picture, and there are none any more; timers and the connection live on. */
async function unreadGamepad({ page, watcher, check, screenshot }) {
  // Only the page in front gets pictures.
  await page.bringToFront();
  // Without a graphics card one drawing takes longer than a gamepad may go unread: it is read, and nothing is drawn.
  await page.evaluate(() => (window.pictures.clock = performance.now()));
  await watcher.passes(OBSERVATION_MS);
  const begun = Date.now();
  await hold(watcher, trigger(page));
  check(true, "a gamepad's trigger turns the elbow");
  await page.evaluate(() => (window.pictures.wanted = false));
  await watcher.until(() => window.seen.at(-1).gesture === "no_motion");
  check((await page.textContent(".toast")).includes("not read"), "the page says that the gamepad is not read");
  await watcher.passes(OBSERVATION_MS);
  checkRest(check, await watcher.since(begun), await page.evaluate(() => window.pictures.ended), SILENT_MS, "its last reading");
  const mark = Date.now();
  await page.evaluate(() => window.drawAgain());
  await watcher.passes(OBSERVATION_MS);
  check(isElbowMoving(await watcher.since(mark)).length === 0, "a trigger held all through does not move the arm again");
  await trigger(page)(false);
  await watcher.passes(OBSERVATION_MS);
  await hold(watcher, trigger(page));
  check(true, "a new pull does");
  await trigger(page)(false);
  await watcher.until(() => window.seen.at(-1).gesture === "no_motion");
  await page.evaluate(() => (window.pictures.clock = null));
  await screenshot("stop-gamepad");
}

/** Another page takes command, and its line ends without a word, as in a crash; then it is closed as a person would. */
async function closedPage({ page, url, watcher, check, screenshot }) {
  const driver = await page.context().newPage();
  await driver.addInitScript(recordInPage);
  await driver.goto(new URL("?quality=3&tutorial=0&pictures=6", url).href);
  await driver.waitForFunction(() => window.__proact?.connected && window.__proact.framesDrawn > 3);
  await driver.click('.wheel button:text-is("Take over")');
  await drives(driver);
  let begun = Date.now();
  await hold(watcher, key(driver));
  const ended = await driver.evaluate(() => {
    window.line.close();
    return Date.now();
  });
  await watcher.until(() => window.seen.at(-1).stop !== null);
  await watcher.passes(OBSERVATION_MS);
  const { source, cause, reason } = (await watcher.latest()).stop;
  check(source === "page" && cause === "closed", `a page whose line ends stops the arm: ${source}, ${cause}`);
  checkRest(check, await watcher.since(begun), ended, CLOSED_MS, "the end of its line");
  await checkBanner(page, check, reason, "the page that is left");
  await screenshot("stop-closed");

  // Whoever goes on, relaxes first.
  await drives(driver);
  await driver.keyboard.up("KeyW");
  await driver.keyboard.press("KeyW", { delay: 150 });
  await watcher.until(() => window.seen.at(-1).stop === null);
  begun = Date.now();
  await hold(watcher, key(driver));
  check(true, "after a relaxed gesture it goes on");
  await driver.close();
  const gone = Date.now();
  await watcher.passes(OBSERVATION_MS);
  // The browser may take its time to end the line of a page that is gone already.
  const frames = await watcher.since(begun);
  const late = isElbowMoving(frames).at(-1) - firstAfter(frames, gone).time;
  check(late <= SILENT_MS, `a page that is closed leaves the arm at rest ${late} ms later, ${SILENT_MS} are allowed`);
}

/** A page whose line has a constant delay: everything comes, nothing is missing, and all of it is old. */
async function delayedPage({ page, url, watcher, check, screenshot }) {
  const line = await delayedLine(new URL(url).port);
  const driver = await page.context().newPage();
  await driver.goto(new URL(`?quality=3&tutorial=0&pictures=6`, `http://127.0.0.1:${line.port}/`).href);
  await driver.waitForFunction(() => window.__proact?.connected && window.__proact.framesDrawn > 3);
  await driver.click('.wheel button:text-is("Take over")');
  await drives(driver);
  await driver.locator(".delay-banner:not([hidden])").waitFor();
  check(/delayed by \d{3} ms/.test(await driver.textContent(".delay-banner")), "a page with a slow line says by how much");
  let begun = Date.now();
  await driver.keyboard.down("KeyW");
  await watcher.until(() => window.seen.at(-1).stop !== null);
  await watcher.passes(OBSERVATION_MS);
  const { source, cause, reason } = (await watcher.latest()).stop;
  check(source === "page" && cause === "delayed", `and stops the arm: ${source}, ${cause}`);
  const turned = isElbowMoving(await watcher.since(begun)).length;
  check(turned === 0, `which did not begin to move: ${turned} frames`);
  await checkBanner(page, check, reason, "another page");
  await screenshot("stop-delayed");
  await driver.keyboard.up("KeyW");
  line.delayMs = 0;
  await driver.locator(".delay-banner").waitFor({ state: "hidden" });
  await watcher.until(() => window.seen.at(-1).stop === null);
  await hold(watcher, key(driver));
  check(true, "on a line that is fast again a new press moves it");
  // The mouse moves, and nothing vouches for the key any more.
  await driver.evaluate(() => {
    const send = WebSocket.prototype.send;
    WebSocket.prototype.send = function (text) {
      if (!["alive", "gesture"].includes(JSON.parse(text).type)) send.call(this, text);
    };
  });
  begun = Date.now();
  for (let k = 0; (await watcher.latest()).stop === null && k < 200; k++) await driver.mouse.move(400 + k, 300);
  const stop = (await watcher.latest()).stop;
  check(stop?.cause === "silent", `gaze keeps no gesture alive: ${stop?.cause}`);
  await driver.close();
  line.close();
}

/** A line to `port` of this machine whose bytes come `delayMs` later in each direction, in their order. */
async function delayedLine(port) {
  const line = { delayMs: ONE_WAY_MS, port: 0, close: () => server.close() };
  const server = net.createServer((near) => {
    const far = net.connect(port, "127.0.0.1");
    for (const [from, to] of [[near, far], [far, near]]) {
      // One queue a direction: bytes keep their order, whatever timers do.
      const waiting = [];
      const pass = () => {
        while (waiting.length > 0 && waiting[0].due <= Date.now()) to.write(waiting.shift().data);
        if (waiting.length > 0) setTimeout(pass, waiting[0].due - Date.now());
      };
      from.on("data", (data) => {
        waiting.push({ due: Date.now() + line.delayMs, data });
        if (waiting.length === 1) setTimeout(pass, line.delayMs);
      });
      from.on("close", () => to.destroy());
      from.on("error", () => to.destroy());
    }
  });
  await new Promise((resolve) => server.listen(0, "127.0.0.1", resolve));
  line.port = server.address().port;
  return line;
}

function drives(page) {
  return page.locator('.wheel:has-text("You drive")').waitFor();
}

/** Runs in a page before its own scripts: lets a test cut its line, press a gamepad's buttons and stop its pictures. */
function recordInPage() {
  window.silence = { wanted: false, since: null };
  const send = WebSocket.prototype.send;
  WebSocket.prototype.send = function (text) {
    window.line = this;
    if (window.silence.since !== null) return;
    send.call(this, text);
    // A sign of life is the last that is heard, so that it is known when that was.
    if (window.silence.wanted && JSON.parse(text).type === "alive") window.silence.since = Date.now();
  };

  const buttons = Array.from({ length: 17 }, () => ({ pressed: false, value: 0 }));
  const pad = { id: "test pad", index: 0, connected: true, mapping: "standard", axes: [0, 0, 0, 0], buttons };
  navigator.getGamepads = () => [pad];
  window.press = (button, value) => Object.assign(buttons[button], { value, pressed: value > 0.5 });

  const request = window.requestAnimationFrame.bind(window);
  // With a clock that stands still the page goes on with its loop and finds no picture due.
  window.pictures = { wanted: true, clock: null, ended: null, next: null };
  window.requestAnimationFrame = (draw) => {
    if (window.pictures.wanted) return request((time) => draw(window.pictures.clock ?? time));
    Object.assign(window.pictures, { ended: Date.now(), next: draw });
    return 0;
  };
  window.drawAgain = () => {
    window.pictures.wanted = true;
    request(window.pictures.next);
  };
}

/** Presses WE's key, or lets it go. */
function key(page) {
  return (down) => (down ? page.keyboard.down("KeyW") : page.keyboard.up("KeyW"));
}

/** The same with a gamepad's trigger. */
function trigger(page) {
  return (down) => page.evaluate(([button, value]) => window.press(button, value), [TRIGGER, down ? 1 : 0]);
}

/** Holds WE until the elbow turns. A browser that is busy may be stopped before: then it takes a new press. */
async function hold(watcher, press) {
  for (let presses = 0; presses < 5; presses++) {
    await press(true);
    if (await watcher.turnsOn()) return;
    await press(false);
    await watcher.passes(100);
  }
  throw new Error("the elbow does not turn by WE");
}

/** A third party that sees the frames and draws nothing, so that it is not late. */
async function watch(context, url) {
  const page = await context.newPage();
  await page.goto(new URL("healthz", url).href);
  await page.evaluate(() => {
    window.seen = [];
    const socket = new WebSocket(`${location.origin.replace("http", "ws")}/live?role=spectator`);
    socket.onmessage = ({ data }) => {
      const { type, time, method, joints, gesture, stop } = JSON.parse(data);
      if (type !== "frame") return;
      // Another trial.
      if (time < window.seen.at(-1)?.time) window.seen = [];
      window.seen.push({ wall: Date.now(), time, method, joints, gesture, stop: stop ?? null });
    };
  });
  const until = (condition, argument) => page.waitForFunction(condition, argument, { polling: 20, timeout: 20_000 });
  const latest = () => page.evaluate(() => window.seen.at(-1));
  return {
    page,
    until,
    latest,
    since: (wall) => page.evaluate((from) => window.seen.filter((frame) => frame.wall >= from), wall),
    async passes(ms) {
      await until((then) => window.seen.at(-1).time >= then, (await latest()).time + ms);
    },
    /** Whether the elbow turns by more than a little from where it is. */
    async turnsOn() {
      const from = (await latest()).joints[ELBOW];
      const further = ([joint, before]) => Math.abs(window.seen.at(-1).joints[joint] - before) > 0.05;
      const seen = page.waitForFunction(further, [ELBOW, from], { polling: 20, timeout: 3_000 });
      return seen.then(() => true, () => false);
    },
  };
}

/** Times of the frames in which a joint is further on than in the frame before. */
function isElbowMoving(frames) {
  return frames
    .filter((frame, k) => {
      const before = frames[k - 1] ?? frame;
      const most = (REST * (frame.time - before.time)) / 1000;
      return frame.joints.some((angle, joint) => Math.abs(angle - before.joints[joint]) > most);
    })
    .map(({ time }) => time);
}

function firstAfter(frames, wall) {
  const found = frames.find((frame) => frame.wall >= wall);
  if (!found) throw new Error("no frame came any more");
  return found;
}

/** The arm turned when `wall` was on the clock, and was at rest soon after. */
function checkRest(check, frames, wall, allowed, since) {
  const { time } = firstAfter(frames, wall);
  const turned = isElbowMoving(frames);
  check(turned.includes(time), `the arm turns at ${since}`);
  const late = turned.at(-1) - time;
  check(late <= allowed, `and is at rest ${late} ms of trial time later, ${allowed} are allowed`);
}

/** The reason of the stop is on display, and the middle of the scene is free. */
async function checkBanner(page, check, reason, who = "the page") {
  const banner = page.locator(".stop-banner:not([hidden])");
  await banner.waitFor();
  const text = (await banner.textContent()).toLowerCase();
  check(text.includes(reason.toLowerCase().replace(/\.$/, "")), `${who} says why: ${reason}`);
  check((await banner.getAttribute("role")) === "alert", "as an alert");
  const { y, height } = await banner.boundingBox();
  check(y >= 0 && y + height < 0.4 * page.viewportSize().height, "above the middle of the scene");
}

/** Taps HO until the elbow is the joint that WE moves. */
async function selectElbow(page) {
  for (let taps = 0; taps < 30; taps++) {
    const now = await page.evaluate(() => JSON.stringify(window.__proact.frame.mode.moves));
    if (JSON.parse(now).joint === ELBOW) return;
    await page.keyboard.press("KeyD", { delay: 150 });
    const next = (before) => window.__proact.frame.gesture === "no_motion" && JSON.stringify(window.__proact.frame.mode.moves) !== before;
    await page.waitForFunction(next, now, { timeout: 2_000 }).catch(() => {});
  }
  throw new Error("the elbow could not be selected by HO");
}
