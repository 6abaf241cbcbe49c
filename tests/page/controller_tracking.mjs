// A controller strapped to the brace, beside `proact serve --mocap headset:right_controller`: the arm hangs on it, it is neither gaze
// nor buttons, and an arm whose controller is gone stops.

import { emulateHeadset, ready } from "./participant_page.mjs";

export async function controllerTracking(page, { url, check, screenshot, emulator }) {
  await emulateHeadset(page, emulator);
  await page.addInitScript(() => {
    const right = window.headset.controllers.right;
    // The emulator calls every place a guess; headsets do so where they do not see the controller.
    window.guessed = false;
    Object.defineProperty(XRPose.prototype, "emulatedPosition", { get: () => window.guessed });
    right.position.set(0.2, 1.4, -0.1);
    let phase = 0;
    // A person breathes.
    setInterval(() => (right.position.y += 2e-4 * Math.cos((phase += 0.3))), 10);
  });
  await page.setViewportSize({ width: 900, height: 500 });
  await page.goto(new URL("?quality=3&tutorial=0", url).href);
  await ready(page);
  const report = () => page.evaluate(async () => (await (await fetch("/api/tracking")).json())[0]);
  const until = async (right, what) => {
    let last;
    for (let k = 0; k < 300; k++) {
      last = await report();
      if (last && right(last)) {
        check(true, what);
        return last;
      }
      await page.waitForTimeout(100);
    }
    check(false, `${what}; last: ${JSON.stringify(last)}`);
  };
  await until((now) => now.fault_name === "waiting" && now.fault.includes("no right controller"), "without a headset the arm waits for its controller");
  await page.click('button:text-is("Enter VR")');
  await page.waitForFunction(() => window.__proact.worn);
  const before = await until((now) => now.fault === null && now.world_from_shoulder, "the controller is the shoulder");
  // 5 cm ahead and 3 cm to the left, as the headset counts: x to the right, z backwards.
  await page.evaluate(() => {
    const { position } = window.headset.controllers.right;
    position.set(position.x - 0.03, position.y, position.z - 0.05);
  });
  const by = (now, k) => now.world_from_shoulder.translation[k] - before.world_from_shoulder.translation[k];
  await until((now) => now.fault === null && Math.abs(by(now, 0) - 0.05) < 0.01 && Math.abs(by(now, 1) - 0.03) < 0.01, "the shoulder moves as the controller does");
  await page.evaluate(() => (window.guessed = true));
  await until((now) => now.fault_name === "occluded", "a place that the headset guesses is not followed");
  await page.evaluate(() => (window.guessed = false));
  await until((now) => now.fault === null, "and is when it sees the controller again");
  await page.evaluate(() => window.headset.controllers.right.updateButtonValue("trigger", 1));
  await page.waitForTimeout(700);
  check((await page.evaluate(() => window.__proact.frame.gesture)) !== "wrist_extension", "the trigger on the brace is no gesture");
  await page.evaluate(() => {
    const { left } = window.headset.controllers;
    left.position.set(-0.2, 1.2, -0.3);
    left.quaternion.set(0, 0, 0, 1);
  });
  await page.waitForFunction(() => window.__proact.frame.gaze?.direction[0] > 0.9);
  check(true, "the other hand is the gaze");
  await screenshot("brace");
  await page.evaluate(() => (window.headset.controllers.right.connected = false));
  await until((now) => now.fault_name === "silent", "a controller that is gone is silent");
  await page.evaluate(() => (window.headset.controllers.right.connected = true));
  await until((now) => now.fault === null, "and followed again when it is back");
}
