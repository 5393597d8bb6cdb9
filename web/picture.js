// The last frame, small: as the camera made it, how its levels are spread, and how much of it is clipped. Computed here from the frame's
// own file, at a reduced size, one frame at a time, no oftener than once a second, and only while somebody looks.
import { Unreachable, load } from "/api.js";
import { h, percent, svg } from "/show.js";

const WIDTH = 320;
const LEAST_MS = 1000;
const BINS = 64;
const CLIPPED = 255;    // level of a channel that the sensor or the JPEG has cut off

/// Shares of pixels by the level of their brightest channel, and of those in which it is clipped.
function spread({ data }) {
  const bins = new Array(BINS).fill(0);
  let clipped = 0;
  for (let i = 0; i < data.length; i += 4) {
    const level = Math.max(data[i], data[i + 1], data[i + 2]);
    bins[Math.floor((level * BINS) / 256)] += 1;
    if (level >= CLIPPED) clipped += 1;
  }
  const pixels = data.length / 4;
  return { bins: bins.map((n) => n / pixels), clipped: clipped / pixels };
}

/// Heights go by the square root: a bright object is a small part of a dark frame.
function histogram(bins, words) {
  const most = Math.sqrt(Math.max(...bins)) || 1;
  const bars = bins.map((share, i) => svg("rect", { x: i, y: 24 - (24 * Math.sqrt(share)) / most, width: 1, height: (24 * Math.sqrt(share)) / most, class: i === BINS - 1 ? "top" : "" }));
  return svg("svg", { viewBox: `0 0 ${BINS} 24`, preserveAspectRatio: "none", role: "img", "aria-label": words, class: "histogram" }, bars);
}

/// Every pixel of the small picture is one of the frame, not a mean of several: what is clipped stays clipped.
async function small(path, width) {
  const answer = await load(path);
  if (!answer.ok) return null;
  return createImageBitmap(await answer.blob(), { resizeWidth: width, resizeQuality: "pixelated" });
}

/// `update` shows `frame` (a journal record) of session `id`, called `name`; the frame's sensor is `width` pixels wide.
export function lastFrame() {
  const canvas = h("canvas", { role: "img" });
  const [caption, levels] = [h("figcaption", {}), h("div", {})];
  const box = h("section", { className: "last-frame", hidden: true }, h("h3", {}, "Last frame"), h("figure", {}, canvas, levels, caption));
  let [shown, busy, last] = ["", false, 0];

  async function draw(path, name, width) {
    const bitmap = await small(path, Math.min(WIDTH, width));
    if (!bitmap) return;
    [canvas.width, canvas.height] = [bitmap.width, bitmap.height];
    const context = canvas.getContext("2d", { willReadFrequently: true });
    context.drawImage(bitmap, 0, 0);
    bitmap.close();
    const { bins, clipped } = spread(context.getImageData(0, 0, canvas.width, canvas.height));
    canvas.setAttribute("aria-label", `Last frame: ${name}`);
    levels.replaceChildren(histogram(bins, `Histogram of the brightest channel, dark to bright; ${percent(clipped)} of the frame is clipped`));
    caption.replaceChildren(name, h("br"), h("span", { className: "clipped" }, `${percent(clipped)} clipped`), " (long exposures are, on purpose)");
    box.hidden = false;
  }

  async function update(id, frame, name, width) {
    const path = `/v1/sessions/${id}/frames/${frame.file}`;
    const key = `${path} ${frame.seq}`;
    if (key === shown || busy || document.hidden || Date.now() - last < LEAST_MS) return;
    [shown, busy, last] = [key, true, Date.now()];
    try {
      await draw(path, name, width);
    } catch (error) {
      // A frame that cannot be reached or decoded is tried again with the next.
      if (!(error instanceof Unreachable || error instanceof TypeError || error instanceof DOMException)) throw error;
    } finally {
      busy = false;
    }
  }
  return { box, update };
}
