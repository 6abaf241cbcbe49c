// A study on the participant's page: what its person sees and does not see, and that every kind of question can be answered by
// keys alone, by the mouse alone, by a finger and in a headset. The study itself is played by `study_mock.mjs`.

import { checkWithAxe } from "./accessibility.mjs";
import { answerByKeys, answerByPressing, tabTo } from "./questionnaire.mjs";
import { emulateHeadset } from "./participant_page.mjs";
import { MockStudy } from "./study_mock.mjs";
import { CONDITIONS, comments, easeAgencySpeed, lastTrial, nasaTlx, odd, pairsOf, participant, ranking } from "./study_questions.mjs";

const PATH = "?quality=3&pictures=10";
const QUIET = "?quality=3&tutorial=0&pictures=10";
/** What nobody may be made to do in a study, or to see. */
const HIDDEN = [".methodbutton", ".method", ".methodname", ".chip", ".action.restart", ".result", ".welcome", ".events", ".clock"];
/** Rounding of the browser's own, CSS pixels. */
const SLACK = 1.5;

/** What each question is answered with below. */
const ANSWERS = {
  consent: "1",
  age_band: "25-34",
  handedness: "left",
  vision: "glasses",
  ease: 4,
  agency: 2,
  speed: 5,
  mental_demand: 55,
  physical_demand: 50,
  temporal_demand: 45,
  performance: 60,
  effort: 40,
  frustration: 50,
  symptoms: ["tired", "sick"],
  pain: 3,
  weight: 0.3,
  choice: "B",
  why: "It was quick, as waves are: wasd R für alle",
};
const ORDER = [["B"], ["A", "C"]];
const answerTo = (form, key) => (form === ranking ? ORDER : (ANSWERS[key] ?? key.split("_or_")[0]));
const FORMS = [participant, easeAgencySpeed, nasaTlx, ranking, lastTrial, odd];

export async function studyForms(page, tools) {
  const { check, screenshot, url } = tools;
  const study = new MockStudy();
  await study.route(page);
  await page.setViewportSize({ width: 800, height: 600 });
  await page.goto(new URL(PATH, url).href);
  await page.waitForFunction(() => window.__proact?.connected);
  await scene(page, study, tools);
  await screens(page, study, tools);
  for (const [by, answer] of [["keys alone", byKeys], ["the mouse alone", byMouse]]) {
    for (const form of FORMS) await fillIn(page, study, tools, form, by, answer);
  }
  await checkMissingAnswers(page, study, tools);
  await checkCorrection(page, study, tools);
  await checkDoubleClick(page, study, tools);
  await checkReconnect(page, study, tools);
  check(!study.types().some((type) => ["gesture", "restart", "trunk"].includes(type)), "no key that was pressed in a form did anything to the arm");
  await rules(page, study, tools);
  await page.goto("about:blank");
  await byFinger(tools);
  await inHeadset(page, tools);
  await screenshot("end");
}

/** The scene as a participant sees it. */
async function scene(page, study, { check, screenshot }) {
  await page.locator(".welcome:not([hidden])").first().waitFor();
  study.show({ show: "scene", countdown: false, title: "Practice" });
  await page.locator('.scenetitle:text-is("Practice")').waitFor();
  await page.waitForFunction(() => window.__proact.framesDrawn > 3);
  const seen = [];
  for (const what of HIDDEN) if (await page.locator(what).first().isVisible()) seen.push(what);
  check(seen.length === 0, `a participant sees neither methods, trials of one's own, results nor the clock: ${seen.join(", ") || "none of it"}`);
  check((await page.title()) === "ProACT", "and the page's title names no method");
  await page.mouse.move(400, 300);
  await page.keyboard.press("KeyR");
  await page.keyboard.press("KeyA", { delay: 150 });
  await page.waitForFunction(() => window.__proact.frame.gesture === "no_motion");
  check(!study.types().includes("restart"), "the key R begins no trial");
  check(study.types().includes("gesture"), "while keys are gestures there");
  await page.click('.corner button:text-is("Settings")');
  const offered = await page.locator(".settings button:visible").allTextContents();
  check(!offered.some((text) => /gaze|block/i.test(text)) && offered.includes("Standard keys"), "the settings offer keys and no gaze check");
  await screenshot("settings");
  await page.keyboard.press("Escape");
  await screenshot("scene");
  study.show({ show: "scene", countdown: true, title: "" });
  await page.locator(".clock").waitFor();
  check(await page.locator(".scenetitle").isHidden(), "the clock is shown where the study wants it, and a trial has no title");
  study.sent.length = 0;
}

/** Screens without questions. */
async function screens(page, study, { check, screenshot }) {
  const heading = () => page.locator(".participant h2:visible").textContent();
  for (const [show, title] of [["wait", "One moment"], ["listen", "Please listen"], ["thanks", "Thank you"]]) {
    study.show({ show });
    await page.locator(`.participant h2:text-is("${title}")`).waitFor();
    await screenshot(show);
  }
  check(true, "what is to be done is said in a sentence");
  check(await page.evaluate(() => document.querySelector(".hud").inert && document.querySelector("#scene").inert), "what is behind it cannot be reached");
  study.show({ show: "rest", left_secs: 65 });
  await page.locator('.restclock:text-is("1:03")').waitFor();
  check(true, "a break counts down by itself");
  await screenshot("rest");
  study.show({ show: "rest", left_secs: 0 });
  await page.locator('.participant h2:text-is("The break is over")').waitFor();
  const prompt = { gesture: "wrist_extension", text: "hold", share: 0.4, recording: true, recognised: "hand_open", in_a_row: 2, wanted: 5, passed: false, keys: true };
  study.show({ show: "train", ...prompt });
  check((await heading()) === "Bend the wrist back", "training names the gesture");
  check((await page.locator(".picture svg").getAttribute("aria-label")) === "Bend the wrist back", "and draws it");
  check(/Open the hand.*2 of 5/.test(await page.locator(".trainline").innerText().then((text) => text.replace(/\s+/g, " "))), "and says what is recognised, and how many are right");
  await screenshot("train");
}

/** A form from the first question to its end. */
async function fillIn(page, study, { check, screenshot }, form, by, answer) {
  study.ask(form, form === nasaTlx ? "A" : null);
  await page.locator(`.questionnaire h2:text-is("${form.title.en}")`).waitFor();
  if (form === nasaTlx) check((await page.textContent(".about")) === "Condition A", "the form says what it is about");
  await inside(page, check, `${form.name} at 800x600`);
  const questions = [...form.items, ...pairsOf(form)];
  for (const question of questions) {
    await answer(page, form, question);
    await page.locator(`[data-key="${question.key}"][data-state="saved"]`).waitFor();
  }
  const wanted = Object.fromEntries(questions.map(({ key }) => [key, answerTo(form, key)]));
  check(same(study.answers, wanted), `${form.name} is answered by ${by}`);
  await screenshot(`${form.name}-${by.replaceAll(" ", "-")}`);
  await (by === "keys alone" ? doneByKeys(page) : page.click(".done"));
  await page.locator('.participant h2:text-is("One moment")').waitFor();
  check(study.submitted.length === 1, "and sent once");
}

function same(one, other) {
  const sorted = (object) => JSON.stringify(Object.entries(object).sort());
  return sorted(one) === sorted(other);
}

async function doneByKeys(page) {
  await tabTo(page, ".done");
  await page.keyboard.press("Enter");
}

const byKeys = (page, form, question) => answerByKeys(page, question, answerTo(form, question.key), CONDITIONS);
const byMouse = (page, form, question, press) => answerByPressing(page, question, answerTo(form, question.key), CONDITIONS, press);

/** Who has forgotten something is led to it. */
async function checkMissingAnswers(page, study, { check, screenshot }) {
  study.ask(easeAgencySpeed);
  await page.locator('[data-key="agency"]').waitFor();
  await page.click('[data-key="agency"] input >> nth=0');
  await page.click(".done");
  await page.locator(".notice:visible").waitFor();
  check((await page.textContent(".notice")) === "2 answers are still missing: 1 and 3", "who forgets something is told what");
  check(await page.evaluate(() => document.activeElement?.closest("[data-key]")?.dataset.key === "ease"), "and led to the first of it");
  check(study.submitted.length === 0, "and nothing is sent");
  await screenshot("missing");
  await page.locator('[data-key="agency"][data-state="saved"]').waitFor();
  await tabTo(page, '[data-key="agency"] input');
  await page.keyboard.press("Delete");
  await page.locator('[data-key="agency"][data-state="none"]').waitFor();
  check(!("agency" in study.answers), "an answer is taken back by a key");
  await page.click('[data-key="ease"] input >> nth=2');
  await page.click('[data-key="ease"] .clear');
  await page.locator('[data-key="ease"][data-state="none"]').waitFor();
  check(!("ease" in study.answers), "and by the mouse");
}

/** A refused answer says why, and what was typed stays. */
async function checkCorrection(page, study, { check, screenshot }) {
  study.refuses = "comments";
  study.ask(comments);
  await page.locator("textarea").fill("hm");
  await page.locator(".refusal:visible").waitFor();
  check((await page.textContent(".refusal")).includes("it says nothing, expected a reason"), "a refused answer says why");
  check((await page.getAttribute(".refusal", "role")) === "alert" && (await page.inputValue("textarea")) === "hm", "where a screen reader hears it, and what was typed stays");
  await screenshot("refused");
  study.refuses = null;
  await page.locator("textarea").fill("A reason");
  await page.locator('[data-key="comments"][data-state="saved"]').waitFor();
  check(await page.locator(".refusal").isHidden(), "another answer is taken");
  check((await page.textContent(".questionnaire .only-heard[role=status]"))?.startsWith("Saved"), "and that is said too");
}

/** A second click on "Done" does not end the next questionnaire, of which nobody has seen anything. */
async function checkDoubleClick(page, study, { check }) {
  study.ask(comments);
  await page.locator("textarea").waitFor();
  await page.locator(".done").evaluate((node) => node.click());
  await page.waitForTimeout(300);
  check(study.submitted.length === 0, "a second click does not end the next questionnaire");
  await page.waitForTimeout(600);
  await page.click(".done");
  await study.until(() => study.submitted.length === 1);
  check(true, "and what may be left empty may");
}

/** A reload loses nothing, nor does a line that breaks; the language stays as it was chosen. */
async function checkReconnect(page, study, { check, screenshot }) {
  study.ask(odd);
  await page.locator('[data-key="pain"]').waitFor();
  await page.click('[data-key="pain"] input >> nth=7');
  await page.locator('[data-key="pain"][data-state="saved"]').waitFor();
  await page.selectOption(".language select", "de");
  await page.locator('.questionnaire h2:text-is("Alles andere")').waitFor();
  const languages = await page.locator('[data-key="symptoms"] .option .face').evaluateAll((nodes) => nodes.map(({ lang, textContent }) => [lang, textContent]));
  check(same(languages.slice(0, 2), [["de", "Müder Arm"], ["en", "Tired eyes"]]), "the form is shown in another language, as far as it was translated");
  check(await page.locator('[data-key="pain"] input >> nth=7').isChecked(), "with the answers that were given");
  await screenshot("language");
  await page.reload();
  await page.locator('.questionnaire h2:text-is("Alles andere")').waitFor();
  check(await page.locator('[data-key="pain"] input >> nth=7').isChecked(), "a reload keeps answers and language");
  await study.dropConnection();
  await page.click('[data-key="weight"] input >> nth=1');
  check((await page.locator('[data-key="weight"]').getAttribute("data-state")) === "sending", "an answer on a broken line is not called saved");
  await screenshot("broken-line");
  study.down = false;
  await page.locator('[data-key="weight"][data-state="saved"]').waitFor();
  check(study.answers.weight === 0.2, "and goes out when the line is back");
  await page.selectOption(".language select", "en");
}

/** axe-core, sizes of what is touched, and windows of all sizes. */
async function rules(page, study, tools) {
  const { check, screenshot } = tools;
  const look = await checkWithAxe(page, tools);
  for (const scheme of ["light", "dark"]) {
    await page.emulateMedia({ colorScheme: scheme });
    for (const [width, height] of [[800, 600], [390, 844]]) {
      await page.setViewportSize({ width, height });
      for (const form of [...FORMS, comments]) {
        study.ask(form, "A");
        await page.locator(`.questionnaire h2:text-is("${form.title.en}")`).waitFor();
        if (form === easeAgencySpeed) {
          await page.click('[data-key="ease"] input >> nth=1');
          await page.click(".done");
          await page.locator(".notice:visible").waitFor();
        }
        await look(`${form.name}, ${scheme}, ${width}x${height}`);
      }
      study.show({ show: "rest", left_secs: 100 });
      await look(`rest, ${scheme}, ${width}x${height}`);
      study.show({ show: "train", gesture: "hand_open", text: "hold", share: 0.4, recording: false, recognised: "hand_open", in_a_row: 2, wanted: 5, passed: true, keys: true });
      await look(`train, ${scheme}, ${width}x${height}`);
      await screenshot(`train-${scheme}-${width}`);
    }
    study.show({ show: "scene", countdown: false, title: "Practice" });
    await page.setViewportSize({ width: 800, height: 600 });
    await page.locator(".scenetitle:visible").waitFor();
    await look(`scene, ${scheme}`);
  }
  await page.emulateMedia({ colorScheme: null });
  // The last two are a window of 1280x720 at 400 %, and one of 1920x1080.
  for (const [width, height] of [[320, 640], [390, 844], [844, 390], [320, 180], [1920, 1080]]) {
    await page.setViewportSize({ width, height });
    for (const form of FORMS) {
      study.ask(form, "A");
      await page.locator(`.questionnaire h2:text-is("${form.title.en}")`).waitFor();
      await inside(page, check, `${form.name} at ${width}x${height}`);
      await screenshot(`${form.name}-${width}x${height}`);
    }
  }
}

/** Nothing leaves the window at a side, and fingers find what they press. */
async function inside(page, check, what) {
  const found = await page.evaluate((slack) => {
    const root = document.querySelector(".participant");
    const faults = root.scrollWidth > root.clientWidth ? ["it scrolls sideways"] : [];
    const shown = [...root.querySelectorAll("*")].filter((node) => node.checkVisibility() && !node.closest(".only-heard"));
    for (const node of shown) {
      const { left, right } = node.getBoundingClientRect();
      if (left < -slack || right > innerWidth + slack) faults.push(`.${node.className} leaves the window`);
    }
    for (const node of root.querySelectorAll(".option, .slider, .nudge, .done, .words, .language select")) {
      const { width, height } = node.getBoundingClientRect();
      if (node.checkVisibility() && (width < 44 - slack || height < 44 - slack)) faults.push(`.${node.className} is ${width} by ${height}`);
    }
    return faults;
  }, SLACK);
  check(found.length === 0, `${what}: ${found.slice(0, 4).join("; ") || "all inside, and large enough to touch"}`);
}

/** On a telephone. */
async function byFinger({ check, tab, url }) {
  const phone = await tab({ viewport: { width: 390, height: 844 }, hasTouch: true, isMobile: true });
  const study = new MockStudy();
  await study.route(phone);
  await phone.goto(new URL(QUIET, url).href);
  await phone.waitForFunction(() => window.__proact?.connected);
  for (const form of FORMS) {
    study.ask(form);
    await phone.locator(`.questionnaire h2:text-is("${form.title.en}")`).waitFor();
    const questions = [...form.items, ...pairsOf(form)];
    for (const question of questions) await byMouse(phone, form, question, (locator, options) => locator.tap(options));
    await phone.waitForTimeout(500);
    await phone.tap(".done");
    await phone.locator('.participant h2:text-is("One moment")').waitFor();
    check(same(study.answers, Object.fromEntries(questions.map(({ key }) => [key, answerTo(form, key)]))), `${form.name} is answered by a finger`);
  }
  await phone.context().close();
}

/** In a headset the board is all that there is. */
async function inHeadset(page, { check, screenshot, emulator, url }) {
  await emulateHeadset(page, emulator);
  const study = new MockStudy();
  await study.route(page);
  await page.setViewportSize({ width: 900, height: 500 });
  await page.goto(new URL(QUIET, url).href);
  await page.waitForFunction(() => window.__proact?.connected && window.__proact.frame);
  study.show({ show: "listen" });
  await page.click('.participant button:text-is("Enter VR")');
  await page.waitForFunction(() => window.__proact.worn);
  check(true, "a headset is entered from a study's screen");
  const hand = handOf(page);
  await page.waitForTimeout(500);
  await screenshot("headset-listen");

  study.ask(easeAgencySpeed, "A");
  await hand.sees("Next");
  // The hand is where the emulator puts it, which is over one of the cells.
  await page.waitForTimeout(1500);
  check(Object.keys(study.answers).length === 0, "what appears under a ray that is there already is not chosen");
  await hand.away();
  await hand.rest("4");
  await page.waitForFunction(() => window.__proact.boardCells().some(({ label, chosen }) => label === "4" && chosen));
  check(study.answers.ease === 4, "a ray that rests on a cell of the board answers");
  await screenshot("headset-scale");
  await hand.rest("Next");
  await hand.sees("Back");
  check(true, "and turns the page");
  await page.waitForTimeout(1500);
  const still = await page.evaluate(() => window.__proact.boardCells().map(({ label }) => label));
  check(still.includes("Next"), "once, however long it stays");
  await hand.press("2");
  await study.until(() => study.answers.agency === 2);
  check(true, "the trigger answers at once");
  await hand.press("Next");
  await hand.sees("Done");
  await hand.press("Done");
  await page.waitForTimeout(300);
  check(study.submitted.length === 0, "what is missing is not sent");
  await hand.press("5");
  await hand.press("Done");
  await study.until(() => study.submitted.length === 1);
  check(same(study.answers, { ease: 4, agency: 2, speed: 5 }), "all of it is sent from the headset");

  study.ask(ranking);
  await hand.sees("Next");
  await screenshot("headset-ranking");
  for (const label of ["2 0", "1 1", "2 2"]) await hand.press(...label.split(" "));
  await study.until(() => JSON.stringify(study.answers.ease) === JSON.stringify(ORDER));
  check(true, "conditions are put in order");
  study.ask(nasaTlx);
  await hand.sees("Next");
  await page.waitForTimeout(400);
  await screenshot("headset-slider");
  study.ask(participant);
  await hand.sees("I agree");
  await page.waitForTimeout(400);
  await screenshot("headset-consent");
  study.ask(lastTrial);
  await hand.press("Condition B");
  await hand.press("Next");
  await hand.sees("Done");
  await page.waitForTimeout(400);
  await screenshot("headset-text");
  check(study.answers.choice === "B", "a condition is chosen");
  check(!study.types().includes("gesture"), "and the trigger was no gesture meanwhile");
  study.show({ show: "scene", countdown: false, title: "" });
  await page.waitForFunction(() => window.__proact.boardCells().length === 0);
  await page.evaluate(() => window.headset.controllers.right.updateButtonValue("trigger", 1));
  await study.until(() => study.types().includes("gesture"));
  await page.evaluate(() => window.headset.controllers.right.updateButtonValue("trigger", 0));
  check(true, "in the scene it is one again");
  await page.evaluate(() => window.headset.activeSession.end());
  await page.waitForFunction(() => !window.__proact.worn);
}

/** The right hand, which points at cells of the board by their labels; of several with one label, at the k-th. */
function handOf(page) {
  const sees = (label) => page.waitForFunction((text) => window.__proact.boardCells().some((cell) => cell.label === text), label);
  const pictures = () =>
    page.evaluate(() => new Promise((done) => window.headset.activeSession.requestAnimationFrame(() => window.headset.activeSession.requestAnimationFrame(() => done()))));
  const point = async (label, k = 0) => {
    await sees(label);
    await page.evaluate(
      ([text, k]) => {
        const { at } = window.__proact.boardCells().filter((cell) => cell.label === text)[k];
        const { right } = window.headset.controllers;
        right.position.set(0.2, 1.2, -0.2);
        const way = [at[0] - 0.2, at[1] - 1.2, at[2] + 0.2];
        const [x, y, z] = way.map((part) => part / Math.hypot(...way));
        // The turn that brings the way ahead, -z, there: half way between the two.
        const turn = [y, -x, 0, 1 - z];
        right.quaternion.set(...turn.map((part) => part / Math.hypot(...turn)));
      },
      [label, Number(k)],
    );
    await pictures();
  };
  const trigger = (value) => page.evaluate((value) => window.headset.controllers.right.updateButtonValue("trigger", value), value);
  return {
    sees,
    rest: point,
    async away() {
      await page.evaluate(() => window.headset.controllers.right.quaternion.set(0.7, 0, 0, 0.7));
      await pictures();
    },
    async press(label, k) {
      await point(label, k);
      await trigger(1);
      await page.waitForTimeout(200);
      await trigger(0);
      await page.waitForTimeout(200);
    },
  };
}
