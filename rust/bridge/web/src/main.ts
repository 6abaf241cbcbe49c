// The participant's page: scene, display and controls around one live connection.

import "./theme.css";
import "./layout.css";
import "./style.css";
import "./dialogs.css";
import "./form.css";
import "./participant.css";
import "./signals.css";
import "./scoreboard.css";
import { Vector2, Vector3 } from "three";
import { CAMERA_NAMES, type CameraKind } from "./cameras";
import { Controls } from "./controls";
import type { Debug } from "./debug";
import { element } from "./dom";
import { FrameCounter, ScriptTime } from "./frameCount";
import { GamepadInput } from "./gamepad";
import { GazeCheckView } from "./gazeCheckView";
import { AccessibleInput } from "./accessibleInput";
import { jogGoal } from "./jogGoal";
import { Board } from "./headsetBoard";
import { FormBoard } from "./formBoard";
import { HintBar } from "./hintBar";
import { stopHint, nextHint, type HintContext } from "./hints";
import { Headset } from "./headset";
import { Hud, scoreText } from "./hud";
import { LiveConnection } from "./liveConnection";
import { FocusTargets, likelyFocusTargets, type FocusTarget } from "./focusTargets";
import { FrameInterpolator } from "./frameInterpolation";
import { SettingsPanel } from "./settingsPanel";
import { ParticipantView } from "./participantView";
import { GazePicker } from "./gazePicking";
import type { ObjectId, DisplayFrame, PageContent, TrialStatus } from "./generated/types";
import { methodOf } from "./protocol";
import { keyName, loadSettings, storeSettings, type Settings } from "./settings";
import { setPalette } from "./objects";
import { setTextMirrored } from "./shapes";
import { StartErrorView } from "./startError";
import { ResultView } from "./resultCard";
import { ScoresDrawer } from "./scoresDrawer";
import { LazySignalsDrawer } from "./lazySignalsDrawer";
import { Sounds } from "./sounds";
import { SceneRenderer, drawErrorText } from "./renderer";
import { STOPPED_TITLE } from "./stopBanner";
import { strings } from "./strings";
import { Tutorial } from "./tutorial";
import { defaultPageName, ControlLease, type Driver } from "./controlLease";

const parameters = new URLSearchParams(location.search);
/** Pictures are at least this far apart, ms: `?pictures=N` asks for at most N a second. */
const MIN_FRAME_INTERVAL_MS = 1000 / (Number(parameters.get("pictures")) || Infinity);
/** A connection of a page that is gone ends within so long, ms. */
const RELOAD_TIMEOUT_MS = 3000;
const canvas = document.getElementById("scene") as HTMLCanvasElement;
const overlay = document.getElementById("overlay") as HTMLElement;

function start(): void {
  let settings = loadSettings();
  setPalette(settings.palette);
  setTextMirrored(settings.leftArm);
  const stage = new SceneRenderer(canvas);
  const { cameras } = stage;
  const pointing = new GazePicker();
  const motion = new FrameInterpolator();
  const count = new FrameCounter();
  const [script, whole] = [new ScriptTime(), new ScriptTime()];
  const signals = new LazySignalsDrawer(
    () => stage.content,
    (open, escaped) => {
      live.send({ type: "watch", signals: open });
      controls.setOpen("signals", open);
      if (escaped) controls.focus("signals");
    },
  );
  const sounds = new Sounds();
  const guide = new HintBar();
  const refusal = new StartErrorView();
  const scores = new ScoresDrawer((open) => controls.setOpen("scores", open));
  let everConnected = false;
  let cursor: Vector2 | null = null;
  let gazeSource: string | null = null;
  let asked: Pick<TrialStatus, "gaze_checks" | "gaze_calibrations"> | null = null;
  const shown = { since: performance.now(), received: 0, drawn: 0 };

  const debug: Debug = {
    frame: null,
    framesReceived: 0,
    framesDrawn: 0,
    framesDropped: 0,
    cues: 0,
    worn: false,
    ghost: null,
    connected: false,
    script,
    whole,
    drawCalls: 0,
    triangles: 0,
    faded: 0,
    signals,
    content: null,
    camera: cameras.kind,
    chooseCamera,
    project: (what, id) => stage.project(what, id, settings.leftArm),
    gazePoint() {
      const seen = check.point?.project(cameras.camera);
      const x = settings.leftArm ? -(seen?.x ?? 0) : (seen?.x ?? 0);
      return seen ? { x: ((x + 1) / 2) * window.innerWidth, y: ((1 - seen.y) / 2) * window.innerHeight } : null;
    },
    boardCells: () =>
      formBoard.cells.map((cell) => {
        const at = cameras.rig.worldToLocal(formBoard.pointOf(cell));
        return { label: cell.label, chosen: cell.chosen, at: at.toArray() };
      }),
    tableMiddle: () => stage.taskScene?.tableCenter.toArray() ?? null,
  };
  (window as unknown as { __proact: Debug }).__proact = debug;

  let trial: TrialStatus | null = null;
  /** The person did something since the trial began: from then on the mouse is the gaze. */
  let acted = false;
  /** This page holds the trial's time. */
  let held = false;
  /** The server knows that a picture of the trial is on the screen. */
  let drawn = false;
  let greeted = false;
  let driver: Driver | null = null;
  let connectedAt = 0;
  /** The page may drive, and does. */
  const interactive = () => (stage.content?.interactive ?? false) && (driver?.you ?? false);
  /** The page may begin another trial. In a study the experimenter does. */
  const restarts = () => interactive() && !study.active;
  const restart = (choice: { method?: string; again?: boolean } = {}) => {
    if (!study.active) live.send({ type: "restart", ...choice });
  };
  const controls = new Controls(
    {
      gesture(gesture) {
        if (!interactive()) return;
        acted ||= gesture !== "no_motion";
        live.send({ type: "gesture", gesture });
      },
      heartbeat: () => live.send({ type: "alive" }),
      pollingStopped: () => hud.showToast(strings.controls.unread),
      trunk: (posture) => live.send({ type: "trunk", ...posture }),
      restart: () => restart(),
      camera: () => !study.coversScene && chooseCamera(cameras.next()),
      signals: () => !study.active && signals.toggle(),
      views() {
        stage.toggleInsets();
        controls.setOpen("views", stage.insets.on);
      },
      scores: () => !study.active && scores.toggle(stage.content),
      turn: (code) => cameras.key(code),
      arrow: (code) => marks.onArrowKey(code),
    },
    settings.keys,
  );
  const chooseMethod = (method: string) => restart({ method });
  const wheel = new ControlLease(() => live.send({ type: "take_over" }));
  const hud = new Hud(chooseMethod, wheel.root, () => panel.toggle());
  const tutorial = new Tutorial({ choose: chooseMethod, ended: () => change({ ...settings, welcomed: true }) }, settings.keys);
  const check = new GazeCheckView((result) => live.send({ type: "gaze_check", ...result }));
  const panel = new SettingsPanel(settings, {
    changed: change,
    gazeCheck: () => checkGaze(),
    gazeCalibration: () => checkGaze(true),
    tutorial: () => restarts() && tutorial.start(),
  });
  const study = new ParticipantView({
    answer: (step, key, answer) => live.send({ type: "answer", step, key, answer }),
    submit: (step) => live.send({ type: "submit", step }),
    settings: () => panel.toggle(),
    changed: () => inStudy(),
  });
  const gamepad = new GamepadInput({
    hold: (source, gesture, down) => controls.holdPolled(source, gesture, down),
    moveGaze(x, y) {
      if (study.coversScene) return;
      acted = true;
      cursor ??= new Vector2();
      cursor.set(Math.min(Math.max(cursor.x + x, -1), 1), Math.min(Math.max(cursor.y + y, -1), 1));
    },
    restart: () => interactive() && restart(),
    camera: () => !study.coversScene && chooseCamera(cameras.next()),
    found(name) {
      controls.showGamepad();
      hud.showToast(strings.controls.found(name));
    },
    lost: () => hud.showToast(strings.controls.gone),
  });
  const live = new LiveConnection({
    reset() {
      motion.clear();
      count.restart();
      hud.startTrial();
      signals.drawer?.clear();
      stage.showGhost(null);
      debug.ghost = null;
      acted = false;
    },
    newTrial() {
      trial = null;
    },
    content: (content) => show(content),
    frame(frame) {
      motion.push(frame, performance.now());
      count.countFrame(frame.time);
      debug.frame = frame;
      debug.framesReceived = count.received;
      debug.framesDropped = count.dropped;
      signals.drawer?.frame(frame, methodOf(stage.content, frame));
      sounds.updateFromFrame(frame);
      debug.cues = sounds.cueCount;
      present(frame);
      check.addFrame(frame);
    },
    events(events) {
      hud.addEvents(events);
    },
    status(status) {
      trial = status;
      hud.setStatus(status, interactive());
      refusal.show(study.active ? null : status.refused);
      if (status.results.length > 0) scores.results = status.results;
      showResult(status, motion.latest?.finished ?? false);
      gazeSource = status.gaze_source;
      checkIfAsked(status);
    },
    ghost(arm) {
      stage.showGhost(arm);
      debug.ghost = arm;
    },
    signals: (next) => signals.drawer?.addSignals(next),
    delay: (ms) => hud.setDelay(ms),
    participant: (screen) => study.show(screen),
    driver(next) {
      const before = driver;
      driver = next;
      wheel.show(next);
      if (before?.you && !next.you && next.name !== null) hud.showToast(strings.wheel.taken(next.name));
      if (!next.you) check.stop();
      // Another driver's dialogs let time go; a new name alone does not.
      if (before?.you !== next.you) held = false;
      // A page that was loaded again comes before its old connection is gone.
      if (next.name === null && next.may_drive && performance.now() - connectedAt < RELOAD_TIMEOUT_MS) join();
      if (stage.content) drives(stage.content);
    },
    connected(connected) {
      connectedAt = performance.now();
      if (!connected) {
        driver = null;
        held = drawn = false;
        wheel.hide();
      }
      everConnected ||= connected;
      debug.connected = connected;
      hud.setConnected(connected, everConnected);
      hud.setDelay(null);
      study.connected(connected);
      if (connected && signals.open) live.send({ type: "watch", signals: true });
      if (!connected) controls.releaseAll();
    },
    brace: (controller) => (headset.brace = controller),
    messageRefused: (message) => console.warn(`ProACT: ${message}`),
  });
  const board = new Board();
  const formBoard = new FormBoard(study.form.draft);
  const marks = new FocusTargets(
    () => (acted = true),
    () => access.lock(),
    () => settings.leftArm,
  );
  const access: AccessibleInput = new AccessibleInput(
    canvas,
    marks,
    {
      hold: (source, gesture, down) => controls.hold(source, gesture, down),
      restart: () => restart(),
      mayRestart: () => !study.active,
      isDriving: () => interactive() && !controls.suspended && !study.coversScene,
      mouseTurnsView: () => cameras.kind === "free",
      selectsByGaze: looks,
      focusTargets: places,
    },
    settings,
  );
  const result = new ResultView(
    (ask) => live.send({ type: "after", ask }),
    (again) => restart({ again }),
  );
  const headset = new Headset(
    stage,
    {
      head: (position, quaternion) => interactive() && !controls.suspended && !study.coversScene && live.send({ type: "head", position, quaternion }),
      controller(hand, time_ms, position, quaternion, tracked) {
        if (interactive()) live.send({ type: "controller", hand, time_ms, position, quaternion, tracked });
      },
      ray(origin, direction, head) {
        if (study.coversScene) {
          if (boarded()) formBoard.aim(origin, direction, performance.now());
          return;
        }
        if (!stage.taskScene || !interactive()) return;
        const point = pointing.pickAlongRay(origin, direction, stage.taskScene, heldOrNone());
        const toPoint = point.sub(head).normalize();
        live.send({ type: "gaze", origin: head.toArray(), direction: toPoint.toArray(), measured: true });
      },
      hold: (source, gesture, down) => controls.holdPolled(source, gesture, down),
      trigger: () => boarded() && formBoard.press(),
      showMessage: (message) => hud.showToast(message),
    },
    overlay,
  );
  hud.corner.append(headset.root);
  hud.root.append(signals.root);
  hud.view.append(access.root, stage.insets.root);
  hud.view.prepend(refusal.root);
  hud.view.querySelector(".toast")?.before(sounds.caption);
  overlay.append(marks.root, signals.overlay, hud.root, tutorial.root, check.root, result.root, study.root, hud.banner, panel.root, scores.root);
  /** What a study's screens lie over. */
  const behind: HTMLElement[] = [canvas, marks.root, hud.root, tutorial.root, check.root, result.root];
  hud.right.append(controls.root);
  hud.right.after(guide.root);
  hud.view.append(tutorial.card);
  new ResizeObserver(() => stage.setVisibleArea(hud.view.getBoundingClientRect(), settings.leftArm)).observe(hud.view);
  hud.setConnected(false, false);
  applyMirror();

  function targetPlace(object: ObjectId): { x: number; y: number } | null {
    const target = stage.taskScene?.target(object);
    return target ? { x: target.x, y: target.y } : null;
  }

  /** Everything that is told of an instant beside the scene. */
  function present(frame: DisplayFrame): void {
    const method = methodOf(stage.content, frame);
    const now = circumstances(frame);
    hud.update(frame, restarts(), frame.stop && interactive() ? stopHint(frame.stop, now) : "", now.jogGoal);
    controls.setEffects(method?.help, frame.mode);
    guide.update(frame, method, now);
    tutorial.update(frame, now, debug.project);
    guide.root.hidden ||= tutorial.running || check.active;
    if (trial) showResult(trial, frame.finished);
  }

  /** A participant compares no trials. */
  function showResult(status: TrialStatus, finished: boolean): void {
    if (study.active) result.hide();
    else result.show(status, finished, interactive());
  }

  /** The title of the page may name the method, which a participant need not know. */
  function nameTab(): void {
    const title = study.active ? "" : stage.content?.title;
    document.title = title ? `ProACT · ${title}` : "ProACT";
  }

  /** What was asked for before this page came is over. Over the scene there is nothing to look at: it waits. */
  function checkIfAsked(status: TrialStatus): void {
    if (asked && study.coversScene) return;
    if (asked && status.gaze_checks > asked.gaze_checks) checkGaze();
    if (asked && status.gaze_calibrations > asked.gaze_calibrations) checkGaze(true);
    asked = status;
  }

  /** A study began on this page or ended, or shows something else. */
  function inStudy(): void {
    overlay.classList.toggle("in-study", study.active);
    overlay.classList.toggle("untimed", !study.showsTime);
    for (const node of behind) node.inert = study.coversScene;
    // A headset is entered from whatever is shown.
    const corner = study.coversScene ? study.corner : hud.corner;
    if (headset.root.parentElement !== corner) corner.append(headset.root);
    hud.setSceneTitle(study.sceneTitle);
    nameTab();
    if (study.active) tutorial.close();
    if (study.active && signals.open) signals.toggle();
    check.hidesFigures = study.active;
    if (study.coversScene) check.stop();
    suspend();
    if (trial) checkIfAsked(trial);
    if (motion.latest) present({ ...motion.latest, events: [] });
  }

  /** What a hint has to know. A headset's person has neither mouse nor keys. */
  function circumstances(frame: DisplayFrame): HintContext {
    const keys = interactive() && !headset.inHeadset && byKeys();
    return {
      target: targetPlace,
      lean: stage.content?.lean ?? false,
      mouseIsGaze: interactive() && gazeSource === null && !headset.inHeadset,
      key: (gesture) => (keys ? keyName(settings.keys[gesture][0] ?? "") : ""),
      mayRestart: restarts(),
      jogGoal: frame.mode && stage.content ? jogGoal(frame, stage.content.arm, stage.content.scene) : null,
    };
  }

  /** A study's screens are on the headset's board: their person sees no page. */
  function boarded(): boolean {
    return study.coversScene && headset.inHeadset && !headset.hasDomOverlay;
  }

  function looks(): boolean {
    const now = motion.latest && methodOf(stage.content, motion.latest);
    return now ? now.style === "selecting" : false;
  }

  function places(): FocusTarget[] {
    return motion.latest && stage.taskScene ? likelyFocusTargets(motion.latest, stage.taskScene) : [];
  }

  function checkGaze(calibrates = false): void {
    const source = gazeSource ?? (headset.inHeadset ? "headset" : "mouse");
    if (stage.taskScene && interactive()) check.start(stage.taskScene, source, calibrates);
  }

  /** What the gaze passes: with an object in hand, or in a gaze check, only the table counts. */
  function heldOrNone(): ObjectId | null {
    return check.active ? 0 : (motion.latest?.hand.holds ?? null);
  }

  function chooseCamera(kind: CameraKind): void {
    cameras.choose(kind, stage.taskScene);
    debug.camera = kind;
    hud.showToast(strings.views.camera(CAMERA_NAMES[kind], kind !== "shoulder"));
  }

  function show(content: PageContent, rebuild = false): void {
    stage.show(content, rebuild);
    stage.worldContent.add(check.mark, board.root, formBoard.root);
    if (stage.taskScene) {
      board.place(stage.taskScene);
      formBoard.setPosition(stage.taskScene);
      marks.show(stage.taskScene);
    }
    debug.content = content;
    hud.setContent(content);
    signals.drawer?.show(content);
    nameTab();
    tutorial.setMethods(content.methods);
    if (content.interactive && driver === null) join();
    drives(content);
    // Names and titles are known only now; what happened was told before.
    if (motion.latest) present({ ...motion.latest, events: [] });
  }

  /** Gestures come from this page. Before the first scene nobody has said otherwise. */
  function byKeys(): boolean {
    return ["keys", "synthetic"].includes(motion.latest?.emg_source ?? "keys");
  }

  /** While a dialog is open or the scene is covered, keys and mouse have nothing to do with the arm. Gestures are trained all the same. */
  function suspend(): void {
    const suspended = panel.open || scores.open || tutorial.asking || (study.coversScene && !study.isTraining);
    if (suspended && !controls.suspended) {
      controls.releaseAll();
      access.releaseAll();
    }
    controls.suspended = suspended;
  }

  /** While a dialog is open the trial's time stands still. A study's screens come between trials. */
  function reading(): void {
    suspend();
    const open = panel.open || scores.open || tutorial.asking;
    if (open === held || !interactive()) return;
    held = open;
    live.send({ type: "hold", on: open });
  }

  function join(): void {
    live.send({ type: "join", name: settings.name || defaultPageName(navigator.userAgent) });
  }

  /** Whoever does not drive has neither keys nor gaze here. */
  function drives(content: PageContent): void {
    controls.setMode(interactive(), content.lean);
    canvas.classList.toggle("gaze", interactive());
    // Newcomers who drive are asked once; a page that says so, never, and a participant is told by the experimenter.
    if (!interactive() || greeted || study.active) return;
    greeted = true;
    if (!settings.welcomed && parameters.get("tutorial") !== "0") tutorial.showWelcome();
  }

  function change(next: Settings): void {
    const renamed = next.name !== settings.name;
    const rebuild = next.palette !== settings.palette || next.leftArm !== settings.leftArm;
    settings = next;
    storeSettings(settings);
    controls.setKeys(settings.keys);
    access.setSettings(settings);
    tutorial.setKeys(settings.keys);
    setPalette(settings.palette);
    setTextMirrored(settings.leftArm);
    applyMirror();
    if (renamed && stage.content?.interactive) join();
    if (rebuild && stage.content) show(stage.content, true);
  }

  function applyMirror(): void {
    canvas.classList.toggle("mirrored", settings.leftArm);
    controls.mirrored = settings.leftArm;
    stage.setVisibleArea(hud.view.getBoundingClientRect(), settings.leftArm);
    Object.assign(sounds, { cues: settings.cues, showsCaptions: settings.captions });
  }

  window.addEventListener("pointermove", (event) => look(event));
  canvas.addEventListener("pointermove", (event) => {
    if (event.shiftKey && event.buttons === 1) cameras.drag(settings.leftArm ? -event.movementX : event.movementX, event.movementY);
  });
  canvas.addEventListener("pointerdown", (event) => look(event));
  function look(event: PointerEvent): void {
    // Over a card the eyes stay where they were.
    if (event.target !== canvas) return;
    acted = true;
    marks.release();
    cursor ??= new Vector2();
    const x = (event.clientX / window.innerWidth) * 2 - 1;
    cursor.set(settings.leftArm ? -x : x, 1 - (event.clientY / window.innerHeight) * 2);
  }

  let before = performance.now();
  let drawnAt = 0;
  function draw(wall: number): void {
    const began = performance.now();
    live.frameTimes.recordDisplayed(began);
    const seconds = Math.max((wall - before) / 1000, 0);
    before = wall;
    reading();
    study.update();
    controls.moveGestureButtons(study.isTrainingKeys && interactive() ? study.keys : null);
    controls.update(seconds);
    gamepad.update(seconds);
    access.update(wall);
    const frame = motion.latest;
    const { taskScene: room } = stage;
    check.update();
    headset.update(frame, seconds);
    if (frame) {
      board.show(frame.stop ? STOPPED_TITLE : boardTitle(frame), nextHint(frame, circumstances(frame)).hint, headset.inHeadset && !study.coversScene);
    }
    stage.hidesArm = boarded();
    formBoard.show(boarded() ? study.screen : null, study.form.language, study.breakRemainingSecs);
    // What is covered is not drawn: the server is told of the first picture that can be seen.
    const due = headset.inHeadset || (wall - drawnAt >= MIN_FRAME_INTERVAL_MS && !study.coversScene);
    if (due) drawnAt = wall;
    if (due && stage.draw(motion.interpolateAt(wall), frame, seconds, wall)) {
      live.frameTimes.recordDrawn(motion.drawnTimeMs);
      debug.framesDrawn = stage.frameCount;
      debug.worn = headset.inHeadset;
      if (!drawn && frame && live.open) {
        drawn = true;
        live.send({ type: "drawn" });
      }
      marks.updatePositions(debug.project);
      signals.drawer?.intent.updateOverlay(debug.project, signals.open);
      const looked = check.followedPoint ?? marks.gazePoint();
      if (frame && room && interactive() && (check.followedPoint || (acted && (cursor || looked))) && !controls.suspended && !headset.inHeadset) {
        const eye = new Vector3(...frame.world_from_head.translation);
        const at = looked ?? pointing.pickAtCursor(cursor ?? new Vector2(), cameras.camera, room, heldOrNone());
        const direction = at.sub(eye).normalize();
        live.send({ type: "gaze", origin: eye.toArray(), direction: direction.toArray() });
      }
    }
    signals.drawer?.draw();
    if (wall - shown.since > 1000) measure(wall);
    const took = performance.now() - began;
    whole.take(took);
    script.take(took - stage.drawTimeMs);
    Object.assign(debug, { drawCalls: stage.drawCalls, triangles: stage.triangles, faded: stage.occlusion.count });
  }

  /** The line above the hint on the headset's board. */
  function boardTitle(frame: DisplayFrame): string {
    const score = scoreText(frame.score, stage.content?.briefing);
    const left = strings.hud.left(Math.max(Math.round(frame.time_left_secs), 0));
    const first = study.active ? study.sceneTitle : strings.hud.byMethod(frame.method);
    return [first, score, study.showsTime ? left : ""].filter(Boolean).join(" · ");
  }

  function measure(wall: number): void {
    const span = (wall - shown.since) / 1000;
    const drawnRate = (stage.frameCount - shown.drawn) / span;
    hud.setRate((count.received - shown.received) / span, drawnRate, count.dropped);
    stage.adaptQuality(drawnRate);
    Object.assign(shown, { since: wall, received: count.received, drawn: stage.frameCount });
  }

  stage.renderer.setAnimationLoop(draw);
}

try {
  start();
} catch (error) {
  overlay.append(element("div", "banner", drawErrorText(error)));
}
