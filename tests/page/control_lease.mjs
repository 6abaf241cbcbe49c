// Two pages and one arm: the first drives, the second watches, and "Take over" changes that in one step.

export async function controlLease(page, { url, check, screenshot }) {
  const address = new URL("?quality=3&tutorial=0&pictures=20", url).href;
  const ready = (tab) => tab.waitForFunction(() => window.__proact?.connected && window.__proact.framesDrawn > 3);
  const says = (tab, text) => tab.locator(`.wheel:has-text("${text}")`).waitFor();
  const gesture = (tab) => tab.evaluate(() => window.__proact.frame.gesture);
  const seconds = () => page.waitForTimeout(600);
  // A page of another person: nothing of the first one's is kept there.
  const other = await (await page.context().browser().newContext({ viewport: { width: 1280, height: 720 } })).newPage();
  await page.goto(address);
  await ready(page);
  await says(page, "You drive");
  await other.goto(address);
  await ready(other);
  await page.click('button:text-is("Settings")');
  await page.fill('input[name="name"]', "Ann");
  await page.click('button:text-is("Close")');
  await says(other, "Ann drives. You watch.");
  check(true, "the second page says by name who drives");
  await screenshot("drives");

  await other.bringToFront();
  await other.mouse.move(700, 400);
  await other.keyboard.down("KeyW");
  await seconds();
  check((await gesture(other)) === "no_motion", "a key on the page that watches does nothing");
  await other.keyboard.up("KeyW");
  check((await other.locator(".pad").isVisible()) === false, "and it shows no buttons for gestures");

  await page.bringToFront();
  await page.mouse.move(700, 400);
  await page.keyboard.down("KeyA");
  await page.waitForFunction(() => window.__proact.frame.gesture === "hand_close");
  await other.evaluate(() => document.querySelector(".wheel button").click());
  await says(other, "You drive");
  await says(page, "drives. You watch.");
  await page.waitForFunction(() => window.__proact.frame.gesture === "no_motion");
  check(true, "a take-over lets go of what the first page held");
  check(((await page.textContent(".toast")) ?? "").includes("has taken over"), "and the first page is told so");
  await seconds();
  check((await gesture(page)) === "no_motion", "its key, still held, does nothing");
  await page.keyboard.up("KeyA");
  await screenshot("watches");

  await other.context().close();
  await says(page, "Nobody drives");
  await page.click('.wheel button:text-is("Drive")');
  await says(page, "You drive");
  await page.mouse.move(720, 420);
  await page.keyboard.down("KeyA");
  await page.waitForFunction(() => window.__proact.frame.gesture === "hand_close");
  await page.keyboard.up("KeyA");
  check(true, "who is left drives when asked to");
  await page.reload();
  await ready(page);
  await says(page, "You drive");
  check(true, "and after a reload without being asked");
}
