// Many trials one after the other with one server and one page, driven by mouse and keys: what the server holds (memory,
// handles, threads) must not grow, simulated time must keep up with the clock, and every record must replay.

import { execFile } from "node:child_process";
import { readdir, readFile, rm } from "node:fs/promises";
import { promisify } from "node:util";
import { driveBlocks } from "./drive.mjs";
import { startServe } from "./processes.mjs";

/** Blocks of a trial before the next begins: many trials tell more than long ones. */
const BLOCKS = 1;
const TRIAL_MS = 240_000;
const SAMPLE_MS = 5_000;
/** Trials until caches are filled. */
const WARM_UP = 2;
/** What the server's memory may differ from trial to trial, MB. */
const MAX_MEMORY_GROWTH_MB = 12;
/** Of the samples' paces the median must be above this: the browser draws on the same processors. */
const MIN_REAL_TIME_FACTOR = 0.97;

export async function soak(page, { program, minutes, out, open, check }) {
  const records = `${out}/records`;
  await rm(records, { recursive: true, force: true });
  const serve = await startServe(program, 0, ["--out", records, "--seed", "1"]);
  const pace = recordRealTimeFactor(page);
  const trials = [];
  try {
    // Few pictures: the browser draws on the processors that the trial needs.
    await open(page, serve.url, 6);
    const end = Date.now() + 60_000 * minutes;
    while (Date.now() < end || trials.length < WARM_UP + 2) {
      await driveBlocks(page, { wanted: BLOCKS, limitMs: TRIAL_MS, log: () => {}, screenshot: async () => {} });
      const held = await processResources(serve.pid);
      trials.push(held);
      console.log(`    trial ${trials.length}: ${JSON.stringify(held)}, pace ${pace.median().toFixed(3)}`);
      const time = await page.evaluate(() => window.__proact.frame.time);
      await page.keyboard.press("KeyR");
      await page.waitForFunction((before) => window.__proact.frame && window.__proact.frame.time < before, time);
      await replayAndRemove(program, records, check);
    }
  } finally {
    pace.stop();
    // A page that lost its server would say so.
    await page.goto("about:blank");
    await serve.stop();
  }
  const { median, worst, count } = { median: pace.median(), worst: pace.worst(), count: trials.length };
  const first = trials[WARM_UP];
  const last = trials[count - 1];
  check(last.handles <= first.handles, `${count} trials: ${first.handles} handles, then ${last.handles}`);
  check(last.threads <= first.threads, `${first.threads} threads, then ${last.threads}`);
  check(last.memoryMb <= first.memoryMb + MAX_MEMORY_GROWTH_MB, `${first.memoryMb} MB, then ${last.memoryMb} MB`);
  check(median >= MIN_REAL_TIME_FACTOR, `simulated time keeps up: median ${median.toFixed(3)}, worst five seconds ${worst.toFixed(3)}`);
}

/** Simulated seconds for one of the clock, every few seconds within a trial. */
function recordRealTimeFactor(page) {
  const paces = [];
  let last;
  const timer = setInterval(async () => {
    // A page that is being loaded has no frame, and one that is closed no more.
    const time = await page.evaluate(() => window.__proact?.frame?.time).catch(() => undefined);
    const now = performance.now();
    if (last && time > last.time) paces.push((time - last.time) / (now - last.now));
    last = time === undefined ? undefined : { time, now };
  }, SAMPLE_MS);
  const sorted = () => [...paces].sort((a, b) => a - b);
  return {
    stop: () => clearInterval(timer),
    median: () => sorted()[Math.floor(paces.length / 2)] ?? 0,
    worst: () => sorted()[0] ?? 0,
  };
}

async function processResources(pid) {
  const status = await readFile(`/proc/${pid}/status`, "utf8");
  const number = (name) => Number(new RegExp(`^${name}:\\s+(\\d+)`, "m").exec(status)[1]);
  const handles = (await readdir(`/proc/${pid}/fd`)).length;
  return { memoryMb: Math.round(number("VmRSS") / 1024), handles, threads: number("Threads") };
}

/** Every record but that of the trial that goes on. */
async function replayAndRemove(program, records, check) {
  const names = await readdir(records);
  for (const name of names) {
    const folder = `${records}/${name}`;
    if (!(await readdir(folder)).includes("SHA256SUMS")) continue;
    const { stdout } = await promisify(execFile)(program, ["replay", folder, "--json"]);
    const { agrees, finished, seconds } = JSON.parse(stdout);
    check(agrees && finished, `the record of ${seconds.toFixed(1)} s replays`);
    await rm(folder, { recursive: true });
  }
}
