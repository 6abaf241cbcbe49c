// Bundles the page into dist/, which the Rust crate embeds. `--watch` builds again at each change.
import { cp, mkdir, rm } from "node:fs/promises";
import { fileURLToPath } from "node:url";
import * as esbuild from "esbuild";

const root = fileURLToPath(new URL(".", import.meta.url));
const options = {
  absWorkingDir: root,
  entryPoints: {
    app: "src/main.ts",
    calibrate: "src/calibrate.ts",
    experimenter: "src/experimenter.ts",
    "reference-board": "src/reference-board.ts",
    replay: "src/replay.ts",
  },
  outdir: "dist",
  bundle: true,
  // What the pages share is one file.
  splitting: true,
  chunkNames: "shared-[hash]",
  minify: true,
  format: "esm",
  target: ["chrome100", "firefox100", "safari15.4"],
  legalComments: "linked",
  logLevel: "warning",
};

await rm(`${root}dist`, { recursive: true, force: true });
await mkdir(`${root}dist`, { recursive: true });
const files = ["index.html", "calibrate.html", "experimenter.html", "reference-board.html", "replay.html", "icon.svg"];
for (const file of files) {
  await cp(`${root}src/${file}`, `${root}dist/${file}`);
}
if (process.argv.includes("--watch")) {
  const context = await esbuild.context({ ...options, minify: false, sourcemap: "inline", logLevel: "info" });
  await context.watch();
} else {
  await esbuild.build(options);
}
