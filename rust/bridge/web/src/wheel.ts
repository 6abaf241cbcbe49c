// Who drives, by name, and the button that takes over.

import { button, element, setClass, setText } from "./dom";
import { strings } from "./strings";
import type { ServerMessage } from "./generated/types";

const words = strings.wheel;

export type Driver = Omit<Extract<ServerMessage, { type: "driver" }>, "type">;

/** What a page is called as long as its person gives it no name: the browser and the system that it runs on. */
export function ownName(agent: string): string {
  const browsers: [RegExp, string][] = [[/Edg\//, "Edge"], [/OculusBrowser/, "Headset"], [/Firefox\//, "Firefox"], [/Chrome\//, "Chrome"], [/Safari\//, "Safari"]];
  const systems: [RegExp, string][] = [[/Android/, "Android"], [/iPhone|iPad/, "iOS"], [/Windows/, "Windows"], [/Mac OS/, "macOS"], [/Linux|X11/, "Linux"]];
  const first = (list: [RegExp, string][]) => list.find(([pattern]) => pattern.test(agent))?.[1];
  const [browser, system] = [first(browsers), first(systems)];
  return browser ? (system ? `${browser} on ${system}` : browser) : "A page";
}

/** What a page says of who drives. */
export function wheelText({ name, you }: Driver): string {
  if (you) return words.you;
  return name === null ? words.nobody : words.other(name);
}

export class Wheel {
  readonly root = element("div", "wheel");
  private readonly text = element("span");
  private readonly take: HTMLButtonElement;

  constructor(takeOver: () => void) {
    this.take = button(words.takeOver, takeOver, "primary");
    this.text.setAttribute("role", "status");
    this.root.append(this.text, this.take);
    this.root.hidden = true;
  }

  show(driver: Driver): void {
    setText(this.text, wheelText(driver));
    setText(this.take, driver.name === null ? words.drive : words.takeOver);
    this.take.hidden = driver.you || !driver.may_drive;
    setClass(this.root, "watches", !driver.you);
    this.root.hidden = false;
  }

  hide(): void {
    this.root.hidden = true;
  }
}
