/**
 * Points and lines straight into the pixels of a canvas: the fast way for a great many.
 *
 * @typedef {object} Frame What a canvas shows at the moment.
 * @property {CanvasRenderingContext2D} ctx
 * @property {number} width CSS pixels
 * @property {number} height
 * @property {number} ratio device pixels for a CSS pixel
 * @property {import("./store.js").Viewport} view
 * @property {import("./viewport.js").Box} seen metres
 * @property {import("./colours.js").Theme} theme
 */

import { visitPoints } from "./pyramid.js";

/** Side of a point in CSS pixels where at most so many are seen. */
const POINT_SIDES = [
  { most: 5000, side: 3 },
  { most: 60000, side: 2 },
  { most: Infinity, side: 1 },
];

/**
 * Change the pixels of a canvas.
 * @param {Frame} frame
 * @param {(pixels: Uint32Array, width: number, height: number) => void} paint
 */
function changePixels(frame, paint) {
  const { width, height } = frame.ctx.canvas;
  const image = frame.ctx.getImageData(0, 0, width, height);
  paint(new Uint32Array(image.data.buffer), width, height);
  frame.ctx.putImageData(image, 0, 0);
}

/**
 * Draw points as small squares.
 * @param {Frame} frame
 * @param {import("./pyramid.js").Pyramid} pyramid
 * @param {{x: Float64Array, y: Float64Array}} positions
 * @param {Uint8Array} classes number in the palette of each point's colour
 * @param {Uint32Array} palette
 */
export function paintPoints(frame, pyramid, positions, classes, palette) {
  const { view, seen, ratio } = frame;
  const scale = view.scale * ratio;
  const seenCount = countPoints(frame, pyramid);
  const side = Math.round((POINT_SIDES.find(({ most }) => seenCount <= most)?.side ?? 1) * ratio);
  changePixels(frame, (pixels, width, height) => {
    const left = width / 2 - view.x * scale - side / 2;
    const top = height / 2 + view.y * scale - side / 2;
    visitPoints(pyramid, seen, 1 / scale, (points, from, to) => {
      for (let k = from; k < to; k++) {
        const i = points[k];
        const column = Math.round(left + positions.x[i] * scale);
        const row = Math.round(top - positions.y[i] * scale);
        if (column < 0 || row < 0 || column + side > width || row + side > height) continue;
        const colour = palette[classes[i]];
        for (let v = row; v < row + side; v++) {
          for (let u = column; u < column + side; u++) pixels[v * width + u] = colour;
        }
      }
    });
  });
}

/**
 * Points that may be seen.
 * @param {Frame} frame
 * @param {import("./pyramid.js").Pyramid} pyramid
 */
export function countPoints(frame, pyramid) {
  let count = 0;
  visitPoints(pyramid, frame.seen, 1 / (frame.view.scale * frame.ratio), (_, from, to) => {
    count += to - from;
  });
  return count;
}

/**
 * Draw segments, each one pixel wide or more.
 * @param {Frame} frame
 * @param {import("./scene.js").Lines} lines
 * @param {Uint32Array} segments numbers of the points to which the segments lead
 * @param {number} count how many of the segments
 * @param {Uint8Array} classes number in the palette of each point's segment
 * @param {Uint32Array} palette
 * @param {Uint8Array | null} widths half CSS pixels of each line; a pixel if null
 */
export function paintSegments(frame, lines, segments, count, classes, palette, widths) {
  const { view, ratio } = frame;
  const scale = view.scale * ratio;
  changePixels(frame, (pixels, width, height) => {
    const left = width / 2 - view.x * scale;
    const top = height / 2 + view.y * scale;
    for (let s = 0; s < count; s++) {
      const k = segments[s];
      const wide = widths
        ? Math.max(Math.round((widths[lines.line[k]] * ratio) / 4), 1)
        : ratio >= 2
          ? 2
          : 1;
      const ends = clip(
        left + lines.x[k - 1] * scale,
        top - lines.y[k - 1] * scale,
        left + lines.x[k] * scale,
        top - lines.y[k] * scale,
        width - wide,
        height - wide,
      );
      if (ends) paintLine(pixels, width, ends, wide, palette[classes[k]]);
    }
  });
}

/** Ends of the segment that was clipped last: one array, as there are a great many. */
const clipped = new Float64Array(4);

/**
 * The part of a segment inside of the canvas (Liang and Barsky 1984).
 * @param {number} x0
 * @param {number} y0
 * @param {number} x1
 * @param {number} y1
 * @param {number} width
 * @param {number} height
 * @returns {Float64Array | null} both ends; null if nothing is inside
 */
export function clip(x0, y0, x1, y1, width, height) {
  const dx = x1 - x0;
  const dy = y1 - y0;
  let [first, last] = [0, 1];
  for (let side = 0; side < 4; side++) {
    const step = side < 2 ? (side ? dx : -dx) : side === 2 ? -dy : dy;
    const space = [x0, width - 1 - x0, y0, height - 1 - y0][side];
    if (step === 0 && space < 0) return null;
    if (step < 0) first = Math.max(first, space / step);
    if (step > 0) last = Math.min(last, space / step);
  }
  if (first > last) return null;
  clipped[0] = x0 + first * dx;
  clipped[1] = y0 + first * dy;
  clipped[2] = x0 + last * dx;
  clipped[3] = y0 + last * dy;
  return clipped;
}

/**
 * Draw a line by steps of one pixel.
 * @param {Uint32Array} pixels
 * @param {number} width of the canvas
 * @param {Float64Array} ends
 * @param {number} wide pixels
 * @param {number} colour
 */
function paintLine(pixels, width, ends, wide, colour) {
  const [x0, y0, x1, y1] = ends;
  const steps = Math.max(Math.ceil(Math.max(Math.abs(x1 - x0), Math.abs(y1 - y0))), 1);
  const dx = (x1 - x0) / steps;
  const dy = (y1 - y0) / steps;

  // A line is made wider across its direction.
  const across = Math.abs(dx) > Math.abs(dy) ? width : 1;
  for (let i = 0, x = x0 + 0.5, y = y0 + 0.5; i <= steps; i++, x += dx, y += dy) {
    const at = (y | 0) * width + (x | 0);
    for (let w = 0; w < wide; w++) pixels[at + w * across] = colour;
  }
}
