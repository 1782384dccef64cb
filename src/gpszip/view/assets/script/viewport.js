/**
 * What part of the plane is seen: areas, fitting, zooming.
 *
 * A viewport is the position in the middle and the scale; screen positions are CSS pixels from the
 * top left corner.
 *
 * @typedef {{minX: number, minY: number, maxX: number, maxY: number}} Box
 * @typedef {import("./store.js").Viewport} Viewport
 * @typedef {{label: string, box: Box, x: number, center: [number, number] | null}} Area
 *   What one plane holds; x is where its centre lies.
 */

import { formatDegrees } from "./format.js";

/** Pixels between what is fitted and the border. */
const MARGIN = 36;

/** Metres that are seen at least. */
const SMALLEST_EXTENT = 0.5;

/** Limits of the scale: pixels for a metre. */
const MIN_SCALE = 1e-7;
const MAX_SCALE = 1e5;

/**
 * Areas that hold positions: one for each plane of a log in degrees, else a single one.
 * @param {import("./scene.js").Scene} scene
 * @returns {Area[]}
 */
export function findAreas(scene) {
  const centers = scene.planes.length ? scene.planes : [null];
  /** @type {Box[]} */
  const boxes = centers.map(emptyBox);

  // Boxes of the nodes, and of the samples where there are no nodes.
  for (const archive of scene.archives) {
    for (const positions of [archive.nodes, archive.raw]) {
      const { x, y } = positions ?? { x: [], y: [] };
      for (let i = 0; i < x.length; i++) extend(boxes[areaOf(x[i], scene)], x[i], y[i]);
    }
  }

  // Planes that hold anything.
  const areas = centers.map((center, i) => ({
    label: center
      ? `${formatDegrees(center[0], "lat", 2)} ${formatDegrees(center[1], "lon", 2)}`
      : "",
    box: boxes[i],
    x: i * (scene.planes.length ? scene.spread : 0),
    center,
  }));
  const used = areas.filter(({ box }) => box.minX <= box.maxX);
  return used.length ? used : [{ ...areas[0], box: { minX: -1, minY: -1, maxX: 1, maxY: 1 } }];
}

/**
 * Number of the plane of a position.
 * @param {number} x metres
 * @param {import("./scene.js").Scene} scene
 */
function areaOf(x, scene) {
  if (!scene.planes.length) return 0;
  return Math.min(Math.max(Math.round(x / scene.spread), 0), scene.planes.length - 1);
}

/** @returns {Box} */
export function emptyBox() {
  return { minX: Infinity, minY: Infinity, maxX: -Infinity, maxY: -Infinity };
}

/**
 * Extend a box to a position.
 * @param {Box} box
 * @param {number} x
 * @param {number} y
 */
export function extend(box, x, y) {
  if (x < box.minX) box.minX = x;
  if (x > box.maxX) box.maxX = x;
  if (y < box.minY) box.minY = y;
  if (y > box.maxY) box.maxY = y;
}

/**
 * Viewport that shows a box.
 * @param {Box} box
 * @param {number} width pixels
 * @param {number} height pixels
 * @returns {Viewport}
 */
export function fitBox(box, width, height) {
  const spanX = Math.max(box.maxX - box.minX, SMALLEST_EXTENT);
  const spanY = Math.max(box.maxY - box.minY, SMALLEST_EXTENT);
  const margin = Math.min(MARGIN, width / 8, height / 8);
  const scale = Math.min((width - 2 * margin) / spanX, (height - 2 * margin) / spanY);
  return {
    x: (box.minX + box.maxX) / 2,
    y: (box.minY + box.maxY) / 2,
    scale: Math.min(Math.max(scale, MIN_SCALE), MAX_SCALE),
  };
}

/**
 * Zoom about a place on the screen.
 * @param {Viewport} view
 * @param {number} factor
 * @param {number} dx pixels to the right of the middle
 * @param {number} dy pixels below the middle
 * @returns {Viewport}
 */
export function zoomView(view, factor, dx = 0, dy = 0) {
  const scale = Math.min(Math.max(view.scale * factor, MIN_SCALE), MAX_SCALE);
  const shift = 1 / view.scale - 1 / scale;
  return { x: view.x + dx * shift, y: view.y - dy * shift, scale };
}

/**
 * Move what is seen by pixels.
 * @param {Viewport} view
 * @param {number} dx to the right
 * @param {number} dy down
 * @returns {Viewport}
 */
export function panView(view, dx, dy) {
  return { ...view, x: view.x - dx / view.scale, y: view.y + dy / view.scale };
}

/**
 * Box that is seen.
 * @param {Viewport} view
 * @param {number} width pixels
 * @param {number} height pixels
 * @returns {Box}
 */
export function seenBox(view, width, height) {
  const halfX = width / 2 / view.scale;
  const halfY = height / 2 / view.scale;
  return { minX: view.x - halfX, minY: view.y - halfY, maxX: view.x + halfX, maxY: view.y + halfY };
}

/**
 * Screen position of a position in metres.
 * @param {import("./pixels.js").Frame} frame
 * @param {{x: number, y: number}} position
 * @returns {[number, number]}
 */
export function toScreen({ view, width, height }, { x, y }) {
  return [width / 2 + (x - view.x) * view.scale, height / 2 - (y - view.y) * view.scale];
}
