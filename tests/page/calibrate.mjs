// The calibration page in a headless Chromium, with a simulated person at the armband: begin, two rounds, one gesture
// again, stop; then the cursor test; then a regressor, with the R2 of each degree of freedom, and a classifier that knows the position of
// the arm. At rest, when judged and in the cursor test it fits windows of all sizes, follows the
// system's colours and keeps WCAG 2.2 AA.
//
//   node tests/page/calibrate.mjs --program target/release/proact --out build/page/calibrate
//
// Exits 0 only if everything was seen and the model was written.

import { spawn } from "node:child_process";
import { existsSync } from "node:fs";
import { mkdir, rm } from "node:fs/promises";
import { createRequire } from "node:module";
import { parseArgs } from "node:util";
import { checkWithAxe } from "./accessibility.mjs";

// playwright-core is installed with the page, whose package.json pins it.
const require = createRequire(new URL("../../rust/bridge/web/package.json", import.meta.url));
const { chromium } = require("playwright-core");

const { values: options } = parseArgs({
  options: { program: { type: "string" }, out: { type: "string", default: "build/page/calibrate" } },
});
const WAIT_MS = 60_000;
const SIZES = [[320, 568], [390, 844], [800, 600], [1280, 720], [3840, 2160]];
const model = `${options.out}/model.json`;
// What an earlier run left is no part of this one.
await rm(options.out, { recursive: true, force: true });
await mkdir(options.out, { recursive: true });

/** Starts a command with a page; its address, and how it ends. */
async function start(...words) {
  const child = spawn(options.program, ["emg", "--json", ...words, "--page", "--no-browser", "--port", "18190"], {
    stdio: ["ignore", "pipe", "pipe"],
  });
  let [out, errors] = ["", ""];
  child.stdout.on("data", (data) => (out += data));
  const ended = new Promise((resolve) => child.once("exit", (code) => resolve({ code, out, errors })));
  const url = await new Promise((resolve, reject) => {
    child.stderr.on("data", (data) => {
      errors += data;
      const found = /page: (http:\/\/[0-9.:]+\/)/.exec(errors);
      if (found) resolve(found[1]);
    });
    child.once("exit", (code) => reject(new Error(`${words.join(" ")} ended with ${code}: ${errors}`)));
  });
  return { url, ended, stop: () => child.kill("SIGKILL") };
}

function check(holds, what) {
  if (!holds) throw new Error(what);
  console.log(`ok  ${what}`);
}

/** Sizes, colours and rules of the page as it stands. */
async function checkNoOverflow(page, what) {
  const look = await checkWithAxe(page, {
    axe: require.resolve("axe-core/axe.min.js"),
    check,
    screenshot: (name) => page.screenshot({ path: `${options.out}/${name}.png` }),
  });
  const grounds = [];
  for (const colorScheme of ["dark", "light"]) {
    await page.emulateMedia({ colorScheme });
    grounds.push(await page.evaluate(() => getComputedStyle(document.body).backgroundColor));
    await look(`${what}, ${colorScheme}`);
  }
  check(grounds[0] !== grounds[1], `${what}: colours follow the system (${grounds.join(" and ")})`);
  for (const [width, height] of SIZES) {
    await page.setViewportSize({ width, height });
    const over = await page.evaluate(() => document.documentElement.scrollWidth - innerWidth);
    check(over <= 1, `${what}: nothing leaves a window of ${width}x${height}`);
  }
  await page.setViewportSize({ width: 1280, height: 720 });
}

/** Cells of the table of degrees of freedom. */
const driveRows = (page) => page.locator("table.drives tr").evaluateAll((rows) => rows.slice(1).map((row) => [...row.children].map((cell) => cell.textContent)));

const executablePath = ["/usr/bin/chromium", "/usr/bin/chromium-browser"].find((path) => existsSync(path));
const browser = await chromium.launch({ executablePath, args: ["--headless=new", "--no-sandbox", "--disable-gpu"] });
const errors = [];
let running = null;
try {
  const page = await browser.newPage();
  page.on("pageerror", (error) => errors.push(String(error)));
  const seen = (check, argument) => page.waitForFunction(check, argument, { timeout: WAIT_MS });
  const button = (name) => page.getByRole("button", { name, exact: true });

  running = await start("train", "--source", "synthetic", "--repetition-seconds", "0.6", "--prepare-seconds", "0.6", "--out", model);
  await page.goto(running.url);
  await button("Begin").waitFor({ timeout: WAIT_MS });
  // Eight electrodes and the stream, none red.
  await seen(() => document.querySelectorAll(".light").length === 9);
  if ((await page.locator(".light.red").count()) !== 0) throw new Error("a light is red without reason");
  await page.screenshot({ path: `${options.out}/begin.png` });
  await checkNoOverflow(page, "begin");
  await button("Begin").click();
  for (const name of ["Relax", "Close the hand", "Open the hand", "Bend the wrist in", "Bend the wrist back"]) {
    await page.locator(".name", { hasText: name }).waitFor({ timeout: WAIT_MS });
    await page.locator(`svg[aria-label="${name}"]`).waitFor({ timeout: WAIT_MS });
  }
  await page.locator(".bar.recording").waitFor({ timeout: WAIT_MS });
  await page.screenshot({ path: `${options.out}/recording.png` });
  await seen(() => window.__calibration.reviewing && window.__calibration.rounds === 1);
  await button("Another round").click();
  await page.locator("h2.accuracy").waitFor({ timeout: WAIT_MS });
  const heading = await page.locator("h2.accuracy").innerText();
  if (!/^Round 2: [0-9.]+ % recognised/.test(heading)) throw new Error(`the heading is ${heading}`);
  if ((await page.locator("table tr").count()) !== 6) throw new Error("the confusion has not five rows");
  await page.screenshot({ path: `${options.out}/judged.png` });
  await checkNoOverflow(page, "judged");
  // A reload loses nothing.
  await page.reload();
  await page.locator("h2.accuracy").waitFor({ timeout: WAIT_MS });
  await button("Again: Open the hand").click();
  await seen(() => window.__calibration.phase.prompt?.gesture === "hand_open");
  await seen(() => window.__calibration.reviewing);
  await button("Stop and save the model").click();
  const trained = await running.ended;
  if (trained.code !== 0 || !existsSync(model)) throw new Error(`train ended with ${trained.code}: ${trained.errors}`);
  // The figures stay when the program has ended, and are those beside the model.
  for (const title of ["Confusion", "Feature space"]) {
    const figure = page.locator("figure", { has: page.locator("h3", { hasText: title }) });
    await figure.locator("svg svg").waitFor({ timeout: WAIT_MS });
    const { width, height } = await figure.locator("> svg").boundingBox();
    if (width < 200 || height < 150) throw new Error(`${title} is ${width} by ${height} pixels`);
    if (!/windows/.test(await figure.locator("figcaption").innerText())) throw new Error(`${title} has no caption`);
  }
  await page.screenshot({ path: `${options.out}/figures.png`, fullPage: true });
  await checkNoOverflow(page, "figures");
  const report = JSON.parse(trained.out);
  for (const path of Object.values(report.plots)) if (!existsSync(path)) throw new Error(`${path} is missing`);
  console.log(`trained: ${(100 * report.accuracy).toFixed(1)} % after ${report.rounds} rounds`);

  running = await start("test", "--model", model, "--source", "synthetic", "--tests", "cursor", "--cursor-targets", "3");
  await page.goto(running.url);
  await button("Begin").click({ timeout: WAIT_MS });
  await seen(() => window.__calibration.type === "cursor" && window.__calibration.report.movements.length >= 1);
  const drawn = await page.evaluate(() => {
    const canvas = document.querySelector("canvas");
    const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
    return data.some((value) => value !== 0);
  });
  if (!drawn) throw new Error("the cursor test draws nothing");
  await page.screenshot({ path: `${options.out}/cursor.png` });
  const tested = await running.ended;
  if (tested.code !== 0) throw new Error(`test ended with ${tested.code}: ${tested.errors}`);
  const { cursor } = JSON.parse(tested.out);
  console.log(`cursor: ${cursor.throughput_bits_per_s.toFixed(2)} bit/s, ${(100 * cursor.completion_rate).toFixed(0)} %`);
  if (cursor.movements.length !== 9) throw new Error(`${cursor.movements.length} movements, expected 9`);

  // A regressor: what is told of each degree of freedom, after each round and beside the figures at the end.
  const quick = (name) => ["--source", "synthetic", "--repetition-seconds", "0.6", "--prepare-seconds", "0.4", "--out", `${options.out}/${name}.json`];
  running = await start("train", ...quick("driven"), "--classifier", "ridge", "--target-r2", "0.99");
  await page.goto(running.url);
  await button("Begin").click({ timeout: WAIT_MS });
  await seen(() => window.__calibration.reviewing && window.__calibration.rounds === 1);
  if ((await page.locator("table.drives").count()) !== 0) throw new Error("R2 before there is anything to judge");
  await button("Another round").click();
  await page.locator("table.drives").waitFor({ timeout: WAIT_MS });
  const shown = await driveRows(page);
  const drives = await page.evaluate(() => window.__calibration.report.drives);
  check(shown.length === 2 && drives.length === 2, "two degrees of freedom have a row each");
  for (const [k, { drive, r2, mean_absolute_error: off }] of drives.entries()) {
    check(shown[k].join(" ") === `${drive} ${r2.toFixed(3)} ${off.toFixed(3)}`, `the row says ${shown[k].join(", ")}`);
    check(r2 > 0.3 && r2 < 1, `R2 of a simulated person is ${r2.toFixed(3)}`);
  }
  check((await page.locator("h2.accuracy").innerText()).includes("the aim is an R² of 0.99"), "and the aim is said");
  await page.screenshot({ path: `${options.out}/drives.png`, fullPage: true });
  await checkNoOverflow(page, "drives");
  await button("Stop and save the model").click();
  const driven = await running.ended;
  check(driven.code !== 0 && /expected 0\.99/.test(driven.errors), "what is not reached is an error of the command");
  await page.locator("table.drives").waitFor({ timeout: WAIT_MS });
  check(JSON.stringify(await driveRows(page)) === JSON.stringify(shown), "the rows stay at the end");

  // Rounds in several positions of the arm, and what the inertial measurement unit is worth.
  running = await start("train", ...quick("positioned"), "--imu", "acceleration", "--positions", "hanging,overhead", "--target-accuracy", "0.5");
  await page.goto(running.url);
  await button("Begin").click({ timeout: WAIT_MS });
  for (let round = 1; round <= 4; round++) {
    const arm = round % 2 === 1 ? "hanging" : "overhead";
    await page.locator(".count", { hasText: `arm: ${arm}` }).waitFor({ timeout: WAIT_MS });
    if (round === 1) await page.screenshot({ path: `${options.out}/position.png` });
    await seen((count) => window.__calibration.reviewing && window.__calibration.rounds === count, round);
    if (round < 4) await button("Another round").click();
  }
  check(/^[0-9.]+ % without the inertial measurement unit$/.test(await page.locator(".withoutimu").innerText()), "what it is worth is said");
  await button("Stop and save the model").click();
  const positioned = await running.ended;
  if (positioned.code !== 0) throw new Error(`train ended with ${positioned.code}: ${positioned.errors}`);
  const { accuracy, accuracy_without_imu: without } = JSON.parse(positioned.out);
  console.log(`positions: ${(100 * accuracy).toFixed(1)} % with the inertial measurement unit, ${(100 * without).toFixed(1)} % without`);
  if (errors.length > 0) throw new Error(`errors on the page: ${errors.join("; ")}`);
} catch (error) {
  const page = browser.contexts()[0]?.pages()[0];
  await page?.screenshot({ path: `${options.out}/failure.png` }).catch(() => {});
  console.error(`FAILED: ${error.message}`);
  process.exitCode = 1;
} finally {
  running?.stop();
  await browser.close();
}
