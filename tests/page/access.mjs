// Who gets in with a browser where other machines can connect: with the token, which leaves the address at once; nobody whose
// name was made to lead here.

import { startServe } from "./processes.mjs";

const TOKEN = "a-token-for-the-page-test";
/** The browser is told that this name is this machine, as DNS rebinding does. */
const EVIL = "evil.example";

export async function access(page, { program, check, problems }) {
  if (!program) throw new Error("--mode access needs --program PATH_OF_PROACT");
  const serve = await startServe(program, 0, ["--no-record", "--bind", "0.0.0.0"], { PROACT_TOKEN: TOKEN });
  const context = page.context();
  // What the browser complains about below is meant to happen.
  const forgive = () => (problems.length = 0);
  const at = (host, path) => `http://${host}:${serve.port}${path}`;
  try {
    check(!serve.text().includes(TOKEN), "a token of one's own is not printed");
    const status = async (url) => (await page.goto(url)).status();
    check((await status(at("127.0.0.1", "/"))) === 401, "without the token the page is refused on this machine too");
    forgive();

    await page.goto(at("127.0.0.1", `/?quality=3&token=${TOKEN}&tutorial=0`));
    await page.waitForURL(at("127.0.0.1", "/?quality=3&tutorial=0"));
    check((await page.evaluate(() => history.length)) <= 3, "the token is not in the address, and no step back leads to it");
    await page.waitForFunction(() => window.__proact?.connected && window.__proact.framesDrawn > 3);
    check(true, "the page connects by what the browser keeps");
    const cookies = await context.cookies();
    const [cookie] = cookies;
    const strict = cookie?.httpOnly && cookie.sameSite === "Strict" && cookie.name === `proact_token_${serve.port}`;
    check(cookies.length === 1 && strict, "in one cookie of this port that no script reads and no other site sends");
    check(!(await page.evaluate((token) => document.cookie.includes(token), TOKEN)), "no script sees it");
    await page.reload();
    await page.waitForFunction(() => window.__proact?.connected);
    check(true, "and a reload needs nothing more");
    for (const path of ["/experimenter", "/spectator", "/replay", "/reference-board"]) {
      check((await status(at("127.0.0.1", path))) === 200, `${path} opens too`);
    }

    const broken = problems.filter((problem) => /policy|violate/i.test(problem));
    check(broken.length === 0, `no page breaks the policy that it is under${broken.join("; ")}`);

    // A policy that forbids nothing would pass all tests.
    await page.evaluate(() => {
      const script = document.createElement("script");
      script.textContent = "window.inline = true";
      document.body.append(script);
    });
    check(!(await page.evaluate(() => window.inline)), "a script that somebody slips into the page does not run");
    const framed = await page.evaluate(async (url) => {
      const frame = document.createElement("iframe");
      frame.src = url;
      document.body.append(frame);
      await new Promise((resolve) => (frame.onload = resolve));
      return frame.contentDocument !== null && frame.contentDocument.title !== "";
    }, at("127.0.0.1", "/"));
    check(!framed, "nobody frames the page");
    forgive();

    // The rebound page even has the cookie.
    await context.addCookies([{ ...cookie, domain: EVIL }]);
    check((await status(at(EVIL, "/experimenter"))) === 403, "a name that was made to lead here gets no page");
    const answer = await page.evaluate(
      (url) =>
        new Promise((resolve) => {
          const socket = new WebSocket(url);
          socket.onopen = () => resolve("open");
          socket.onerror = () => resolve("refused");
        }),
      `ws://${EVIL}:${serve.port}/live?role=experimenter`,
    ).catch(() => "refused");
    check(answer === "refused", "and no experimenter's role");
    forgive();

    // A link in somebody's mail or chat.
    await context.clearCookies();
    await page.route("http://chat.example/", (route) =>
      route.fulfill({ contentType: "text/html", body: `<a href="${at("127.0.0.1", `/?token=${TOKEN}`)}">come in</a>` }),
    );
    await page.goto("http://chat.example/");
    await page.click("a");
    await page.waitForURL(at("127.0.0.1", "/"));
    await page.waitForFunction(() => window.__proact?.connected);
    check(true, "who comes by a link of another site gets in too");
    await page.reload();
    await page.waitForFunction(() => window.__proact?.connected);
    check(page.url() === at("127.0.0.1", "/"), "and stays");
    forgive();
  } finally {
    await serve.stop();
    forgive();
  }
}
