// A study's screens in a headset, where no page is seen: a board behind the box. A ray chooses by the trigger, or by resting.

import {
  CanvasTexture,
  DoubleSide,
  Group,
  Matrix4,
  Mesh,
  MeshBasicMaterial,
  PlaneGeometry,
  Raycaster,
  RingGeometry,
  SRGBColorSpace,
  Vector3,
} from "three";
import { paintPage, paintSentence } from "./headsetBoardDrawing";
import type { FormState } from "./formState";
import { BOARD_HEIGHT, BOARD_WIDTH, cellAt, DwellSelector, pageOf, pagesOf, type CellAction, type Cell } from "./formLayout";
import { conditionName, conditionsByRank, ranksOf, textInLanguage, type Question } from "./forms";
import type { FormScreen, ParticipantScreen } from "./generated/types";
import { gestureInstruction } from "./hand";
import { clockText, screenKey, promptTexts, sentenceOf } from "./participantScreens";
import type { TaskScene } from "./scene";
import { strings } from "./strings";

const texts = strings.forms;

/** Size in the world, distance behind the box, and height of the lower edge above the table, metres. */
const SIZE_M = { x: 0.9, y: (0.9 * BOARD_HEIGHT) / BOARD_WIDTH };
const DISTANCE_M = 0.25;
const HEIGHT_M = 0.16;
/** The ring at the end of the ray: inner and outer radius, metres, and of how many parts it is made. */
const RING = [0.013, 0.02, 48] as const;
/** Two triangles draw one part. */
const INDICES_PER_PART = 6;
/** The ring floats before the board, metres. */
const RING_OFFSET_M = 0.004;

export class FormBoard {
  readonly root = new Group();
  /** What can be chosen now. */
  cells: Cell[] = [];
  private readonly canvas = document.createElement("canvas");
  private readonly texture: CanvasTexture;
  private readonly sheet: Mesh;
  private readonly pointer = new Group();
  private readonly progress: RingGeometry;
  private readonly raycaster = new Raycaster();
  private readonly dwell = new DwellSelector();
  private hoveredCell: Cell | null = null;
  private painted = "";
  private shownScreenKey = "";
  private screen: FormScreen | null = null;
  private pages: Question[] = [];
  private pageIndex = 0;
  /** Places in rankings, which may be incomplete, by question. */
  private readonly ranks = new Map<string, Map<string, number>>();

  constructor(private readonly draft: FormState) {
    this.canvas.width = BOARD_WIDTH;
    this.canvas.height = BOARD_HEIGHT;
    this.texture = new CanvasTexture(this.canvas);
    this.texture.colorSpace = SRGBColorSpace;
    this.texture.anisotropy = 8;
    this.sheet = new Mesh(new PlaneGeometry(SIZE_M.x, SIZE_M.y), new MeshBasicMaterial({ map: this.texture, transparent: true, toneMapped: false }));
    const [ground, progress] = [ring("#17212b", 20), ring("#f59e0b", 21)];
    this.progress = progress.geometry;
    this.pointer.add(ground, progress);
    this.root.add(this.sheet, this.pointer);
    // Upright, facing the person, who looks along x: text runs to the right, which is -y.
    this.root.quaternion.setFromRotationMatrix(new Matrix4().makeBasis(new Vector3(0, -1, 0), new Vector3(0, 0, 1), new Vector3(-1, 0, 0)));
    this.root.visible = false;
  }

  setPosition({ tableCenter: centre, tableHalfSize: half, tableHeight }: TaskScene): void {
    this.root.position.set(centre.x + half.x + DISTANCE_M, centre.y, tableHeight + HEIGHT_M + SIZE_M.y / 2);
  }

  /** Where the middle of a cell is, in the frame in which the board stands. */
  pointOf(cell: Cell): Vector3 {
    const { x, y } = local(cell.x + cell.width / 2, cell.y + cell.height / 2);
    return this.root.localToWorld(new Vector3(x, y, 0));
  }

  /** Shows a screen; none hides the board. Called once per picture. `restLeft`: of a break, seconds. */
  show(screen: ParticipantScreen | null, language: string, restLeft: number): void {
    this.root.visible = screen !== null;
    if (!screen) {
      this.shownScreenKey = "";
      this.cells = [];
      this.hoveredCell = null;
      return;
    }
    if (screen.show === "form") this.showForm(screen, language);
    else this.showSentence(screen, restLeft);
  }

  /** Takes the ray, in the frame in which the board stands, and what it rests on. */
  aim(origin: Vector3, direction: Vector3, nowMs: number): void {
    this.root.updateWorldMatrix(true, true);
    this.raycaster.set(origin, direction);
    const hit = this.raycaster.intersectObject(this.sheet, false)[0];
    const at = hit?.uv ? { x: hit.uv.x * BOARD_WIDTH, y: (1 - hit.uv.y) * BOARD_HEIGHT } : null;
    this.pointer.visible = at !== null && this.cells.length > 0;
    if (at) {
      const { x, y } = local(at.x, at.y);
      this.pointer.position.set(x, y, RING_OFFSET_M);
    }
    this.hoveredCell = at && cellAt(this.cells, at.x, at.y);
    const { share, chosen } = this.dwell.update(nowMs, this.hoveredCell);
    this.progress.setDrawRange(0, INDICES_PER_PART * Math.round(share * RING[2]));
    if (chosen) this.choose();
  }

  /** The trigger was pressed. */
  press(): void {
    this.dwell.reset();
    this.choose();
  }

  private choose(): void {
    if (this.hoveredCell) this.applyAction(this.hoveredCell.action);
  }

  private applyAction(act: CellAction): void {
    switch (act.act) {
      case "answer":
        this.draft.setAnswer(act.key, act.answer);
        break;
      case "rank": {
        const ranks = this.ranksOf(act.key).set(act.condition, act.place);
        this.ranks.set(act.key, ranks);
        const places = conditionsByRank(this.screen?.conditions ?? [], ranks);
        if (places) this.draft.setAnswer(act.key, places);
        break;
      }
      case "turn":
        this.pageIndex = Math.min(Math.max(this.pageIndex + act.by, 0), this.pages.length - 1);
        break;
      case "done": {
        const [missing] = this.draft.submit();
        const page = this.pages.findIndex(({ key }) => key === missing?.key);
        if (page >= 0) this.pageIndex = page;
        break;
      }
    }
  }

  private ranksOf(key: string): Map<string, number> {
    return this.ranks.get(key) ?? ranksOf(this.draft.answer(key));
  }

  private showForm(screen: { show: "form" } & FormScreen, language: string): void {
    this.screen = screen;
    this.pages = pagesOf(this.draft.questions);
    if (screenKey(screen) !== this.shownScreenKey) {
      this.shownScreenKey = screenKey(screen);
      this.ranks.clear();
      this.dwell.begin();
      // Where one stopped, if one was here before.
      const [missing] = this.draft.missing();
      this.pageIndex = Math.max(this.pages.findIndex(({ key }) => key === missing?.key), 0);
    }
    const { conditions, form, about } = screen;
    const question = this.pages[this.pageIndex];
    const ranks = question ? this.ranksOf(question.key) : new Map<string, number>();
    const page = pageOf({ pages: this.pages, pageIndex: this.pageIndex, conditions, language, answer: (key) => this.draft.answer(key), ranks });
    this.cells = page.cells;
    const title = textInLanguage(form.title, language).text;
    const head = {
      left: about === null ? title : `${title} · ${conditionName(about)}`,
      right: this.pages.length > 1 ? `${this.pageIndex + 1} of ${this.pages.length}` : "",
    };
    const reason = question ? this.draft.reason(question.key) : "";
    if (reason) page.note = texts.refused(reason);
    const under = this.hoveredCell && cellAt(page.cells, this.hoveredCell.x, this.hoveredCell.y);
    this.paint(JSON.stringify([head, page, under]), (context) => paintPage(context, head, page, under));
  }

  private showSentence(screen: Exclude<ParticipantScreen, { show: "form" }>, restLeft: number): void {
    this.shownScreenKey = screen.show;
    this.cells = [];
    this.hoveredCell = null;
    const clock = screen.show === "rest" && restLeft > 0 ? clockText(restLeft) : "";
    if (screen.show === "train") {
      const words = { title: gestureInstruction(screen.gesture), text: screen.text };
      const { recognised, row } = promptTexts(screen);
      // In steps: each picture of the board goes to the graphics card.
      const share = Math.round(20 * screen.share) / 20;
      const line = [recognised, row].filter(Boolean).join(" · ");
      this.paint(JSON.stringify([words, line, share]), (context) => paintSentence(context, words, line, share));
      return;
    }
    const words = sentenceOf(screen, restLeft) ?? { title: "", text: "" };
    this.paint(JSON.stringify([words, clock]), (context) => paintSentence(context, words, clock, null));
  }

  /** Paints what is not on the board yet. */
  private paint(what: string, draw: (context: CanvasRenderingContext2D) => void): void {
    const context = this.canvas.getContext("2d");
    if (what === this.painted || !context) return;
    this.painted = what;
    draw(context);
    this.texture.needsUpdate = true;
  }
}

/** A point of the picture on the board, metres from its middle, x to the right and y up. */
function local(x: number, y: number): { x: number; y: number } {
  return { x: (x / BOARD_WIDTH - 0.5) * SIZE_M.x, y: (0.5 - y / BOARD_HEIGHT) * SIZE_M.y };
}

/** A ring that is drawn from the top clockwise. */
function ring(colour: string, order: number): Mesh<RingGeometry, MeshBasicMaterial> {
  const [inner, outer, parts] = RING;
  const material = new MeshBasicMaterial({ color: colour, side: DoubleSide, transparent: true, toneMapped: false, depthTest: false });
  const mesh = new Mesh(new RingGeometry(inner, outer, parts, 1, Math.PI / 2, -2 * Math.PI), material);
  mesh.renderOrder = order;
  return mesh;
}
