// Windows of all sizes: nothing overlaps, nothing leaves the window, and the scene keeps a place of its own.

/** Width and height of the window in pixels of the screen, and zoom in percent. */
const SIZES = [
  [320, 640, 100],
  [390, 844, 100],
  [800, 600, 100],
  [844, 390, 100],
  [1024, 768, 100],
  [1280, 720, 100],
  [1280, 720, 200],
  [1280, 720, 400],
  [1920, 1080, 100],
  [1920, 1080, 300],
  [2560, 1440, 100],
  [3840, 2160, 100],
];
/** Rounding of the browser's own, CSS pixels. */
export const SLACK_PX = 1.5;

/** What is wrong with the layout of the participant's page as it stands; runs in the page. There may be no clock or no hint. */
export function layoutFaults({ slack, timed = true, hinted = true }) {
  const found = [];
  const name = (node) => `.${node.className.split(" ").join(".")}`;
  const within = (inner, outer) =>
    inner.left >= outer.left - slack && inner.right <= outer.right + slack && inner.top >= outer.top - slack && inner.bottom <= outer.bottom + slack;
  const screen = { left: 0, top: 0, right: innerWidth, bottom: innerHeight };
  if (document.documentElement.scrollWidth > innerWidth) found.push("the page scrolls sideways");
  /** The part of a box that what scrolls around it shows. */
  const seen = (node) => {
    let { left, top, right, bottom } = node.getBoundingClientRect();
    for (let around = node.parentElement; around; around = around.parentElement) {
      const { overflowY } = getComputedStyle(around);
      if (overflowY !== "auto" && overflowY !== "scroll") continue;
      const box = around.getBoundingClientRect();
      if (left < box.left - slack || right > box.right + slack) found.push(`${name(node)} is cut off at a side`);
      [top, bottom] = [Math.max(top, box.top), Math.min(bottom, box.bottom)];
    }
    return { left, top, right, bottom };
  };
  // What a folded card hides has boxes all the same.
  const shown = (node) => node.checkVisibility() && node.getClientRects().length > 0;
  const cards = [...document.querySelectorAll(".hud .card, .hud .stop-banner")]
    .filter(shown)
    .map((node) => ({ node, box: seen(node) }))
    .filter(({ box }) => box.bottom - box.top > 1);
  for (const { node, box } of cards) {
    if (!within(box, screen)) found.push(`${name(node)} leaves the window`);
    // No text runs out of its card.
    const whole = node.getBoundingClientRect();
    for (const part of node.querySelectorAll("*")) {
      if (shown(part) && !part.closest(".only-heard") && !within(part.getBoundingClientRect(), whole)) {
        found.push(`${name(part)} runs out of ${name(node)}`);
      }
    }
  }
  const apart = (a, b) => a.right <= b.left + slack || b.right <= a.left + slack || a.bottom <= b.top + slack || b.bottom <= a.top + slack;
  cards.forEach(({ node, box }, k) => {
    for (const other of cards.slice(k + 1)) {
      if (!node.contains(other.node) && !apart(box, other.box)) found.push(`${name(node)} covers ${name(other.node)}`);
    }
  });
  const { content, project } = window.__proact;
  const view = document.querySelector(".view").getBoundingClientRect();
  for (const what of ["object", "target"]) {
    content.scene.objects.forEach((_, id) => {
      const at = project(what, id);
      if (at && !(at.x > view.left && at.x < view.right && at.y > view.top && at.y < view.bottom)) {
        found.push(`${what} ${id} is outside the scene's place`);
      }
    });
  }
  if (timed && !shown(document.querySelector(".clock"))) found.push("no clock");
  if (hinted && !shown(document.querySelector(".hint"))) found.push("no hint");
  return found;
}

export async function layout(page, { url, check, screenshot, limitMs }) {
  const address = new URL("?quality=3&tutorial=0&pictures=4", url).href;
  const ready = (tab) => tab.waitForFunction(() => window.__proact?.connected && window.__proact.framesDrawn > 3, null, { timeout: limitMs });
  await page.goto(address);
  await ready(page);
  for (const method of ["D", "B"]) {
    await page.evaluate((name) => document.querySelectorAll(".methodbutton").forEach((node) => node.textContent === name && node.click()), method);
    await page.waitForFunction((name) => window.__proact.frame?.method === name, method);
    for (const [width, height, zoom] of SIZES) {
      await page.setViewportSize({ width: Math.round((100 * width) / zoom), height: Math.round((100 * height) / zoom) });
      // Cards find their places, then a picture is drawn from the camera's.
      await page.waitForTimeout(700);
      await page.waitForFunction((drawn) => window.__proact.framesDrawn > drawn + 1, await page.evaluate(() => window.__proact.framesDrawn));
      const found = await page.evaluate(layoutFaults, { slack: SLACK_PX });
      if (found.length > 0) await screenshot(`fault-${width}x${height}-${zoom}`);
      check(found.length === 0, `method ${method}, ${width}x${height} at ${zoom} %: ${found.length ? found.join("; ") : "all in its place"}`);
      if (method === "D") await screenshot(`${width}x${height}-${zoom}`);
      if (width === 3840) {
        const size = await page.evaluate(() => Number.parseFloat(getComputedStyle(document.querySelector(".hint")).fontSize));
        check(size >= 24, `and the hint is ${size} px tall there`);
      }
    }
  }
  await unfolded(page, { check, screenshot });
  await touched(page, { address, ready, check });
  await dark(page, { url, check, screenshot });
  await plain(page, { url, check });
}

/** Here the processor computes the pictures, and nobody asked for a quality: they have fewer points than the window from the start. */
async function plain(page, { url, check }) {
  const share = async (query) => {
    await page.goto(new URL(`?tutorial=0&pictures=4${query}`, url).href);
    await page.waitForFunction(() => window.__proact?.framesDrawn > 0);
    return page.evaluate(() => document.getElementById("scene").width / document.getElementById("scene").clientWidth);
  };
  const [own, best] = [await share(""), await share("&quality=1")];
  check(own < 0.7 && best === 1, `drawn by the processor, a picture has ${own.toFixed(2)} of the window's width; asked for the best, ${best}`);
}

/** Folded cards open where one asks for it, and still nothing is covered. */
async function unfolded(page, { check, screenshot }) {
  await page.setViewportSize({ width: 390, height: 844 });
  await page.waitForFunction(() => [...document.querySelectorAll("details")].every((card) => !card.open));
  for (const card of ["brand", "status", "log"]) await page.click(`.${card} > summary`);
  await page.waitForTimeout(500);
  const found = await page.evaluate(layoutFaults, { slack: SLACK_PX });
  await screenshot("unfolded");
  check(found.length === 0, `with all cards unfolded: ${found.join("; ") || "all in its place"}`);
  await page.click('button:text-is("Settings")');
  const box = await page.locator(".settings").boundingBox();
  await screenshot("settings-narrow");
  check(box.x >= 0 && box.x + box.width <= 390 && box.y >= 0 && box.y + box.height <= 844, "the settings fit a telephone");
  const sideways = await page.locator(".settings").evaluate((node) => node.scrollWidth - node.clientWidth);
  check(sideways <= 1, "and scroll in one direction only");
  await page.keyboard.press("Escape");
}

/** A finger is gaze on the scene, and gesture on a button for as long as it stays. */
async function touched(page, { address, ready, check }) {
  const context = await page.context().browser().newContext({ viewport: { width: 390, height: 844 }, hasTouch: true, isMobile: true });
  await page.goto("about:blank");
  const phone = await context.newPage();
  await phone.goto(address);
  await ready(phone);
  await phone.locator('.wheel:has-text("You drive")').waitFor();
  const line = await context.newCDPSession(phone);
  const touch = (type, points) => line.send("Input.dispatchTouchEvent", { type, touchPoints: points });
  const at = await phone.evaluate(() => window.__proact.project("object", 0));
  await touch("touchStart", [at]);
  await touch("touchEnd", []);
  await phone.waitForFunction(() => window.__proact.frame.gaze !== null);
  check(true, "a finger on the scene is the gaze");
  const { x, y, width, height } = await phone.locator(".gesture.hand_close").boundingBox();
  check(width >= 24 && height >= 24, `a gesture's button is ${Math.round(width)} by ${Math.round(height)} px`);
  await touch("touchStart", [{ x: x + width / 2, y: y + height / 2 }]);
  await phone.waitForFunction(() => window.__proact.frame.gesture === "hand_close");
  await touch("touchEnd", []);
  await phone.waitForFunction(() => window.__proact.frame.gesture === "no_motion");
  check(true, "a finger on a button is its gesture until it is lifted");
  await context.close();
}

/** Dark where the system is dark, on all pages. */
async function dark(page, { url, check, screenshot }) {
  await page.setViewportSize({ width: 1280, height: 720 });
  for (const path of ["?quality=3&tutorial=0&pictures=4", "experimenter?quality=3"]) {
    for (const scheme of ["light", "dark"]) {
      await page.emulateMedia({ colorScheme: scheme });
      await page.goto(new URL(path, url).href);
      await page.waitForFunction(() => window.__proact?.framesDrawn > 3);
      const card = await page.evaluate(() => getComputedStyle(document.querySelector(".card, .pane:not(.view)")).backgroundColor);
      const brightness = Math.max(...card.match(/\d+/g).slice(0, 3).map(Number));
      await screenshot(`${path.split("?")[0] || "page"}-${scheme}`);
      check(scheme === "dark" ? brightness < 80 : brightness > 200, `${path.split("?")[0] || "page"} is ${scheme}: cards are ${card}`);
    }
  }
  await page.emulateMedia({ colorScheme: null });
}
