// A report beside `proact analyze TRIALS --page`: legible in both colours and three widths, and each trial leads to its replay.

import { checkWithAxe } from "./accessibility.mjs";

const SIZES = [[1280, 720], [820, 1180], [390, 844]];

export async function report(page, tools) {
  const { url, check, screenshot } = tools;
  const look = await checkWithAxe(page, tools);
  const open = () => page.goto(new URL("report", url).href);
  await open();
  const styled = () => page.evaluate(() => getComputedStyle(document.querySelector("main")).maxWidth);
  check((await styled()) === "960px", "its own style is in force");
  const figures = await page.locator("figure svg").count();
  check(figures > 5, `${figures} figures`);
  for (const scheme of ["light", "dark"]) {
    await page.emulateMedia({ colorScheme: scheme });
    for (const [width, height] of SIZES) {
      await page.setViewportSize({ width, height });
      const wide = await page.evaluate(() => document.documentElement.scrollWidth - innerWidth);
      check(wide <= 0, `nothing leaves the window of ${width} px, ${scheme}`);
      await look(`report ${width} ${scheme}`);
    }
    await screenshot(`report-${scheme}`);
  }
  await page.emulateMedia({ colorScheme: null });
  await page.setViewportSize({ width: 1280, height: 720 });

  const links = page.locator('#table-trials a[href^="replay"]');
  const rows = await page.locator("#table-trials tbody tr").count();
  check(rows > 1 && (await links.count()) === rows, `each of the ${rows} trials has a link`);
  const replayed = [];
  for (let row = 0; row < 2; row++) {
    await open();
    const cells = await page.locator("#table-trials tbody tr").nth(row).locator("td").allTextContents();
    await links.nth(row).click();
    await page.waitForFunction(() => window.__proact?.views.length === 1 && window.__proact.views[0].timeline);
    const record = await page.evaluate(() => {
      const { name, method, seconds, score } = window.__proact.views[0].timeline.record;
      return { name, method, seconds: seconds.toFixed(1), score: String(score) };
    });
    const [who, method, trial, , score, seconds] = cells;
    check(record.name === `${who} ${method} trial ${trial}`, `the link of ${who} ${method} ${trial} leads to ${record.name}`);
    check(record.score === score && record.seconds === seconds, `with its score ${score} and its ${seconds} s`);
    check((await page.textContent(".trial .chip")) === "Digest agrees", "recomputed with the recorded digest");
    replayed.push(record.method);
  }
  check(replayed[0] !== replayed[1], "two links lead to two trials");
  await screenshot("report-replay");
}
