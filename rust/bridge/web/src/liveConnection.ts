// The connection to the server: it comes back by itself after a reload, a restart or a lost line.

import { ClockOffset, FrameTimes } from "./frameLatency";
import type { Driver } from "./controlLease";
import type {
  ClientMessage,
  DisplayFrame,
  ExperimenterScreen,
  GhostArm,
  PageContent,
  ParticipantScreen,
  Role,
  ServerMessage,
  Side,
  Signals,
  TrialEvent,
  TrialStatus,
} from "./generated/types";

/** Waiting times between attempts, ms; the last one repeats. */
const BACKOFF_MS = [200, 400, 800, 1500, 3000];
const CONTENT_RETRY_MS = 1000;
/** How often the round trip is measured, ms. */
const PING_MS = 1000;
/** What is sent on a stuck line too: a gesture must end in time, and an answer must not get lost. */
const UNDROPPABLE_MESSAGES = new Set<ClientMessage["type"]>(["gesture", "answer", "submit"]);

export interface LiveHandlers {
  /** What was known of the trial is void: another one, or another server. */
  reset(): void;
  /** Another trial began: its status counts from zero. */
  newTrial?(): void;
  content(content: PageContent): void;
  frame(frame: DisplayFrame): void;
  events(events: TrialEvent[]): void;
  connected(connected: boolean): void;
  /** Which controller of a headset is strapped to the brace. */
  brace?(controller: Side | null): void;
  messageRefused(message: string): void;
  /** Another client drives, or nobody. */
  driver?(driver: Driver): void;
  status?(status: TrialStatus): void;
  /** A second arm is to be shown, or none. */
  ghost?(arm: GhostArm | null): void;
  signals?(signals: Signals): void;
  /** What a study shows to whoever conducts it. */
  study?(screen: ExperimenterScreen): void;
  /** What a study shows to whoever takes part. */
  participant?(screen: ParticipantScreen): void;
  /** The round trip is longer than the trial allows, ms; null: no longer. */
  delay?(ms: number | null): void;
  /** Time from a message to its answer, ms. */
  roundTrip?(ms: number): void;
}

export class LiveConnection {
  private socket: WebSocket | null = null;
  private attempts = 0;
  private pageVersion: string | null = null;
  private wantedRevision = 0;
  private lastPing = { id: 0, at: 0 };
  private readonly serverClock = new ClockOffset();
  /** When frames were on the screen; whoever draws says so. The server is told. */
  readonly frameTimes = new FrameTimes();

  constructor(
    private readonly handlers: LiveHandlers,
    private readonly role: Role = "participant",
  ) {
    this.connect();
    window.setInterval(() => {
      this.lastPing = { id: (this.lastPing.id + 1) % 65_536, at: performance.now() };
      this.send({ type: "ping", id: this.lastPing.id });
      this.sendFrameTimes();
    }, PING_MS);
    // The network is back, or the laptop woke up: no need to wait for the next attempt.
    window.addEventListener("online", () => this.socket?.close());
  }

  get open(): boolean {
    return this.socket?.readyState === WebSocket.OPEN;
  }

  private sendFrameTimes(): void {
    const ahead = this.serverClock.offsetMs;
    const frames = ahead === null ? [] : this.frameTimes.drain(ahead);
    if (frames.length > 0) this.send({ type: "seen", frames });
  }

  /** Sends if connected. Most is not sent on a stuck line: where one looked then is worth nothing later. */
  send(message: ClientMessage): void {
    if (this.socket?.readyState !== WebSocket.OPEN) return;
    if (UNDROPPABLE_MESSAGES.has(message.type) || this.socket.bufferedAmount < 16_384) this.socket.send(JSON.stringify(message));
  }

  private connect(): void {
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    const socket = new WebSocket(`${scheme}://${location.host}/live?role=${this.role}`);
    this.socket = socket;
    socket.onmessage = (message) => this.handleMessage(JSON.parse(String(message.data)) as ServerMessage);
    socket.onclose = () => {
      this.handlers.connected(false);
      const wait = BACKOFF_MS[Math.min(this.attempts, BACKOFF_MS.length - 1)] ?? 3000;
      this.attempts += 1;
      window.setTimeout(() => this.connect(), wait);
    };
  }

  private handleMessage(message: ServerMessage): void {
    switch (message.type) {
      case "hello":
        if (this.pageVersion !== null && this.pageVersion !== message.page_version) {
          // The server was replaced by another version; so is the page.
          location.reload();
          return;
        }
        this.pageVersion = message.page_version;
        this.serverClock.clear();
        this.frameTimes.clear();
        this.attempts = 0;
        this.handlers.connected(true);
        this.handlers.brace?.(message.brace_controller);
        this.handlers.reset();
        void this.fetchContent();
        break;
      case "content":
        this.frameTimes.clear();
        this.handlers.reset();
        this.handlers.newTrial?.();
        void this.fetchContent();
        break;
      case "frame":
        this.frameTimes.recordReceived(message.time, performance.now());
        this.handlers.frame(message);
        break;
      case "events":
        this.handlers.events(message.events);
        break;
      case "driver":
        this.handlers.driver?.(message);
        break;
      case "status":
        this.handlers.status?.(message);
        break;
      case "ghost":
        this.handlers.ghost?.(message.arm);
        break;
      case "signals":
        this.handlers.signals?.(message);
        break;
      case "study":
        this.handlers.study?.(message);
        break;
      case "participant":
        this.handlers.participant?.(message);
        break;
      case "delay":
        this.handlers.delay?.(message.ms);
        break;
      case "pong":
        if (message.id === this.lastPing.id) {
          const now = performance.now();
          this.serverClock.addRoundTrip(this.lastPing.at, now, message.clock_ms);
          this.handlers.roundTrip?.(now - this.lastPing.at);
        }
        break;
      case "error":
        this.handlers.messageRefused(message.message);
        break;
    }
  }

  private async fetchContent(): Promise<void> {
    // Only the answer to the latest question counts.
    const wanted = ++this.wantedRevision;
    try {
      const answer = await fetch("/api/content", { cache: "no-store" });
      if (!answer.ok) throw new Error(`the server answered ${answer.status}`);
      const content = (await answer.json()) as PageContent;
      if (wanted === this.wantedRevision) this.handlers.content(content);
    } catch {
      window.setTimeout(() => {
        if (wanted === this.wantedRevision && this.open) void this.fetchContent();
      }, CONTENT_RETRY_MS);
    }
  }
}
