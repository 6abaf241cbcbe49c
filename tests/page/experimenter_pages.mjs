// The pages at a desk: experimenter, spectator, the replay of a bag.

/** Pauses, resumes and ends a trial, and sees the signals; a spectator has no buttons and is refused. */
export async function experimenter(page, { url, check, screenshot, limitMs }) {
  await page.goto(new URL("experimenter?quality=3", url).href);
  await page.waitForFunction(() => window.__proact?.framesDrawn > 3 && window.__proact.status !== null);
  check(true, "the experimenter's page connects and draws");
  await page.waitForFunction(() => window.__proact.channels === 8, null, { timeout: limitMs });
  check(true, "eight channels of EMG come in");
  await page.waitForFunction(() => document.querySelectorAll(".loglist li").length > 2, null, { timeout: limitMs });
  // The table of latencies needs somebody's screen.
  const screen = await page.context().newPage();
  await screen.goto(new URL("?quality=3", url).href);
  await screen.waitForFunction(() => window.__proact?.framesDrawn > 10);
  const stages = ["recognition", "emg", "world", "tick", "line", "picture"];
  await page.waitForFunction((names) => names.every((name) => document.querySelector(`.latencies .${name}`)), stages, { timeout: limitMs });
  const medians = Object.fromEntries(await page.$$eval(".latencies tbody tr", (rows) => rows.map((row) => [row.className, Number(row.cells[1].textContent)])));
  const sane = Object.values(medians).every((ms) => Number.isFinite(ms) && ms >= 0 && ms < 10_000);
  check(sane, `the table of latencies has times, ms: ${JSON.stringify(medians)}`);
  check(medians.recognition > 20, "a gesture takes at least a window to be recognised");
  check(medians.picture > 17, "a picture lies behind by what smooths it");
  await screen.close();
  await page.bringToFront();
  await page.waitForTimeout(2_500);
  await screenshot("experimenter");
  const time = () => page.evaluate(() => window.__proact.frame.time);
  await page.click('.actionsgrid button:text-is("Pause")');
  await page.waitForFunction(() => window.__proact.status.paused);
  await page.waitForTimeout(300);
  const paused = await time();
  await page.waitForTimeout(700);
  check((await time()) === paused, "a pause stops simulated time");
  await page.click('button:text-is("Resume")');
  await page.waitForFunction((before) => window.__proact.frame.time > before + 100, paused);
  check(true, "and it goes on");

  const spectator = await page.context().newPage();
  const refusals = [];
  spectator.on("console", (message) => refusals.push(message.text()));
  await spectator.goto(new URL("spectator?quality=3", url).href);
  await spectator.waitForFunction(() => window.__proact?.framesDrawn > 1);
  check((await spectator.locator(".actionsgrid button").count()) === 0, "a spectator has no buttons");
  await spectator.evaluate(() => window.__proact.live.send({ type: "study", action: "abort" }));
  const end = Date.now() + 10_000;
  while (!refusals.some((text) => text.includes("only watches")) && Date.now() < end) await spectator.waitForTimeout(50);
  check(refusals.some((text) => text.includes("only watches")), "and is refused what it sends all the same");
  await spectator.close();

  await page.click('button:text-is("End trial")');
  await page.waitForFunction(() => window.__proact.status.aborted);
  check(true, "the trial ends on request");
}

/** A bag of a trial that reached its four targets. */
export async function bag(page, { url, check, screenshot }) {
  await page.goto(new URL("replay?quality=3", url).href);
  await page.waitForFunction(() => window.__proact?.views.length === 1 && window.__proact.views[0].timeline);
  check((await page.textContent(".trial .chip")) === "From a bag", "it is said to be a bag");
  const facts = await page.textContent(".trial .state");
  check(facts.includes("4 of 4"), "its blocks end on their targets");
  const length = await page.evaluate(() => window.__proact.state.length);
  await page.locator('input[type="range"]').fill(String(Math.round(length / 20) * 10));
  await page.waitForFunction(() => window.__proact.state.time > 1000);
  await page.waitForTimeout(700);
  await screenshot("bag");
}
