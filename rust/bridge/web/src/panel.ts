// The settings: keys, colours, cues, side of the arm, and the gaze check.

import { element, setText } from "./dom";
import type { Gesture } from "./generated/types";
import { GESTURE_NAMES } from "./protocol";
import { COMMANDS, DEFAULT_KEYS, keyName, remap, type Command, type Settings } from "./settings";

const NAMES: Record<string, string> = {
  turn_left: "Turn left",
  ahead: "Lean ahead",
  turn_right: "Turn right",
  left: "Lean left",
  back: "Lean back",
  right: "Lean right",
  upright: "Sit up",
  camera: "Next camera",
  restart: "New trial",
};

export interface PanelHandlers {
  changed(settings: Settings): void;
  gazeCheck(): void;
  gazeCalibration(): void;
  tutorial(): void;
}

export class Panel {
  readonly root = element("div", "dialog settings");
  private readonly keyButtons = new Map<Command, HTMLButtonElement>();
  private listening: Command | null = null;

  constructor(
    private settings: Settings,
    private readonly handlers: PanelHandlers,
  ) {
    this.root.hidden = true;
    this.root.setAttribute("role", "dialog");
    this.root.setAttribute("aria-label", "Settings");
    const keys = element("div", "keymap");
    for (const command of COMMANDS) {
      const gesture = GESTURE_NAMES[command as Gesture] as { name: string } | undefined;
      const button = element("button", "keybutton");
      button.type = "button";
      button.dataset["command"] = command;
      button.addEventListener("click", () => this.listen(command));
      this.keyButtons.set(command, button);
      keys.append(element("span", "", gesture ? gesture.name : (NAMES[command] ?? command)), button);
    }
    const reset = this.button("Standard keys", "plain", () => this.change({ keys: structuredClone(DEFAULT_KEYS) }));
    this.root.append(
      element("div", "dialoghead", element("h2", "", "Settings"), this.button("Close", "plain close", () => this.close())),
      element(
        "div",
        "columns",
        element("section", "", element("h3", "", "Keys"), element("p", "note", "Choose one, then press the new key."), keys, reset),
        element(
          "section",
          "",
          element("h3", "", "Display"),
          this.choice("Colours", ["standard", "colour-blind"], settings.palette, (palette) =>
            this.change({ palette: palette as Settings["palette"] }),
          ),
          this.choice("Cues", ["chimes", "speech", "off"], settings.cues, (cues) => this.change({ cues: cues as Settings["cues"] })),
          this.choice("Arm", ["right", "left (mirrored)"], settings.leftArm ? "left (mirrored)" : "right", (side) =>
            this.change({ leftArm: side !== "right" }),
          ),
          element("h3", "", "Gaze"),
          this.button("Check the gaze (five points)", "plain wide", () => {
            this.close();
            this.handlers.gazeCheck();
          }),
          this.button("Calibrate the gaze (five points)", "plain wide", () => {
            this.close();
            this.handlers.gazeCalibration();
          }),
          element("h3", "", "Help"),
          this.button("Show me how to move a block", "plain wide", () => {
            this.close();
            this.handlers.tutorial();
          }),
        ),
      ),
    );
    window.addEventListener(
      "keydown",
      (event) => {
        if (this.root.hidden) return;
        if (!this.listening) {
          if (event.code === "Escape") this.close();
          return;
        }
        event.preventDefault();
        event.stopPropagation();
        const command = this.listening;
        this.listening = null;
        if (event.code === "Escape") this.show();
        else this.change({ keys: remap(this.settings.keys, command, event.code) });
      },
      true,
    );
    this.show();
  }

  get open(): boolean {
    return !this.root.hidden;
  }

  toggle(): void {
    this.root.hidden = !this.root.hidden;
    this.listening = null;
    this.show();
  }

  private close(): void {
    this.root.hidden = true;
    this.listening = null;
  }

  private listen(command: Command): void {
    this.listening = command;
    this.show();
  }

  private change(part: Partial<Settings>): void {
    this.settings = { ...this.settings, ...part };
    this.show();
    this.handlers.changed(this.settings);
  }

  private show(): void {
    for (const [command, button] of this.keyButtons) {
      const keys = this.settings.keys[command].map(keyName).join("  ") || "none";
      setText(button, this.listening === command ? "press a key …" : keys);
    }
  }

  private button(label: string, classes: string, act: () => void): HTMLButtonElement {
    const node = element("button", classes, label);
    node.type = "button";
    node.addEventListener("click", () => {
      act();
      // Or the next key press would click again.
      node.blur();
    });
    return node;
  }

  private choice(label: string, options: string[], chosen: string, changed: (value: string) => void): HTMLElement {
    const select = element("select", "", ...options.map((option) => element("option", "", option)));
    select.value = chosen;
    select.name = label.toLowerCase();
    select.addEventListener("change", () => {
      changed(select.value);
      select.blur();
    });
    return element("label", "choice", element("span", "", label), select);
  }
}
