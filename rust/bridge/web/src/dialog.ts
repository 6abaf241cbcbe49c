// Dialogs: named for screen readers, with the focus inside while they are open, closed by Escape. The browser's own
// element does this; a modal one keeps everything behind it from being reached.

import { element } from "./dom";

let numbers = 0;

export class Dialog {
  readonly root: HTMLDialogElement;

  /**
   * `title` names it. `escaped` is called when Escape closes it. A dialog that is not modal stands beside the scene and leaves
   * keys their meaning.
   */
  constructor(
    classes: string,
    title: HTMLElement,
    private readonly escaped: () => void,
    private readonly modal = true,
  ) {
    numbers += 1;
    title.id ||= `dialog-title-${numbers}`;
    this.root = element("dialog", `dialog ${classes}`);
    this.root.setAttribute("aria-labelledby", title.id);
    this.root.hidden = true;
    this.root.addEventListener("cancel", (event) => {
      event.preventDefault();
      this.close();
      this.escaped();
    });
  }

  get open(): boolean {
    return !this.root.hidden;
  }

  show(): void {
    if (this.open) return;
    this.root.hidden = false;
    if (this.modal) this.root.showModal();
    else this.root.show();
  }

  close(): void {
    if (!this.open) return;
    this.root.close();
    this.root.hidden = true;
    // The focus came back to the button that opened it, and would go on taking Space for itself.
    if (document.activeElement instanceof HTMLElement) document.activeElement.blur();
  }
}
