// Every page in Debian's own Firefox (firefox-esr), over WebDriver BiDi: it loads without an error, the scene is drawn, the main
// keys act.
//
//   xvfb-run -a node tests/page/firefox.mjs --program target/release/proact --out build/page/firefox
//
// Firefox without a window has no WebGL where there is no graphics card: it needs a screen, a virtual one will do. Exits 0 only if
// everything was seen.

import { execFile } from "node:child_process";
import { existsSync } from "node:fs";
import { mkdir, rm, writeFile } from "node:fs/promises";
import { createRequire } from "node:module";
import { promisify } from "node:util";
import { parseArgs } from "node:util";
import { start, startEmgTest, startServe, startStudy } from "./processes.mjs";

// puppeteer-core is installed with the page, whose package.json pins it.
const require = createRequire(new URL("../../rust/bridge/web/package.json", import.meta.url));
const puppeteer = require("puppeteer-core");

const run = promisify(execFile);
const { values: options } = parseArgs({
  options: { program: { type: "string" }, out: { type: "string", default: "build/page/firefox" } },
});
const WAIT_MS = 60_000;
/** The cheapest drawing: the processor draws here. */
const CHEAP = "?quality=3&tutorial=0&pictures=10";
/** Fewer shades than these, and nothing is drawn but the background. */
const MIN_SHADES = 60;
const PLAN = `
name = "firefox"
participants = 1

[trial]
task = "modified_bbt"
setup = "still"
limit_secs = 4

[[conditions]]
name = "D"
trial = { method = "D" }

[order]
by = "listed"

[[sessions]]
name = "1"
trials = 1
begin = [{ do = "form", form = "nasa_tlx", minutes = 1 }]
`;

const { program, out } = options;
if (!program) throw new Error("firefox.mjs needs --program PATH_OF_PROACT");
const executablePath = [process.env.FIREFOX, "/usr/bin/firefox-esr"].find((path) => path && existsSync(path));
if (!executablePath) throw new Error("no Firefox found; install the package firefox-esr or name it in FIREFOX");
if (!process.env.DISPLAY) throw new Error("Firefox needs a screen to draw on: start this with xvfb-run -a");
// What an earlier run left is no part of this one.
await rm(out, { recursive: true, force: true });
await mkdir(out, { recursive: true });

const problems = [];
const running = [];
const browser = await puppeteer.launch({ browser: "firefox", executablePath, headless: false, acceptInsecureCerts: true });
try {
  console.log(`    ${await browser.version()}, ${browser.protocol ?? "webDriverBiDi"}`);
  await live();
  await spectatorPages();
  await headset();
  await study();
  await calibration();
  await replay();
  check(problems.length === 0, `no error on any page${problems.length ? `: ${problems.join("; ")}` : ""}`);
  console.log("1 passed, 0 failed");
} catch (error) {
  for (const [k, page] of (await browser.pages()).entries()) await page.screenshot({ path: `${out}/failure-${k}.png` }).catch(() => {});
  for (const problem of problems) console.error(problem);
  console.error(`Firefox failed: ${error.message}`);
  console.log("0 passed, 1 failed");
  process.exitCode = 1;
} finally {
  await browser.close();
  for (const server of running) await server.stop();
}

function check(holds, what) {
  if (!holds) throw new Error(`expected: ${what}`);
  console.log(`ok  ${what}`);
}

/** The program with a page, which is stopped at the end at the latest. */
async function withServer(server) {
  const served = await server;
  running.push(served);
  return served;
}

/** A page whose mistakes are kept in mind. */
async function open(url) {
  const page = await browser.newPage();
  await page.setViewport({ width: 1280, height: 720 });
  page.setDefaultTimeout(WAIT_MS);
  page.on("pageerror", (error) => problems.push(`${url}: ${error.message}`));
  page.on("console", (message) => {
    if (message.type() === "error") problems.push(`${url}: ${message.text()}`);
  });
  await page.goto(url);
  return page;
}

/** Closed before its program ends: a page that loses its connection complains. */
async function done(page, name) {
  await page.screenshot({ path: `${out}/${name}.png` });
  await page.close();
}

/** How many shades a part of the page is of, as it is seen. */
async function shadesOf(page, selector) {
  const node = await page.waitForSelector(selector);
  const png = await node.screenshot({ encoding: "base64" });
  return page.evaluate(async (text) => {
    const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
    const picture = await createImageBitmap(new Blob([bytes], { type: "image/png" }));
    const canvas = new OffscreenCanvas(picture.width, picture.height);
    const context = canvas.getContext("2d");
    context.drawImage(picture, 0, 0);
    const { data } = context.getImageData(0, 0, picture.width, picture.height);
    return new Set(new Uint32Array(data.buffer)).size;
  }, png);
}

async function sceneDrawn(page, name, selector = "canvas") {
  await page.waitForFunction(() => window.__proact?.framesDrawn > 3);
  const shades = await shadesOf(page, selector);
  check(shades > MIN_SHADES, `${name}: the scene is drawn, in ${shades} shades`);
}

/** The participant's page: each gesture's key acts while it is held, the mouse is the gaze, a key begins a new trial. */
async function live() {
  const server = await withServer(startServe(program, 0, ["--no-record", "--setup", "still", "--method", "D"]));
  const page = await open(new URL(CHEAP, server.url).href);
  await sceneDrawn(page, "participant");
  await page.mouse.move(640, 360);
  await page.waitForFunction(() => window.__proact.frame.gaze?.valid);
  check(true, "participant: the mouse is the gaze");
  const keys = { KeyW: "wrist_extension", KeyS: "wrist_flexion", KeyA: "hand_close", KeyD: "hand_open" };
  for (const [key, gesture] of Object.entries(keys)) {
    await page.keyboard.down(key);
    await page.waitForFunction((name) => window.__proact.frame.gesture === name, {}, gesture);
    await page.keyboard.up(key);
    await page.waitForFunction(() => window.__proact.frame.gesture === "no_motion");
  }
  check(true, "participant: W, S, A and D are gestures for as long as they are held");
  const before = await page.evaluate(() => window.__proact.frame.time);
  await page.keyboard.press("KeyR");
  await page.waitForFunction((time) => window.__proact.frame.time < time, {}, before);
  check(true, "participant: R begins a new trial");
  await done(page, "participant");
  await server.stop();
}

/** Who watches, and who runs the trial, beside one that is shown. */
async function spectatorPages() {
  const server = await withServer(start(program, ["demo"], 0, ["--no-record", "--method", "D", "--seed", "1"], {}));
  const page = await open(new URL(`experimenter${CHEAP}`, server.url).href);
  await sceneDrawn(page, "experimenter");
  await page.waitForFunction(() => window.__proact.channels === 8);
  const pause = await page.waitForSelector("::-p-xpath(//button[text()='Pause'])");
  await pause.focus();
  await page.keyboard.press("Enter");
  await page.waitForFunction(() => window.__proact.status.paused);
  await page.keyboard.press("Enter");
  await page.waitForFunction(() => !window.__proact.status.paused);
  check(true, "experimenter: a key pauses the trial and lets it go on");
  await done(page, "experimenter");
  const spectator = await open(new URL(`spectator${CHEAP}`, server.url).href);
  await sceneDrawn(spectator, "spectator");
  await done(spectator, "spectator");
  const emg = await open(new URL("emg", server.url).href);
  await emg.waitForFunction(() => !document.querySelector(".keys").hidden);
  const shades = await shadesOf(emg, "canvas");
  check(shades > 10, `EMG: the traces are drawn, in ${shades} shades`);
  await emg.keyboard.press("KeyF");
  await emg.waitForFunction(() => document.body.innerText.includes("frozen"));
  check(true, "EMG: F freezes the picture");
  await done(emg, "emg");
  await server.stop();
}

/** Over HTTPS with a certificate of its own. Firefox on a desk has no headset, and the page offers none. */
async function headset() {
  const server = await withServer(startServe(program, 0, ["--no-record", "--headset"]));
  // The program names the address with its token first.
  const page = await open(/https:\/\/\S+/.exec(server.text())[0]);
  await page.waitForFunction(() => location.protocol === "https:" && !location.search.includes("token"));
  await sceneDrawn(page, "headset");
  const offered = await page.evaluate(() => document.body.innerText.includes("Enter VR"));
  const known = await page.evaluate(async () => (await navigator.xr?.isSessionSupported("immersive-vr")) ?? false);
  check(offered === known, `headset: VR is ${known ? "" : "not "}there, and ${offered ? "" : "not "}offered`);
  await done(page, "headset");
  await server.stop();
}

/** A questionnaire on the participant's page, from its beginning to its first answer. */
async function study() {
  const folder = `${out}/study`;
  await run(program, ["study", "new", folder]);
  await writeFile(`${folder}/plan.toml`, PLAN);
  const server = await withServer(startStudy(program, folder));
  const seat = await open(new URL(CHEAP, server.url).href);
  const desk = await open(new URL(`experimenter${CHEAP}`, server.url).href);
  await desk.bringToFront();
  const begin = await desk.waitForSelector("::-p-xpath(//button[normalize-space()='Begin session'])");
  await desk.waitForFunction((node) => !node.disabled && node.getAttribute("aria-disabled") !== "true", {}, begin);
  await begin.focus();
  await desk.keyboard.press("Enter");
  await desk.waitForFunction((node) => !node.checkVisibility(), {}, begin);
  await seat.bringToFront();
  await seat.waitForSelector(".questionnaire h2");
  await seat.waitForSelector(".questionnaire input");
  await seat.focus(".questionnaire input");
  await seat.keyboard.press("ArrowRight");
  await seat.waitForFunction(() => document.body.innerText.includes("✓ Saved"));
  const title = await seat.$eval(".questionnaire h2", (node) => node.textContent);
  check(title.length > 3, `form: ${title} is asked, and what an arrow key answers is kept`);
  await done(seat, "form");
  await done(desk, "conducting");
  await server.stop();
}

/** The calibration page before and in a calibration, and the page of the tests, with a simulated person at the armband. */
async function calibration() {
  const model = `${out}/model.json`;
  const simulated = ["--source", "synthetic"];
  await run(program, ["emg", "train", ...simulated, "--no-realtime", "--repetition-seconds", "1", "--prepare-seconds", "1", "--out", model]);
  for (const [name, server] of [
    ["calibration", start(program, ["emg", "--json", "train", "--page"], 0, [...simulated, "--out", `${out}/again.json`], {})],
    ["test", startEmgTest(program, ["--model", model, ...simulated, "--tests", "motion", "--motion-repetitions", "1", "--tac-repetitions", "1"])],
  ]) {
    const served = await withServer(server);
    const page = await open(served.url);
    await page.waitForFunction(() => window.__calibration && document.activeElement?.tagName === "BUTTON");
    const first = await page.evaluate(() => document.body.innerText);
    await page.keyboard.press("Enter");
    await page.waitForFunction((text) => window.__calibration.begun && document.body.innerText !== text, {}, first);
    check(true, `${name}: the page is there, and a key begins`);
    await done(page, name);
    await served.stop();
  }
}

/** Two recorded trials: signals are drawn, the cursor is dragged, keys play and step. */
async function replay() {
  const dirs = [1, 2].map((seed) => `${out}/trials/seed${seed}`);
  for (const [k, dir] of dirs.entries()) await run(program, ["demo", "--headless", "--method", "D", "--seed", String(k + 1), "--time-limit", "20", "--out", dir]);
  const server = await withServer(start(program, ["replay", "--page"], 0, dirs, {}));
  const page = await open(new URL("replay?quality=3", server.url).href);
  await page.waitForFunction(() => window.__proact?.views?.length === 2 && window.__proact.views.every((view) => view.timeline && view.stage.frameCount > 3));
  const [scene, emg] = [await shadesOf(page, ".trial .view canvas"), await shadesOf(page, ".lane.emg .uplot")];
  check(scene > MIN_SHADES && emg > MIN_SHADES, `replay: scene and EMG are drawn, in ${scene} and ${emg} shades`);
  await page.evaluate(() => document.activeElement.blur());
  await page.keyboard.press("ArrowRight");
  await page.waitForFunction(() => window.__proact.state.time === 100);
  await page.keyboard.press(" ");
  await page.waitForFunction(() => window.__proact.state.time > 300);
  await page.keyboard.press(" ");
  await page.waitForFunction(() => !window.__proact.state.playing);
  check(true, "replay: arrows step, Space plays and pauses");
  const plot = await page.waitForSelector(".lane.emg .u-over");
  const box = await plot.boundingBox();
  await page.mouse.move(box.x + 20, box.y + 10);
  await page.mouse.down();
  await page.mouse.move(box.x + box.width / 2, box.y + 10, { steps: 4 });
  await page.mouse.up();
  const { time, length } = await page.evaluate(() => window.__proact.state);
  check(Math.abs(time - length / 2) < 300, `replay: the cursor is dragged to the middle, ${(time / 1000).toFixed(2)} s`);
  await done(page, "replay");
  await server.stop();
}
