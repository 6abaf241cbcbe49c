// Bundles the page into dist/, which the Rust crate embeds. `--watch` builds again at each change.
import { cp, mkdir, rm } from "node:fs/promises";
import { fileURLToPath } from "node:url";
import * as esbuild from "esbuild";

const root = fileURLToPath(new URL(".", import.meta.url));
const options = {
  absWorkingDir: root,
  entryPoints: { app: "src/main.ts", calibrate: "src/calibrate.ts" },
  outdir: "dist",
  bundle: true,
  minify: true,
  format: "esm",
  target: ["chrome100", "firefox100", "safari15.4"],
  legalComments: "linked",
  logLevel: "warning",
};

await rm(`${root}dist`, { recursive: true, force: true });
await mkdir(`${root}dist`, { recursive: true });
await cp(`${root}src/index.html`, `${root}dist/index.html`);
await cp(`${root}src/calibrate.html`, `${root}dist/calibrate.html`);
await cp(`${root}src/icon.svg`, `${root}dist/icon.svg`);
if (process.argv.includes("--watch")) {
  const context = await esbuild.context({ ...options, minify: false, sourcemap: "inline", logLevel: "info" });
  await context.watch();
} else {
  await esbuild.build(options);
}
