// Small pieces of page.

type Child = Node | string | null | undefined;

/** An element with classes and children; text is text, never markup. */
export function element<K extends keyof HTMLElementTagNameMap>(
  tag: K,
  classes = "",
  ...children: Child[]
): HTMLElementTagNameMap[K] {
  const node = document.createElement(tag);
  if (classes) node.className = classes;
  node.append(...children.filter((child): child is Node | string => child !== null && child !== undefined));
  return node;
}

/** Writes only what has changed: the display is refreshed with every frame. */
export function setText(node: Element, text: string): void {
  if (node.textContent !== text) node.textContent = text;
}

export function setClass(node: Element, name: string, on: boolean): void {
  if (node.classList.contains(name) !== on) node.classList.toggle(name, on);
}

export function setWidth(node: HTMLElement, share: number): void {
  const width = `${Math.round(100 * Math.min(Math.max(Number.isFinite(share) ? share : 0, 0), 1))}%`;
  if (node.style.width !== width) node.style.width = width;
}

/** After a click by mouse the focus is nobody's, so that Space and Enter go on meaning what they do; by key it stays. */
export function returnFocus(click: MouseEvent, node: HTMLElement): void {
  if (click.detail > 0) node.blur();
}

/** A button that gives the focus back, so that keys go on meaning gestures. */
export function button(label: string, act: () => void, classes = ""): HTMLButtonElement {
  const node = element("button", classes, label);
  node.type = "button";
  node.addEventListener("click", (event) => {
    act();
    returnFocus(event, node);
  });
  return node;
}
