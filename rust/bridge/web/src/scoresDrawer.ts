// Opens the scoreboard, which is loaded with its first opening.

import { element } from "./dom";
import type { PageContent, ResultCard } from "./generated/types";
import type { Scoreboard } from "./scoreboard";

export class ScoresDrawer {
  /** Where it stands once it is there. */
  readonly root = element("div");
  /** Of this visit, the newest first. */
  results: ResultCard[] = [];
  private board: Scoreboard | null = null;

  constructor(private readonly opened: (open: boolean) => void) {}

  get open(): boolean {
    return this.board?.open ?? false;
  }

  toggle(content: PageContent | null): void {
    if (this.open) this.board?.close();
    else if (content) void this.show(content);
  }

  private async show(content: PageContent): Promise<void> {
    if (!this.board) {
      const { Scoreboard: Board } = await import("./scoreboard");
      this.board ??= new Board(() => this.opened(false));
      this.root.append(this.board.root);
    }
    this.board.show(this.results, content);
    this.opened(true);
  }
}
