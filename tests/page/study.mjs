// A study from the first page to the last questionnaire, with the program that conducts it: one page for whoever conducts it, one
// for whoever takes part, by keys alone, by the mouse alone and on a telephone. What was answered on the pages is what the tables
// have.

import { execFile } from "node:child_process";
import { mkdtemp, readFile, rm, writeFile } from "node:fs/promises";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { promisify } from "node:util";
import { layoutFaults, SLACK_PX } from "./layout.mjs";
import { startStudy } from "./processes.mjs";
import { ExperimenterPage, ParticipantPage } from "./study_page_objects.mjs";

const run = promisify(execFile);
/** The cheapest drawing: the processor draws here, and the trial needs it too. */
const PATH = "?quality=3&pictures=8";
/** What the documentation shows is drawn better. Of several of a kind the last one is kept. */
const PICTURED_PATH = "?quality=1&pictures=4";
const PICTURES = {
  "say-desk": "study_session",
  "ready-desk": "study_ready",
  "train-seat": "study_training",
  "trial-seat": "study_trial",
  "form-ease_agency_speed-full-seat": "study_questionnaire",
};
const WINDOW = { width: 800, height: 600 };
/** The next trial can be begun so long after one has ended, ms. */
const READY_MS = 2000;
/** Of a trial. */
const LIMIT_SECS = 4;
/** What no participant may see. */
const HIDDEN = [".over", ".methodbutton", ".method", ".methodname", ".chip", ".action.restart", ".result", ".welcome", ".events", ".log"];
const HIDDEN_WORDS = /\bmethod\b|new trial|restart|participant \d|trial \d/i;

const VARIANTS = {
  keys: { name: "the keyboard alone", conditions: ["D"], trials: 2, after: ["nasa_tlx", "ease_agency_speed"], end: ["ranking", "last_trial", "comments"], countdown: false },
  mouse: { name: "the mouse alone", conditions: ["A", "D"], trials: 1, after: ["nasa_tlx", "ease_agency_speed"], end: ["ranking", "comments"], countdown: true },
  finger: { name: "a finger", conditions: ["D"], trials: 2, after: ["pros_tlx", "sus", "ease_agency_speed"], end: ["last_trial"], countdown: false },
};
const PHONE = { viewport: { width: 390, height: 844 }, hasTouch: true, isMobile: true };

function planOf({ conditions, trials, after, end, countdown }) {
  const form = (name) => `{ do = "form", form = "${name}", minutes = 1 }`;
  const condition = (name) => `
[[conditions]]
name = "${name}"
trial = { method = "${name}" }
begin = [{ do = "demonstrate", minutes = 1 }, { do = "practise", transfers = 1, minutes = 1 }]
`;
  return `
name = "reaching"
title = "Two ways of reaching"
participants = 2

[trial]
task = "modified_bbt"
setup = "still"
limit_secs = ${LIMIT_SECS}
${conditions.map(condition).join("")}
[order]
by = "listed"

[[sessions]]
name = "1"
trials = ${trials}
countdown = ${countdown}
begin = [
  ${form("participant")},
  { do = "say", text = "welcome", minutes = 1 },
  { do = "train", repetitions = 2, hold_secs = 1, consecutive_correct_runs = 1, minutes = 1 },
  { do = "calibrate_gaze", minutes = 1 },
  { do = "rest", minutes = 0.02 },
]
after_condition = [${after.map(form).join(", ")}]
end = [${end.map(form).join(", ")}]

[texts]
welcome = """
Thank you for coming. Today you move blocks with a virtual arm, in two ways.
You may stop at any time, without giving a reason.
"""
`;
}

/** An answer of its own for each question. */
function valueOf(question, conditions, k) {
  switch (question.kind) {
    case "consent":
      return question.version;
    case "text":
      return `Words, "quoted",\nin two lines: für ${k}`;
    case "ranking":
      return k % 2 ? [conditions] : [...conditions].reverse().map((name) => [name]);
    case "condition":
      return conditions[k % conditions.length];
    case "choice": {
      const chosen = question.options[(k + 1) % question.options.length].value;
      return question.several ? [chosen] : chosen;
    }
    case "scale": {
      const steps = Math.round((question.most - question.least) / question.step);
      // Near the middle, where a mark that is moved stands: keys move it step by step.
      const middle = Math.round(steps / 2);
      const step = steps <= 10 ? k % (steps + 1) : middle + (k % 7) - 3;
      return question.least + question.step * step;
    }
    default:
      return k % 2 ? question.first : question.second;
  }
}

/** As the tables have it. */
function cellOf(value) {
  if (!Array.isArray(value)) return String(value);
  return value.map((place) => (Array.isArray(place) ? place.join("=") : place)).join(",");
}

export async function study(page, tools) {
  const { program, hands } = tools;
  if (!program) throw new Error("--mode study needs --program PATH_OF_PROACT");
  await page.goto("about:blank");
  const unknown = hands.find((each) => !(each in VARIANTS));
  if (unknown !== undefined) throw new Error(`--hands ${unknown} is unknown; expected ${Object.keys(VARIANTS).join(", ")}`);
  for (const each of hands) await conductStudy(each, tools);
}

/** One session, and what is left of it. */
async function conductStudy(hands, tools) {
  const { check, program, tab } = tools;
  const variant = VARIANTS[hands];
  const began = Date.now();
  const work = await mkdtemp(join(tmpdir(), "proact-study-page-"));
  const folder = join(work, "reaching");
  await run(program, ["study", "new", folder]);
  await writeFile(join(folder, "plan.toml"), planOf(variant));
  const server = await startStudy(program, folder);
  const pages = [];
  try {
    const deskPage = await tab({ viewport: hands === "finger" || tools.pictures ? { width: 1280, height: 720 } : WINDOW });
    const seatPage = await tab(hands === "finger" ? PHONE : { viewport: WINDOW });
    pages.push(deskPage, seatPage);
    const desk = new ExperimenterPage(deskPage, hands === "keys" ? "keys" : "mouse");
    const seat = new ParticipantPage(seatPage, hands, hands === "finger" ? await seatPage.context().newCDPSession(seatPage) : null);
    const path = tools.pictures ? PICTURED_PATH : PATH;
    await deskPage.goto(new URL(`experimenter${path}`, server.url).href);
    await seatPage.goto(new URL(path, server.url).href);
    const session = new StudyDriver(desk, seat, variant, hands, tools);
    await session.runSession();
    const status = JSON.parse((await run(program, ["study", "status", folder, "--json"])).stdout);
    const [own] = status.sessions;
    check(own.steps[0] === own.steps[1] && own.trials[0] === own.trials[1], `the session is over: ${own.steps[0]} steps, ${own.trials[0]} trials`);
    await Promise.all(pages.splice(0).map((each) => each.context().close()));
    await server.stop("SIGINT");
    await tables(program, folder, session, variant, check);
    check(true, `a study by ${variant.name} takes ${Math.round((Date.now() - began) / 1000)} s`);
  } finally {
    // On failure, as they stand; a page that outlives the program would complain of that.
    for (const [k, each] of pages.entries()) await tools.screenshotOf(each, `failure-${["desk", "seat"][k]}`).catch(() => {});
    await Promise.all(pages.map((each) => each.context().close()));
    await server.stop();
    await rm(work, { recursive: true, force: true });
  }
}

class StudyDriver {
  /** What was answered, in the order of the questions. */
  given = [];
  practised = 0;
  reloaded = false;
  waits = [];
  shots = 0;

  constructor(desk, seat, variant, hands, tools) {
    Object.assign(this, { desk, seat, variant, hands, tools, check: tools.check });
  }

  async runSession() {
    const { desk, seat } = this;
    await desk.until(({ next }) => next, "says who is next");
    await seat.until(({ show }) => show === "wait", "there is nothing to do yet");
    await this.look("begin");
    await desk.press("Begin session");
    await desk.until(({ session }) => session?.now, "the session begins");
    let step = null;
    for (;;) {
      const { session } = await desk.until(({ session }) => !session || (session.now && session.now.step !== step), "another step comes");
      if (!session) break;
      const { now } = session;
      step = now.step;
      await this[now.what.is](now);
    }
    await this.look("end");
    if (this.variant.trials > 1) this.check(this.waits.length > 0 && this.waits.every((wait) => wait < READY_MS), `the next trial can be begun ${this.waits.map((wait) => `${wait} ms`).join(", ")} after one has ended`);
  }

  /** Both pages as they stand: nothing is covered or leaves the window, and a participant sees nothing else. */
  async look(what) {
    const { desk, seat, check, hands } = this;
    this.shots += 1;
    const name = `${hands}-${String(this.shots).padStart(2, "0")}-${what}`;
    const sides = [["desk", desk.page], ["seat", seat.page]];
    for (const [side, page] of sides) {
      await page.waitForTimeout(150);
      await this.tools.screenshotOf(page, `${name}-${side}`);
      await this.picture(page, `${what}-${side}`);
      const found = await page.evaluate(overlappingElements, SLACK_PX);
      if (side === "seat" && seat.shows === "scene") found.push(...(await page.evaluate(layoutFaults, { slack: SLACK_PX, timed: false, hinted: !what.startsWith("gaze") })));
      check(found.length === 0, `${what}, ${side}: ${found.slice(0, 4).join("; ") || "nothing is covered or leaves the window"}`);
    }
    const seen = await seat.page.evaluate((hidden) => hidden.filter((name) => [...document.querySelectorAll(name)].some((node) => node.checkVisibility())), HIDDEN);
    const words = HIDDEN_WORDS.exec(await seat.page.evaluate(() => document.body.innerText));
    if (words) seen.push(words[0]);
    if ((await seat.page.title()) !== "ProACT") seen.push(await seat.page.title());
    const clock = await seat.page.locator(".clock").first().isVisible();
    if (seat.shows === "scene" && clock !== Boolean(seat.newest.countdown)) seen.push(clock ? "a clock" : "no clock");
    check(seen.length === 0, `${what}: the participant sees nothing of the study's plan${seen.length ? `: ${seen.join(", ")}` : ""}`);
  }

  /** For the documentation, if it is wanted and shown there. */
  async picture(page, what) {
    const { pictures } = this.tools;
    if (pictures && what in PICTURES) await page.screenshot({ path: `${pictures}/${PICTURES[what]}.png` });
  }

  async say({ what }) {
    const { desk, check } = this;
    check((await desk.page.locator(".speech").textContent()).startsWith(what.text.slice(0, 20)), "what is to be said is there");
    await desk.note("arrived late, for no reason");
    await this.look("say");
    await desk.next("Done, next");
  }

  async form({ step }) {
    const { seat, desk, check } = this;
    const screen = await seat.until(({ show, step: own }) => show === "form" && own === step, "the questionnaire is there");
    const { form, pairs, conditions, about } = screen;
    const questions = [...form.items, ...pairs];
    await seat.page.locator(`.questionnaire h2:text-is("${form.title.en}")`).waitFor();
    await this.look(`form-${form.name}`);
    const values = questions.map((question, k) => valueOf(question, conditions, k + step));
    for (const [k, question] of questions.entries()) {
      if (k === Math.floor(questions.length / 2) && !this.reloaded && questions.length > 6) await this.reload(values.slice(0, k), questions);
      await seat.answer(question, values[k], conditions);
    }
    const kept = questions.map(({ key }, k) => [key, values[k]]);
    const wrong = ({ answers }) => kept.filter(([key, value]) => JSON.stringify(answers?.[key]) !== JSON.stringify(value));
    await seat.until((screen) => wrong(screen).length === 0, `every answer to ${form.name} is kept`);
    check(true, `${form.name} is answered by ${this.variant.name}`);
    await this.look(`form-${form.name}-full`);
    for (const [key, value] of kept) this.given.push({ condition: about ?? "", form: form.name, key, value: cellOf(value) });
    await seat.done();
    await desk.until(({ session }) => session?.now?.step !== step, "the questionnaire is over");
  }

  /** In the middle of a questionnaire both pages are loaded again. */
  async reload(values, questions) {
    const { seat, desk, check } = this;
    this.reloaded = true;
    const before = `${values.length} of ${questions.length} answered`;
    await seat.page.reload();
    await seat.page.locator(`.questionnaire .tally:text-is("${before}")`).waitFor({ timeout: 10_000 });
    const saved = await seat.page.locator('.questionnaire [data-state="saved"]').count();
    check(saved === values.length, `the participant's page comes back with ${before}`);
    await desk.page.reload();
    await desk.page.locator(`.now p:text-is("${before}")`).waitFor({ timeout: 10_000 });
    check(true, "and so does the experimenter's");
  }

  async train({ step }) {
    const { seat, desk } = this;
    await seat.page.locator(".prompt h2").waitFor();
    await this.look("train");
    await seat.train();
    await desk.page.locator(".found.good").waitFor();
    await this.look("train-passed");
    await desk.next("End training");
    await desk.until(({ session }) => session?.now?.step !== step, "the training ends");
  }

  async calibrate_gaze({ step, running }) {
    const { seat, desk, check } = this;
    if (!running) await desk.next("Start calibration");
    await desk.until(({ session }) => session.now.running, "the calibration begins");
    const verdict = await seat.calibrate(() => this.look("gaze"));
    check(verdict === "Your gaze was measured.", `the gaze is calibrated, and no point is below anything${verdict === "Your gaze was measured." ? "" : `: ${seat.measured}`}`);
    await this.look("gaze-figures");
    await seat.closeFigures();
    await desk.page.locator(".now .good").waitFor();
    await desk.next("Done, next");
    await desk.until(({ session }) => session?.now?.step !== step, "the calibration ends");
  }

  async rest({ step }) {
    const { desk } = this;
    await desk.page.locator(".countdown.over").waitFor();
    await this.seat.page.locator('h2:text-is("The break is over")').waitFor();
    await this.look("rest");
    await desk.next("End break");
    await desk.until(({ session }) => session?.now?.step !== step, "the break ends");
  }

  async demonstrate({ step }) {
    const { seat, desk } = this;
    await this.look("before-demonstration");
    await desk.next("Start demonstration");
    await seat.page.locator(".scenetitle:visible").filter({ hasText: "watch" }).waitFor();
    await seat.page.waitForTimeout(1000);
    await this.look("demonstration");
    await desk.next("End demonstration");
    await desk.until(({ session }) => session?.now?.step !== step, "the demonstration ends");
  }

  async practise({ step }) {
    const { seat, desk } = this;
    await desk.next("Start practice");
    await seat.page.locator(".scenetitle:visible").filter({ hasText: "Practice" }).waitFor();
    await seat.act();
    await this.look("practice");
    await desk.next("End practice");
    await desk.until(({ session }) => session?.now?.step !== step, "the practice ends");
  }

  async trial({ step, what }) {
    const { seat, desk, check } = this;
    await desk.until(({ can }) => can.includes("next") || can.includes("start_anyway"), "it is known what is ready");
    if (desk.ended) {
      await desk.ready(desk.newest.can.includes("next") ? "Start trial" : "Start anyway");
      this.waits.push(Date.now() - desk.ended);
    }
    await this.look("ready");
    if (desk.newest.can.includes("next")) await desk.next("Start trial");
    else {
      await desk.press("Start anyway");
      await desk.reason("checked by hand just now", "Start trial");
    }
    await desk.until(({ session }) => session.now.running, "the trial begins");
    desk.finishedAt = desk.ended = null;
    await seat.until(({ show }) => show === "scene", "the scene is there");
    await seat.page.waitForFunction(() => !document.querySelector(".participant").checkVisibility() && window.__proact.frame?.time < 1000);
    await seat.act();
    await this.look("trial");
    await desk.until(({ session }) => session?.now?.step !== step || !session.now.running, "the trial ends by its limit");
    // What comes next may be another trial.
    desk.ended = desk.now?.what.is === "trial" ? desk.finishedAt : null;
    check(desk.finishedAt !== null, `trial ${what.number[0]} of ${what.number[1]} ends by its limit`);
  }
}

/** What leaves the window or is covered on a page as it stands; runs in the page. */
function overlappingElements(slack) {
  const found = [];
  const name = (node) => `${node.tagName.toLowerCase()}.${node.className || node.id} "${(node.textContent || node.getAttribute("aria-label") || "").slice(0, 30)}"`;
  if (document.documentElement.scrollWidth > innerWidth) found.push("the page scrolls sideways");
  /** The part of a box that is shown by what scrolls around it. */
  const seen = (node, { left, top, right, bottom }) => {
    for (let around = node.parentElement; around; around = around.parentElement) {
      if (getComputedStyle(around).overflowY === "visible") continue;
      const box = around.getBoundingClientRect();
      [left, top, right, bottom] = [Math.max(left, box.left), Math.max(top, box.top), Math.min(right, box.right), Math.min(bottom, box.bottom)];
    }
    return { left, top: Math.max(top, 0), right, bottom: Math.min(bottom, innerHeight) };
  };
  const says = (node) => [...node.childNodes].some((child) => child.nodeType === Node.TEXT_NODE && child.textContent.trim() !== "");
  for (const node of document.querySelectorAll("body *")) {
    const acts = node.matches("button, input, textarea, select, summary");
    if (!(acts || says(node)) || !node.checkVisibility({ visibilityProperty: true, opacityProperty: true }) || node.closest("[inert], .only-heard, svg, option, .mark")) continue;
    const whole = node.getBoundingClientRect();
    if (whole.width < 2 || whole.height < 2) continue;
    if (whole.left < -slack || whole.right > innerWidth + slack) found.push(`${name(node)} leaves the window`);
    const box = seen(node, whole);
    if (box.right - box.left < 4 || box.bottom - box.top < 4) continue;
    const top = document.elementFromPoint((box.left + box.right) / 2, (box.top + box.bottom) / 2);
    // A label covers its own field, and what stays at the lower edge lies over what scrolls below it. While the gaze is
    // calibrated nothing else matters.
    const fine = !top || node.contains(top) || top.contains(node) || top.closest("label")?.contains(node) || node.closest("label")?.contains(top);
    const stuck = top?.closest(".foot, .conductbar .first, .gazecheck");
    if (!fine && !stuck) found.push(`${name(node)} is covered by ${name(top)}`);
  }
  return found;
}

/** The tables have what was answered, and nothing else. */
async function tables(program, folder, { given }, variant, check) {
  const out = join(folder, "out");
  await run(program, ["study", "export", folder, "--out", out]);
  const table = async (name) => rowsOf(await readFile(join(out, `${name}.csv`), "utf8"));
  const answers = (await table("answers")).map(({ condition, form, item, answer, simulated }) => ({ condition, form, key: item, value: answer, simulated }));
  const wanted = given.map((one) => ({ ...one, simulated: "0" }));
  const differs = wanted.findIndex((one, k) => JSON.stringify(one) !== JSON.stringify(answers[k]));
  check(
    answers.length === wanted.length && differs < 0,
    `answers.csv has the ${wanted.length} answers that were given${differs < 0 ? "" : `: ${JSON.stringify(answers[differs])} instead of ${JSON.stringify(wanted[differs])}`}`,
  );
  const trials = await table("trials");
  const kinds = variant.conditions.flatMap((name) => Array(variant.trials).fill(name));
  check(JSON.stringify(trials.map(({ condition }) => condition)) === JSON.stringify(kinds), `trials.csv has ${kinds.join(", ")}`);
  check(trials.every(({ ended, seconds, mark }) => ended === "task" && Math.abs(seconds - LIMIT_SECS) < 0.5 && mark === ""), "each as long as planned, without a departure from the plan");
  const scores = await table("scores");
  for (const condition of variant.conditions) {
    const own = given.filter((one) => one.condition === condition);
    if (variant.after.includes("nasa_tlx")) {
      const load = own.filter(({ form }) => form === "nasa_tlx");
      const scales = load.filter(({ key }) => !key.includes("_or_"));
      const raw = scales.reduce((sum, { value }) => sum + Number(value), 0) / 6;
      const weighted = scales.reduce((sum, { key, value }) => sum + Number(value) * load.filter((one) => one.value === key).length, 0) / 15;
      for (const [name, value] of [["nasa_tlx_raw", raw], ["nasa_tlx_weighted", weighted]]) {
        const found = scores.find((row) => row.score === name && row.condition === condition);
        check(Math.abs(found?.value - value) < 1e-6 && found.missing === "", `scores.csv has ${name} of ${condition}: ${value.toFixed(2)}`);
      }
    }
    if (variant.after.includes("sus")) {
      const sum = own.filter(({ form }) => form === "sus").reduce((sum, { value }, k) => sum + (k % 2 ? 5 - Number(value) : Number(value) - 1), 0);
      const found = scores.find((row) => row.form === "sus" && row.condition === condition);
      check(Math.abs(found?.value - 2.5 * sum) < 1e-6, `scores.csv has the usability of ${condition}: ${2.5 * sum}`);
    }
  }
}

/** The rows of a CSV file (RFC 4180), by the names of its columns. */
function rowsOf(text) {
  const rows = [[""]];
  let quoted = false;
  for (let k = 0; k < text.length; k++) {
    const row = rows.at(-1);
    const add = (words) => row.push(row.pop() + words);
    const letter = text[k];
    if (quoted && letter === '"' && text[k + 1] === '"') (add('"'), k++);
    else if (letter === '"') quoted = !quoted;
    else if (quoted) add(letter);
    else if (letter === ",") row.push("");
    else if (letter === "\n") rows.push([""]);
    else if (letter !== "\r") add(letter);
  }
  const [head, ...body] = rows.filter((row) => row.length > 1 || row[0] !== "");
  return body.map((row) => Object.fromEntries(head.map((name, k) => [name, row[k]])));
}
