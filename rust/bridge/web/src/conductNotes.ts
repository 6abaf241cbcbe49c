// Notes of a session. What is written stays in the field until the server shows it among the notes.

import { noteCounts } from "./conductText";
import { element } from "./dom";
import { strings } from "./strings";

const texts = strings.study;

/** Longest note, characters. */
const MAX_NOTE_CHARS = 2000;

export class NotesView {
  readonly root: HTMLElement;
  private readonly field = element("textarea");
  private readonly add = element("button", "", texts.addNote);
  private readonly list = element("ul", "notelist");
  private notes: string[] = [];
  private shown = "";
  /** What was sent, and how often it was there before. */
  private sent: { text: string; times: number } | null = null;

  constructor(noted: (text: string) => void) {
    const { field, add, list } = this;
    Object.assign(field, { rows: 2, maxLength: MAX_NOTE_CHARS, placeholder: texts.noteHint });
    field.setAttribute("aria-label", texts.note);
    field.setAttribute("aria-keyshortcuts", "T");
    field.addEventListener("keydown", (event) => {
      if (event.key === "Enter" && (event.ctrlKey || event.metaKey)) form.requestSubmit();
      if (event.key === "Escape") field.blur();
    });
    add.type = "submit";
    add.title = texts.noteKeys;
    list.tabIndex = 0;
    list.setAttribute("aria-label", texts.notesLabel);
    const form = element("form", "", field, add);
    form.addEventListener("submit", (event) => {
      event.preventDefault();
      // As the server keeps it: on one line.
      const text = oneLine(field.value);
      if (text === "" || add.disabled) return;
      this.sent = { text, times: noteCounts(this.notes, text) };
      noted(text);
    });
    const key = element("kbd", "", "T");
    key.setAttribute("aria-hidden", "true");
    this.root = element("section", "pane notes", element("div", "loghead", element("h2", "", texts.notes), key), form, list);
  }

  focus(): void {
    this.field.focus();
  }

  showConnected(connected: boolean): void {
    this.add.disabled = !connected;
  }

  show(notes: string[]): void {
    const text = JSON.stringify(notes);
    if (text === this.shown) return;
    this.shown = text;
    this.notes = notes;
    if (this.sent && noteCounts(notes, this.sent.text) > this.sent.times) {
      if (oneLine(this.field.value) === this.sent.text) this.field.value = "";
      this.sent = null;
    }
    this.list.replaceChildren(...[...notes].reverse().map((note) => element("li", "", note)));
    this.list.hidden = notes.length === 0;
  }
}

function oneLine(text: string): string {
  return text.trim().replace(/\s+/g, " ");
}
