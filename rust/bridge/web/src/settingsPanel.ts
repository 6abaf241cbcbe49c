// The settings: keys, colours, cues, side of the arm, and the gaze check.

import { Dialog } from "./dialog";
import { button, element, setText } from "./dom";
import type { Command } from "./generated/types";
import { GESTURE_NAMES } from "./protocol";
import { COMMANDS, DEFAULT_KEYS, DWELL_CHOICES_MS, keyName, MAX_NAME_CHARS, SCAN_CHOICES_MS, remap, type KeyCommand, type Settings } from "./settings";
import { strings } from "./strings";
import { defaultPageName } from "./controlLease";
import { fixed } from "./numbers";

const words = strings.settings;
const NAMES: Record<string, string> = words.commands;

function timeText(ms: number): string {
  return ms === 0 ? words.off : `${fixed(ms / 1000, 1)} s`;
}

function timesOf(times: number[]): Record<string, string> {
  return Object.fromEntries(times.map((ms) => [timeText(ms), timeText(ms)]));
}

export interface SettingsHandlers {
  changed(settings: Settings): void;
  gazeCheck(): void;
  gazeCalibration(): void;
  tutorial(): void;
}

export class SettingsPanel {
  readonly root: HTMLElement;
  private readonly dialog: Dialog;
  private readonly keyButtons = new Map<KeyCommand, HTMLButtonElement>();
  private commandToRemap: KeyCommand | null = null;

  constructor(
    private settings: Settings,
    private readonly handlers: SettingsHandlers,
  ) {
    const title = element("h2", "", words.title);
    this.dialog = new Dialog("settings", title, () => this.close());
    this.root = this.dialog.root;
    const keys = element("div", "keymap");
    for (const command of COMMANDS) {
      const gesture = GESTURE_NAMES[command as Command] as { name: string } | undefined;
      const hidden = command === "restart" ? "not-in-study" : "";
      const node = element("button", `keybutton ${hidden}`);
      node.type = "button";
      node.dataset["command"] = command;
      node.addEventListener("click", () => this.startRemap(command));
      this.keyButtons.set(command, node);
      keys.append(element("span", hidden, gesture ? gesture.name : (NAMES[command] ?? command)), node);
    }
    const reset = button(words.standardKeys, () => this.change({ keys: structuredClone(DEFAULT_KEYS) }), "plain");
    this.root.append(
      element("div", "dialoghead", title, button(words.close, () => this.close(), "plain close")),
      element(
        "div",
        "columns",
        element("section", "", element("h3", "", words.keys), element("p", "note", words.chooseKey), keys, reset),
        element(
          "section",
          "",
          element("h3", "", words.display),
          this.choice("colours", words.palettes, settings.palette, (palette) =>
            this.change({ palette: palette as Settings["palette"] }),
          ),
          this.choice("cues", words.cueKinds, settings.cues, (cues) => this.change({ cues: cues as Settings["cues"] })),
          this.choice("captions", words.offOn, settings.captions ? "on" : "off", (on) => this.change({ captions: on === "on" })),
          this.choice("arm", words.sides, settings.leftArm ? "left" : "right", (side) =>
            this.change({ leftArm: side !== "right" }),
          ),
          element("h3", "", words.withoutKeys),
          this.choice("mouse", words.onOff, settings.mouseGestures ? "on" : "off", (on) =>
            this.change({ mouseGestures: on === "on" }),
          ),
          element("p", "note", words.mouseNote),
          this.choice("resting", timesOf(DWELL_CHOICES_MS), timeText(settings.dwellMs), (time) =>
            this.change({ dwellMs: DWELL_CHOICES_MS.find((each) => timeText(each) === time) ?? 0 }),
          ),
          this.choice("one", timesOf(SCAN_CHOICES_MS), timeText(settings.scanMs), (time) =>
            this.change({ scanMs: SCAN_CHOICES_MS.find((each) => timeText(each) === time) ?? 0 }),
          ),
          element("h3", "", words.driver),
          this.nameField(),
          element("h3", "not-in-study", words.gaze),
          button(
            words.checkGaze,
            () => {
              this.close();
              this.handlers.gazeCheck();
            },
            "plain wide not-in-study",
          ),
          button(
            words.calibrateGaze,
            () => {
              this.close();
              this.handlers.gazeCalibration();
            },
            "plain wide not-in-study",
          ),
          element("h3", "not-in-study", words.help),
          button(
            words.showMe,
            () => {
              this.close();
              this.handlers.tutorial();
            },
            "plain wide not-in-study",
          ),
        ),
      ),
    );
    window.addEventListener(
      "keydown",
      (event) => {
        if (!this.open || !this.commandToRemap) return;
        event.preventDefault();
        event.stopPropagation();
        const command = this.commandToRemap;
        this.commandToRemap = null;
        if (event.code === "Escape") this.show();
        else this.change({ keys: remap(this.settings.keys, command, event.code) });
      },
      true,
    );
    this.show();
  }

  get open(): boolean {
    return this.dialog.open;
  }

  toggle(): void {
    if (this.open) this.close();
    else this.dialog.show();
    this.commandToRemap = null;
    this.show();
  }

  private close(): void {
    this.dialog.close();
    this.commandToRemap = null;
  }

  private startRemap(command: KeyCommand): void {
    this.commandToRemap = command;
    this.show();
  }

  private change(part: Partial<Settings>): void {
    this.settings = { ...this.settings, ...part };
    this.show();
    this.handlers.changed(this.settings);
  }

  private show(): void {
    for (const [command, button] of this.keyButtons) {
      const keys = this.settings.keys[command].map(keyName).join("  ") || words.noKey;
      setText(button, this.commandToRemap === command ? words.pressKey : keys);
    }
  }

  private nameField(): HTMLElement {
    const field = element("input");
    field.type = "text";
    field.name = "name";
    field.maxLength = MAX_NAME_CHARS;
    field.value = this.settings.name;
    field.placeholder = defaultPageName(navigator.userAgent);
    field.addEventListener("change", () => this.change({ name: field.value.trim() }));
    return element("label", "choice", element("span", "", words.yourName), field);
  }

  /** `options`: what each value is called. */
  private choice(name: keyof typeof words.choices, options: Record<string, string>, chosen: string, changed: (value: string) => void): HTMLElement {
    const option = ([value, text]: [string, string]) => Object.assign(element("option", "", text), { value });
    const select = element("select", "", ...Object.entries(options).map(option));
    select.value = chosen;
    select.name = name;
    select.addEventListener("change", () => {
      changed(select.value);
    });
    return element("label", "choice", element("span", "", words.choices[name]), select);
  }
}
