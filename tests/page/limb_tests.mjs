// The motion test and target achievement control on the calibration page, with a simulated person at the armband: begun by keys,
// watched, and read from the tables at the end. Each screen fits windows of all sizes, follows the system's colours and keeps WCAG
// 2.2 AA.

import { execFileSync } from "node:child_process";
import { checkWithAxe } from "./accessibility.mjs";
import { startEmgTest } from "./processes.mjs";

const SIZES = [[320, 568], [390, 844], [800, 600], [1280, 720], [3840, 2160]];

/** `program` is the testbed's; the model goes to the folder `out`. */
export async function limbTests(page, { program, out, ...tools }) {
  if (!program) throw new Error("--mode limb_tests needs --program PATH_OF_PROACT");
  const { check, screenshot, problems } = tools;
  const model = `${out}/model.json`;
  execFileSync(program, ["emg", "train", "--source", "synthetic", "--no-realtime", "--repetition-seconds", "1", "--prepare-seconds", "1", "--replace", "--out", model], { stdio: "ignore" });
  const words = ["--model", model, "--source", "synthetic", "--tests", "motion,tac1,tac3", "--motion-repetitions", "2", "--tac-repetitions", "2"];
  const running = await startEmgTest(program, words);
  const seen = (what, argument) => page.waitForFunction(what, argument, { timeout: tools.limitMs, polling: 30 });
  try {
    await page.goto(running.url);
    // An outcome is shown for a moment, which the looks below may miss.
    await page.evaluate(() => {
      window.__flashes = [];
      const flash = document.querySelector(".flash");
      new MutationObserver(() => flash.textContent && window.__flashes.push(flash.textContent)).observe(flash, { childList: true });
    });
    for (const next of ["motion", "tac1", "tac3"]) {
      await seen((next) => window.__calibration?.type === "ready" && window.__calibration.next === next, next);
      await seen(() => document.activeElement?.textContent === "Begin");
      if (next === "motion") {
        await screenshot("ready");
        await checkNoOverflow(page, tools, "before a test");
      }
      await page.evaluate(() => (window.__flashes.length = 0));
      await page.keyboard.press("Enter");
      await (next === "motion" ? motion(page, seen, tools) : tac(page, seen, tools, next));
    }
    await seen(() => window.__calibration.type === "end");
    check(true, "each test begins by a key");
    const tables = await page.evaluate(() =>
      [...document.querySelectorAll("table.results")].map((table) => [...table.rows].map((row) => [...row.cells].map((cell) => cell.textContent))),
    );
    const heads = tables.map((rows) => rows.map(([name]) => name));
    check(heads.length === 3, "three tables at the end");
    check(heads[0].join() === "motion,Close the hand,Open the hand,Bend the wrist back,Bend the wrist in,all", `a row each motion: ${heads[0].join()}`);
    check(heads[1].join() === "axis,wrist flexion,grasp,all", `a row each axis: ${heads[1].join()}`);
    check(heads[2].length === 4 && /^1: wrist flexion -?\d+°, grasp \d+ %$/.test(heads[2][1]), `a row each target: ${heads[2][1]}`);
    // The program is gone by then; what it found stays.
    const { motion: reported } = await page.evaluate(() => window.__calibration.result);
    check(tables[0].at(-1)[1] === `${reported.attempts.filter((attempt) => attempt.completion_secs !== null).length} of 8`, `all motions: ${tables[0].at(-1).join(", ")}`);
    await screenshot("results");
    await checkNoOverflow(page, tools, "results");
    // The browser says of each attempt to connect that nobody is there.
    problems.length = 0;
  } finally {
    await running.stop();
  }
}

async function motion(page, seen, tools) {
  const { check, screenshot } = tools;
  await seen(() => window.__calibration.type === "motion" && window.__calibration.right >= 3);
  await screenshot("motion");
  const now = await page.evaluate(() => ({
    dots: document.querySelectorAll(".dots > .on").length,
    all: document.querySelectorAll(".dots > span").length,
    text: document.querySelector(".prompt:not([hidden])").textContent,
  }));
  check(now.all === 10 && now.dots >= 3, `right decisions are counted: ${now.dots} of ${now.all}`);
  check(/Motion 1 of 8/.test(now.text) && /s left/.test(now.text) && /Recognised: .* ✓/.test(now.text), `how far, how long, what is recognised: ${now.text}`);
  await seen(() => window.__flashes.some((text) => /^✓ .*: complete in/.test(text)));
  await screenshot("motion-flash");
  check(true, "a motion that is complete is said");
  await checkNoOverflow(page, tools, "motion test");
}

async function tac(page, seen, tools, name) {
  const { check, screenshot } = tools;
  await seen(() => window.__calibration.type === "tac" && window.__calibration.phase === "moving");
  const axes = name === "tac1" ? 1 : 2;
  const found = await page.evaluate(() => ({
    gauges: document.querySelectorAll(".gauge").length,
    value: document.querySelector("[role=meter]").getAttribute("aria-valuetext"),
    count: document.querySelector(".tac h2").textContent,
  }));
  check(found.gauges === axes && /^-?\d+°, target -?\d+° ± 5$/.test(found.value), `${name}: a gauge an axis: ${found.gauges}, ${found.value}`);
  check(new RegExp(`^Target 1 of ${name === "tac1" ? 4 : 2}`).test(found.count), `${name}: ${found.count}`);
  await screenshot(name);
  if (name === "tac1") {
    await seen(() => window.__calibration.dwelt > 0.3 && document.querySelector(".gauge.inside"));
    const reported = await page.evaluate(() => document.querySelector(".tac .name").textContent);
    check(reported === "In the target: relax and stay", `${name}: ${reported}, and a ring closes`);
    await screenshot("dwelling");
  }
  await checkNoOverflow(page, tools, name);
  const flashed = await seen(() => window.__flashes.find((text) => /^(✓ Reached in|✗ Not reached)/.test(text)));
  await screenshot(`${name}-flash`);
  check(true, `${name}: how a target ended is said: ${await flashed.jsonValue()}`);
}

/** Sizes, colours and rules of the page as it stands. */
async function checkNoOverflow(page, tools, what) {
  const look = await checkWithAxe(page, tools);
  for (const colorScheme of ["dark", "light"]) {
    await page.emulateMedia({ colorScheme });
    await look(`${what}, ${colorScheme}`);
    await tools.screenshot(`${what.replaceAll(" ", "-")}-${colorScheme}`);
  }
  for (const [width, height] of SIZES) {
    await page.setViewportSize({ width, height });
    const over = await page.evaluate(() => document.documentElement.scrollWidth - innerWidth);
    tools.check(over <= 1, `${what}: nothing leaves a window of ${width}x${height}`);
    if (width === 390) await tools.screenshot(`${what.replaceAll(" ", "-")}-phone`);
  }
  await page.setViewportSize({ width: 1280, height: 720 });
}
