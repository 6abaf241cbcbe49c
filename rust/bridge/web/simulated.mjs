// Makes src/simulated.json, the results of simulated people beside which the page shows those of a visit:
//
//   ./proact simulate --methods A,B,C,D --participant-kind person --participants 24 --seed 1 --setup still --out build/simulated/still
//   ./proact simulate --methods A,B,C,D --participant-kind person --participants 24 --seed 1 --setup seated --out build/simulated/seated
//   node rust/bridge/web/simulated.mjs build/simulated/still build/simulated/seated
//
// One row a trial: method, score, seconds, attempts, path of the hand in metres; the path is null where the last action was not
// completed, since its part of the way is in no table.

import { readFile, writeFile } from "node:fs/promises";
import { fileURLToPath } from "node:url";
import { csvParse } from "d3";

/** So little of a trial may lie outside its completed actions, seconds. */
const REST_SECS = 3;

const readCsv = async (folder, name) => csvParse(await readFile(`${folder}/${name}.csv`, "utf8"));
const key = ({ participant, condition, trial }) => `${participant} ${condition} ${trial}`;

/** The trials of one batch. */
async function batch(folder) {
  const [trials, measures, phases, about] = [await readCsv(folder, "trials"), await readCsv(folder, "measures"), await readCsv(folder, "phases"), JSON.parse(await readFile(`${folder}/batch.json`, "utf8"))];
  const attempts = new Map(measures.map((row) => [key(row), Number(row.attempts)]));
  const sum = (column) => {
    const sums = new Map();
    for (const row of phases) sums.set(key(row), (sums.get(key(row)) ?? 0) + Number(row[column]));
    return (row) => sums.get(key(row)) ?? 0;
  };
  const [spent, path] = [sum("seconds"), sum("hand_path_m")];
  const pathOf = (row) => (Number(row.seconds) - spent(row) < REST_SECS ? Number(path(row).toFixed(2)) : null);
  const { task, arm, setup } = trials[0];
  const rows = trials.map((row) => [row.method, Number(row.score), Number(Number(row.seconds).toFixed(1)), attempts.get(key(row)) ?? 0, pathOf(row)]);
  return { setup, task, arm, people: about.participants, seed: about.seed, rows };
}

const batches = await Promise.all(process.argv.slice(2).map(batch));
const text = batches.map(({ rows, ...about }) => `${JSON.stringify(about).slice(0, -1)},"rows":[\n${rows.map((row) => JSON.stringify(row)).join(",\n")}\n]}`);
await writeFile(fileURLToPath(new URL("src/simulated.json", import.meta.url)), `[${text.join(",\n")}]\n`);
