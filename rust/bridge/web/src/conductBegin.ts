// Before a session: whose turn it is, beginning for somebody else, and how far each participant is.

import { suggestedId, participantText } from "./conductText";
import { button, element, setText } from "./dom";
import type { ExperimenterScreen, ParticipantRow } from "./generated/types";
import { strings } from "./strings";

const texts = strings.study;

/** Longest pseudonym, characters, and those that it may have; the server checks it again. */
const MAX_ID_CHARS = 32;
const ID_PATTERN = "[A-Za-z0-9_\\-]+";

export class BeginView {
  readonly root = element("div", "begin");
  private readonly who = element("h3");
  private readonly about = element("p");
  private readonly deviation = element("p", "warning");
  private readonly id = element("input");
  private readonly isNew = element("input");
  private readonly ids = element("datalist");
  private readonly begin = element("button", "", texts.beginOther);
  private readonly form: HTMLFormElement;
  private readonly people = element("tbody");
  private participants: ParticipantRow[] = [];
  private shown = "";

  constructor(begun: (id: string, isNew: boolean) => void) {
    const { id, isNew, ids } = this;
    ids.id = "pseudonyms";
    Object.assign(id, { type: "text", name: "pseudonym", required: true, maxLength: MAX_ID_CHARS, pattern: ID_PATTERN, autocomplete: "off", spellcheck: false });
    id.title = texts.idAbout;
    id.setAttribute("list", ids.id);
    Object.assign(isNew, { type: "checkbox", name: "new" });
    isNew.addEventListener("change", () => {
      if (isNew.checked && id.value === "") id.value = suggestedId(this.participants);
    });
    this.begin.type = "submit";
    this.form = element(
      "form",
      "beginother",
      element("h3", "", texts.somebodyElse),
      element("label", "field", element("span", "label", texts.pseudonym), id, ids),
      element("label", "check", isNew, texts.newParticipant),
      this.begin,
    );
    this.form.addEventListener("submit", (event) => {
      event.preventDefault();
      begun(id.value.trim(), isNew.checked);
    });
    const head = [texts.place, texts.pseudonym, texts.steps, texts.trials, ""].map((name) => {
      const cell = element(name ? "th" : "td", "", name);
      if (name) cell.setAttribute("scope", "col");
      return cell;
    });
    const table = element("table", "people", element("caption", "label", texts.participants), element("thead", "", element("tr", "", ...head)), this.people);
    this.root.append(element("div", "turn", this.who, this.about, this.deviation), this.form, table);
  }

  show({ next, participants, can }: ExperimenterScreen): void {
    setText(this.who, next ? participantText(next) : texts.allOver);
    const fresh = next?.id === null ? texts.nobodyYet : texts.notBegun;
    setText(this.about, next ? (next.begun ? texts.begunBefore : fresh) : texts.nobodyLeft);
    setText(this.deviation, next?.departs ? texts.departs(next.departs) : "");
    this.form.hidden = !can.includes("begin");
    const text = JSON.stringify([participants, can.includes("begin")]);
    if (text === this.shown) return;
    this.shown = text;
    this.participants = participants;
    this.ids.replaceChildren(...participants.flatMap(({ id }) => (id === null ? [] : [new Option(id, id)])));
    this.people.replaceChildren(...participants.map((line) => this.row(line)));
  }

  /** Forgets who was typed in: somebody's session is under way. */
  clear(): void {
    if (this.id.value !== "" || this.isNew.checked) this.form.reset();
  }

  showConnected(connected: boolean): void {
    this.begin.disabled = !connected;
  }

  private row({ participant, id, steps, trials }: ParticipantRow): HTMLElement {
    const place = element("th", "", String(participant));
    place.scope = "row";
    const over = steps[0] >= steps[1];
    const choose = button(texts.choose, () => {
      this.id.value = id ?? "";
      this.isNew.checked = false;
    });
    choose.setAttribute("aria-label", texts.chooseWho(id ?? ""));
    return element(
      "tr",
      over ? "over" : "",
      place,
      element("td", "", id ?? "–"),
      element("td", "", `${steps[0]} of ${steps[1]}`),
      element("td", "", `${trials[0]} of ${trials[1]}`),
      element("td", "", id === null || over || this.form.hidden ? null : choose),
    );
  }
}
