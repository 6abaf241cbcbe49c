// Opens the drawer of signals, which is loaded with its first opening.

import { element } from "./dom";
import type { PageContent } from "./generated/types";
import type { SignalsDrawer } from "./signalsDrawer";

export class LazySignalsDrawer {
  /** In the place of the drawer until it is there. */
  readonly root = element("div");
  /** In that of its bars over the scene. */
  readonly overlay = element("div");
  drawer: SignalsDrawer | null = null;
  private loading = false;

  /** `opened`: it was opened or closed, and signals are wanted from the server or no longer; `escaped` by a key of its own. */
  constructor(
    private readonly content: () => PageContent | null,
    private readonly opened: (open: boolean, escaped: boolean) => void,
  ) {
    this.root.hidden = true;
  }

  get open(): boolean {
    return this.drawer?.open ?? false;
  }

  toggle(): void {
    if (this.drawer) this.drawer.toggle();
    else if (!this.loading) void this.load();
  }

  private async load(): Promise<void> {
    this.loading = true;
    try {
      const { SignalsDrawer: Drawer } = await import("./signalsDrawer");
      this.drawer = new Drawer(this.opened);
    } finally {
      this.loading = false;
    }
    const content = this.content();
    if (content) this.drawer.show(content);
    this.root.replaceWith(this.drawer.root);
    this.overlay.replaceWith(this.drawer.intent.overlay);
    this.drawer.toggle();
  }
}
