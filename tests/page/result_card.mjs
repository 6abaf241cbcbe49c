// What comes after a trial that was shown: a result card, the same once more, and the person's turn.

export async function resultCard(page, { url, check, screenshot, limitMs }) {
  const time = () => page.evaluate(() => window.__proact.frame.time);
  const card = page.getByRole("dialog").filter({ has: page.locator("table") });
  const shown = () => card.waitFor({ timeout: limitMs });
  await page.goto(new URL("?quality=3&tutorial=0&pictures=20", url).href);
  // Asked for in one go: a second question takes seconds on a busy machine.
  const drawn = await page.waitForFunction(() => window.__proact?.frame && window.__proact.framesDrawn > 0 && { time: window.__proact.frame.time });
  const first = (await drawn.jsonValue()).time;
  check(first < 5_000, `the trial waits for the page: ${first / 1000} s of it are over when it is drawn`);
  await shown();
  await screenshot("result");
  const text = (await card.textContent()) ?? "";
  for (const part of ["Simulated participant", "red", "blue", "cm", " m", " s"]) {
    check(text.toLowerCase().includes(part.toLowerCase()), `the result card has "${part}"`);
  }
  const end = await time();
  await card.getByRole("button", { name: "Watch again" }).click();
  await page.waitForFunction((end) => window.__proact.frame.time < end, end);
  check(await card.isHidden(), "Watch again begins the trial anew, without the card");
  await shown();
  check((await time()) === end, "and the same trial takes as long");
  await card.getByRole("button", { name: "Now you drive" }).click();
  await page.locator('.wheel:has-text("You drive")').waitFor();
  check(await page.evaluate(() => window.__proact.content.interactive), "Now you drive gives the arm to the page");
  await page.waitForTimeout(1500);
  const still = await time();
  await page.waitForTimeout(1500);
  check((await time()) === still, `time waits at ${still / 1000} s for the person's first action`);
  await page.mouse.move(640, 360);
  await page.waitForFunction((still) => window.__proact.frame.time > still, still);
  check(true, "and begins with it");
  await screenshot("drive");
}
