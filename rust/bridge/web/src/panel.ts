// The settings: keys, colours, cues, side of the arm, and the gaze check.

import { Dialog } from "./dialog";
import { button, element, setText } from "./dom";
import type { Gesture } from "./generated/types";
import { GESTURE_NAMES } from "./protocol";
import { COMMANDS, DEFAULT_KEYS, DWELLS_MS, keyName, MOST_NAME, SCANS_MS, remap, type Command, type Settings } from "./settings";
import { ownName } from "./wheel";

const NAMES: Record<string, string> = {
  turn_left: "Turn left",
  ahead: "Lean ahead",
  turn_right: "Turn right",
  left: "Lean left",
  back: "Lean back",
  right: "Lean right",
  upright: "Sit up",
  camera: "Next camera",
  signals: "Signals",
  views: "Hand and eye views",
  scores: "Scores",
  restart: "New trial",
};

function timeText(ms: number): string {
  return ms === 0 ? "off" : `${(ms / 1000).toFixed(1)} s`;
}

export interface PanelHandlers {
  changed(settings: Settings): void;
  gazeCheck(): void;
  gazeCalibration(): void;
  tutorial(): void;
}

export class Panel {
  readonly root: HTMLElement;
  private readonly dialog: Dialog;
  private readonly keyButtons = new Map<Command, HTMLButtonElement>();
  private listening: Command | null = null;

  constructor(
    private settings: Settings,
    private readonly handlers: PanelHandlers,
  ) {
    const title = element("h2", "", "Settings");
    this.dialog = new Dialog("settings", title, () => this.close());
    this.root = this.dialog.root;
    const keys = element("div", "keymap");
    for (const command of COMMANDS) {
      const gesture = GESTURE_NAMES[command as Gesture] as { name: string } | undefined;
      const hidden = command === "restart" ? "not-in-study" : "";
      const node = element("button", `keybutton ${hidden}`);
      node.type = "button";
      node.dataset["command"] = command;
      node.addEventListener("click", () => this.listen(command));
      this.keyButtons.set(command, node);
      keys.append(element("span", hidden, gesture ? gesture.name : (NAMES[command] ?? command)), node);
    }
    const reset = button("Standard keys", () => this.change({ keys: structuredClone(DEFAULT_KEYS) }), "plain");
    this.root.append(
      element("div", "dialoghead", title, button("Close", () => this.close(), "plain close")),
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
          this.choice("Captions of sounds", ["off", "on"], settings.captions ? "on" : "off", (on) => this.change({ captions: on === "on" })),
          this.choice("Arm", ["right", "left (mirrored)"], settings.leftArm ? "left (mirrored)" : "right", (side) =>
            this.change({ leftArm: side !== "right" }),
          ),
          element("h3", "", "Without keys"),
          this.choice("Mouse buttons and wheel make gestures", ["on", "off"], settings.mouseGestures ? "on" : "off", (on) =>
            this.change({ mouseGestures: on === "on" }),
          ),
          element("p", "note", "On the scene: left wrist extension, right wrist flexion; wheel towards you hand close, away hand open."),
          this.choice("Resting the pointer acts", DWELLS_MS.map(timeText), timeText(settings.dwellMs), (time) =>
            this.change({ dwellMs: DWELLS_MS.find((each) => timeText(each) === time) ?? 0 }),
          ),
          this.choice("One switch (Space, Enter or a click)", SCANS_MS.map(timeText), timeText(settings.scanMs), (time) =>
            this.change({ scanMs: SCANS_MS.find((each) => timeText(each) === time) ?? 0 }),
          ),
          element("h3", "", "Driver"),
          this.nameField(),
          element("h3", "not-in-study", "Gaze"),
          button(
            "Check the gaze (five points)",
            () => {
              this.close();
              this.handlers.gazeCheck();
            },
            "plain wide not-in-study",
          ),
          button(
            "Calibrate the gaze (five points)",
            () => {
              this.close();
              this.handlers.gazeCalibration();
            },
            "plain wide not-in-study",
          ),
          element("h3", "not-in-study", "Help"),
          button(
            "Show me how to move a block",
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
        if (!this.open || !this.listening) return;
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
    return this.dialog.open;
  }

  toggle(): void {
    if (this.open) this.close();
    else this.dialog.show();
    this.listening = null;
    this.show();
  }

  private close(): void {
    this.dialog.close();
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

  private nameField(): HTMLElement {
    const field = element("input");
    field.type = "text";
    field.name = "name";
    field.maxLength = MOST_NAME;
    field.value = this.settings.name;
    field.placeholder = ownName(navigator.userAgent);
    field.addEventListener("change", () => this.change({ name: field.value.trim() }));
    return element("label", "choice", element("span", "", "Your name, as others see it"), field);
  }

  private choice(label: string, options: string[], chosen: string, changed: (value: string) => void): HTMLElement {
    const select = element("select", "", ...options.map((option) => element("option", "", option)));
    select.value = chosen;
    select.name = label.toLowerCase().split(" ")[0] ?? "";
    select.addEventListener("change", () => {
      changed(select.value);
    });
    return element("label", "choice", element("span", "", label), select);
  }
}
