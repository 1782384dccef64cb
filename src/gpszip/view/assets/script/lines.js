/**
 * Lines on the map: few are stroked by the canvas, many are painted pixel by pixel.
 *
 * @typedef {import("./pixels.js").Frame} Frame
 * @typedef {import("./scene.js").Lines} Lines
 *
 * @typedef {object} LineStyle
 * @property {string[]} palette
 * @property {Uint8Array} classes number in the palette of each point's segment
 * @property {number} [width] CSS pixels
 * @property {Uint8Array | null} [widths] half CSS pixels of each line
 * @property {boolean} [casing] whether lines have a border in the colour of the paper
 * @property {number[]} [dash]
 */

import { PALETTE_SIZE, toPixels } from "./colours.js";
import { paintSegments } from "./pixels.js";
import { toScreen } from "./viewport.js";

/** Segments that are stroked at most: more take longer than painting pixels (measured). */
const MAX_STROKED = 4000;

/** Widths in half CSS pixels are below this. */
const WIDTH_CLASSES = 16;

/** CSS pixels by which a casing is wider. */
const CASING = 2;

/** Numbers of the segments that are seen; grows with the scene. */
let seenSegments = new Uint32Array(1024);

/**
 * Draw the segments of lines that are seen.
 * @param {Frame} frame
 * @param {Lines} lines
 * @param {LineStyle} style
 */
export function drawLines(frame, lines, style) {
  const count = findSegments(frame, lines);
  if (count > MAX_STROKED) {
    const palette = toPixels(style.palette);
    paintSegments(frame, lines, seenSegments, count, style.classes, palette, style.widths ?? null);
    return;
  }
  if (style.casing) strokeSegments(frame, lines, count, style, CASING);
  strokeSegments(frame, lines, count, style, 0);
}

/**
 * Find the segments whose boxes are seen; their numbers are in seenSegments.
 * @param {Frame} frame
 * @param {Lines} lines
 * @returns {number} how many
 */
function findSegments(frame, lines) {
  const { x, y, joined } = lines;
  if (seenSegments.length < x.length) seenSegments = new Uint32Array(x.length);
  const margin = WIDTH_CLASSES / frame.view.scale;
  const minX = frame.seen.minX - margin;
  const maxX = frame.seen.maxX + margin;
  const minY = frame.seen.minY - margin;
  const maxY = frame.seen.maxY + margin;
  let count = 0;
  for (let k = 1; k < x.length; k++) {
    if (!joined[k]) continue;
    if ((x[k] < minX && x[k - 1] < minX) || (x[k] > maxX && x[k - 1] > maxX)) continue;
    if ((y[k] < minY && y[k - 1] < minY) || (y[k] > maxY && y[k - 1] > maxY)) continue;
    seenSegments[count++] = k;
  }
  return count;
}

/**
 * Stroke the segments that are seen, colour by colour.
 * @param {Frame} frame
 * @param {Lines} lines
 * @param {number} count
 * @param {LineStyle} style
 * @param {number} casing CSS pixels by which lines are wider, in the colour of the paper
 */
function strokeSegments(frame, lines, count, style, casing) {
  const { ctx, view, width, height, theme } = frame;
  const left = width / 2 - view.x * view.scale;
  const top = height / 2 + view.y * view.scale;

  // Which colours and widths there are.
  const used = new Uint8Array(PALETTE_SIZE * WIDTH_CLASSES);
  const keys = new Uint16Array(count);
  for (let s = 0; s < count; s++) {
    const k = seenSegments[s];
    const wide = style.widths ? style.widths[lines.line[k]] : 0;
    keys[s] = style.classes[k] * WIDTH_CLASSES + wide;
    used[keys[s]] = 1;
  }

  // One path for each of them; segments that follow each other are joined.
  ctx.lineCap = ctx.lineJoin = "round";
  ctx.setLineDash(style.dash ?? []);
  for (let key = 0; key < used.length; key++) {
    if (!used[key]) continue;
    ctx.beginPath();
    let previous = -1;
    for (let s = 0; s < count; s++) {
      if (keys[s] !== key) continue;
      const k = seenSegments[s];
      if (k - 1 !== previous) {
        ctx.moveTo(left + lines.x[k - 1] * view.scale, top - lines.y[k - 1] * view.scale);
      }
      ctx.lineTo(left + lines.x[k] * view.scale, top - lines.y[k] * view.scale);
      previous = k;
    }
    ctx.strokeStyle = casing ? theme.paper : style.palette[Math.floor(key / WIDTH_CLASSES)];
    ctx.lineWidth = ((key % WIDTH_CLASSES) / 2 || (style.width ?? 1)) + casing;
    ctx.stroke();
  }
  ctx.setLineDash([]);
}

/** Pixels of an edge below which it has no arrow, and half the length of an arrow. */
const ARROW_SPACE = 52;
const ARROW_SIZE = 3.25;

/**
 * Draw an arrow in the middle of each edge that is travelled in one direction only.
 * @param {Frame} frame
 * @param {import("./scene.js").Edges} edges
 */
export function drawArrows(frame, edges) {
  const { ctx, view, theme, seen } = frame;
  ctx.beginPath();
  for (let i = 0; i + 1 < edges.offsets.length; i++) {
    const isOneWay = edges.forward[i] > 0 !== edges.backward[i] > 0;
    const k = Math.ceil((edges.offsets[i] + edges.offsets[i + 1] - 1) / 2);
    if (!isOneWay || !edges.joined[k] || edges.offsets[i + 1] - edges.offsets[i] < 2) continue;
    if (edges.x[k] < seen.minX || edges.x[k] > seen.maxX) continue;
    if (edges.y[k] < seen.minY || edges.y[k] > seen.maxY) continue;
    if (lineLength(edges, i) * view.scale < ARROW_SPACE) continue;

    // A chevron along the segment in the middle.
    const sign = edges.forward[i] ? 1 : -1;
    const heading = Math.atan2(
      sign * (edges.y[k] - edges.y[k - 1]),
      sign * (edges.x[k] - edges.x[k - 1]),
    );
    const middle = { x: (edges.x[k] + edges.x[k - 1]) / 2, y: (edges.y[k] + edges.y[k - 1]) / 2 };
    addChevron(ctx, ...toScreen(frame, middle), heading);
  }

  // With a border, so that they are seen on wide edges.
  ctx.lineCap = ctx.lineJoin = "round";
  ctx.strokeStyle = theme.paper;
  ctx.lineWidth = 3.5;
  ctx.stroke();
  ctx.strokeStyle = theme.ink;
  ctx.lineWidth = 1.25;
  ctx.stroke();
}

/**
 * @param {CanvasRenderingContext2D} ctx
 * @param {number} x CSS pixels
 * @param {number} y
 * @param {number} heading radians, counterclockwise from the east
 */
function addChevron(ctx, x, y, heading) {
  const cos = Math.cos(heading) * ARROW_SIZE;
  const sin = -Math.sin(heading) * ARROW_SIZE;
  ctx.moveTo(x - cos - sin, y - sin + cos);
  ctx.lineTo(x + cos, y + sin);
  ctx.lineTo(x - cos + sin, y - sin - cos);
}

/**
 * Length of a line in metres.
 * @param {Lines} lines
 * @param {number} i
 */
export function lineLength(lines, i) {
  let length = 0;
  for (let k = lines.offsets[i] + 1; k < lines.offsets[i + 1]; k++) {
    length += Math.hypot(lines.x[k] - lines.x[k - 1], lines.y[k] - lines.y[k - 1]);
  }
  return length;
}
