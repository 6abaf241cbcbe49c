// The page of EMG beside `proact serve --emg-source synthetic --emg-model FILE`: traces that move, posteriors that follow a prompted
// gesture, channels by key, 64 channels as a raster, nothing against WCAG, in light and dark.

import { checkWithAxe } from "./accessibility.mjs";

const SIZES = [[1280, 720], [820, 1180], [390, 844]];
/** Channels of the grid that the page is shown in the place of the armband's. */
const GRID = 64;
/** Samples of which the program sends the lowest and the highest value, at so many channels and 1 kHz. */
const BLOCK = 16;

export async function emg(page, tools) {
  const { url, check, tab } = tools;
  const address = new URL("/emg", url).href;
  await page.goto(address);
  await page.locator(".emgview:not([hidden]) .bars li").first().waitFor();
  const before = await picture(page);
  await page.waitForTimeout(500);
  check((await picture(page)) !== before, "the traces move");
  const channels = await page.locator(".channels li").count();
  check(channels === 8, `${channels} channels, each with a light`);
  const words = await page.locator(".channels .word").allTextContents();
  check(words.every((word) => word.length > 3), `the lights say in words: ${words.join(", ")}`);
  check((await posterior(page)).some((share) => share > 50), "a posterior is shown");
  const sum = (await posterior(page)).reduce((total, share) => total + share, 0);
  check(Math.abs(sum - 100) <= 3, `posteriors add up to ${sum} %`);
  await byKey(page, check);
  await checkFreeze(page, check);
  await checkPosterior(page, await tab({ viewport: { width: 640, height: 480 } }), tools);
  await sizes(page, tools, "emg");
  await highDensityGrid(await tab({ viewport: { width: 1280, height: 720 } }), address, tools);
  await withoutArmband(await tab({ viewport: { width: 1280, height: 720 } }), address, tools);
}

const picture = (page) => page.locator(".pictures canvas").first().evaluate((canvas) => canvas.toDataURL());

async function posterior(page) {
  const texts = await page.locator(".bars .percent").allTextContents();
  return texts.map((text) => Number.parseInt(text, 10));
}

/** Arrow keys choose the channel, with the focus nowhere and in the list. */
async function byKey(page, check) {
  const title = () => page.locator(".spectrumpart h2").textContent();
  await page.keyboard.press("ArrowDown");
  await page.keyboard.press("ArrowDown");
  check((await title()) === "Spectrum of channel 3", `two keys down: ${await title()}`);
  check((await page.locator('.channels [aria-selected="true"]').getAttribute("aria-label")).startsWith("Channel 3:"), "the list says so too");
  await page.locator(".channels").focus();
  await page.keyboard.press("End");
  check((await title()) === "Spectrum of channel 8", `the last channel: ${await title()}`);
  await page.waitForFunction(() => /Median frequency \d+ Hz/.test(document.querySelector(".spectrumpart p")?.textContent ?? ""));
  check(true, "its spectrum has a median frequency");
}

/** F stops the picture, and lets it go on. */
async function checkFreeze(page, check) {
  await page.keyboard.press("f");
  await page.waitForTimeout(200);
  // Not the canvas's bytes: a browser that is asked for them often goes on drawing by other means.
  const edge = () => page.evaluate(() => window.__proact.view.edge);
  const still = await edge();
  await page.waitForTimeout(400);
  check((await edge()) === still, "F freezes the picture");
  await page.keyboard.press("f");
  await page.waitForFunction(() => document.querySelector("header .muted")?.textContent === "live");
  await page.waitForFunction((old) => window.__proact.view.edge > old, still);
  check(true, "and lets it go on");
}

/** A key on the participant's page prompts the simulated person, whose gesture is shown. */
async function checkPosterior(page, driver, { url, check, screenshot }) {
  await driver.goto(new URL("?quality=3&tutorial=0&pictures=4", url).href);
  await driver.waitForFunction(() => window.__proact?.framesDrawn > 2);
  await driver.keyboard.down("KeyA");
  const made = (name) => page.waitForFunction((wanted) => document.querySelector(".inforce")?.textContent === wanted, name, { timeout: 20_000, polling: 100 });
  await made("Hand close");
  const now = await page.locator(".bars .now").textContent();
  check(/Hand close\s*\d+ %\s*in force/.test(now), `the gesture in force is marked in words: ${now}`);
  await page.waitForFunction(() => Number.parseInt(document.querySelector(".effort .percent")?.textContent ?? "0", 10) > 10);
  check(true, `effort ${await page.locator(".effort .percent").textContent()}`);
  await page.waitForTimeout(1500);
  await screenshot("emg-hand-close");
  await driver.keyboard.up("KeyA");
  await made("No motion");
  check(true, "and with the key the gesture ends");
  await driver.close();
}

async function sizes(page, tools, name) {
  const look = await checkWithAxe(page, tools);
  for (const scheme of ["light", "dark"]) {
    await page.emulateMedia({ colorScheme: scheme });
    for (const [width, height] of SIZES) {
      await page.setViewportSize({ width, height });
      await page.waitForTimeout(400);
      const wide = await page.evaluate(() => document.documentElement.scrollWidth - innerWidth);
      tools.check(wide <= 0, `nothing leaves the window of ${width} px, ${scheme}`);
      if (width === 1280) {
        const high = await page.evaluate(() => document.documentElement.scrollHeight - innerHeight);
        tools.check(high <= 0, `all is in sight in ${width} x ${height}`);
      }
      await look(`${name} ${width} ${scheme}`);
      await tools.screenshotOf(page, `${name}-${width}-${scheme}`);
    }
  }
}

/** The armband's messages on their way to the page, changed by `change`. */
async function changed(page, change) {
  await page.routeWebSocket(/\/live/, (socket) => {
    const server = socket.connectToServer();
    server.onMessage((message) => {
      const parsed = JSON.parse(message);
      socket.send(parsed.type === "signals" ? JSON.stringify(change(parsed)) : message);
    });
  });
}

/** As the program thins a dense stream. */
function lowestAndHighest(rows) {
  return Array.from({ length: Math.floor(rows.length / BLOCK) }, (_, k) => rows.slice(k * BLOCK, (k + 1) * BLOCK)).flatMap((block) => [Math.min, Math.max].map((most) => block[0].map((_, channel) => most(...block.map((row) => row[channel])))));
}

/** 64 channels: a raster, a grid of channels by keys, faults by name. */
async function highDensityGrid(page, address, tools) {
  const { check } = tools;
  const wide = (row) => Array.from({ length: GRID }, (_, k) => (k === 20 ? 0 : row[k % row.length] * (0.3 + 0.7 * Math.abs(Math.cos(k / 9)))));
  await changed(page, (signals) => ({
    ...signals,
    emg: lowestAndHighest(signals.emg.map(wide)),
    emg_row_hz: (2 * signals.emg_row_hz) / BLOCK,
    // All but channel 11, whose turn has not come.
    spectra: Array.from({ length: GRID }, (_, channel) => ({ channel, step_hz: 3.90625, density: Array.from({ length: 256 }, (_, k) => (k === channel ? 1 : 0)) })).filter(({ channel }) => channel !== 10),
    lights: Array.from({ length: GRID }, (_, k) => (k === 20 ? "red" : k > 40 && k < 44 ? "amber" : "green")),
    faults: Array.from({ length: GRID }, (_, k) => (k === 20 ? "flat" : k > 40 && k < 44 ? "mains" : null)),
  }));
  await page.goto(address);
  await page.locator(".emgview.many .channels li").nth(GRID - 1).waitFor();
  const verdict = await page.locator(".verdict").textContent();
  check(/Flat: channel 21\..*Mains hum: channels 42, 43, 44\./.test(verdict), `faults by name: ${verdict}`);
  await page.keyboard.press("ArrowDown");
  await page.keyboard.press("ArrowRight");
  check((await page.locator(".spectrumpart h2").textContent()) === "Spectrum of channel 10", "a row down and one to the right is channel 10");
  await page.waitForFunction(() => /^Median frequency 3\d Hz; lines 3\.9 Hz apart/.test(document.querySelector(".spectrumpart p")?.textContent ?? ""));
  check(true, "the spectrum that the program took of the channel is shown");
  await page.keyboard.press("ArrowRight");
  check((await page.locator(".spectrumpart p").textContent()).startsWith("The spectrum of this channel comes"), "one that has not come yet is waited for");
  await page.keyboard.press("ArrowLeft");
  const before = await picture(page);
  await page.waitForTimeout(500);
  check((await picture(page)) !== before, "the raster moves");
  await page.waitForTimeout(4000);
  await sizes(page, tools, "emg-64");
}

/** Without an armband the page says how to get one. */
async function withoutArmband(page, address, { check, screenshotOf }) {
  await changed(page, (signals) => ({ ...signals, emg: [], emg_rate_hz: 0, emg_row_hz: 0, lights: [], faults: [], recognition: null }));
  await page.goto(address);
  const said = page.locator(".card:not([hidden])");
  await said.waitFor();
  check((await said.textContent()).includes("proact serve --emg-source synthetic"), `without an armband: ${await said.textContent()}`);
  await screenshotOf(page, "emg-none");
}
