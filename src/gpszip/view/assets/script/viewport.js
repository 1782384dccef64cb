/**
 * What part of the plane is seen: areas, fitting, zooming.
 *
 * A viewport is the position in the middle and the scale; screen positions are CSS pixels from the
 * top left corner.
 *
 * @typedef {{minX: number, minY: number, maxX: number, maxY: number}} Box
 * @typedef {import("./store.js").Viewport} Viewport
 * @typedef {{label: string, box: Box, main: Box, x: number, center: [number, number] | null}} Area
 *   What one plane holds; main is the box of nearly all travel, x is where its centre lies.
 */

import { formatDegrees } from "./format.js";

/** Pixels between what is fitted and the border. */
const MARGIN = 36;

/** Metres that are seen at least. */
const SMALLEST_EXTENT = 0.5;

/** Positions from which the box of nearly all travel is found, and the share of them on each side of
 * its middle part. */
const MAIN_POSITIONS = 20_000;
const OUTER_SHARE = 0.005;

/** Share of the extent of all that the box of nearly all travel is shown instead below. */
const MUCH_SMALLER = 0.5;

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
    main: mainBox(scene, i, boxes[i]),
    x: i * (scene.planes.length ? scene.spread : 0),
    center,
  }));
  const used = areas.filter(({ box }) => box.minX <= box.maxX);
  if (used.length) return used;
  const box = { minX: -1, minY: -1, maxX: 1, maxY: 1 };
  return [{ ...areas[0], box, main: box }];
}

/**
 * Box of nearly all travel in an area: without a few positions that lie so far off that they would
 * make the rest small.
 * @param {import("./scene.js").Scene} scene
 * @param {number} area
 * @param {Box} box of all positions
 * @returns {Box}
 */
function mainBox(scene, area, box) {
  // Some knots of the area.
  const total = scene.archives.reduce((sum, { knots }) => sum + knots.x.length, 0);
  const step = Math.max(Math.ceil(total / MAIN_POSITIONS), 1);
  /** @type {[number[], number[]]} */
  const [xs, ys] = [[], []];
  for (const { knots } of scene.archives) {
    for (let k = 0; k < knots.x.length; k += step) {
      if (areaOf(knots.x[k], scene) !== area) continue;
      xs.push(knots.x[k]);
      ys.push(knots.y[k]);
    }
  }
  if (!xs.length) return box;

  // Those near the middle part of them.
  const [[lowX, highX], [lowY, highY]] = [nearMiddle(xs), nearMiddle(ys)];
  const main = emptyBox();
  for (let i = 0; i < xs.length; i++) {
    const isNear = lowX <= xs[i] && xs[i] <= highX && lowY <= ys[i] && ys[i] <= highY;
    if (isNear) extend(main, xs[i], ys[i]);
  }
  const isSmaller = largerSide(main) > 0 && largerSide(main) < MUCH_SMALLER * largerSide(box);
  return isSmaller ? main : box;
}

/**
 * Range of the middle part of values, with as much again on each side.
 * @param {number[]} values
 * @returns {[number, number]}
 */
function nearMiddle(values) {
  const sorted = Float64Array.from(values).sort();
  const outer = Math.floor(OUTER_SHARE * sorted.length);
  const [low, high] = [sorted[outer], sorted[sorted.length - 1 - outer]];
  return [2 * low - high, 2 * high - low];
}

/** @param {Box} box */
function largerSide({ minX, minY, maxX, maxY }) {
  return Math.max(maxX - minX, maxY - minY);
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
