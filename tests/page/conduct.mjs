// Conducting a study on the experimenter's page: by keys alone, by mouse alone, in three sizes of window, in light and dark.
// Nothing that was pressed changes the page before the server says so.

import { checkWithAxe } from "./accessibility.mjs";
import { screenAtStep, screenBetweenSessions, CHECKS, form, SPEECH, studySocket, trial } from "./conduct_mock.mjs";

/** A button takes no press for so long after it has come to mean something else, ms; see conductBar.ts. */
const SETTLING_MS = 600;
const WELCOME = screenAtStep('spoken text "welcome"', { is: "say", text: SPEECH });
const READY_CAN = ["next", "start_anyway", "redo", "retrain", "recalibrate", "skip", "leave"];
const READY = screenAtStep("trial 2 of C", trial(), { running: false, can: READY_CAN, notice: "gaze is not ready", notes: ["Armband moved up"] });
const RUNNING = screenAtStep("trial 2 of C", trial(), { can: ["pause", "abort"], since_secs: 31 });
const REST = (left_secs) => screenAtStep("break", { is: "rest", left_secs });
const FORM = (answers) => screenAtStep("questionnaire nasa_tlx", form(10, answers));

export async function conduct(page, tools) {
  const { url, check, screenshot } = tools;
  const socket = await studySocket(page);
  await page.goto(new URL("experimenter?quality=3", url).href);
  await page.waitForFunction(() => window.__proact?.framesDrawn > 3 && window.__proact.status !== null);
  check((await page.locator(".conduct").count()) === 0, "without a study the page has no pane for one");
  check(await page.getByRole("button", { name: "New trial" }).isVisible(), "and begins trials as one likes");
  const show = async (screen) => {
    socket.show(screen);
    await page.waitForTimeout(SETTLING_MS + 200);
  };
  const asked = async (what, wanted) => {
    const end = Date.now() + 5000;
    while (socket.asked.length < wanted.length && Date.now() < end) await page.waitForTimeout(20);
    // What is too much would follow at once.
    await page.waitForTimeout(150);
    check(JSON.stringify(socket.asked) === JSON.stringify(wanted), `${what}: ${JSON.stringify(socket.asked)}`);
    socket.asked = [];
  };
  const hands = { page, socket, show, asked, check, button: (name) => page.getByRole("button", { name, exact: true }) };
  await show(screenBetweenSessions());
  check((await page.locator("#desk > section").first().getAttribute("class")).includes("conduct"), "a study's pane comes first");
  for (const name of ["New trial", "Reset objects", "D"]) check((await hands.button(name).count()) === 0, `the plan decides, not ${name}`);
  await byKeys(hands);
  await byMouse(hands);
  await checkClocks(hands);
  await fillInForm(hands, screenshot);
  await planChange(hands);
  await connectionLoss(hands, screenshot);
  await sizes(hands, screenshot);
  await rules(hands, tools, screenshot);
}

/** Tab, Enter, Space, arrows and the single keys; the mouse is never used. */
async function byKeys({ page, socket, show, asked, check, button }) {
  const { keyboard } = page;
  const focused = () => page.evaluate(() => document.activeElement?.textContent ?? "");
  const tabTo = async (name) => {
    for (let k = 0; k < 60; k++) {
      if ((await focused()).startsWith(name)) return;
      await keyboard.press("Tab");
    }
    throw new Error(`Tab never came to ${name}`);
  };
  await tabTo("Continue session");
  await keyboard.press("Enter");
  await asked("Enter begins for whoever is next", [{ type: "conduct", ask: "begin", id: "P03" }]);
  check(await button("Continue session").isVisible(), "and the page waits until the server says so");

  await show(WELCOME);
  check((await page.textContent(".speech")).includes("without a reason"), "what is to be said is there");
  await keyboard.press("n");
  await keyboard.press("n");
  await asked("N is the next step, and pressed twice it is still one", [{ type: "conduct", ask: "next" }]);
  socket.show(READY);
  await keyboard.press("n");
  await asked("who presses while another step comes begins nothing", []);
  await page.waitForTimeout(SETTLING_MS + 200);
  for (const name of ["Start trial", "Start anyway", "Redo last trial", "Train again", "Calibrate gaze again", "Skip", "End for today", "Add note"]) {
    await tabTo(name);
  }
  check(true, "Tab comes to every button");

  await keyboard.press("t");
  await page.keyboard.type("next time put a towel on the chair");
  await asked("letters in a note are letters", []);
  await keyboard.press("Control+Enter");
  const text = "next time put a towel on the chair";
  await asked("Control and Enter add the note", [{ type: "conduct", ask: "note", text }]);
  check((await page.inputValue(".notes textarea")) === text, "it stays in the field until it is kept");
  await show({ ...READY, notes: [...READY.notes, text] });
  check((await page.inputValue(".notes textarea")) === "", "and leaves it then");
  check((await page.locator(".notelist li").first().textContent()) === text, "the newest note is the first");
  await keyboard.press("Escape");

  await tabTo("Skip");
  await keyboard.press("Enter");
  const inside = () => page.evaluate(() => document.activeElement?.closest("dialog.ask") !== null);
  check(await inside(), "a dialog asks for the reason, and has the focus");
  check(await button("Skip").last().isDisabled(), "without a reason it does not go on");
  await keyboard.press("n");
  await asked("N means nothing there", []);
  for (let k = 0; k < 12; k++) await keyboard.press("Tab");
  check(await page.evaluate(() => document.activeElement === document.body || document.activeElement?.closest("dialog") !== null), "the focus stays inside");
  await keyboard.press("Escape");
  check(await page.locator("dialog.ask").isHidden(), "Escape closes it");
  await asked("and nothing is skipped", []);
  await tabTo("Skip");
  await keyboard.press("Enter");
  await keyboard.press("Space");
  await keyboard.press("ArrowDown");
  await keyboard.press("Enter");
  await asked("arrows choose a reason, Enter takes it", [{ type: "conduct", ask: "skip", reason: "no time left" }]);

  await show(RUNNING);
  await keyboard.press("p");
  await asked("P pauses", [{ type: "study", action: "pause" }]);
  await button("Resume").waitFor();
  check((await page.textContent(".livetrial")).startsWith("Paused"), "what the trial does is shown beside its checks");
  await keyboard.press("p");
  await asked("and goes on", [{ type: "study", action: "resume" }]);
  await button("Pause").waitFor();

  await page.getByRole("checkbox", { name: "Keys N, P, T" }).focus();
  await keyboard.press("Space");
  await page.evaluate(() => document.activeElement.blur());
  await keyboard.press("p");
  await asked("single keys can be turned off", []);
  await page.reload();
  await button("Pause").waitFor();
  check((await page.locator(".steplist > .now .what").textContent()) === "Trial 2 of C", "a page that reloads shows all of it again");
  await page.waitForTimeout(SETTLING_MS);
  await keyboard.press("p");
  await asked("and keeps to the choice", []);
  await page.getByRole("checkbox", { name: "Keys N, P, T" }).press("Space");
}

/** Clicks alone: every request that there is. */
async function byMouse({ page, show, asked, check, button }) {
  await show(screenBetweenSessions());
  await button("Continue session").click();
  await asked("a click begins", [{ type: "conduct", ask: "begin", id: "P03" }]);
  await page.getByRole("button", { name: "Choose mira" }).click();
  await button("Begin for this person").click();
  await asked("for somebody of the list", [{ type: "conduct", ask: "begin", id: "mira" }]);
  await page.getByLabel("Pseudonym").fill("");
  await page.getByRole("checkbox", { name: "New participant" }).click();
  await button("Begin for this person").click();
  await asked("for somebody new, with a name to go with", [{ type: "conduct", ask: "begin", id: "P05", new: true }]);
  await show(screenBetweenSessions({ next: { participant: 5, id: null, session: "1", begun: false, departs: "5 days late" } }));
  check((await page.textContent(".begin .warning")).includes("5 days late"), "a departure from the plan is a warning");
  await button("Begin session").click();
  await asked("for a place that nobody has", [{ type: "conduct", ask: "begin" }]);

  await show(READY);
  check((await page.locator(".checks .unready").count()) === 1, "what is not ready stands out");
  check((await page.getByRole("status").first().textContent()) === "Gaze is not ready", "what came of a request is said aloud");
  await button("Start trial").click();
  await asked("the next step", [{ type: "conduct", ask: "next" }]);
  for (const [name, reason, act, ask] of [
    ["Start anyway", "checked by hand just now", "Start trial", "start_anyway"],
    ["Redo last trial", "armband slipped", "Redo trial", "redo"],
    ["Train again", "armband taken off", "Train again", "retrain"],
    ["Calibrate gaze again", "eye tracker slipped", "Calibrate again", "recalibrate"],
    ["Skip", "participant declined", "Skip", "skip"],
  ]) {
    await button(name).click();
    const dialog = page.getByRole("dialog");
    await dialog.getByRole("radio", { name: reason }).click();
    await dialog.getByRole("button", { name: act, exact: true }).click();
    await asked(`${name}, with a reason`, [{ type: "conduct", ask, reason }]);
  }
  await button("Redo last trial").click();
  await page.getByRole("dialog").getByRole("textbox").fill("a fly sat on the camera");
  await page.getByRole("dialog").getByRole("button", { name: "Redo trial" }).click();
  await asked("another reason in own words", [{ type: "conduct", ask: "redo", reason: "a fly sat on the camera" }]);
  await button("End for today").click();
  await page.getByRole("dialog").getByRole("button", { name: "End for today" }).click();
  await asked("the session ends for today", [{ type: "conduct", ask: "leave" }]);

  await show(RUNNING);
  await button("End trial").click();
  await page.getByRole("dialog").getByRole("button", { name: "Cancel" }).click();
  await asked("a trial is not ended by one click", []);
  await button("End trial").click();
  await page.getByRole("dialog").getByRole("radio", { name: "participant is tired" }).click();
  await page.getByRole("dialog").getByRole("button", { name: "End trial" }).click();
  await asked("but by two, and the reason is kept as a note", [
    { type: "conduct", ask: "note", text: "Trial ended: participant is tired" },
    { type: "study", action: "abort" },
  ]);
  await show(screenAtStep("calibration of the gaze", { is: "calibrate_gaze", error_deg: 2.9 }));
  await button("Calibrate").click();
  await button("Check").click();
  await asked("gaze is calibrated and checked", [
    { type: "study", action: "calibrate_gaze" },
    { type: "study", action: "check_gaze" },
  ]);
}

/** Times go on while no message comes. */
async function checkClocks({ page, show, check }) {
  await show(REST(2.5));
  const first = await page.textContent(".countdown");
  await page.waitForFunction((text) => document.querySelector(".countdown").textContent !== text, first);
  check(/^0:0[12] left$/.test(first ?? ""), `a break counts down by itself from ${first}`);
  await page.locator(".countdown.over").waitFor();
  check((await page.textContent(".countdown")).endsWith("over time"), "and shows how long it is over");
  await show(screenAtStep("trial 2 of C", trial([{ ...CHECKS[0], age_secs: 58 }]), { running: false }));
  await page.waitForFunction(() => document.querySelector(".checks .age").textContent === "1 min");
  check(true, "what was found grows older");
}

/** The experimenter fills in a questionnaire for the participant. */
async function fillInForm({ page, show, asked, check, button }, screenshot) {
  await show(FORM({ mental: 35 }));
  check((await page.textContent(".now")).includes("1 of 2 answered"), "it is shown how much of a questionnaire is answered");
  await button("Fill in here").click();
  await page.locator("dialog.fillin .questionnaire").waitFor();
  await page.waitForTimeout(200);
  await screenshot("conduct-form");
  await page.locator('dialog.fillin [data-key="physical"] input').press("ArrowRight");
  await page.locator('dialog.fillin [data-key="physical"] input').blur();
  await asked("an answer goes out at once", [{ type: "answer", step: 10, key: "physical", answer: 55 }]);
  await show(FORM({ mental: 35, physical: 55 }));
  await page.locator("dialog.fillin").getByRole("button", { name: "Done" }).click();
  await asked("and that all is answered", [{ type: "submit", step: 10 }]);
  check(await page.locator("dialog.fillin").isVisible(), "it stays until the server goes on");
  await show(READY);
  check(await page.locator("dialog.fillin").isHidden(), "and closes then");
}

/** Another side conducts too. */
async function planChange({ page, show, asked, check, button }) {
  await show(READY);
  await button("Skip").click();
  await page.getByRole("radio", { name: "no time left" }).click();
  await show(screenAtStep("trial 3 of C", trial(), { running: false, can: READY_CAN }));
  check(await page.locator("dialog.ask").isHidden(), "a reason for one step is not taken for the next");
  await asked("nothing was skipped", []);
  const scrolled = () => page.evaluate(() => document.querySelector(".steplist").scrollTop);
  await page.evaluate(() => (document.querySelector(".steplist").scrollTop = 0));
  await show(screenAtStep("trial 3 of C", trial(), { running: false, can: READY_CAN, minutes_left: 61 }));
  check((await scrolled()) === 0, "who looks at other steps is left alone");
  await show(screenAtStep("questionnaire ranking", { ...form(26), about: null }));
  check((await scrolled()) > 0, "until the next step comes, which is brought into sight");
}

async function connectionLoss({ page, socket, show, asked, check, button }, screenshot) {
  await show(WELCOME);
  socket.lose();
  await page.getByRole("alert").filter({ hasText: "Connection lost" }).waitFor();
  check((await button("Done, next").getAttribute("aria-disabled")) === "true", "without a connection it is said, and no button acts");
  await page.keyboard.press("n");
  await page.waitForTimeout(300);
  await screenshot("conduct-lost");
  socket.down = false;
  await page.waitForFunction(() => document.querySelector(".lost").textContent === "");
  await page.waitForTimeout(SETTLING_MS + 200);
  await asked("what was pressed meanwhile is not sent later", []);
  await button("Done, next").click();
  await asked("with the connection back it goes on", [{ type: "conduct", ask: "next" }]);
}

/** What matters is on the screen, whatever its size. */
async function sizes({ page, show, check, button }, screenshot) {
  const shown = [
    ["between", screenBetweenSessions({ next: { participant: 3, id: "P03", session: "1", begun: true, departs: "6 days after the session before" } }), "Continue session"],
    ["welcome", WELCOME, "Done, next"],
    ["ready", READY, "Start trial"],
    ["running", RUNNING, "Pause"],
    ["break", REST(100), "End break"],
    ["form", FORM({ mental: 35 }), "Done, next"],
  ];
  for (const [width, height] of [[1280, 720], [800, 600], [390, 844]]) {
    await page.setViewportSize({ width, height });
    for (const [name, screen, primary] of shown) {
      await show(screen);
      await page.evaluate(() => window.scrollTo(0, 0));
      const size = `${width} x ${height}, ${name}`;
      const inSight = async (locator) => {
        const box = await locator.boundingBox();
        return box !== null && box.x >= 0 && box.x + box.width <= width && box.y >= 0 && box.y + box.height <= height;
      };
      const over = await page.evaluate(() => [document.documentElement.scrollWidth - window.innerWidth, document.documentElement.scrollHeight - window.innerHeight]);
      check(over[0] <= 0, `${size}: nothing leaves the window at its side`);
      if (width === 1280) check(over[1] <= 0, `${size}: the page needs no scrolling`);
      check(await inSight(button(primary)), `${size}: ${primary} is in sight`);
      if (screen.session) check(await stepInSight(page), `${size}: and so is the step that is on`);
      await screenshot(`conduct-${name}-${width}`);
      await page.evaluate(() => window.scrollTo(0, document.documentElement.scrollHeight));
      check(await inSight(button(primary)), `${size}: also at the end of the page`);
    }
    const covered = await hidden(page);
    check(covered.length === 0, `${width} x ${height}: what has the focus is not covered${covered.length ? `: ${covered.join(", ")}` : ""}`);
  }
  await page.setViewportSize({ width: 1280, height: 720 });
}

/** The step that is on is within the list's own window. */
function stepInSight(page) {
  return page.evaluate(() => {
    const [list, step] = [".steplist", ".steplist > .now > .stepline"].map((name) => document.querySelector(name).getBoundingClientRect());
    return step.top >= list.top && step.bottom <= list.bottom;
  });
}

/** Tabs through the page; what has the focus and is covered by something else. */
async function hidden(page) {
  const found = [];
  await page.evaluate(() => window.scrollTo(0, 0));
  for (let k = 0; k < 40; k++) {
    await page.keyboard.press("Tab");
    const covered = await page.evaluate(() => {
      const node = document.activeElement;
      if (!node || node === document.body || node.matches("ol, ul")) return null;
      const { left, top, width, height } = node.getBoundingClientRect();
      const seen = document.elementFromPoint(left + width / 2, top + height / 2);
      return seen && (node.contains(seen) || seen.contains(node)) ? null : (node.textContent || node.tagName);
    });
    if (covered) found.push(covered);
  }
  return found;
}

async function rules({ page, show, button }, tools, screenshot) {
  const look = await checkWithAxe(page, tools);
  for (const scheme of ["light", "dark"]) {
    await page.emulateMedia({ colorScheme: scheme });
    for (const [name, screen] of [
      ["between sessions", screenBetweenSessions({ notice: "mirja is nobody", next: { participant: 3, id: "P03", session: "1", begun: true, departs: "6 days late" } })],
      ["words to say", WELCOME],
      ["trial not ready", READY],
      ["trial", RUNNING],
      ["break over time", REST(0.1)],
      ["training", screenAtStep("training of the gestures", { is: "train", gesture: "hand_open", text: "hold", share: 0.4, recording: true, recognised: "hand_close", in_a_row: 3, wanted: 3, passed: true })],
      ["gaze", screenAtStep("calibration of the gaze", { is: "calibrate_gaze", error_deg: 2.9 })],
    ]) {
      await show(screen);
      await look(`${name}, ${scheme}`);
    }
    await screenshot(`conduct-${scheme}`);
    await show(READY);
    await button("Redo last trial").click();
    await look(`reasons, ${scheme}`);
    await page.keyboard.press("Escape");
    await show(FORM({ mental: 35 }));
    await button("Fill in here").click();
    await look(`questionnaire for the participant, ${scheme}`);
    await page.keyboard.press("Escape");
    await page.setViewportSize({ width: 390, height: 844 });
    await show(READY);
    await look(`on a telephone, ${scheme}`);
    await page.setViewportSize({ width: 1280, height: 720 });
  }
  await page.emulateMedia({ colorScheme: null });
}
