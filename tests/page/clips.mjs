// Short clips of real runs, as animated WebP, and the moving picture of the README. Each trial is recorded, then replayed on the page, which
// stands still at every picture: slow drawing costs time and no smoothness. Needs img2webp, of Debian's package webp.
//
//   node tests/page/run.mjs --mode clips --program target/release/proact --out build/clips [--only D,A]

import { execFile } from "node:child_process";
import { mkdir, rm, stat } from "node:fs/promises";
import { fileURLToPath } from "node:url";
import { promisify } from "node:util";
import { start } from "./processes.mjs";

const run = promisify(execFile);
const CLIPS = fileURLToPath(new URL("../../docs/images/clips", import.meta.url));
/** What is shown: a trial, from when to when, s, and how fast. */
export const SCENES = [
  { name: "D", title: "Method D: looked at, locked, planned around the obstacles, gripped, carried, released", words: ["--method", "D"], from: 0.5, to: 18.5, speed: 2 },
  { name: "A", title: "Method A, joint by joint", words: ["--method", "A"], from: 4, to: 34, speed: 5 },
  { name: "cup", title: "Another task: cups over a partition", words: ["--method", "D", "--task", "cup_transfer"], from: 0.5, to: 20.5, speed: 2.5 },
];
const VIEW = { width: 640, height: 400 };
const FRAME_RATE_HZ = 12.5;
const QUALITY = 62;
/** All clips together, bytes. */
const MAX_BYTES = 3_000_000;

export async function clips(page, { program, out, tab, check, only }) {
  if (!program) throw new Error("--mode clips needs --program PATH_OF_PROACT");
  await page.goto("about:blank");
  await mkdir(CLIPS, { recursive: true });
  let bytes = 0;
  for (const { name, title, words, from, to, speed } of SCENES) {
    const file = `${CLIPS}/${name}.webp`;
    if (only.length === 0 || only.includes(name)) {
      const [trial, pictures] = [`${out}/${name}/trial`, `${out}/${name}/pictures`];
      await rm(`${out}/${name}`, { recursive: true, force: true });
      await mkdir(pictures, { recursive: true });
      await run(program, ["demo", "--headless", ...words, "--seed", "1", "--out", trial]);
      const replay = await start(program, ["replay", "--page"], 0, [trial], {});
      try {
        // Wide enough for the scene to stand above its signals.
        const opened = await tab({ viewport: { width: 1100, height: 900 } });
        await opened.goto(new URL(`replay?quality=1&trial=0&camera=shoulder&t=${from}`, replay.url).href);
        await opened.waitForFunction(() => window.__proact?.views?.length === 1 && window.__proact.views[0].timeline && window.__proact.views[0].stage.frameCount > 3, null, { timeout: 180_000 });
        // The scene alone, in the size of a clip.
        await opened.addStyleTag({ content: `.view { position: fixed !important; inset: 0 auto auto 0; width: ${VIEW.width}px !important; height: ${VIEW.height}px !important; z-index: 99; border-radius: 0 !important; margin: 0 !important; padding: 0 !important } .view .head { display: none !important }` });
        await opened.waitForTimeout(1_000);
        const count = Math.round(((to - from) / speed) * FRAME_RATE_HZ);
        for (let k = 0; k < count; k += 1) {
          const ms = 10 * Math.round((1000 * (from + (k * speed) / FRAME_RATE_HZ)) / 10);
          const before = await opened.evaluate(() => window.__proact.views[0].stage.frameCount);
          await opened.locator('input[type="range"]').fill(String(ms));
          await opened.waitForFunction(([drawn, time]) => Math.abs(window.__proact.state.time - time) < 11 && window.__proact.views[0].stage.frameCount > drawn + 1, [before, ms]);
          await opened.screenshot({ path: `${pictures}/${String(k).padStart(4, "0")}.png`, clip: { x: 0, y: 0, ...VIEW } });
        }
        await opened.context().close();
        const each = Array.from({ length: count }, (_, k) => `${pictures}/${String(k).padStart(4, "0")}.png`);
        await run("img2webp", ["-loop", "0", "-mixed", "-min_size", "-d", String(Math.round(1000 / FRAME_RATE_HZ)), "-lossy", "-q", String(QUALITY), "-m", "6", ...each, "-o", file]);
      } finally {
        await replay.stop();
      }
    }
    const { size } = await stat(file);
    bytes += size;
    check(size > 20_000, `${name}: ${title}, ${Math.round(size / 1000)} kB`);
  }
  check(bytes < MAX_BYTES, `${Math.round(bytes / 1000)} kB in all`);
}
