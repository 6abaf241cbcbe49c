// The page of tracking beside `proact serve --mocap ..`: figures that live, a picture, nothing against WCAG, in three sizes.

import { checkWithAxe } from "./accessibility.mjs";

const SIZES = [[1440, 900], [820, 1180], [360, 740]];

export async function tracking(page, tools) {
  const { url, check, screenshot } = tools;
  const look = await checkWithAxe(page, tools);
  await page.goto(new URL("/tracking", url).href);
  await page.locator(".verdict").first().waitFor();
  const cell = (name) => page.locator(`dt:text-is("${name}") + dd`).first().textContent();
  await page.waitForFunction(() => document.querySelector(".verdict")?.textContent.startsWith("Good"), null, { timeout: 20_000 });
  const rate = Number.parseFloat(await cell("Rate"));
  check(rate > 30, `a rate of ${rate} Hz`);
  check(/^\d+ ms$/.test(await cell("Age")), `an age: ${await cell("Age")}`);
  await page.waitForFunction(() => /^\d+ ms behind/.test(document.querySelector("dl")?.textContent.match(/Lag(.*?)Jitter/)?.[1] ?? ""));
  check(/^\d+ ms$/.test(await cell("Jitter")), `a jitter: ${await cell("Jitter")}`);
  check(/in 10 s/.test(await cell("Drop-outs")), `drop-outs: ${await cell("Drop-outs")}`);
  check(/mm, .* degrees/.test(await cell("Noise")), `noise: ${await cell("Noise")}`);
  check((await cell("Calibration")).startsWith("none"), "that there is no calibration is said");
  check(/% of the box is reached/.test(await cell("In reach")), `what is in reach: ${await cell("In reach")}`);
  const before = await cell("In tracking");
  await page.waitForFunction((old) => ![...document.querySelectorAll("dd")].some((node) => node.textContent === old), before);
  check(true, "the body moves on the page");
  for (const scheme of ["light", "dark"]) {
    await page.emulateMedia({ colorScheme: scheme });
    for (const [width, height] of SIZES) {
      await page.setViewportSize({ width, height });
      await page.waitForTimeout(300);
      const wide = await page.evaluate(() => document.documentElement.scrollWidth - innerWidth);
      check(wide <= 0, `nothing leaves the window of ${width} px, ${scheme}`);
      await look(`tracking ${width} ${scheme}`);
      await screenshot(`tracking-${width}-${scheme}`);
    }
  }
}
