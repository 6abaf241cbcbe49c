// The ghost arm of miniVIE's virtual limb, sent byte by byte as a decoder does: it appears in its colour, moves, and is switched off;
// packets that are none change nothing. The log of use of the sitting has it all.

import { execFileSync } from "node:child_process";
import { createSocket } from "node:dgram";
import { readFile, rm } from "node:fs/promises";
import { startServe } from "./processes.mjs";

/** Enable, red, green, blue, alpha: on, 0.3, 0.4, 0.5, 0.8. */
const SHOW_PACKET = Buffer.from("0000803f9a99993ecdcccc3e0000003fcdcc4c3f", "hex");
const HIDE_PACKET = Buffer.alloc(20);

export async function ghost(page, { program, out, check, screenshot, limitMs }) {
  if (!program) throw new Error("--mode ghost needs --program PATH_OF_PROACT");
  const [listen, decoder, commands, setups] = await freePorts(4);
  const at = (port) => `127.0.0.1:${port}`;
  const words = `proact:vmpl listen=${at(listen)} decoder=${at(decoder)} ghost=${at(commands)} ghost_setup=${at(setups)}`;
  const log = `${out}/use.jsonl`;
  await rm(log, { force: true });
  const serve = await startServe(program, 0, ["--no-record", "--setup", "still", "--method-command", words, "--usage-log", log]);
  const sender = createSocket("udp4");
  const send = (packet, port) => new Promise((resolve, reject) => sender.send(packet, port, "127.0.0.1", (error) => (error ? reject(error) : resolve())));
  const angles = (elbow) => {
    const packet = Buffer.alloc(108);
    packet.writeFloatLE(elbow, 12);
    return packet;
  };
  const seen = (what, argument) => page.waitForFunction(what, argument, { timeout: limitMs, polling: 30 });
  const drawn = async (more) => {
    const before = await page.evaluate(() => window.__proact.framesDrawn);
    await seen((least) => window.__proact.framesDrawn > least, before + more);
  };
  const scene = async () => {
    await drawn(8);
    return page.locator("#scene").screenshot();
  };
  let [there, spent] = [false, 0];
  try {
    await page.goto(new URL("?quality=3&tutorial=0&pictures=20", serve.url).href);
    await seen(() => window.__proact?.connected && window.__proact.framesDrawn > 3);
    const begun = Date.now();
    const alone = await scene();
    const held = await page.evaluate(() => window.__proact.frame.joints[3]);
    await send(angles(Math.PI / 2), commands);
    await drawn(8);
    check((await page.evaluate(() => window.__proact.ghost)) === null, "a ghost that nobody switched on is not there");
    await send(SHOW_PACKET, setups);
    await seen(() => window.__proact.ghost !== null);
    const arm = await page.evaluate(() => window.__proact.ghost);
    const near = (value, wanted) => Math.abs(value - wanted) < 1e-6;
    check(arm.colour.every((part, k) => near(part, [0.3, 0.4, 0.5][k])) && near(arm.alpha, 0.8), `it has its colour: ${arm.colour}, ${arm.alpha}`);
    check(near(arm.joints[3], Math.PI / 2) && near(arm.joints[0], 0), `and its angles: ${arm.joints.slice(0, 7)}`);
    const bent = await scene();
    check(!bent.equals(alone), "it is drawn");
    for (const colorScheme of ["dark", "light"]) {
      await page.emulateMedia({ colorScheme });
      await drawn(8);
      await screenshot(`ghost-${colorScheme}`);
    }
    await page.setViewportSize({ width: 390, height: 844 });
    await drawn(8);
    await screenshot("ghost-phone");
    await page.setViewportSize({ width: 1280, height: 720 });
    await send(angles(0.2), commands);
    await seen(() => Math.abs(window.__proact.ghost?.joints[3] - 0.2) < 1e-6);
    check(!(await scene()).equals(bent), "it moves");
    const elbow = () => page.evaluate(() => window.__proact.frame.joints[3]);
    const still = await elbow();
    check(Math.abs(still - held) < 0.01, `and moves nothing: the elbow stays at ${still}`);
    for (const packet of [Buffer.alloc(19, 1), Buffer.alloc(20, 0xff), Buffer.alloc(500, 1)]) {
      await send(packet, commands);
      await send(packet, setups);
    }
    await drawn(8);
    check((await page.evaluate(() => window.__proact.ghost?.alpha)) === arm.alpha, "packets that are none change nothing");
    await page.reload();
    await seen(() => window.__proact?.framesDrawn > 3 && window.__proact.ghost !== null);
    check(true, "a page that comes later has it too");
    await send(HIDE_PACKET, setups);
    await seen(() => window.__proact.ghost === null);
    check(true, "it is switched off");
    // The limb itself is a decoder's still.
    // From where it is, so that nothing is in the way; the packet of the arm alone.
    const arm7 = await page.evaluate(() => window.__proact.frame.joints.slice(0, 7));
    const goal = arm7[3] + 0.3;
    const command = Buffer.alloc(28);
    arm7.forEach((angle, k) => command.writeFloatLE(k === 3 ? goal : angle, 4 * k));
    const moved = seen((goal) => Math.abs(window.__proact.frame.joints[3] - goal) < 0.05, goal).then(() => (there = true));
    // A decoder sends all the time; its silence stops the arm.
    while (!there) {
      await send(command, listen);
      await Promise.race([moved, new Promise((resolve) => setTimeout(resolve, 20))]);
    }
    check(true, `a command moves the arm: the elbow is at ${await elbow()}`);
    // The page that is left open would complain of the program's end.
    await page.goto("about:blank");
    spent = (Date.now() - begun) / 1000;
  } finally {
    await serve.stop("SIGINT");
    sender.close();
  }
  check(/packets for the ghost arm were none/.test(serve.text()), "packets that were none are counted");
  const lines = (await readFile(log, "utf8")).trimEnd().split("\n").map((line) => JSON.parse(line));
  const last = lines.at(-1);
  // Less the reload.
  check(last.used.connected_secs > 0.5 * spent && last.used.connected_secs < spent + 10 && last.used.moving_secs > 0 && last.used.trials === 1, `the log of use has the sitting of ${spent} s: ${JSON.stringify(last)}`);
  const usage = execFileSync(program, ["emg", "usage", log], { encoding: "utf8" });
  check(/^\d{4}-\d\d-\d\d {2}#{30} {2}0:00:/.test(usage) && /\n1 days of use, /.test(usage), `and it is told: ${usage.trim()}`);
}

async function freePorts(count) {
  const sockets = Array.from({ length: count }, () => createSocket("udp4"));
  const ports = await Promise.all(sockets.map((socket) => new Promise((resolve) => socket.bind(0, "127.0.0.1", () => resolve(socket.address().port)))));
  await Promise.all(sockets.map((socket) => new Promise((resolve) => socket.close(resolve))));
  return ports;
}
