// The replay of two trials as a laboratory uses it: the cursor dragged over the signals, events filtered and chosen, both trials
// aligned by an event, slow motion, pictures and a video saved, a link that opens the same moment. Beside `proact replay DIR DIR --page`.

import { checkWithAxe } from "./accessibility.mjs";

const SIZES = [[1280, 720], [1920, 1080], [390, 844]];
const SCHEMES = ["light", "dark"];
/** Instants of the page and of the test may differ by a pixel of a plot, ms. */
const PIXEL_MS = 250;

export async function replay(page, tools) {
  const { url, check, screenshot } = tools;
  const look = await checkWithAxe(page, tools);
  await page.goto(new URL("replay?quality=3", url).href);
  await loaded(page, 2);
  check(true, "two trials are side by side");
  const verdicts = await page.locator(".trial .chip").allTextContents();
  const agree = verdicts.filter((text) => text === "Digest agrees");
  check(agree.length === 2, "both are the recorded trials, by their digests");
  await cursor(page, tools);
  await events(page, tools);
  await checkAlignment(page, tools);
  await checkPlayback(page, tools);
  await checkSavedFiles(page, tools);
  await checkLink(page, tools);
  for (const colorScheme of SCHEMES) {
    await page.emulateMedia({ colorScheme });
    for (const [width, height] of SIZES) {
      await page.setViewportSize({ width, height });
      await page.waitForTimeout(300);
      const wide = await page.evaluate(() => document.documentElement.scrollWidth - innerWidth);
      check(wide <= 0, `nothing leaves the window of ${width} px, ${colorScheme}`);
      await look(`replay ${width} ${colorScheme}`);
      await screenshot(`replay-${width}-${colorScheme}`);
    }
  }
}

function loaded(page, count) {
  return page.waitForFunction(
    (views) => window.__proact?.views?.length === views && window.__proact.views.every((view) => view.timeline),
    count,
  );
}

const time = (page) => page.evaluate(() => window.__proact.state.time);

/** Lanes, and the cursor in them: dragged, and following. */
async function cursor(page, { check, screenshot }) {
  const lanes = await page.locator(".trial:first-child .lane summary b").allTextContents();
  const expected = ["EMG", "Gesture posterior", "Gesture in force", "Gaze on the table", "Intent posterior", "Plans", "Joint angles"];
  check(JSON.stringify(lanes) === JSON.stringify(expected), `plots of ${lanes.join(", ")}`);
  const drawn = await page.evaluate(() => {
    const { width, height } = document.querySelector(".lane.emg canvas");
    const pixels = document.querySelector(".lane.emg canvas").getContext("2d").getImageData(0, 0, width, height).data;
    return new Set(new Uint32Array(pixels.buffer)).size;
  });
  check(drawn > 50, `the EMG is drawn, in ${drawn} shades`);
  const plot = page.locator(".trial:first-child .lane.decoder .u-over");
  await plot.evaluate((node) => node.scrollIntoView({ block: "center" }));
  const box = await plot.boundingBox();
  const at = (share) => [box.x + share * box.width, box.y + box.height / 2];
  const length = await page.evaluate(() => window.__proact.state.length);
  await page.mouse.move(...at(0.2));
  await page.mouse.down();
  await page.mouse.move(...at(0.35));
  await page.mouse.move(...at(0.5), { steps: 4 });
  const dragged = await time(page);
  check(Math.abs(dragged - length / 2) < PIXEL_MS, `the cursor is dragged to the middle: ${(dragged / 1000).toFixed(2)} s`);
  await page.mouse.up();
  await page.mouse.move(...at(0.8));
  check((await time(page)) === dragged, "and stays when the button is let go");
  const value = () => page.locator(".trial:first-child .lane.joints .value").first().textContent();
  const before = await value();
  await screenshot("cursor");
  await page.locator('input[type="range"]').fill(String(Math.round(length / 4)));
  await page.waitForFunction((old) => document.querySelector(".trial:first-child .lane.joints .value").textContent !== old, before);
  const shown = Number((await value()).replace("−", "-").replace("°", ""));
  const angle = await page.evaluate(() => {
    const { views, state } = window.__proact;
    return (views[0].timeline.at(state.time).frame.joints[0] * 180) / Math.PI;
  });
  check(Math.abs(shown - angle) < 0.06, `the value at the cursor is that of the frame: ${shown}°`);
  await page.click(".trial:first-child .lane.plan summary");
  await page.waitForFunction(() => !document.querySelector(".trial:first-child .lane.plan .uplot"));
  await page.click(".trial:first-child .lane.plan summary");
  await page.waitForFunction(() => document.querySelector(".trial:first-child .lane.plan .uplot"));
  check(true, "a plot is folded and unfolded");
}

/** The list of events by groups, by mouse and keys. */
async function events(page, { check }) {
  const lines = page.locator(".events li button");
  const all = await lines.count();
  await page.uncheck('.eventlegend label:has-text("Gestures") input');
  const left = await lines.count();
  const gestures = await page.locator(".events li button.gesture").count();
  check(left > 0 && left < all && gestures === 0, `${left} of ${all} events without the gestures`);
  const marks = await page.locator(".marks .gesture").count();
  check(marks === 0, "nor are they on the rulers");
  const line = page.locator(".events li button.grasp").first();
  const [text, said] = [await line.locator("span").last().textContent(), Number(await line.locator("time").textContent())];
  await line.click();
  const there = (await time(page)) / 1000;
  check(Math.abs(there - said) < 0.006, `a click on "${text}" goes to ${said} s`);
  await page.evaluate(() => document.activeElement.blur());
  const next = await page.evaluate(() => window.__proact.events.neighbor(window.__proact.state.time, 1));
  await page.keyboard.press("Shift+ArrowRight");
  check((await time(page)) === next && next > 1000 * there, `Shift and an arrow go to the next event, at ${next / 1000} s`);
  await page.waitForFunction(() => document.querySelector(".events [aria-current]"));
}

/** Both trials at the same event. */
async function checkAlignment(page, { check, screenshot }) {
  await page.selectOption('.align select', "object_attached");
  await page.locator('input[type="number"]').fill("2");
  await page.locator('input[type="number"]').press("Enter");
  await page.waitForFunction(() => window.__proact.state.align?.occurrence === 2);
  const { zeros, expected, now } = await page.evaluate(() => {
    const { views, state } = window.__proact;
    const second = ({ timeline }) => timeline.events.filter(({ event }) => event === "object_attached")[1].time;
    return { zeros: views.map((view) => view.zero), expected: views.map(second), now: state.time };
  });
  check(now === 0 && zeros[0] === expected[0] && zeros[1] === expected[1], `both stand at their second contact, ${zeros.join(" and ")} ms`);
  check(zeros[0] !== zeros[1], "which was at different times");
  await page.waitForFunction(() => [...document.querySelectorAll(".facts.now")].every((node) => node.textContent.includes("last: Contact made")));
  check(true, "and say so");
  await page.click('button[aria-label="Zoom in"]');
  await page.click('button[aria-label="Zoom in"]');
  const part = await page.evaluate(() => window.__proact.state.window);
  check(part[0] < 0 && part[1] > 0, `zoomed to ${part.map((ms) => (ms / 1000).toFixed(1)).join(" to ")} s about it`);
  await page.click('button:text-is("One below the other")');
  const tops = await page.evaluate(() => window.__proact.views.map(({ root }) => root.getBoundingClientRect().top));
  check(tops[1] > tops[0], "the second is below the first");
  await page.click('button:text-is("Side by side")');
  await page.locator('input[type="number"]').fill("99");
  await page.locator('input[type="number"]').press("Enter");
  await page.waitForFunction(() => document.querySelector(".notice").textContent.includes("of these events"));
  check(true, "that there are not so many is said");
  await page.locator('input[type="number"]').fill("2");
  await page.locator('input[type="number"]').press("Enter");
  await page.waitForFunction(() => window.__proact.state.align.occurrence === 2);
  await screenshot("aligned");
}

/** Playing, slowly too. */
async function checkPlayback(page, { check }) {
  for (const [speed, most] of [["0.1×", 0.1], ["4×", 4]]) {
    await page.selectOption('select[aria-label="Speed"]', speed);
    const begin = await page.evaluate(() => ({ time: window.__proact.state.time, wall: performance.now() }));
    await page.click('button:text-is("Play")');
    await page.waitForFunction((before) => window.__proact.state.time > before + 60, begin.time);
    const end = await page.evaluate(() => ({ time: window.__proact.state.time, wall: performance.now() }));
    await page.click('button:text-is("Pause")');
    const rate = (end.time - begin.time) / (end.wall - begin.wall);
    check(rate > 0 && rate <= most, `at ${speed} a second of the trial takes no less than ${(1 / most).toFixed(2)} s: ${rate.toFixed(3)} s a second`);
  }
  await page.selectOption('select[aria-label="Speed"]', "0.5×");
  await page.evaluate(() => document.activeElement.blur());
  await page.keyboard.press("Space");
  await page.waitForFunction(() => window.__proact.state.playing);
  await page.keyboard.press("Space");
  check(!(await page.evaluate(() => window.__proact.state.playing)), "Space plays and pauses");
}

/** A PNG that can be decoded, an SVG with its labels, a video. */
async function checkSavedFiles(page, { check, keep }) {
  const png = await keep(await download(page, () => page.click('button:text-is("Save PNG")')), "replay-export.png");
  const { width, height, shades } = await page.evaluate(async (bytes) => {
    const picture = await createImageBitmap(new Blob([Uint8Array.from(atob(bytes), (c) => c.charCodeAt(0))], { type: "image/png" }));
    const canvas = new OffscreenCanvas(picture.width, picture.height);
    const context = canvas.getContext("2d");
    context.drawImage(picture, 0, 0);
    // The middle of the first scene: a picture without it would be of one colour there.
    const { data } = context.getImageData(200, 200, 1400, 300);
    return { width: picture.width, height: picture.height, shades: new Set(new Uint32Array(data.buffer)).size };
  }, png.toString("base64"));
  check(width > 3000 && height > 1500 && shades > 100, `a PNG is saved: ${width} x ${height}, the scene in ${shades} shades`);
  const svg = await keep(await download(page, () => page.click('button:text-is("Save SVG")')), "replay-export.svg");
  const { error, texts, lines, scenes } = await page.evaluate((text) => {
    const parsed = new DOMParser().parseFromString(text, "image/svg+xml");
    return {
      error: parsed.querySelector("parsererror")?.textContent ?? null,
      texts: [...parsed.querySelectorAll("text")].map((node) => node.textContent),
      lines: parsed.querySelectorAll("polyline").length,
      scenes: parsed.querySelectorAll("image").length,
    };
  }, svg.toString());
  check(error === null && scenes === 2 && lines > 50, `an SVG is saved: ${svg.length} bytes, ${lines} lines`);
  for (const label of ["Time from: contact made 2 (s)", "Joint angles, between the joint's limits; dashed where a plan ends"]) {
    check(texts.includes(label), `it says "${label}"`);
  }
  check(texts.some((text) => /^Elbow flexion\/extension [\d.−]+°$/.test(text)), "and the joints by name with their angles");
  await page.click('button:text-is("Record video")');
  await page.waitForTimeout(1_500);
  const video = await keep(await download(page, () => page.click('button:text-is("Stop and save")')), "replay-export.webm");
  check(video.readUInt32BE(0) === 0x1a45dfa3 && video.length > 1_000, `a video is saved: ${video.length} bytes`);
}

/** The address opens the same moment on another page. */
async function checkLink(page, { check, tab }) {
  await page.click('button[aria-label="Zoom in"]');
  await page.click('button:text-is("Free")');
  const scene = await page.locator(".trial:first-child .view canvas").boundingBox();
  await page.mouse.move(scene.x + scene.width / 2, scene.y + scene.height / 2);
  await page.mouse.down();
  await page.mouse.move(scene.x + scene.width / 3, scene.y + scene.height / 2, { steps: 5 });
  await page.mouse.up();
  const place = () => Object.values(window.__proact.views[0].stage.cameras.freeCameraPose).flat();
  const apart = (a, b) => Math.max(...a.map((value, k) => Math.abs(value - b[k])));
  // A camera that was let go of comes to rest by and by, in as many pictures as that takes.
  let eye = await page.evaluate(place);
  for (let before = null; before === null || apart(before, eye) > 1e-4; eye = await page.evaluate(place)) {
    before = eye;
    await page.waitForTimeout(1_000);
  }
  await page.click('button:text-is("Copy link")');
  await page.waitForFunction(() => document.querySelector(".notice").textContent.includes("link"));
  const moment = () => {
    const { state, views } = window.__proact;
    const { camera, speed, hidden, align, window: part } = state;
    return JSON.stringify({ time: Math.round(state.time), camera, speed, hidden, align, part: part.map(Math.round), zeros: views.map((view) => view.zero) });
  };
  const here = await page.evaluate(moment);
  check(here.includes('"camera":"free"') && here.includes('"hidden":["gesture"]'), "the moment has a camera and a filter of its own");
  const other = await tab({ viewport: { width: 1000, height: 700 } });
  await other.goto(page.url());
  await loaded(other, 2);
  await other.waitForTimeout(500);
  const there = await other.evaluate(moment);
  check(there === here, `the link opens the same moment: ${there}, was ${here}`);
  const off = apart(eye, await other.evaluate(place));
  check(off < 0.005, `from the same place: ${off} m apart`);
  await other.close();
}

async function download(page, act) {
  const [file] = await Promise.all([page.waitForEvent("download"), act()]);
  return file;
}
