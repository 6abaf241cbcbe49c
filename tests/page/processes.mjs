// Starts and stops `proact serve`, `proact study run` and `proact emg test` for the tests that need to kill them or to look at their process.

import { spawn } from "node:child_process";
import { createServer } from "node:net";

/**
 * Starts `serve` on `port`, or on a free one if that is zero, with more words and variables, and waits until it prints its
 * address.
 */
export function startServe(program, port, words = ["--no-record"], variables = {}) {
  return start(program, ["serve"], port, words, variables);
}

/** Starts `study run` of a folder in the same way. */
export function startStudy(program, folder, words = []) {
  return start(program, ["study", "run", folder], 0, words, {});
}

/** Starts `emg test` on its page in the same way. */
export function startEmgTest(program, words) {
  return start(program, ["emg", "--json", "test", "--page"], 0, words, {});
}

/** Starts a command in the same way. */
export async function start(program, command, port, words, variables) {
  const chosen = port || (await freePort());
  // The others have no port but the one that they are told, or take the next one if that is taken meanwhile.
  const exact = ["serve", "study"].includes(command[0]) ? ["--exact-port"] : [];
  // In a session of its own, as from another terminal: the system shares its processors between sessions, and Chromium
  // takes all that it can get to draw.
  const child = spawn(
    program,
    [...command, "--no-browser", ...exact, "--port", String(chosen), ...words],
    { env: { ...process.env, ...variables }, stdio: ["ignore", "pipe", "pipe"], detached: true },
  );
  const ended = new Promise((resolve) => child.once("exit", resolve));
  let text = "";
  const url = await new Promise((resolve, reject) => {
    const read = (data) => {
      text += data;
      const found = /https?:\/\/[0-9.:]+\//.exec(text);
      if (found) resolve(found[0]);
    };
    child.stdout.on("data", read);
    child.stderr.on("data", read);
    child.once("error", reject);
    child.once("exit", (code) => reject(new Error(`${program} ${command.join(" ")} ended with ${code} before it served: ${text}`)));
  });
  const stop = async (signal = "SIGKILL") => {
    if (child.exitCode === null && child.signalCode === null) child.kill(signal);
    await ended;
  };
  return { url, port: chosen, pid: child.pid, stop, ended, text: () => text };
}

function freePort() {
  return new Promise((resolve, reject) => {
    const probe = createServer();
    probe.once("error", reject);
    probe.listen(0, "127.0.0.1", () => {
      const { port } = probe.address();
      probe.close(() => resolve(port));
    });
  });
}
