// Bundles the page into dist/, which the Rust crate embeds. `--watch` builds again at each change.
import { mkdir, readFile, readdir, rm, writeFile } from "node:fs/promises";
import { fileURLToPath } from "node:url";
import { promisify } from "node:util";
import { gzip } from "node:zlib";
import * as esbuild from "esbuild";

const root = fileURLToPath(new URL(".", import.meta.url));

/** uPlot's notice is in no comment that a bundler keeps. */
const notices = {
  name: "notices",
  setup(build) {
    build.onLoad({ filter: /uPlot\.esm\.js$/ }, async ({ path }) => ({
      contents: `/*!\nuPlot\n${await readFile(`${root}node_modules/uplot/LICENSE`, "utf8")}*/\n${await readFile(path, "utf8")}`,
      loader: "js",
    }));
  },
};
const options = {
  absWorkingDir: root,
  entryPoints: {
    app: "src/main.ts",
    calibrate: "src/calibrate.ts",
    emg: "src/emg.ts",
    experimenter: "src/experimenter.ts",
    "reference-board": "src/reference-board.ts",
    replay: "src/replay.ts",
    tracking: "src/tracking.ts",
  },
  outdir: "dist",
  bundle: true,
  // What the pages share is one file.
  splitting: true,
  // A file whose name holds the hash of its content can be kept by a browser for ever.
  entryNames: "[name]-[hash]",
  chunkNames: "shared-[hash]",
  minify: true,
  format: "esm",
  target: ["chrome100", "firefox100", "safari15.4"],
  legalComments: "linked",
  plugins: [notices],
  logLevel: "warning",
  metafile: true,
};

/** Licences whose notices have to go with the script and are in no comment of their code. */
const licenses = await Promise.all(
  ["@observablehq/plot", "d3", "linkedom"].map(async (name) => `${name}\n${await readFile(`${root}node_modules/${name}/LICENSE`, "utf8")}`),
);

/** The figures of reports, which the program runs itself: no page loads them, so they are in a folder of their own. */
const figures = {
  absWorkingDir: root,
  entryPoints: { figures: "src/figures/figures.ts" },
  inject: ["src/figures/intl.js"],
  outdir: "dist-figures",
  bundle: true,
  minify: true,
  format: "iife",
  target: "es2020",
  legalComments: "eof",
  footer: { js: `/*\n${licenses.join("\n\n").replaceAll("*/", "* /")}\n*/` },
  logLevel: "warning",
};

await rm(`${root}dist`, { recursive: true, force: true });
await mkdir(`${root}dist`, { recursive: true });
const pages = ["index.html", "calibrate.html", "emg.html", "experimenter.html", "reference-board.html", "replay.html", "tracking.html"];

/** The pages and the icon, with the hashed names of what was built in them. */
async function copyPages({ metafile }) {
  const built = Object.keys(metafile.outputs).map((path) => path.replace(/^dist\//, ""));
  await writeFile(`${root}dist/icon.svg`, await readFile(`${root}src/icon.svg`));
  // Its notice has to go with the script and is in no comment that the bundler keeps.
  await writeFile(`${root}dist/uplot.LEGAL.txt`, await readFile(`${root}node_modules/uplot/LICENSE`));
  for (const page of pages) {
    const text = await readFile(`${root}src/${page}`, "utf8");
    const named = text.replace(/"\/([a-z-]+)\.(js|css)"/g, (_, name, ending) => {
      const file = built.find((candidate) => new RegExp(`^${name}-[A-Z0-9]+\\.${ending}$`).test(candidate));
      if (!file) throw new Error(`${page} asks for ${name}.${ending}, which was not built`);
      return `"/${file}"`;
    });
    await writeFile(`${root}dist/${page}`, named);
  }
}

/** Each file once more as browsers take it over the line, where that is smaller. */
async function compress() {
  for (const name of await readdir(`${root}dist`)) {
    const plain = await readFile(`${root}dist/${name}`);
    const small = await promisify(gzip)(plain, { level: 9 });
    if (small.length < 0.9 * plain.length) await writeFile(`${root}dist/${name}.gz`, small);
  }
}

if (process.argv.includes("--watch")) {
  const copied = { name: "pages", setup: (build) => build.onEnd(copyPages) };
  const context = await esbuild.context({ ...options, minify: false, sourcemap: "inline", logLevel: "info", plugins: [notices, copied] });
  await context.watch();
} else {
  await copyPages(await esbuild.build(options));
  await esbuild.build(figures);
  await compress();
}
