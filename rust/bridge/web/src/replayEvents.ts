// The events of the trials on display: a list to choose from, by groups, which are its legend as well.

import { element, setClass, setText } from "./dom";
import type { TrialEvent } from "./generated/types";
import { eventText } from "./hud";
import { capitalize } from "./protocol";
import { gestureText } from "./replaySignals";
import { strings } from "./strings";
import { fixed } from "./numbers";

export const EVENT_GROUPS = ["gesture", "gaze", "plan", "grasp", "task", "stop"] as const;
export type EventGroup = (typeof EVENT_GROUPS)[number];

const words = strings.replay;

/** The group of each kind of event. */
const GROUP_OF: Record<TrialEvent["event"], EventGroup> = {
  gesture_changed: "gesture",
  gaze_unusable: "gaze",
  locked: "gaze",
  unlocked: "gaze",
  plan_requested: "plan",
  plan_finished: "plan",
  plans_failed: "plan",
  method_note: "plan",
  motion_stopped: "plan",
  motion_finished: "plan",
  grasp_made: "grasp",
  grasp_ended: "grasp",
  grasp_failed: "grasp",
  object_attached: "grasp",
  object_released: "grasp",
  object_on_target: "task",
  object_off_target: "task",
  object_crossed: "task",
  objects_refilled: "task",
  goal_reached: "task",
  goal_missed: "task",
  practice_finished: "task",
  trial_finished: "task",
  emg_gap: "stop",
  stopped: "stop",
  rearmed: "stop",
  base_held: "stop",
  base_follows: "stop",
  contacts_unsolved: "stop",
};

export function groupOf(event: TrialEvent): EventGroup {
  return GROUP_OF[event.event];
}

export function replayEventText(event: TrialEvent): string {
  return event.event === "gesture_changed" ? words.gesture(gestureText(event.gesture)) : capitalize(eventText(event));
}

/** When the event of that kind and number, from 1, was; none if there are fewer. Milliseconds. */
export function timeOf(events: readonly TrialEvent[], kind: TrialEvent["event"], number: number): number | null {
  return events.filter(({ event }) => event === kind)[number - 1]?.time ?? null;
}

/** An event on the common axis of the trials, and which of them it is of, from 0. */
export interface PlacedEvent {
  event: TrialEvent;
  /** Milliseconds on the common axis. */
  time: number;
  view: number;
}

export class EventList {
  readonly root: HTMLElement;
  private readonly hidden: Set<EventGroup>;
  private readonly list = element("ol", "loglist");
  private readonly count = element("span", "small");
  private readonly empty = element("p", "small", words.eventsNone);
  private events: PlacedEvent[] = [];
  private lines: HTMLElement[] = [];
  private current = -1;

  constructor(
    hidden: readonly EventGroup[],
    private readonly jump: (time: number) => void,
    /** Another choice of groups. */
    private readonly changed: () => void,
  ) {
    this.hidden = new Set(hidden);
    const legend = element("div", "eventlegend", ...EVENT_GROUPS.map((group) => this.filter(group)));
    legend.setAttribute("role", "group");
    legend.setAttribute("aria-label", words.events);
    const head = element("div", "loghead", element("h2", "", words.events), this.count);
    this.root = element("aside", "pane events", head, legend, this.list, this.empty);
  }

  get hiddenGroups(): EventGroup[] {
    return EVENT_GROUPS.filter((group) => this.hidden.has(group));
  }

  get shown(): readonly PlacedEvent[] {
    return this.events.filter(({ event }) => this.isShown(event));
  }

  isShown(event: TrialEvent): boolean {
    return !this.hidden.has(groupOf(event));
  }

  /** Lists these events, of `views` trials. */
  setEvents(events: PlacedEvent[], views: number): void {
    this.events = events.sort((a, b) => a.time - b.time);
    const { shown } = this;
    this.lines = shown.map(({ event, time, view }) => {
      const node = element(
        "button",
        groupOf(event),
        element("i", "dot"),
        element("time", "", fixed(time / 1000, 2).replace("-", "−")),
        views > 1 ? element("span", "chip", String(view + 1)) : null,
        element("span", "", replayEventText(event)),
      );
      node.type = "button";
      node.addEventListener("click", () => this.jump(time));
      return node;
    });
    this.list.replaceChildren(...this.lines.map((line) => element("li", "", line)));
    this.empty.hidden = this.lines.length > 0;
    setText(this.count, words.eventsOf(shown.length, events.length));
    this.current = -1;
  }

  /** Marks the last event up to `time`. */
  moveTo(time: number): void {
    const current = this.shown.filter((event) => event.time <= time + 0.5).length - 1;
    if (current === this.current) return;
    this.lines[this.current]?.removeAttribute("aria-current");
    this.current = current;
    const line = this.lines[current];
    line?.setAttribute("aria-current", "true");
    // Inside the list only: the page stays where it is.
    if (line) this.list.scrollTop = line.offsetTop - this.list.offsetTop - this.list.clientHeight / 2;
  }

  /** When the next event after `time` is, or the one before it; none if there is none. */
  neighbor(time: number, direction: 1 | -1): number | null {
    const times = this.shown.map((event) => event.time);
    const found = direction > 0 ? times.find((other) => other > time + 0.5) : times.filter((other) => other < time - 0.5).pop();
    return found ?? null;
  }

  private filter(group: EventGroup): HTMLElement {
    const box = element("input");
    box.type = "checkbox";
    box.checked = !this.hidden.has(group);
    box.addEventListener("change", () => {
      if (box.checked) this.hidden.delete(group);
      else this.hidden.add(group);
      this.changed();
    });
    const label = element("label", group, box, element("i", "dot"), words.groups[group]);
    setClass(label, "filter", true);
    return label;
  }
}
