// What a person at the page can do beside driving: tutorial, settings, gaze check, gamepad, headset.

import { readFile } from "node:fs/promises";

export const ready = (page) => page.waitForFunction(() => window.__proact?.connected && window.__proact.framesDrawn > 3);
/** Looked for by a clock: what is held by a gamepad or a headset may be let go of before a slow next picture. */
const waitForGesture = (page, gesture) =>
  page.waitForFunction((name) => window.__proact.frame.gesture === name, gesture, { polling: 20 });

/** A first visit: greeted, led, settings kept; then the gaze check and a gamepad. */
export async function newcomer(page, { url, check, screenshot }) {
  await page.addInitScript(() => {
    // A controller that is not there until it is asked for.
    const buttons = Array.from({ length: 17 }, () => ({ pressed: false, value: 0 }));
    const pad = { id: "test pad", index: 0, connected: true, mapping: "standard", axes: [0, 0, 0, 0], buttons };
    navigator.getGamepads = () => (window.testPad ? [pad] : []);
    window.press = (button, value) => Object.assign(buttons[button], { value, pressed: value > 0.5 });
  });
  await page.goto(new URL("?quality=3&pictures=10", url).href);
  await ready(page);
  await page.locator(".welcome:not([hidden])").first().waitFor();
  await screenshot("welcome");
  await page.click('button:has-text("Show me how")');
  await page.waitForFunction(() => window.__proact.frame.method === "D");
  await page.locator(".lesson:not([hidden])").waitFor();
  check((await page.textContent(".lesson b")) === "Look at the block", "the tutorial begins with a look");
  await screenshot("tutorial");
  const block = await page.evaluate(() => window.__proact.project("object", window.__proact.frame.next));
  await page.mouse.move(block.x, block.y);
  await page.waitForFunction(() => document.querySelector(".lesson b")?.textContent === "Lock it");
  check(true, "and goes on when the block is looked at");
  await page.click('.lesson button:text-is("Skip")');
  await page.reload();
  await ready(page);
  check((await page.locator(".welcome:not([hidden])").count()) === 0, "who was there before is not greeted again");

  await page.click('button:text-is("Settings")');
  await page.click('[data-command="wrist_flexion"]');
  await page.keyboard.press("KeyX");
  await page.selectOption('select[name="colours"]', "colour-blind");
  await screenshot("settings");
  await page.click('button:text-is("Close")');
  // Without gaze the arm is stopped, whatever the gesture.
  await page.mouse.move(block.x, block.y);
  await page.keyboard.down("KeyX");
  await waitForGesture(page, "wrist_flexion");
  await page.keyboard.up("KeyX");
  await waitForGesture(page, "no_motion");
  check(true, "another key makes the gesture");
  await page.reload();
  await ready(page);
  check((await page.textContent(".gesture.wrist_flexion kbd")) === "X", "and is still there after a reload");

  await page.evaluate(() => {
    window.testPad = true;
    window.press(2, 1);
  });
  await waitForGesture(page, "hand_close");
  await page.evaluate(() => window.press(2, 0));
  await waitForGesture(page, "no_motion");
  check(true, "a gamepad's button makes a gesture");

  await page.click('button:text-is("Settings")');
  await page.click('button:has-text("Check the gaze")');
  const straight = await followPoints(page, 0);
  await screenshot("gaze-check");
  check(straight < 1, `the mouse is an eye with an error of ${straight}°`);
  await requestedGazeCheck(page, { url, check, screenshot });
}

/** Follows the points of a gaze check with the mouse, `off` pixels to the right of each; the mean error in degrees. */
async function followPoints(page, off) {
  for (let last = ""; !(await page.locator(".gazecheck .verdict").count()); ) {
    const at = await page.evaluate(() => window.__proact.gazePoint());
    const now = JSON.stringify(at);
    if (at && now !== last) await page.mouse.move(at.x + off, at.y);
    last = now;
    await page.waitForTimeout(60);
  }
  const cells = await page.locator(".gazecheck tbody tr:last-child td").allTextContents();
  return Number.parseFloat(cells[0]);
}

/** The experimenter's buttons begin a calibration and a check on the participant's page. The eye looks beside the point. */
async function requestedGazeCheck(page, { url, check, screenshot }) {
  await page.click(".gazecheck button");
  const desk = await page.context().newPage();
  await desk.goto(new URL("experimenter?quality=3", url).href);
  const ask = async (button) => {
    await desk.click(`button:text-is("${button}"):enabled`);
    await page.bringToFront();
    await page.waitForFunction(() => window.__proact.gazePoint() !== null);
    // In the part of the window that the scene has, a pixel is more degrees for near points than for far ones: so little that
    // the five errors still agree.
    const error = await followPoints(page, 25);
    const verdict = await page.textContent(".gazecheck .verdict");
    await screenshot(`gaze-${button.split(" ")[0].toLowerCase()}`);
    await page.click(".gazecheck button");
    return { error, verdict };
  };
  const before = await ask("Recalibrate gaze");
  check(before.error > 1 && before.verdict.startsWith("Calibrated"), `an eye that is ${before.error}° off: ${before.verdict}`);
  const after = await ask("Check gaze");
  check(after.error < 0.5 * before.error, `after the calibration it is ${after.error}° off`);
  await desk.close();
}

/** The page's browser is a headset's from the next page on: `window.headset`. */
export async function emulateHeadset(page, emulator) {
  await page.addInitScript({ content: await readFile(emulator, "utf8") });
  await page.addInitScript(() => {
    const device = new IWER.XRDevice(IWER.metaQuest3);
    device.installRuntime({ forceInstall: true });
    device.position.set(0, 1.6, 0);
    window.headset = device;
    // A head that is alive is never quite still. One that is counts as a tracker that repeats itself.
    let phase = 0;
    setInterval(() => (device.position.x += 1e-4 * Math.cos((phase += 0.7))), 10);
    // What the emulator lacks: tracking of images. The reference board is in the left hand.
    window.XRImageTrackingResult = class {};
    window.board = null;
    const request = navigator.xr.requestSession.bind(navigator.xr);
    navigator.xr.requestSession = (mode, options) => {
      window.asked = options;
      return request(mode, options);
    };
    XRFrame.prototype.getImageTrackingResults = () =>
      window.board ? [{ index: 0, trackingState: window.board, imageSpace: device.controllers.left.inputSource.targetRaySpace }] : [];
  });
}

/** An emulated headset: it enters, its head moves the display's head, its hand is the gaze, and it leaves. */
export async function headset(page, { url, check, screenshot, emulator }) {
  await emulateHeadset(page, emulator);
  // The processor draws two pictures here: small ones, or the page is silent for longer than it may be.
  await page.setViewportSize({ width: 900, height: 500 });
  await page.goto(new URL("?quality=3&tutorial=0", url).href);
  await ready(page);
  for (const mode of ["VR", "AR"]) {
    await page.click(`button:text-is("Enter ${mode}")`);
    await page.waitForFunction(() => window.__proact.worn);
    check(true, `the page enters ${mode}`);
    const head = () => page.evaluate(() => window.__proact.frame.world_from_head.translation);
    await page.evaluate(() => window.headset.position.set(0, 1.6, 0));
    await page.waitForFunction(() => Math.abs(window.__proact.frame.world_from_head.translation[2] - 1.6) < 0.02);
    const before = await head();
    // A step ahead and to the right, as the headset counts: x to the right, z backwards.
    await page.evaluate(() => window.headset.position.set(0.1, 1.5, -0.2));
    await page.waitForFunction(([, , z]) => Math.abs(window.__proact.frame.world_from_head.translation[2] - z + 0.1) < 0.01, before);
    const after = await head();
    check(
      Math.abs(after[0] - before[0] - 0.2) < 0.01 && Math.abs(after[1] - before[1] + 0.1) < 0.01,
      "a step ahead and to the right is one in the world",
    );
    const gaze = () => page.evaluate(() => window.__proact.frame.gaze?.direction);
    // Level and ahead first: a device keeps its hands where they were in the session before.
    await page.evaluate(() => window.headset.controllers.right.quaternion.set(0, 0, 0, 1));
    await page.waitForFunction(() => window.__proact.frame.gaze?.direction[0] > 0.97);
    const looked = await gaze();
    await page.evaluate(() => {
      const hand = window.headset.controllers.right;
      hand.position.set(0.2, 1.3, -0.3);
      // Down and to the left.
      hand.quaternion.set(-0.25, 0.2, 0.05, 0.946);
    });
    await page.waitForFunction(
      (old) => {
        const now = window.__proact.frame.gaze?.direction;
        return now && (!old || Math.hypot(now[0] - old[0], now[1] - old[1], now[2] - old[2]) > 0.05);
      },
      looked,
    );
    check(true, "the hand's ray is the gaze");
    await page.evaluate(() => window.headset.controllers.right.updateButtonValue("trigger", 1));
    await waitForGesture(page, "wrist_extension");
    await page.evaluate(() => window.headset.controllers.right.updateButtonValue("trigger", 0));
    await waitForGesture(page, "no_motion");
    check(true, "the trigger is WE");
    if (mode === "AR") await referenceBoard(page, { check, head });
    await screenshot(`headset-${mode.toLowerCase()}`);
    await page.evaluate(() => window.headset.activeSession.end());
    await page.waitForFunction(() => !window.__proact.worn);
    check(true, `and leaves ${mode}`);
  }
}

/** A board on the real table puts the virtual one there, level, turned and at its height; one that is guessed at does not. */
async function referenceBoard(page, { check, head }) {
  const width = await page.evaluate(() => window.asked.trackedImages?.[0]?.widthInMeters);
  check(width === 0.18, "the session is asked to find the reference board");
  const before = await head();
  // 0.7 m high, half a metre to the left of the origin and a metre ahead, its right edge towards where one came from.
  await page.evaluate(() => {
    const { left } = window.headset.controllers;
    left.position.set(-0.5, 0.7, -1);
    left.quaternion.set(0, -Math.SQRT1_2, 0, Math.SQRT1_2);
    window.board = "emulated";
  });
  await page.evaluate(() => new Promise((done) => window.headset.activeSession.requestAnimationFrame(() => done())));
  const unmoved = await head();
  check(Math.hypot(...unmoved.map((x, k) => x - before[k])) < 0.01, "a board that is only guessed at moves nothing");
  await page.evaluate(() => (window.board = "tracked"));
  // The middle of the table as the page has it; the head is seen from there with the board's axes.
  const expected = await page.evaluate(() => {
    const [x, y, z] = window.__proact.tableMiddle();
    const eye = window.headset.position;
    const [right, up, back] = [eye.x + 0.5, eye.y - 0.7, eye.z + 1];
    // The board's right is the room's +z, so its way ahead is the room's +x.
    return [x + right, y - back, z + up];
  });
  await page.waitForFunction(
    (there) => Math.hypot(...window.__proact.frame.world_from_head.translation.map((x, k) => x - there[k])) < 0.01,
    expected,
  );
  check(true, "the table stands where the reference board lies");
  await page.evaluate(() => (window.board = null));
}
