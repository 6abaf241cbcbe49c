// Signals, intent, scores and views of the participant's page, beside `proact serve --method D --emg-source synthetic --emg-model FILE`:
// the drawer opens by key and by mouse, looks back, and says what gaze and task say; scores become a table and a file; the small
// pictures, the arm that is seen through and turning the view; bytes, draw calls and triangles stay within what is promised.

import { createSocket } from "node:dgram";
import { checkWithAxe } from "./accessibility.mjs";
import { layoutFaults, SLACK_PX } from "./layout.mjs";

/** What a viewer may take, bytes a second. */
const MAX_BYTES = 150_000;
const MAX_DRAW_CALLS = 200;
const MAX_TRIANGLES = 300_000;
/** Where a decoder of miniVIE sends to. */
const VMPL_PORT = 25_000;
/** Methods and people of the shipped results of simulated people. */
const SIMULATED = 4 * 24;

export async function signals(page, tools) {
  const { url, check, limitMs } = tools;
  const line = drawCounts(page);
  await page.addInitScript(() => localStorage.setItem("proact.settings", JSON.stringify({ welcomed: true, captions: true })));
  await page.goto(new URL("?quality=3&tutorial=0", url).href);
  await page.waitForFunction(() => window.__proact?.connected && window.__proact.framesDrawn > 3, null, { timeout: limitMs });
  await opens(page, check);
  await streams(page, line, tools);
  await checkLookBack(page, tools);
  await checkIntentDisplay(page, tools);
  await captions(page, check);
  await sizes(page, tools);
  await page.keyboard.press("KeyG");
  await watched(await tools.tab({ viewport: { width: 1280, height: 720 } }), tools);
  await scores(page, tools);
  await refused(page, tools);
  await views(page, tools);
}

/** Bytes of text that come in on the page's WebSocket. */
function drawCounts(page) {
  const line = { bytes: 0 };
  page.on("websocket", (socket) => socket.on("framereceived", ({ payload }) => (line.bytes += Buffer.byteLength(payload))));
  return line;
}

const drawer = (page) => page.locator(".drawer");
const button = (page, name) => page.locator(`.action.${name}`);

async function opens(page, check) {
  check(await drawer(page).isHidden(), "the drawer is closed at first");
  await page.keyboard.press("KeyG");
  await drawer(page).waitFor();
  check((await button(page, "signals").getAttribute("aria-expanded")) === "true", "a key opens it, and its button says so");
  await page.keyboard.press("KeyG");
  await drawer(page).waitFor({ state: "hidden" });
  await button(page, "signals").click();
  await drawer(page).waitFor();
  check(true, "the key closes it, the mouse opens it");
}

/** Everything comes in, and no more of it than is promised. */
async function streams(page, line, { check, screenshot }) {
  await page.locator(".signalrow.emg .lanes li").nth(7).waitFor();
  await page.locator(".signalrow.joints .values li").nth(6).waitFor();
  // Gestures come with the first window, which is later than the first samples.
  await page.locator(".signalrow .values").first().locator("li").nth(4).waitFor();
  const values = await page.locator(".signalrow .values").evaluateAll((lists) => lists.map((list) => list.children.length));
  check(values[0] === 5 && values[1] === 2 && values[2] === 7, `gestures, gaze and joints have values: ${values.join(", ")}`);
  const limits = await page.locator(".signalrow.joints .values b").allTextContents();
  const within = limits.every((text) => {
    const [, angle, low, high] = text.match(/^(-?\d+)° \((-?\d+) to (-?\d+)\)$/) ?? [];
    return Number(low) <= Number(angle) && Number(angle) <= Number(high) && Number(low) < Number(high);
  });
  check(within, `joint angles lie between their limits: ${limits.join(", ")}`);
  const begun = await page.evaluate(() => ({ time: window.__proact.frame.time, wall: performance.now() }));
  const before = line.bytes;
  await page.waitForFunction((time) => window.__proact.frame.time > time + 10_000, begun.time, { timeout: 60_000 });
  // By the clock on the wall: where the trial cannot keep up with it, the line has less to do.
  const seconds = ((await page.evaluate(() => performance.now())) - begun.wall) / 1000;
  const rate = (line.bytes - before) / seconds;
  check(rate > 10_000 && rate < MAX_BYTES, `a viewer with signals takes ${(rate / 1000).toFixed(0)} kB a second`);
  const { script, whole } = await page.evaluate(() => {
    const { script: own, whole: all } = window.__proact;
    return { script: [own.median, own.most], whole: [all.median, all.most] };
  });
  const ms = ([median, most]) => `${median.toFixed(1)} ms (95 %: ${most.toFixed(1)} ms)`;
  console.log(`    script a picture, drawer open: ${ms(script)}; with the drawing of the scene: ${ms(whole)}`);
  await screenshot("signals");
}

/** The probability of a gesture as the drawer has it now, per cent. */
const probability = (page, gesture) =>
  page.evaluate((name) => {
    const entries = [...document.querySelectorAll(".signalrow .values li")];
    const found = entries.find((entry) => entry.children[1]?.textContent === name);
    return Number.parseInt(found?.lastElementChild?.textContent ?? "-1", 10);
  }, gesture);

async function waitFor(page, what, check, ask) {
  for (let round = 0; round < 150; round++) {
    if (await ask()) return check(true, what);
    await page.waitForTimeout(100);
  }
  return check(false, what);
}

/** A gesture that is over is seen again by going back, by keys, by dragging and by the slider, while the trial goes on. */
async function checkLookBack(page, { check, screenshot }) {
  await page.keyboard.down("KeyA");
  await waitFor(page, "the gesture that a key prompts is the likeliest", check, async () => (await probability(page, "Hand close")) > 60);
  const begun = await page.evaluate(() => window.__proact.frame.time);
  await page.waitForFunction((time) => window.__proact.frame.time > time + 2500, begun);
  await page.keyboard.up("KeyA");
  await waitFor(page, "and with the key it ends", check, async () => (await probability(page, "Hand close")) < 30);
  // Three seconds back from here the gesture has been on for a second and a half, however soon its end was recognised.
  await page.waitForFunction((time) => window.__proact.frame.time > time + 4500, begun);
  const slider = page.locator(".drawerhead input");
  await slider.focus();
  for (let step = 0; step < 3; step++) await page.keyboard.press("ArrowLeft");
  const picture = await page.locator(".signalrow.band canvas").first().boundingBox();
  let seen = false;
  for (let share = 0.99; share > 0 && !seen; share -= 0.02) {
    const drawn = await page.evaluate(() => window.__proact.framesDrawn);
    await page.mouse.move(picture.x + share * picture.width, picture.y + 5);
    await page.waitForFunction((count) => window.__proact.framesDrawn > count + 1, drawn);
    seen = (await probability(page, "Hand close")) > 60;
  }
  check(seen, "after going back by keys, the past value is there under the pointer");
  const state = page.locator(".drawerhead .state");
  check(/^\d+\.\d s back$/.test(await state.textContent()), `and says how far back that is: ${await state.textContent()}`);
  check((await page.evaluate(() => window.__proact.frame.gesture)) === "no_motion", "while arrow keys of the drawer make no gesture");
  const edge = () => page.evaluate(() => window.__proact.signals.drawer.time.edge);
  const [stood, now] = [await edge(), await page.evaluate(() => window.__proact.frame.time)];
  await page.waitForFunction((time) => window.__proact.frame.time > time + 500, now);
  check((await edge()) === stood, "it stands still while the trial goes on");
  await screenshot("signals-back");
  const rows = await page.locator(".signalrow.band .holder").first().boundingBox();
  await page.mouse.move(rows.x + 200, rows.y + 10);
  await page.mouse.down();
  await page.mouse.move(rows.x + 320, rows.y + 10, { steps: 4 });
  await page.mouse.up();
  check((await edge()) < stood, "dragging goes further back");
  await page.locator('.drawerhead button:text-is("Live")').click();
  check((await state.textContent()) === "live" && (await slider.inputValue()) === "0", "Live returns");
  await page.locator('.drawerhead button:text-is("Pause")').click();
  const paused = await edge();
  await slider.focus();
  await page.keyboard.press("Home");
  check(paused - (await edge()) > 5, "Home goes back as far as is kept");
  await page.keyboard.press("End");
  check((await state.textContent()) === "live", "End is live again");
}

/** The rows of what is meant: name, gaze, task, both, per cent. */
const intents = (page) =>
  page.locator(".intentview tbody tr").evaluateAll((rows) =>
    rows.map((row) => [row.children[0].textContent, ...[1, 2, 3].map((k) => Number.parseInt(row.children[k].textContent, 10))]),
  );

/** Between a block that is due and one that is not, task context makes the difference. */
async function checkIntentDisplay(page, { check, screenshot }) {
  const between = await page.evaluate(() => {
    const { frame, content, project } = window.__proact;
    const colour = (id) => JSON.stringify(content.scene.objects[id].colour);
    const other = content.scene.objects.findIndex((_, id) => colour(id) !== colour(frame.next));
    const [a, b] = [project("object", frame.next), project("object", other)];
    return { a, b };
  });
  let found = null;
  // Where both are equally likely by the gaze is searched for: perspective shifts it.
  for (let share = 0.3; share <= 0.7 && !found; share += 0.025) {
    const at = (axis) => between.a[axis] + share * (between.b[axis] - between.a[axis]);
    await page.mouse.move(at("x"), at("y"));
    await page.waitForTimeout(350);
    const rows = await intents(page);
    if (rows.some(([, gaze, , both]) => Math.abs(gaze - both) >= 10)) found = rows;
  }
  check(found !== null, `with task context the bars differ from those without: ${JSON.stringify(found)}`);
  const due = found.filter(([, , task]) => task > 25);
  check(due.length > 0 && due.every(([, gaze, , both]) => both >= gaze - 1), "towards what the task asks for");
  for (const column of [1, 2, 3]) {
    const sum = found.reduce((total, row) => total + row[column], 0);
    check(Math.abs(sum - 100) <= 3, `column ${column} adds up to ${sum} %`);
  }
  await waitFor(page, "each block has bars in the scene", check, async () => (await page.locator(".intentbars .over-block:visible").count()) === found.length);
  await screenshot("intent");
  const acting = page.locator(".intentview .note").first();
  check(/goes by both/.test(await acting.textContent()), "method D goes by both");
  for (const [method, words] of [["C", /goes by the gaze alone/], ["A", /does not ask/]]) {
    await page.evaluate((name) => [...document.querySelectorAll(".methodbutton")].find((node) => node.textContent === name).click(), method);
    await page.waitForFunction((name) => window.__proact.frame?.method === name, method);
    const block = await page.evaluate(() => window.__proact.project("object", 0));
    await page.mouse.move(block.x, block.y);
    await waitFor(page, `method ${method}: ${words.source}`, check, async () => words.test(await acting.textContent()));
  }
  await page.evaluate(() => [...document.querySelectorAll(".methodbutton")].find((node) => node.textContent === "D").click());
  await page.waitForFunction(() => window.__proact.frame?.method === "D");
}

/** Each sound has words. */
async function captions(page, check) {
  const block = await page.evaluate(() => window.__proact.project("object", window.__proact.frame.next));
  await page.mouse.move(block.x, block.y);
  await page.waitForFunction(() => window.__proact.frame.target.object !== null);
  const caption = page.locator(".caption");
  // A stop of the armband, on a machine with much to do, takes a relaxed hand first.
  for (let round = 0; round < 10 && (await caption.isHidden()); round++) {
    await page.keyboard.down("KeyS");
    await caption.waitFor({ timeout: 4000 }).catch(() => {});
    await page.keyboard.up("KeyS");
    if (await caption.isHidden()) await page.waitForTimeout(1500);
  }
  check(/^♪ lock/.test(await caption.textContent()), `a sound is named: ${await caption.textContent()}`);
}

/** In three sizes, light and dark, nothing is covered and nothing is against WCAG. */
async function sizes(page, tools) {
  const look = await checkWithAxe(page, tools);
  for (const scheme of ["light", "dark"]) {
    await page.emulateMedia({ colorScheme: scheme });
    for (const [width, height] of [[1280, 720], [1920, 1080], [800, 600], [390, 844]]) {
      await page.setViewportSize({ width, height });
      await page.waitForTimeout(1000);
      // In a small window the drawer lies over the cards; its rows scroll.
      const all = width < 1000 ? [] : await page.evaluate(layoutFaults, { slack: SLACK_PX });
      const found = all.filter((fault) => !fault.endsWith("runs out of .card.drawer"));
      tools.check(found.length === 0, `drawer open, ${width}x${height}, ${scheme}: ${found.join("; ") || "all in its place"}`);
      const wide = await page.evaluate(() => document.documentElement.scrollWidth - innerWidth);
      tools.check(wide <= 0, "nothing leaves the window");
      await look(`signals ${width} ${scheme}`);
      await tools.screenshotOf(page, `signals-${width}-${scheme}`);
    }
  }
  await page.emulateMedia({ colorScheme: "light" });
  await page.setViewportSize({ width: 1280, height: 720 });
}

/** Who may only watch has the same drawer. */
async function watched(tab, { url, check, screenshotOf }) {
  await tab.goto(new URL("/spectator?quality=3", url).href);
  await tab.waitForFunction(() => window.__proact?.framesDrawn > 1);
  await tab.keyboard.press("KeyG");
  await tab.locator(".signalrow.emg .lanes li").nth(7).waitFor();
  await tab.locator(".signalrow.joints .values li").nth(6).waitFor();
  check(true, "a spectator has the drawer, too");
  await screenshotOf(tab, "signals-spectator");
  await tab.locator('.drawerhead button:text-is("Hide")').click();
  check(await tab.locator(".drawer").isHidden(), "and hides it");
  await tab.close();
}

/** A trial that the experimenter ends stands on the scoreboard, and in its file. */
async function scores(page, tools) {
  const { check, keep, screenshotOf, screenshot } = tools;
  await page.evaluate(() => {
    const socket = new WebSocket(`ws://${location.host}/live?role=experimenter`);
    socket.onopen = () => socket.send(JSON.stringify({ type: "study", action: "abort" }));
  });
  await page.locator(".dialog.result:not([hidden])").waitFor();
  await page.locator('.dialog.result button:text-is("Look at the scene")').click();
  await page.keyboard.press("KeyB");
  const board = page.locator(".scoreboard");
  await board.waitFor();
  const rows = await board.locator("tbody tr").evaluateAll((lines) => lines.map((line) => [...line.children].map((cell) => cell.textContent)));
  const own = rows.find(([method, who]) => method.startsWith("D") && who === "This visit");
  check(rows.length === 8 && own?.[2] === "1", `a row for each method and kind of people, one trial of this visit: ${own}`);
  const simulated = rows.filter(([, who]) => who === "Simulated people");
  check(simulated.every(([, , count, score]) => count === "24" && /^[\d.]+ \([\d.]+ to [\d.]+\)$/.test(score)), "simulated people have means and intervals");
  check((await board.locator("svg").count()) === 4 && (await board.locator("svg line.people").count()) >= 12, "four pictures with intervals");
  const downloading = page.waitForEvent("download");
  await board.locator(".save").click();
  const file = (await keep(await downloading, "scores.csv")).toString("utf8");
  const lines = file.trimEnd().split("\r\n");
  check(lines[0] === "who,method,setup,score,seconds,attempts,path_m", `the file's head: ${lines[0]}`);
  check(lines.length === 2 + SIMULATED, `and a row for each trial: ${lines.length - 1}`);
  check(/^You,D,still,0,[\d.]+,\d+,[\d.]+$/.test(lines[1]), `this visit's: ${lines[1]}`);
  const look = await checkWithAxe(page, tools);
  for (const scheme of ["light", "dark"]) {
    await page.emulateMedia({ colorScheme: scheme });
    for (const [width, height] of [[1280, 720], [390, 844]]) {
      await page.setViewportSize({ width, height });
      await page.waitForTimeout(300);
      const sideways = await board.evaluate((node) => node.scrollWidth - node.clientWidth);
      check(sideways <= 1, `the scoreboard scrolls one way only in ${width} px`);
      await look(`scores ${width} ${scheme}`);
      await screenshotOf(page, `scores-${width}-${scheme}`);
    }
  }
  await page.emulateMedia({ colorScheme: "light" });
  await page.setViewportSize({ width: 1280, height: 720 });
  await page.keyboard.press("Escape");
  await board.waitFor({ state: "hidden" });
  await button(page, "scores").click();
  await board.waitFor();
  await board.locator(".close").click();
  await board.waitFor({ state: "hidden" });
  check(true, "key and mouse open and close it");
  await screenshot("scores-closed");
  await page.keyboard.press("KeyR");
  await page.waitForFunction(() => !window.__proact.frame.finished && window.__proact.frame.time < 5000);
}

/** A method that cannot begin, here since another program has its port, says why on the page; the trial before goes on. */
async function refused(page, { check, screenshot }) {
  const taken = createSocket("udp4");
  await new Promise((resolve) => taken.bind(VMPL_PORT, resolve));
  await page.click('.methodbutton:text-is("vmpl")');
  const card = page.locator(".not-begun");
  await card.waitFor();
  const said = await card.locator("p").textContent();
  check(/^This trial cannot begin: .*25000/.test(said), `a method that is refused says why: ${said}`);
  check((await page.evaluate(() => window.__proact.frame.method)) === "D", "and the method before goes on");
  await screenshot("refused");
  await card.locator("button").click();
  await card.waitFor({ state: "hidden" });
  await new Promise((resolve) => taken.close(resolve));
}

/** Small pictures, what hides the target, turning the view: at the best quality. */
async function views(page, { url, check, screenshot }) {
  await page.goto(new URL("?quality=1&tutorial=0&pictures=5", url).href);
  await page.waitForFunction(() => window.__proact?.connected && window.__proact.framesDrawn > 3);
  const load = () => page.evaluate(() => ({ calls: window.__proact.drawCalls, triangles: window.__proact.triangles, drawn: window.__proact.framesDrawn }));
  const next = async () => {
    const { drawn } = await load();
    await page.waitForFunction((count) => window.__proact.framesDrawn > count + 3, drawn);
  };
  const cheap = ({ calls, triangles }) => calls > 10 && calls <= MAX_DRAW_CALLS && triangles > 1000 && triangles <= MAX_TRIANGLES;
  const alone = await load();
  check(cheap(alone), `a picture takes ${alone.calls} draw calls and ${alone.triangles} triangles`);
  await page.keyboard.press("KeyV");
  await page.locator(".inset").nth(1).waitFor();
  await next();
  const both = await load();
  check(cheap(both), `with the small ones ${both.calls} draw calls and ${both.triangles} triangles`);
  check((await canvasColors(page)).every((count) => count > 20), "hand's and eyes' view show something");
  await screenshot("views");
  await button(page, "views").click();
  await page.locator(".inset").first().waitFor({ state: "hidden" });
  await page.evaluate(() => window.__proact.chooseCamera("eyes"));
  await page.waitForFunction(() => window.__proact.faded > 0);
  check(true, "through the eyes, the part of the arm that hides the next block is seen through");
  await screenshot("faded");
  const where = () => page.evaluate(() => window.__proact.project("object", 0));
  for (const camera of ["eyes", "free"]) {
    await page.evaluate((kind) => window.__proact.chooseCamera(kind), camera);
    await next();
    const before = await where();
    for (let press = 0; press < 2; press++) await page.keyboard.press("Shift+ArrowRight");
    await next();
    const after = await where();
    check(Math.hypot(after.x - before.x, after.y - before.y) > 20, `Shift and an arrow turn the view: ${camera}`);
    check((await page.evaluate(() => window.__proact.frame.gesture)) === "no_motion", "and make no gesture");
  }
}

/** How many different colours there are in each small picture on the screen. */
async function canvasColors(page) {
  const found = [];
  for (const inset of await page.locator(".inset").all()) {
    const shot = await inset.screenshot();
    found.push(await page.evaluate(async (bytes) => {
      const bitmap = await createImageBitmap(new Blob([new Uint8Array(bytes)], { type: "image/png" }));
      const canvas = new OffscreenCanvas(bitmap.width, bitmap.height);
      const context = canvas.getContext("2d");
      context.drawImage(bitmap, 0, 0);
      const { data } = context.getImageData(0, 0, bitmap.width, bitmap.height);
      const seen = new Set();
      for (let k = 0; k < data.length; k += 4) seen.add((data[k] >> 4) * 256 + (data[k + 1] >> 4) * 16 + (data[k + 2] >> 4));
      return seen.size;
    }, [...shot]));
  }
  return found;
}
