// Pictures of every page in three sizes, each from a real run, and docs/gallery.md, which shows them.
//
//   node tests/page/run.mjs --mode gallery --program target/release/proact --out build/gallery [--only replay,report]

import { execFile } from "node:child_process";
import { mkdir, readdir, rm, stat, writeFile } from "node:fs/promises";
import { fileURLToPath } from "node:url";
import { promisify } from "node:util";
import { SCENES } from "./clips.mjs";
import { start, startEmgTest, startServe, startStudy } from "./processes.mjs";

const run = promisify(execFile);
const DOCS = fileURLToPath(new URL("../../docs", import.meta.url));
const PICTURES = `${DOCS}/images/gallery`;
/** Windows, and how many pixels of a picture one of theirs is: small pictures are enough here. */
const SIZES = [
  { name: "laptop", viewport: { width: 1280, height: 720 }, deviceScaleFactor: 0.75 },
  { name: "screen", viewport: { width: 1920, height: 1080 }, deviceScaleFactor: 0.5 },
  { name: "phone", viewport: { width: 390, height: 844 }, deviceScaleFactor: 0.75 },
];
const QUALITY = 72;
/** All pictures together, bytes. */
const MAX_BYTES = 1_800_000;
const DRAWING = "?quality=2&tutorial=0&pictures=4";
const PLAN = `
name = "gallery"
title = "Two ways of reaching"
participants = 2

[trial]
task = "modified_bbt"
setup = "still"
limit_secs = 30

[[conditions]]
name = "D"
trial = { method = "D" }

[order]
by = "listed"

[[sessions]]
name = "1"
trials = 2
begin = [{ do = "form", form = "nasa_tlx", minutes = 2 }]
`;

export async function gallery(page, { program, out, tab, check, only }) {
  if (!program) throw new Error("--mode gallery needs --program PATH_OF_PROACT");
  await page.goto("about:blank");
  if (only.length === 0) await rm(PICTURES, { recursive: true, force: true });
  await mkdir(PICTURES, { recursive: true });
  const work = `${out}/work`;
  await rm(work, { recursive: true, force: true });
  await mkdir(work, { recursive: true });
  const entries = [];
  const servers = [];
  const serving = async (server) => {
    const served = await server;
    servers.push(served);
    return served;
  };
  /** A page in all sizes, as soon as `ready` holds there; `act` brings it to where it is pictured. */
  const take = async (name, title, command, url, ready, act = async () => {}) => {
    entries.push({ name, title, command });
    if (only.length > 0 && !only.includes(name)) return;
    for (const { name: size, ...device } of SIZES) {
      const opened = await tab(device);
      await opened.goto(url);
      await opened.waitForFunction(ready, null, { timeout: 180_000 });
      await act(opened);
      await opened.waitForTimeout(1_500);
      await opened.screenshot({ path: `${PICTURES}/${name}-${size}.jpg`, type: "jpeg", quality: QUALITY });
      await opened.context().close();
    }
    console.log(`    ${name}`);
  };
  const drawn = () => window.__proact?.framesDrawn > 3;
  try {
    for (const [name, title, path, ready] of [
      ["participant", "The participant's page during a trial with method D", "", () => window.__proact?.frame?.time > 4_000],
      ["experimenter", "The experimenter's page beside it", "experimenter", () => window.__proact?.channels === 8],
      ["spectator", "The same to watch only", "spectator", () => window.__proact?.channels === 8],
      ["emg", "The page of EMG", "emg", () => document.querySelector("canvas")?.checkVisibility()],
    ]) {
      // One for each, or the trial is over before the last picture.
      const demo = await serving(start(program, ["demo"], 0, ["--no-record", "--method", "D", "--seed", "1"], {}));
      await take(name, title, `./proact demo${path && `, then /${path}`}`, new URL(`${path}${DRAWING}`, demo.url).href, ready);
      await demo.stop();
    }

    const serve = await serving(startServe(program, 0, ["--no-record", "--method", "A"]));
    await take("driving", "Driving joint by joint, method A", "./proact serve --method A", new URL(DRAWING, serve.url).href, drawn);
    await take("greeting", "The first visit", "./proact serve", new URL("?quality=2&pictures=4", serve.url).href, () => document.querySelector(".welcome, dialog[open]") !== null);
    await take("reference-board", "The board to print for a headset", "/reference-board", new URL("reference-board", serve.url).href, () => document.body.innerText.length > 20);
    await serve.stop();

    await writeSwayingPoses(`${work}/shoulder.csv`);
    const tracked = await serving(startServe(program, 0, ["--no-record", "--mocap", `file:${work}/shoulder.csv/Shoulderpad`]));
    await take("tracking", "The page of motion capture", "./proact serve --mocap SOURCE, then /tracking", new URL("tracking", tracked.url).href, () => document.querySelector(".verdict")?.textContent.startsWith("Good"));
    await tracked.stop();

    await run(program, ["study", "new", `${work}/study`]);
    await writeFile(`${work}/study/plan.toml`, PLAN);
    const study = await serving(startStudy(program, `${work}/study`));
    const desk = new URL(`experimenter${DRAWING}`, study.url).href;
    await take("conducting", "A study: whose turn it is", "./proact study run NAME, then /experimenter", desk, () => [...document.querySelectorAll("button")].some((node) => node.textContent === "Begin session"));
    const conductor = await tab({});
    await conductor.goto(desk);
    await conductor.getByRole("button", { name: "Begin session", exact: true }).click();
    await take("questionnaire", "A study: a questionnaire", "./proact study run NAME", new URL(DRAWING, study.url).href, () => document.querySelector(".questionnaire input") !== null);
    await conductor.context().close();
    await study.stop();

    const simulated = ["--source", "synthetic"];
    const training = await serving(start(program, ["emg", "--json", "train", "--page"], 0, [...simulated, "--out", `${work}/other.json`], {}));
    const asked = () => window.__calibration?.begun;
    const begin = async (opened) => {
      if (!(await opened.evaluate(asked))) await opened.keyboard.press("Enter");
      await opened.waitForFunction(asked);
    };
    const focused = () => window.__calibration && (window.__calibration.begun || document.activeElement?.tagName === "BUTTON");
    await take("calibration", "The calibration page", "./proact emg train --page", training.url, focused, begin);
    await training.stop();
    await run(program, ["emg", "train", ...simulated, "--no-realtime", "--repetition-seconds", "1", "--prepare-seconds", "1", "--out", `${work}/model.json`]);
    const testing = await serving(startEmgTest(program, ["--model", `${work}/model.json`, ...simulated, "--tests", "cursor"]));
    await take("test", "A test of an EMG model: the cursor", "./proact emg test --page", testing.url, focused, begin);
    await testing.stop();

    const trials = [];
    for (const [seed, method] of [[1, "D"], [2, "D"], [1, "A"]]) {
      const dir = `${work}/trials/${method}-seed${seed}`;
      await run(program, ["demo", "--headless", "--method", method, "--seed", String(seed), "--out", dir]);
      trials.push(dir);
    }
    const replay = await serving(start(program, ["replay", "--page"], 0, trials.slice(0, 2), {}));
    const loaded = () => window.__proact?.views?.length > 0 && window.__proact.views.every((view) => view.timeline && view.stage.frameCount > 3);
    await take("replay", "The replay of a trial with its signals", "./proact replay DIR --page", new URL("replay?quality=2&trial=0&t=20.5", replay.url).href, loaded);
    const aligned = "replay?quality=2&trial=0&trial=1&t=0&align=object_attached,1&window=-8,12&fold=decoder&hide=gesture";
    await take("replay-two", "Two trials aligned by their first contact", "./proact replay DIR DIR --page", new URL(aligned, replay.url).href, loaded);
    await replay.stop();
    const report = await serving(start(program, ["analyze", `${work}/trials`, "--page"], 0, [], {}));
    await take("report", "The report on trials", "./proact analyze DIR --page", new URL("report", report.url).href, () => document.querySelector("figure svg") !== null);
    await report.stop();
  } finally {
    for (const server of servers) await server.stop();
  }
  const files = await readdir(PICTURES);
  const sizes = await Promise.all(files.map(async (file) => (await stat(`${PICTURES}/${file}`)).size));
  const bytes = sizes.reduce((sum, size) => sum + size, 0);
  check(files.length === entries.length * SIZES.length && Math.min(...sizes) > 2_000, `${files.length} pictures of ${entries.length} pages`);
  check(bytes < MAX_BYTES, `${Math.round(bytes / 1000)} kB in all`);
  await writeFile(`${DOCS}/gallery.md`, galleryPage(entries));
}

/** A shoulder that sways, five minutes at 100 Hz. */
async function writeSwayingPoses(path) {
  const rows = ["body,id,stamp_ns,x,y,z,qx,qy,qz,qw,tracked"];
  for (let k = 0; k < 30_000; k++) {
    rows.push(`Shoulderpad,1,${k}0000000,${(2 + 0.03 * Math.sin(k / 80)).toFixed(5)},1.0,${(1.4 + 0.01 * Math.sin(k / 30)).toFixed(5)},0,0,0,1,1`);
  }
  await writeFile(path, `${rows.join("\n")}\n`);
}

function galleryPage(entries) {
  const sizes = SIZES.map(({ viewport: { width, height } }) => `${width} x ${height}`);
  const picture = (name, title, size) => `![${title}, ${size}](images/gallery/${name}-${size}.jpg)`;
  const parts = entries.map(({ name, title, command }) => {
    const row = SIZES.map(({ name: size }) => picture(name, title, size)).join(" | ");
    return `## ${title}\n\n\`${command}\`\n\n| ${sizes.join(" | ")} |\n|---|---|---|\n| ${row} |\n`;
  });
  return [
    "# Gallery",
    "",
    "For whoever wants to see the pages before building anything: each in three sizes of window, taken in Chromium from real runs.",
    "The pictures and this page are made by:",
    "",
    "```",
    "node tests/page/run.mjs --mode gallery --program target/release/proact --out build/gallery",
    "```",
    "",
    "## Moving pictures",
    "",
    "From recorded trials, faster than they were; made by `--mode clips` in the place of `--mode gallery`.",
    "",
    ...SCENES.flatMap(({ name, title, speed }) => [`![${title}](images/clips/${name}.webp)`, "", `${title}; ${speed} times as fast.`, ""]),
    parts.join("\n"),
  ].join("\n");
}
