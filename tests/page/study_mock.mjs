// The study's part of the server, played between the page and a real one: screens are put into the connection, answers are taken
// out of it, and everything else goes through.

import { CONDITIONS, pairsOf } from "./study_questions.mjs";

export class MockStudy {
  /** All that the page sent, but for what it sends all the time. */
  sent = [];
  answers = {};
  submitted = [];
  refused = null;
  /** No connection stands. */
  down = false;
  /** Answers to this key are refused. */
  refuses = null;
  #socket = null;
  #screen = null;
  #step = 0;

  async route(page) {
    await page.routeWebSocket(/\/live/, (socket) => {
      if (this.down) {
        void socket.close({ code: 1001 });
        return;
      }
      const server = socket.connectToServer();
      this.#socket = socket;
      server.onMessage((data) => {
        socket.send(data);
        if (JSON.parse(String(data)).type === "hello") this.#send();
      });
      socket.onMessage((data) => {
        const message = JSON.parse(String(data));
        if (!["ping", "alive", "gaze", "head"].includes(message.type)) this.sent.push(message);
        if (message.type === "answer") this.#take(message);
        else if (message.type === "submit") this.#submit(message);
        else server.send(data);
      });
    });
  }

  show(screen) {
    this.#screen = screen;
    this.#send();
  }

  /** Another questionnaire begins. */
  ask(form, about = null) {
    this.#step += 1;
    this.answers = {};
    this.refused = null;
    this.submitted = [];
    this.show({ show: "form", step: this.#step, form, pairs: pairsOf(form), conditions: CONDITIONS, about, answers: {}, missing: [], refused: null });
  }

  /** Cuts the page's connection, which comes back by itself once `down` is over. */
  async dropConnection() {
    this.down = true;
    await this.#socket.close({ code: 1001 });
    this.#socket = null;
  }

  async until(holds, limitMs = 20_000) {
    for (const end = Date.now() + limitMs; !holds(); await new Promise((done) => setTimeout(done, 30))) {
      if (Date.now() > end) throw new Error(`never came: ${holds}`);
    }
  }

  types() {
    return this.sent.map(({ type }) => type);
  }

  #send() {
    if (!this.#screen || !this.#socket) return;
    const kept = this.#screen.show === "form" ? { answers: this.answers, refused: this.refused, missing: this.#missing() } : {};
    this.#socket.send(JSON.stringify({ type: "participant", ...this.#screen, ...kept }));
  }

  #missing() {
    const { form, pairs } = this.#screen;
    return [...form.items.filter(({ optional }) => !optional), ...pairs].map(({ key }) => key).filter((key) => !(key in this.answers));
  }

  #take({ step, key, answer }) {
    if (step !== this.#step) return;
    this.refused = null;
    if (key === this.refuses) this.refused = { key, reason: "it says nothing, expected a reason" };
    else if (answer === null) delete this.answers[key];
    else this.answers[key] = answer;
    // The disk takes a moment.
    setTimeout(() => this.#send(), 20);
  }

  #submit({ step }) {
    if (step !== this.#step || this.#missing().length > 0) return;
    this.submitted.push(step);
    this.show({ show: "wait" });
  }
}
