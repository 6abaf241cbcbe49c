// Loads the page in a headless Chromium during a trial and looks at it as a person would.
//
//   node tests/page/run.mjs --url http://127.0.0.1:8090/ --out build/page [--mode watch|interactive]
//   node tests/page/run.mjs --mode restart --program target/release/proact --out build/page
//   node tests/page/run.mjs --mode soak --program target/release/proact --minutes 20 --out build/soak
//
// watch: the page connects, the scene changes, every camera draws; with --score the score counts up (a trial
// with a simulated participant has to run). interactive: moves blocks by mouse and keys with method D until one
// is on target. methods: one block with each of --methods. newcomer: tutorial, settings, gamepad, gaze check.
// headset: enters VR and AR with an emulated device. controller_tracking: a controller on the brace, beside serve --mocap headset:right_controller. safety: page and gamepad fall silent or die while the arm moves,
// beside serve. layout: twelve sizes of window, touch, dark. accessibility: WCAG 2.2 AA by axe-core, keyboard alone,
// mouse alone, one switch. hint_bar: method B by what the hint bar says. control_lease: two pages, one driver. result_card: result card
// and what follows, beside a short demo. experimenter: beside a demo. conduct: a study on the experimenter's page, beside
// serve. study_forms: the same on the participant's page. study: starts `study run` itself, with both pages; --hands
// keys,mouse,finger: by each of these instead of by keys alone. replay: beside a replay of two trials. bag: beside a replay of a
// bag. emg: the view of EMG, beside serve --emg-source synthetic. signals: drawer of signals,
// intent, scores and views, beside the same. limb_tests: starts `emg test` itself, with the motion test and
// target achievement control. ghost: starts `serve --method-command proact:vmpl` itself, and is its decoder. report: beside a report on trials. gallery: starts what it needs itself, takes pictures of every page and writes docs/gallery.md. clips: the same with moving pictures of trials. access: starts `serve --bind` itself; who gets in. restart: starts `serve` itself, kills it, starts it again, and the
// open page has to come back.
// soak: starts `serve` itself, and drives trial after trial.
// Screenshots go to the output folder. Exits 0 only if everything was seen.

import { mkdir, readFile, writeFile } from "node:fs/promises";
import { existsSync } from "node:fs";
import { createRequire } from "node:module";
import { parseArgs } from "node:util";
import { access } from "./access.mjs";
import { accessibility } from "./accessibility.mjs";
import { resultCard } from "./result_card.mjs";
import { conduct } from "./conduct.mjs";
import { driveBlocks } from "./drive.mjs";
import { bag, experimenter } from "./experimenter_pages.mjs";
import { emg } from "./emg.mjs";
import { controllerTracking } from "./controller_tracking.mjs";
import { clips } from "./clips.mjs";
import { gallery } from "./gallery.mjs";
import { ghost } from "./ghost.mjs";
import { jogBlock } from "./jog.mjs";
import { layout } from "./layout.mjs";
import { limbTests } from "./limb_tests.mjs";
import { downloadSize } from "./download_size.mjs";
import { headset, newcomer } from "./participant_page.mjs";
import { startServe } from "./processes.mjs";
import { replay } from "./replay.mjs";
import { report } from "./report.mjs";
import { safety } from "./safety.mjs";
import { signals } from "./signals.mjs";
import { soak } from "./soak.mjs";
import { driveByHints } from "./hint_bar.mjs";
import { study } from "./study.mjs";
import { studyForms } from "./study_forms.mjs";
import { tracking } from "./tracking.mjs";
import { controlLease } from "./control_lease.mjs";

// playwright-core is installed with the page, whose package.json pins it.
const require = createRequire(new URL("../../rust/bridge/web/package.json", import.meta.url));
const { chromium } = require("playwright-core");

const { values: options } = parseArgs({
  options: {
    url: { type: "string", default: process.env.PROACT_URL ?? "http://127.0.0.1:8090/" },
    out: { type: "string", default: process.env.PROACT_PAGE_OUT ?? "build/page" },
    mode: { type: "string", default: "watch" },
    score: { type: "boolean", default: false },
    blocks: { type: "string", default: "1" },
    methods: { type: "string", default: "ABCD" },
    timeout: { type: "string", default: "240" },
    dist: { type: "string" },
    program: { type: "string" },
    minutes: { type: "string", default: "20" },
    hands: { type: "string", default: "keys" },
    pictures: { type: "string" },
    only: { type: "string", default: "" },
  },
});

const FLAGS = [
  "--headless=new",
  "--no-sandbox",
  // Without --disable-gpu: with it the page's thread waits for every picture, up to half a second, and a key that is
  // held is let go of, because the signs of life come too late.
  "--use-gl=angle",
  "--use-angle=swiftshader",
  "--enable-unsafe-swiftshader",
  "--disable-background-networking",
  "--disable-component-update",
  "--disable-sync",
  "--no-first-run",
  "--disable-quic",
  // For --mode access: another site's name that leads to this machine.
  "--host-resolver-rules=MAP evil.example 127.0.0.1",
  // A page whose files are replaced (--dist) would not count as local.
  "--disable-features=LocalNetworkAccessChecks",
];

/** Debian's wrapper script prints a warning on some kernels; the program behind it is the same. */
function findChromium() {
  const candidates = [process.env.CHROMIUM, "/usr/lib/chromium/chromium", "/usr/bin/chromium", "/usr/bin/chromium-browser"];
  const found = candidates.find((path) => path && existsSync(path));
  if (!found) throw new Error("no Chromium found; install the package chromium or name it in CHROMIUM");
  return found;
}

function check(condition, what) {
  if (!condition) throw new Error(`expected: ${what}`);
  console.log(`ok  ${what}`);
}

const limitMs = 1000 * Number(options.timeout);
await mkdir(options.out, { recursive: true });
const browser = await chromium.launch({ executablePath: findChromium(), args: FLAGS, headless: true });
const problems = [];
let page;
try {
  const context = await browser.newContext({ viewport: { width: 1280, height: 720 }, ignoreHTTPSErrors: true });
  page = await pageOf(context);
  const modes = { watch, interactive: interact, methods, restart, access, newcomer, headset, safety, experimenter, replay, bag, report, result_card: resultCard, control_lease: controlLease, download_size: downloadSize, layout, conduct, study_forms: studyForms, study, accessibility, hint_bar: hintBar, tracking, emg, signals, limb_tests: limbTests, gallery, clips, ghost, controller_tracking: controllerTracking, soak: (page, tools) => soak(page, { ...tools, ...soakOptions() }) };
  const mode = modes[options.mode];
  if (!mode) throw new Error(`mode ${options.mode} is unknown; expected ${Object.keys(modes).join(", ")}`);
  await mode(page, {
    url: options.url,
    limitMs,
    check,
    screenshot: (name) => screenshot(page, name),
    screenshotOf: screenshot,
    hands: options.hands.split(","),
    pictures: options.pictures,
    only: options.only.split(",").filter(Boolean),
    program: options.program,
    out: options.out,
    problems,
    emulator: require.resolve("iwer/build/iwer.min.js"),
    axe: require.resolve("axe-core/axe.min.js"),
    /** A page of another person, with a window or a device of its own. */
    tab: async (device) => pageOf(await browser.newContext({ ignoreHTTPSErrors: true, ...device })),
    /** Keeps a downloaded file in the output folder; its bytes. */
    async keep(file, name) {
      await file.saveAs(`${options.out}/${name}`);
      return readFile(`${options.out}/${name}`);
    },
  });
  check(problems.length === 0, `no error on the page${problems.length ? `: ${problems.join("; ")}` : ""}`);
  console.log("1 passed, 0 failed");
} catch (error) {
  if (page) await screenshot(page, "failure").catch(() => {});
  for (const problem of problems) console.error(problem);
  console.error(`page test failed: ${error.message}`);
  console.log("0 passed, 1 failed");
  process.exitCode = 1;
} finally {
  await browser.close();
}

/** A page whose mistakes are kept in mind. */
async function pageOf(context) {
  const opened = await context.newPage();
  opened.on("pageerror", (error) => problems.push(`page error: ${error.message}`));
  opened.on("console", (message) => {
    if (message.type() === "error") problems.push(`console: ${message.text()}`);
  });
  opened.on("requestfailed", (request) => problems.push(`request failed: ${request.url()}`));
  if (options.dist) await serveFrom(opened, options.dist);
  opened.setDefaultTimeout(60_000);
  return opened;
}

async function open(page, url, pictures = 60) {
  // The cheapest drawing: the processor draws here, and the trial needs it too.
  await page.goto(new URL(`?quality=3&tutorial=0&pictures=${pictures}`, url).href);
  await ready(page);
}

async function ready(page) {
  await page.waitForFunction(() => window.__proact?.connected && window.__proact.framesDrawn > 3);
  check(true, "the page connects and draws");
}

async function watch(page) {
  await open(page, options.url);
  const first = await page.evaluate(() => ({ ...window.__proact, frame: window.__proact.frame }));
  await screenshot(page, "shoulder");
  await page.waitForFunction(
    ({ drawn, joints }) => {
      const { frame, framesDrawn } = window.__proact;
      return framesDrawn > drawn + 5 && frame.joints.some((angle, k) => Math.abs(angle - joints[k]) > 0.02);
    },
    { drawn: first.framesDrawn, joints: first.frame.joints },
    { timeout: limitMs },
  );
  check(true, "the arm moves");
  const pictures = [await picture(page)];
  await page.waitForFunction((drawn) => window.__proact.framesDrawn > drawn, await drawnCount(page) + 10);
  pictures.push(await picture(page));
  check(!pictures[0].equals(pictures[1]), "the picture changes");
  for (const camera of ["eyes", "free", "shoulder"]) {
    await page.evaluate((kind) => window.__proact.chooseCamera(kind), camera);
    await page.waitForFunction((drawn) => window.__proact.framesDrawn > drawn, (await drawnCount(page)) + 3);
    await screenshot(page, `camera-${camera}`);
  }
  await page.reload();
  await ready(page);
  check(true, "the page survives a reload");
  if (options.score) {
    await page.waitForFunction(() => window.__proact.frame.score >= 1, null, { timeout: limitMs });
    const text = await page.textContent(".count");
    check(/^[1-4] \/ 4$/.test(text ?? ""), `the score counts: ${text}`);
    await screenshot(page, "score");
  }
}

async function interact(page) {
  await open(page, options.url);
  check(await page.evaluate(() => window.__proact.content.interactive), "the page is interactive");
  await screenshot(page, "start");
  await driveBlocks(page, {
    wanted: Number(options.blocks),
    limitMs,
    log: (text) => console.log(`    ${text}`),
    screenshot: (name) => screenshot(page, name),
  });
  const onTarget = await page.evaluate(() => window.__proact.frame.score);
  check(onTarget >= Number(options.blocks), `${onTarget} blocks on target by mouse and keys`);
  await screenshot(page, "on-target");
}

/** One block with each method, chosen on the page. */
async function methods(page) {
  await open(page, options.url, 6);
  for (const method of options.methods) {
    await page.click(`.methodbutton:text-is("${method}")`);
    await page.waitForFunction((name) => window.__proact.frame.method === name && window.__proact.frame.time < 3_000, method);
    const log = (text) => console.log(`    ${method} ${text}`);
    if (method === "A" || method === "B") {
      const jogging = jogBlock(page, { limitMs, log });
      await page.waitForTimeout(4_000);
      await screenshot(page, `method-${method}`);
      await jogging;
    } else {
      await driveBlocks(page, { wanted: 1, limitMs, log, screenshot: (name) => screenshot(page, `method-${method}-${name}`) });
    }
    const { seconds, count } = await page.evaluate(() => ({
      seconds: window.__proact.frame.time / 1000,
      count: window.__proact.frame.score,
    }));
    check(count === 1, `method ${method} moves a block to its target in ${seconds.toFixed(0)} s by keys${"CD".includes(method) ? " and mouse" : ""}`);
  }
}

/** What a newcomer needs with method B, who does what the strip says. */
async function hintBar(page) {
  await open(page, options.url, 20);
  await page.click('.methodbutton:text-is("B")');
  await page.waitForFunction(() => window.__proact.frame.method === "B" && window.__proact.frame.time < 3_000);
  await driveByHints(page, { limitMs, log: (text) => console.log(`    ${text}`) });
  const seconds = await page.evaluate(() => window.__proact.frame.time / 1000);
  await screenshot(page, "strip-B");
  check(seconds <= 120, `by what the strip says a block reaches its target with method B in ${seconds.toFixed(0)} s`);
}

function soakOptions() {
  if (!options.program) throw new Error("--mode soak needs --program PATH_OF_PROACT");
  return { program: options.program, minutes: Number(options.minutes), out: options.out, open };
}

async function restart(page) {
  if (!options.program) throw new Error("--mode restart needs --program PATH_OF_PROACT");
  let serve = await startServe(options.program, 0);
  try {
    await open(page, serve.url);
    await serve.stop();
    await page.locator(".banner:not([hidden])").waitFor();
    check(!(await page.evaluate(() => window.__proact.connected)), "the page says that the program is gone");
    await screenshot(page, "offline");
    // The browser reports every attempt to connect while nobody is there; that is not the page's fault.
    problems.length = 0;
    serve = await startServe(options.program, serve.port);
    const before = await drawnCount(page);
    await page.waitForFunction((drawn) => window.__proact.connected && window.__proact.framesDrawn > drawn + 3, before);
    problems.length = 0;
    check(await page.locator(".banner").isHidden(), "the page comes back when the program does");
    await screenshot(page, "back");
  } finally {
    await serve.stop();
  }
}

function drawnCount(page) {
  return page.evaluate(() => window.__proact.framesDrawn);
}

function picture(page) {
  return page.locator("#scene").screenshot();
}

async function screenshot(page, name) {
  const path = `${options.out}/${name}.png`;
  await writeFile(path, await page.screenshot());
  console.log(`    ${path}`);
}

/** For work on the page: its files come from this folder instead of from the program. */
async function serveFrom(page, folder) {
  await page.context().route("**/*", (route) => {
    const name = new URL(route.request().url()).pathname.slice(1).replace("spectator", "experimenter") || "index.html";
    const path = [name, `${name}.html`].map((file) => `${folder}/${file}`).find((file) => existsSync(file) && !file.endsWith("/"));
    return path ? route.fulfill({ path }) : route.continue();
  });
}
