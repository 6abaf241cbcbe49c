// What is on display as the query of an address, so that a link opens the same moment.

import { CAMERA_KINDS, type CameraKind } from "./cameras";
import { EVENT_GROUPS, type EventGroup } from "./replayEvents";
import { LANES, type LaneName } from "./replaySignals";
import { strings } from "./strings";
import type { TrialEvent } from "./generated/types";
import { fixed } from "./numbers";

/** Trials are laid over each other at this event: its kind, and which of them, from 1. */
export interface Alignment {
  event: TrialEvent["event"];
  occurrence: number;
}

export interface ReplayMoment {
  /** Numbers of the trials in the server's list, one or two. */
  trials: number[];
  /** Milliseconds on the common axis. */
  time: number;
  camera: CameraKind;
  /** Of the free camera: where it is and what it looks at, metres. */
  eye: number[] | null;
  at: number[] | null;
  speed: number;
  /** Groups of events that are not shown. */
  hidden: EventGroup[];
  /** Plots that are folded. */
  folded: LaneName[];
  align: Alignment | null;
  /** The part of the common axis on display, milliseconds; none for all of it. */
  window: [number, number] | null;
  below: boolean;
}

/** As it begins: what a link leaves out. */
export function defaultMoment(): ReplayMoment {
  return {
    trials: [],
    time: 0,
    camera: "shoulder",
    eye: null,
    at: null,
    speed: 1,
    hidden: [],
    folded: [],
    align: null,
    window: null,
    below: false,
  };
}

/** The query of `moment`, on top of what else is in `other`. */
export function toQuery(moment: ReplayMoment, other: URLSearchParams): URLSearchParams {
  const query = new URLSearchParams(other);
  for (const name of ["trial", "t", "camera", "eye", "at", "speed", "hide", "fold", "align", "window", "below"]) query.delete(name);
  for (const trial of moment.trials) query.append("trial", String(trial));
  query.set("t", fixed(moment.time / 1000, 3));
  const put = (name: string, value: string) => value && query.set(name, value);
  put("camera", moment.camera === "shoulder" ? "" : moment.camera);
  if (moment.camera === "free") {
    put("eye", (moment.eye ?? []).map((value) => fixed(value, 3)).join(","));
    put("at", (moment.at ?? []).map((value) => fixed(value, 3)).join(","));
  }
  put("speed", moment.speed === 1 ? "" : String(moment.speed));
  put("hide", moment.hidden.join(","));
  put("fold", moment.folded.join(","));
  put("align", moment.align ? `${moment.align.event},${moment.align.occurrence}` : "");
  put("window", moment.window ? moment.window.map((time) => fixed(time / 1000, 3)).join(",") : "");
  put("below", moment.below ? "1" : "");
  return query;
}

/** What an address asks for, of `count` trials. What it does not say, or says wrongly, is as it begins. */
export function fromQuery(query: URLSearchParams, count: number, speeds: readonly number[]): ReplayMoment {
  const moment = defaultMoment();
  const numbers = (name: string, length: number): number[] | null => {
    const values = (query.get(name) ?? "").split(",").map((text) => (text === "" ? NaN : Number(text)));
    return values.length === length && values.every(Number.isFinite) ? values : null;
  };
  const listed = <T extends string>(name: string, known: readonly T[]) => {
    const words = (query.get(name) ?? "").split(",");
    return known.filter((word) => words.includes(word));
  };
  const named = query.getAll("trial").map(Number);
  const trials = named.filter((number) => Number.isInteger(number) && number >= 0 && number < count).slice(0, 2);
  moment.trials = trials.length > 0 ? trials : count > 1 ? [0, 1] : [0];
  moment.time = 1000 * (numbers("t", 1)?.[0] ?? 0);
  moment.camera = CAMERA_KINDS.find((kind) => kind === query.get("camera")) ?? moment.camera;
  moment.eye = numbers("eye", 3);
  moment.at = numbers("at", 3);
  moment.speed = speeds.find((speed) => speed === Number(query.get("speed"))) ?? moment.speed;
  moment.hidden = listed("hide", EVENT_GROUPS);
  moment.folded = listed("fold", LANES);
  const [event, number] = (query.get("align") ?? "").split(",");
  if (event && event in strings.replay.kinds && Number.isInteger(Number(number)) && Number(number) > 0) {
    moment.align = { event: event as TrialEvent["event"], occurrence: Number(number) };
  }
  const window = numbers("window", 2);
  moment.window = window && (window[0] ?? 0) < (window[1] ?? 0) ? [1000 * (window[0] ?? 0), 1000 * (window[1] ?? 0)] : null;
  moment.below = query.get("below") === "1";
  return moment;
}
