// Who drives, by name, and the button that takes over.

import { button, element, setClass, setText } from "./dom";
import { strings } from "./strings";
import type { ServerMessage } from "./generated/types";

const words = strings.wheel;

export type Driver = Omit<Extract<ServerMessage, { type: "driver" }>, "type">;

/** What a page is called as long as its person gives it no name: the browser and the system that it runs on. */
export function defaultPageName(agent: string): string {
  const browsers: [RegExp, string][] = [[/Edg\//, "Edge"], [/OculusBrowser/, "Headset"], [/Firefox\//, "Firefox"], [/Chrome\//, "Chrome"], [/Safari\//, "Safari"]];
  const systems: [RegExp, string][] = [[/Android/, "Android"], [/iPhone|iPad/, "iOS"], [/Windows/, "Windows"], [/Mac OS/, "macOS"], [/Linux|X11/, "Linux"]];
  const first = (list: [RegExp, string][]) => list.find(([pattern]) => pattern.test(agent))?.[1];
  const [browser, system] = [first(browsers), first(systems)];
  return browser ? (system ? `${browser} on ${system}` : browser) : "A page";
}

/** What a page says of who drives. */
export function driverText({ name, you }: Driver): string {
  if (you) return words.you;
  return name === null ? words.nobody : words.other(name);
}

export class ControlLease {
  readonly root = element("div", "wheel");
  private readonly text = element("span");
  private readonly takeOverButton: HTMLButtonElement;

  constructor(takeOver: () => void) {
    this.takeOverButton = button(words.takeOver, takeOver, "primary");
    this.text.setAttribute("role", "status");
    this.root.append(this.text, this.takeOverButton);
    this.root.hidden = true;
  }

  show(driver: Driver): void {
    setText(this.text, driverText(driver));
    setText(this.takeOverButton, driver.name === null ? words.drive : words.takeOver);
    this.takeOverButton.hidden = driver.you || !driver.may_drive;
    setClass(this.root, "watches", !driver.you);
    this.root.hidden = false;
  }

  hide(): void {
    this.root.hidden = true;
  }
}
