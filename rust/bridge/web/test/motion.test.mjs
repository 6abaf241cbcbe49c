// The picture between two frames.

import assert from "node:assert/strict";
import { test } from "node:test";
import { load } from "./bundle.mjs";

const { FrameInterpolator } = await load("frameInterpolation");
const still = { rotation: [0, 0, 0, 1], translation: [0, 0, 0] };

function frame(time, x = time / 1000) {
  const pose = { rotation: [0, 0, 0, 1], translation: [x, 0, 0] };
  return { time, joints: [x], world_from_base: pose, world_from_tip: still, world_from_head: still, objects: [pose] };
}

/** Frames at 60 Hz whose arrival jitters by up to a frame; pictures every 7 ms. Returns the drawn positions. */
function play(seconds) {
  const motion = new FrameInterpolator();
  const drawn = [];
  let sent = 0;
  for (let wall = 0; wall < 1000 * seconds; wall += 1) {
    const jitter = [0, 9, 3, 14, 6][sent % 5];
    if (wall >= (sent * 1000) / 60 + jitter) {
      motion.push(frame(Math.round((sent * 1000) / 60)), wall);
      sent += 1;
    }
    if (wall % 7 === 0) {
      const now = motion.interpolateAt(wall);
      if (now) drawn.push({ wall, x: now.joints[0], block: now.objects[0].position.x });
    }
  }
  return drawn;
}

test("steady motion is drawn without steps and without going back, whatever the jitter", () => {
  const drawn = play(4).filter(({ wall }) => wall > 1500);
  for (let k = 1; k < drawn.length; k++) {
    const speed = (drawn[k].x - drawn[k - 1].x) / 0.007;
    assert.ok(speed > 0.5 && speed < 1.5, `1 rad/s is drawn at ${speed} rad/s at ${drawn[k].wall} ms`);
  }
});

test("the picture lags by less than a tenth of a second, and arm and blocks are of one instant", () => {
  for (const { wall, x, block } of play(3).filter(({ wall }) => wall > 1500)) {
    assert.ok(wall / 1000 - x < 0.1, `${wall / 1000 - x} s late`);
    assert.equal(x, block);
  }
});

test("a new trial, whose time starts over, is drawn at once", () => {
  const motion = new FrameInterpolator();
  for (let time = 5000; time < 6000; time += 16) motion.push(frame(time), time);
  motion.interpolateAt(6000);
  motion.push(frame(0, 7), 6010);
  assert.equal(motion.interpolateAt(6011).joints[0], 7);
});

test("nothing is drawn before the first frame", () => {
  assert.equal(new FrameInterpolator().interpolateAt(0), null);
});

const { ClockOffset, FrameTimes } = await load("frameLatency");

test("a frame is on the screen with the turn after the first picture that was no older", () => {
  const pictures = new FrameTimes();
  pictures.recordReceived(0, 90);
  pictures.recordReceived(16, 100);
  pictures.recordReceived(33, 117);
  pictures.recordDrawn(10);
  pictures.recordDisplayed(125);
  assert.deepEqual(pictures.drain(0), [], "the first frame may have lain there for long");
  pictures.recordDrawn(17);
  pictures.recordDisplayed(142);
  assert.deepEqual(pictures.drain(1000), [{ time: 16, came_ms: 1100, shown_ms: 1142 }]);
  pictures.recordDrawn(50);
  pictures.recordDisplayed(159);
  pictures.recordDisplayed(176);
  assert.deepEqual(pictures.drain(0), [{ time: 33, came_ms: 117, shown_ms: 159 }]);
});

test("a frame counts once, and of another trial the first one does not", () => {
  const pictures = new FrameTimes();
  const shown = (time, now) => {
    pictures.recordReceived(time, now);
    pictures.recordDrawn(time);
    pictures.recordDisplayed(now + 10);
    return pictures.drain(0).map((frame) => frame.time);
  };
  assert.deepEqual([shown(16, 100), shown(33, 117)], [[], [33]]);
  // Time stands still for three seconds: the same frame comes again and again.
  assert.deepEqual([shown(33, 1100), shown(33, 2100), shown(33, 3100), shown(50, 3117)], [[], [], [], [50]]);
  // Another trial begins, with a frame of the one before still waiting.
  pictures.recordReceived(67, 3130);
  assert.deepEqual([shown(0, 3200), shown(67, 3217)], [[], [67]]);
});

test("another clock is read by the shortest of the last round trips", () => {
  const clock = new ClockOffset();
  assert.equal(clock.offsetMs, null);
  clock.addRoundTrip(100, 140, 5150);
  assert.equal(clock.offsetMs, 5030);
  clock.addRoundTrip(200, 202, 5202);
  assert.equal(clock.offsetMs, 5001);
  for (let k = 0; k < 10; k += 1) clock.addRoundTrip(300, 310, 5310 + k);
  assert.equal(clock.offsetMs, 5005, "a trip that is long ago says nothing of today");
});
