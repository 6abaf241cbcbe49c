// How the headset's board is painted. A headset's picture is coarse: letters are large, and lines are few.

import { BOARD_HEIGHT, BOARD_WIDTH, wrapLines, type BoardPage, type Box, type Cell } from "./formLayout";
import type { Sentence } from "./participantScreens";

const [INK, SOFT, ACCENT, EDGE, PALE] = ["#17212b", "#4f5d6a", "#0b6fb8", "#7b8894", "#dcecf8"];
const FONT_FAMILY = "system-ui, sans-serif";
const MARGIN_PX = 48;
/** Letters of a text that has to fit get as large as they can, pixels. */
const SIZES = [52, 46, 40, 34, 29, 25, 21];
const LINE_HEIGHT = 1.25;

/** What stands above the question. */
export interface Head {
  left: string;
  right: string;
}

export function paintBackground(context: CanvasRenderingContext2D): void {
  context.clearRect(0, 0, BOARD_WIDTH, BOARD_HEIGHT);
  context.fillStyle = "rgba(255,255,255,0.97)";
  roundedRect(context, { x: 4, y: 4, width: BOARD_WIDTH - 8, height: BOARD_HEIGHT - 8 }, 40);
  context.fill();
}

/** A screen without answers. `share` of something is over; none where nothing goes on. */
export function paintSentence(context: CanvasRenderingContext2D, { title, text }: Sentence, clock: string, share: number | null): void {
  paintBackground(context);
  const middle = { x: MARGIN_PX, width: BOARD_WIDTH - 2 * MARGIN_PX };
  paintText(context, title, { ...middle, y: 150, height: 130 }, { align: "center", weight: 700, largest: 76 });
  paintText(context, text, { ...middle, y: 300, height: 190 }, { align: "center", color: SOFT });
  paintText(context, clock, { ...middle, y: 500, height: 130 }, { align: "center", weight: 700, largest: 96 });
  if (share === null) return;
  const bar = { x: 212, y: 620, width: 600, height: 28 };
  paintBox(context, bar, PALE);
  if (share > 0) paintBox(context, { ...bar, width: Math.max(bar.width * Math.min(share, 1), bar.height) }, ACCENT);
}

/** A question and its answers; `under` is the cell that the ray is on. */
export function paintPage(context: CanvasRenderingContext2D, head: Head, page: BoardPage, under: Cell | null): void {
  paintBackground(context);
  const line = { x: MARGIN_PX, y: 36, width: BOARD_WIDTH - 2 * MARGIN_PX, height: 50 };
  paintText(context, head.left, { ...line, width: line.width - 180 }, { color: SOFT, largest: 29 });
  paintText(context, head.right, line, { align: "right", color: SOFT, largest: 29 });
  const answers = page.cells.filter(({ action: act }) => act.act === "answer" || act.act === "rank");
  const note = { ...line, y: answers.length > 0 ? 608 : 400, height: 40 };
  // Long texts have few answers, and the room that those leave.
  const below = Math.min(note.y, ...[...page.labels, ...answers].map(({ y }) => y));
  paintText(context, page.question, { ...line, y: 96, height: below - 16 - 96 }, { weight: 650, top: true });
  for (const label of page.labels) paintText(context, label.text, label, { align: label.align, color: SOFT, largest: 34 });
  paintText(context, page.note, note, { color: ACCENT, largest: 34 });
  for (const cell of page.cells) paintCell(context, cell, cell === under);
}

function paintCell(context: CanvasRenderingContext2D, cell: Cell, under: boolean): void {
  const ahead = cell.action.act === "done" || (cell.action.act === "turn" && cell.action.by === 1);
  const filled = cell.chosen || ahead;
  paintBox(context, cell, filled ? ACCENT : under ? PALE : "#ffffff");
  context.lineWidth = under ? 6 : 2;
  context.strokeStyle = under ? (filled ? INK : ACCENT) : EDGE;
  context.stroke();
  const inner = { x: cell.x + 12, y: cell.y, width: cell.width - 24, height: cell.height };
  const mark = cell.chosen && cell.label !== "" && cell.width > 100 ? "✓ " : "";
  paintText(context, `${mark}${cell.label}`, inner, { align: "center", weight: 600, color: filled ? "#ffffff" : INK, largest: 40 });
}

function paintBox(context: CanvasRenderingContext2D, box: Box, colour: string): void {
  context.fillStyle = colour;
  roundedRect(context, box, Math.min(18, box.width / 3, box.height / 2));
  context.fill();
}

function roundedRect(context: CanvasRenderingContext2D, { x, y, width, height }: Box, radius: number): void {
  context.beginPath();
  context.roundRect(x, y, width, height, radius);
}

interface TextStyle {
  align?: "left" | "right" | "center";
  color?: string;
  weight?: number;
  largest?: number;
  /** Begins at the top of its box. */
  top?: boolean;
}

/** Writes a text into a box, as large as it fits: in the middle of its height, or at its top. */
function paintText(context: CanvasRenderingContext2D, text: string, box: Box, style: TextStyle): void {
  if (text === "") return;
  const { align = "left", color = INK, weight = 500, largest = SIZES[0] ?? 52 } = style;
  const sizes = [largest, ...SIZES.filter((size) => size < largest)];
  const font = (size: number) => `${weight} ${size}px ${FONT_FAMILY}`;
  const broken = (size: number) => {
    context.font = font(size);
    return wrapLines(text, box.width, (line) => context.measureText(line).width);
  };
  const fits = (size: number) => {
    const lines = broken(size);
    return lines.length * size * LINE_HEIGHT <= box.height && lines.every((line) => context.measureText(line).width <= box.width);
  };
  const size = sizes.find(fits) ?? sizes[sizes.length - 1] ?? largest;
  const lines = broken(size);
  context.fillStyle = color;
  context.textBaseline = "middle";
  context.textAlign = align;
  const x = align === "left" ? box.x : align === "right" ? box.x + box.width : box.x + box.width / 2;
  const top = box.y + (style.top ? 0 : (box.height - lines.length * size * LINE_HEIGHT) / 2);
  lines.forEach((line, k) => context.fillText(line, x, top + (k + 0.5) * size * LINE_HEIGHT, box.width));
}
