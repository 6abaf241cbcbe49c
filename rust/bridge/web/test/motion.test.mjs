// The picture between two frames.

import assert from "node:assert/strict";
import { test } from "node:test";
import { load } from "./bundle.mjs";

const { Motion } = await load("motion");
const still = { rotation: [0, 0, 0, 1], translation: [0, 0, 0] };

function frame(time, x = time / 1000) {
  const pose = { rotation: [0, 0, 0, 1], translation: [x, 0, 0] };
  return { time, joints: [x], world_from_base: pose, world_from_tip: still, world_from_head: still, objects: [pose] };
}

/** Frames at 60 Hz whose arrival jitters by up to a frame; pictures every 7 ms. Returns the drawn positions. */
function play(seconds) {
  const motion = new Motion();
  const drawn = [];
  let sent = 0;
  for (let wall = 0; wall < 1000 * seconds; wall += 1) {
    const jitter = [0, 9, 3, 14, 6][sent % 5];
    if (wall >= (sent * 1000) / 60 + jitter) {
      motion.push(frame(Math.round((sent * 1000) / 60)), wall);
      sent += 1;
    }
    if (wall % 7 === 0) {
      const now = motion.at(wall);
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
  const motion = new Motion();
  for (let time = 5000; time < 6000; time += 16) motion.push(frame(time), time);
  motion.at(6000);
  motion.push(frame(0, 7), 6010);
  assert.equal(motion.at(6011).joints[0], 7);
});

test("nothing is drawn before the first frame", () => {
  assert.equal(new Motion().at(0), null);
});

const { ClockBeside, PictureTimes } = await load("picturetimes");

test("a frame is on the screen with the turn after the first picture that was no older", () => {
  const pictures = new PictureTimes();
  pictures.came(0, 90);
  pictures.came(16, 100);
  pictures.came(33, 117);
  pictures.draw(10);
  pictures.turn(125);
  assert.deepEqual(pictures.take(0), [], "the first frame may have lain there for long");
  pictures.draw(17);
  pictures.turn(142);
  assert.deepEqual(pictures.take(1000), [{ time: 16, came_ms: 1100, shown_ms: 1142 }]);
  pictures.draw(50);
  pictures.turn(159);
  pictures.turn(176);
  assert.deepEqual(pictures.take(0), [{ time: 33, came_ms: 117, shown_ms: 159 }]);
});

test("a frame counts once, and of another trial the first one does not", () => {
  const pictures = new PictureTimes();
  const shown = (time, now) => {
    pictures.came(time, now);
    pictures.draw(time);
    pictures.turn(now + 10);
    return pictures.take(0).map((frame) => frame.time);
  };
  assert.deepEqual([shown(16, 100), shown(33, 117)], [[], [33]]);
  // Time stands still for three seconds: the same frame comes again and again.
  assert.deepEqual([shown(33, 1100), shown(33, 2100), shown(33, 3100), shown(50, 3117)], [[], [], [], [50]]);
  // Another trial begins, with a frame of the one before still waiting.
  pictures.came(67, 3130);
  assert.deepEqual([shown(0, 3200), shown(67, 3217)], [[], [67]]);
});

test("another clock is read by the shortest of the last round trips", () => {
  const clock = new ClockBeside();
  assert.equal(clock.ahead, null);
  clock.take(100, 140, 5150);
  assert.equal(clock.ahead, 5030);
  clock.take(200, 202, 5202);
  assert.equal(clock.ahead, 5001);
  for (let k = 0; k < 10; k += 1) clock.take(300, 310, 5310 + k);
  assert.equal(clock.ahead, 5005, "a trip that is long ago says nothing of today");
});
