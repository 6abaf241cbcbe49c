// Starts and stops `proact serve` for the tests that need to kill it or to look at its process.

import { spawn } from "node:child_process";
import { createServer } from "node:net";

/**
 * Starts `serve` on `port`, or on a free one if that is zero, with more words and variables, and waits until it prints its
 * address.
 */
export async function startServe(program, port, words = ["--no-record"], variables = {}) {
  const chosen = port || (await freePort());
  // In a session of its own, as from another terminal: the system shares its processors between sessions, and Chromium
  // takes all that it can get to draw.
  const child = spawn(
    program,
    ["serve", "--no-browser", "--exact-port", "--port", String(chosen), ...words],
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
    child.once("exit", (code) => reject(new Error(`${program} serve ended with ${code} before it served: ${text}`)));
  });
  const stop = async () => {
    if (child.exitCode === null && child.signalCode === null) child.kill("SIGKILL");
    await ended;
  };
  return { url, port: chosen, pid: child.pid, stop, text: () => text };
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
