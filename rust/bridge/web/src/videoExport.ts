// Videos of what is on display, views side by side with a caption each.

import { element } from "./dom";
import { strings } from "./strings";

/** Something that can be put into a video. */
export interface VideoSource {
  canvas: HTMLCanvasElement;
  caption(time: number): string;
}

const CAPTION_PIXELS = 34;
const FRAMES_PER_SECOND = 30;
/** From best to what every browser has. */
const VIDEO_TYPES = ["video/webm;codecs=vp9", "video/webm;codecs=vp8", "video/webm", "video/mp4"];

function paint(canvas: HTMLCanvasElement, views: VideoSource[], time: number): void {
  const context = canvas.getContext("2d");
  if (!context) return;
  context.fillStyle = "#e9eef2";
  context.fillRect(0, 0, canvas.width, canvas.height);
  let left = 0;
  for (const view of views) {
    context.drawImage(view.canvas, left, 0);
    context.fillStyle = "#17212b";
    context.font = "600 18px system-ui, sans-serif";
    context.textBaseline = "middle";
    context.fillText(view.caption(time), left + 14, canvas.height - CAPTION_PIXELS / 2);
    left += view.canvas.width;
  }
}

function canvasFor(views: VideoSource[]): HTMLCanvasElement {
  const canvas = element("canvas");
  // Encoders want even sizes.
  const even = (pixels: number) => pixels + (pixels % 2);
  canvas.width = even(views.reduce((sum, view) => sum + view.canvas.width, 0));
  canvas.height = even(Math.max(...views.map((view) => view.canvas.height)) + CAPTION_PIXELS);
  return canvas;
}

export function saveAs(blob: Blob, name: string): void {
  const anchor = element("a");
  anchor.href = URL.createObjectURL(blob);
  anchor.download = name;
  anchor.click();
  window.setTimeout(() => URL.revokeObjectURL(anchor.href), 10_000);
}

/** Records what is drawn, in real time. */
export class Recorder {
  private canvas: HTMLCanvasElement | null = null;
  private recorder: MediaRecorder | null = null;
  private parts: Blob[] = [];

  get running(): boolean {
    return this.recorder !== null;
  }

  start(views: VideoSource[]): void {
    const type = VIDEO_TYPES.find((candidate) => MediaRecorder.isTypeSupported(candidate));
    if (!type) throw new Error(strings.replay.recordsNone);
    this.canvas = canvasFor(views);
    this.parts = [];
    this.recorder = new MediaRecorder(this.canvas.captureStream(FRAMES_PER_SECOND), { mimeType: type, videoBitsPerSecond: 8e6 });
    this.recorder.ondataavailable = ({ data }) => this.parts.push(data);
    this.recorder.start(500);
  }

  /** Called once per picture. */
  draw(views: VideoSource[], time: number): void {
    if (this.canvas) paint(this.canvas, views, time);
  }

  stop(): Promise<Blob> {
    const { recorder } = this;
    if (!recorder) return Promise.reject(new Error("nothing is being recorded"));
    return new Promise((resolve) => {
      recorder.onstop = () => {
        this.recorder = this.canvas = null;
        resolve(new Blob(this.parts, { type: recorder.mimeType }));
      };
      recorder.stop();
    });
  }
}
