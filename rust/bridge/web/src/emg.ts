// The page of EMG: the live view alone. It only watches, beside whoever drives.

import "./emg.css";
import { element, setText } from "./dom";
import { EmgView } from "./emgView";
import type { TrialStatus } from "./generated/types";
import { LiveConnection } from "./liveConnection";
import { strings } from "./strings";

const words = strings.emg;

/** Without signals for so long something is the matter, ms. */
const STALE_MS = 2000;

const link = element("span", "muted", words.connecting);
const view = new EmgView();
const none = element(
  "p",
  "card",
  words.noArmband,
  element("code", "", "proact serve --emg-source synthetic --emg-model model.json"),
  words.whoseModel,
  element("code", "", "proact emg train --source synthetic --no-realtime --out model.json"),
  words.makes,
);
none.hidden = true;
view.root.hidden = true;
const keys = element("p", "small keys", words.keys);
keys.hidden = true;
document.getElementById("page")?.append(element("header", "", element("h1", "", "EMG"), link), none, view.root, keys);

let connected = false;
let receivedAt = 0;
let status: TrialStatus | null = null;

const live = new LiveConnection(
  {
    reset: () => view.clear(),
    content() {},
    frame() {},
    events() {},
    status(next) {
      status = next;
    },
    signals(signals) {
      receivedAt = performance.now();
      tell();
      none.hidden = signals.emg_rate_hz > 0;
      view.root.hidden = keys.hidden = !none.hidden;
      if (none.hidden) view.setSignals(signals);
    },
    connected(now) {
      connected = now;
      tell();
    },
    messageRefused: (message) => console.warn(`ProACT: ${message}`),
  },
  "spectator",
);

function linkText(): string {
  if (!connected) return words.gone;
  if (performance.now() - receivedAt < STALE_MS) return view.frozen ? words.frozen : "live";
  if (status?.paused || status?.held || status?.waiting) return words.still;
  return words.noTrial;
}

function tell(): void {
  setText(link, linkText());
}

// Where nothing has the focus, keys are the view's.
document.addEventListener("keydown", (event) => {
  if (event.target === document.body && view.key(event)) event.preventDefault();
});

function draw(wall: number): void {
  view.draw(wall);
  requestAnimationFrame(draw);
}
requestAnimationFrame(draw);
window.setInterval(tell, 250);
(window as unknown as { __proact: object }).__proact = { view, live };
