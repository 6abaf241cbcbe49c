// How a person answers a questionnaire on the page: by keys alone, by the mouse alone or by a finger. A question is as the server
// sends it, a pair has no kind.

/** Tabs on until what has the focus matches. */
export async function tabTo(page, selector, most = 200) {
  for (let k = 0; k < most; k++) {
    if (await page.evaluate((wanted) => document.activeElement?.matches(wanted), selector)) return;
    await page.keyboard.press("Tab");
  }
  throw new Error(`Tab never came to ${selector}`);
}

/** What has the focus comes to be in the window, and not below what stays at the lower edge. */
async function expectInView(page, key) {
  const seen = () => {
    const { left, right, top, bottom } = document.activeElement.getBoundingClientRect();
    const there = document.elementFromPoint((left + right) / 2, (top + bottom) / 2);
    return document.activeElement.closest(".item").contains(there);
  };
  await page.waitForFunction(seen, null, { timeout: 5000 }).catch(() => {
    throw new Error(`the focus is on ${key}, which is not in sight`);
  });
}

/** Chooses the k-th of the radio buttons in whose group the focus is. */
async function arrowTo(page, k) {
  await page.keyboard.press("Space");
  for (let step = 0; step < k; step++) await page.keyboard.press("ArrowRight");
}

/** Steps of a scale; with more than ten it is a line with a mark that is moved. */
function stepsOf({ least, most, step }) {
  return Math.round((most - least) / step);
}

/** In which place of a ranking a condition is, from 1. */
function rankIn(order, condition) {
  return order.findIndex((place) => place.includes(condition)) + 1;
}

export async function answerByKeys(page, question, value, conditions) {
  const { key } = question;
  const item = `[data-key="${key}"]`;
  await tabTo(page, `${item} :is(input, textarea)`);
  await expectInView(page, key);
  switch (question.kind) {
    case "consent":
      await page.keyboard.press("Space");
      break;
    case "text":
      await page.keyboard.type(value, { delay: 5 });
      break;
    case "ranking":
      for (const [k, condition] of conditions.entries()) {
        await tabTo(page, `${item} .placed:nth-child(${k + 1}) input`);
        await arrowTo(page, rankIn(value, condition) - 1);
      }
      break;
    case "choice":
      if (!question.several) {
        await arrowTo(page, question.options.findIndex((option) => option.value === value));
        break;
      }
      for (const [k, option] of question.options.entries()) {
        await tabTo(page, `${item} .option:nth-child(${k + 1}) input`);
        if (value.includes(option.value)) await page.keyboard.press("Space");
      }
      break;
    case "condition":
      await arrowTo(page, conditions.indexOf(value));
      break;
    case "scale": {
      const steps = stepsOf(question);
      if (steps <= 10) {
        await arrowTo(page, Math.round((value - question.least) / question.step));
        break;
      }
      // It stands in the middle. There is where it stays once somebody says so.
      const away = Math.round((value - question.least) / question.step) - Math.round(steps / 2);
      if (away === 0) await page.keyboard.press("Space");
      for (let step = 0; step < Math.abs(away); step++) await page.keyboard.press(away > 0 ? "ArrowRight" : "ArrowLeft");
      break;
    }
    default:
      await arrowTo(page, value === question.second ? 1 : 0);
  }
}

/** All but words, which need keys wherever they are. `press` clicks or taps. */
export async function answerByPressing(page, question, value, conditions, press = (locator, options) => locator.click(options)) {
  const { key } = question;
  const inputs = page.locator(`[data-key="${key}"] :is(input, textarea)`);
  switch (question.kind) {
    case "consent":
      await press(inputs);
      break;
    case "text":
      await press(inputs);
      await inputs.fill(value);
      break;
    case "ranking":
      for (const [k, condition] of conditions.entries()) await press(inputs.nth(conditions.length * k + rankIn(value, condition) - 1));
      break;
    case "choice":
      for (const [k, option] of question.options.entries()) if ([value].flat().includes(option.value)) await press(inputs.nth(k));
      break;
    case "condition":
      await press(inputs.nth(conditions.indexOf(value)));
      break;
    case "scale": {
      const steps = stepsOf(question);
      const wanted = Math.round((value - question.least) / question.step);
      if (steps <= 10) {
        await press(inputs.nth(wanted));
        break;
      }
      const { width, height } = await inputs.boundingBox();
      const thumb = 24;
      const at = async (step) => press(inputs, { position: { x: thumb / 2 + ((width - thumb) * step) / steps, y: height / 2 } });
      await at(wanted);
      // A finger is broader than a step: the buttons beside the line put right what it missed.
      for (let left = 5; left > 0; left--) {
        const off = Math.round((Number(await inputs.inputValue()) - value) / question.step);
        if (off === 0) break;
        await press(page.locator(`[data-key="${key}"] .nudge`).nth(off > 0 ? 0 : 1));
      }
      break;
    }
    default:
      await press(inputs.nth(value === question.second ? 1 : 0));
  }
}
