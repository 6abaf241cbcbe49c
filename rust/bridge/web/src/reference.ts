// The printed reference board: a picture that a headset's browser finds in the room (WebXR Marker Tracking), so that the
// virtual table stands on a real one.

/** Width of the picture on paper, metres. */
export const BOARD_WIDTH_M = 0.18;
const PIXELS = 900;

/** What the draft of Marker Tracking adds to a frame. */
interface TrackedImage {
  imageSpace: XRSpace;
  trackingState: "untracked" | "tracked" | "emulated";
}
interface TrackingFrame {
  getImageTrackingResults?: () => Iterable<TrackedImage>;
}

/** Draws the picture: corners everywhere, nothing twice, and no way to take one edge for another. */
export function drawBoard(): HTMLCanvasElement {
  const canvas = document.createElement("canvas");
  canvas.width = canvas.height = PIXELS;
  const context = canvas.getContext("2d");
  if (!context) throw new Error("this browser draws no pictures");
  // The same numbers everywhere: a board that was printed once stays good.
  let state = 20117;
  const random = () => (state = (state * 48271) % 2147483647) / 2147483647;
  context.fillStyle = "#fff";
  context.fillRect(0, 0, PIXELS, PIXELS);
  for (let k = 0; k < 160; k += 1) {
    const [x, y, size] = [random() * PIXELS, random() * PIXELS, 12 + 70 * random() ** 2];
    const corners = 3 + Math.floor(3 * random());
    context.fillStyle = ["#000", "#000", "#fff", "#777"][Math.floor(4 * random())] ?? "#000";
    context.beginPath();
    for (let corner = 0; corner < corners; corner += 1) {
      const angle = ((corner + 0.8 * random()) / corners) * 2 * Math.PI;
      context.lineTo(x + size * Math.cos(angle), y + size * Math.sin(angle));
    }
    context.fill();
  }
  context.strokeStyle = "#000";
  context.lineWidth = 12;
  context.strokeRect(6, 6, PIXELS - 12, PIXELS - 12);
  return canvas;
}

/** What a session is asked for to find the board; nothing where the browser knows no tracked images. */
export async function boardOptions(): Promise<Partial<XRSessionInit>> {
  if (!("XRImageTrackingResult" in window)) return {};
  const trackedImages = [{ image: await createImageBitmap(drawBoard()), widthInMeters: BOARD_WIDTH_M }];
  return { optionalFeatures: ["image-tracking"], trackedImages } as Partial<XRSessionInit>;
}

/** Where the board is seen in this frame; null if it is not, or only guessed at. */
export function boardPose(frame: XRFrame, space: XRReferenceSpace): XRRigidTransform | null {
  for (const { imageSpace, trackingState } of (frame as TrackingFrame).getImageTrackingResults?.() ?? []) {
    if (trackingState === "tracked") return frame.getPose(imageSpace, space)?.transform ?? null;
  }
  return null;
}
