// Screens of a study as the server sends them to the experimenter's page, and a socket that shows them.

const CONDITIONS = ["A", "C", "B", "D"];

/** The steps of a session with four conditions of three trials, as the server lists them. */
function steps() {
  const list = ["questionnaire participant", 'spoken text "welcome"', "training of the gestures", "calibration of the gaze", "break"].map((label) => ({ label, condition: null }));
  for (const condition of CONDITIONS) {
    list.push({ label: condition < "C" ? "demonstration" : "practice", condition });
    for (let trial = 1; trial <= 3; trial++) list.push({ label: `trial ${trial} of ${condition}`, condition });
    list.push({ label: "questionnaire nasa_tlx", condition });
  }
  list.push({ label: "questionnaire ranking", condition: null });
  return list.map((line, k) => ({ step: k + 1, outcome: null, attempts: 0, deviations: [], ...line }));
}

export const PARTICIPANTS = Array.from({ length: 8 }, (_, k) => ({
  participant: k + 1,
  id: ["P01", "P02", "P03", "mira"][k] ?? null,
  steps: [[26, 26], [26, 26], [9, 26], [0, 26]][k] ?? [0, 26],
  trials: [[12, 12], [12, 12], [3, 12], [0, 12]][k] ?? [0, 12],
}));

/** Nobody's session is under way. */
export function screenBetweenSessions(more = {}) {
  return {
    study: "pilot",
    title: "Four methods, three trials each",
    trials: [27, 96],
    participants: PARTICIPANTS,
    next: { participant: 3, id: "P03", session: "1", begun: true, departs: "" },
    session: null,
    can: ["begin"],
    notice: "",
    notes: [],
    ...more,
  };
}

/** A session at the first step with this label. */
export function screenAtStep(label, what, { running = true, can = ["next", "skip", "leave"], notice = "", notes = [], since_secs = 0, minutes_left = 62 } = {}) {
  const all = steps();
  const step = all.find((line) => line.label === label).step;
  for (const line of all) {
    if (line.step < step) Object.assign(line, { outcome: "done", attempts: 1 });
    if (line.step === step) line.attempts = running ? 1 : 0;
  }
  if (step > 7) Object.assign(all[6], { outcome: "aborted", attempts: 2, deviations: ["repeated", "not_ready"] });
  if (step > 10) Object.assign(all[9], { outcome: "skipped", attempts: 0, deviations: ["left_out"] });
  const now = { step, label, running, since_secs, what };
  return screenBetweenSessions({ next: null, session: { participant: 3, id: "P03", session: "1", steps: all, now, minutes_left }, can, notice, notes });
}

export const SPEECH = `Thank you for coming. You will move four blocks with a virtual arm, from your side of the box over the partition to the marked \
places, red before blue and in the order of their numbers. What counts first is how many blocks you move before the time is up, then \
how quickly, then how near to the middle of the marks. You may rest or stop at any time, without a reason.`;

const rating = (key, text) => ({ kind: "scale", key, name: { en: key }, text: { en: text }, low: { en: "Very low" }, high: { en: "Very high" }, least: 0, most: 100, step: 5 });

export function form(step, answers = {}) {
  const items = [rating("mental", "How mentally demanding was the task?"), rating("physical", "How physically demanding was the task?"), { kind: "text", key: "words", text: { en: "Anything else?" }, optional: true }];
  return {
    is: "form",
    step,
    form: { name: "nasa_tlx", title: { en: "NASA Task Load Index" }, source: "", licence: "", confirmed: true, scoring: { by: "nothing" }, items },
    pairs: [],
    conditions: CONDITIONS,
    about: "A",
    answers,
    missing: ["mental", "physical"].filter((key) => !(key in answers)),
    refused: null,
  };
}

export const CHECKS = [
  { name: "gestures", ready: true, found: "trained for P03, 93 % recognised", age_secs: 1260 },
  { name: "armband", ready: true, found: "8 channels, 200 Hz, no losses", age_secs: null },
  { name: "gaze", ready: false, found: "2.9° off, at most 2.0° is wanted", age_secs: 1512 },
  { name: "participant's page", ready: true, found: "open", age_secs: null },
  { name: "disk", ready: true, found: "41 GB free", age_secs: null },
];

export const trial = (checks = CHECKS) => ({ is: "trial", checks, number: [5, 12], before: "3 of 4 blocks on target in 281 s" });

/** Stands between page and server: shows screens of a study, and keeps what the page asks of it. */
export async function studySocket(page) {
  const socket = { asked: [], screen: null, down: false, route: null };
  await page.routeWebSocket(/\/live/, (route) => {
    if (socket.down) {
      route.close();
      return;
    }
    socket.route = route;
    const server = route.connectToServer();
    route.onMessage((text) => {
      const message = JSON.parse(String(text));
      const own = ["conduct", "answer", "submit"].includes(message.type);
      if (own || message.type === "study") socket.asked.push(message);
      // The server beside this test has no study, and its one trial is to go on.
      if (!own && message.action !== "abort") server.send(text);
    });
    server.onMessage((text) => {
      route.send(text);
      if (JSON.parse(String(text)).type === "hello" && socket.screen) socket.show(socket.screen);
    });
  });
  socket.show = (screen) => {
    socket.screen = screen;
    socket.route?.send(JSON.stringify({ type: "study", ...screen }));
  };
  socket.lose = () => {
    socket.down = true;
    socket.route.close();
  };
  return socket;
}
