/**
 * Fewer points for small scales: levels of points, each with at most one in a cell of its grid.
 *
 * @typedef {object} Level
 * @property {number} cell metres of a cell; 0 for all points
 * @property {Uint32Array} points numbers of the points, tile by tile
 * @property {Uint32Array} starts tile i has points starts[i] to starts[i + 1]
 *
 * @typedef {object} Pyramid
 * @property {import("./viewport.js").Box} box
 * @property {Level[]} levels the coarsest first; the last one holds all points
 */

/** Cells on the longer side of each level. */
const CELLS = [512, 1024, 2048, 4096];

/** Tiles on each side: so many are skipped or drawn together. */
const TILES = 32;

/** Levels of importance by which points are sorted. */
const RANKS = 256;

/**
 * Build the levels of points.
 * @param {Float64Array} x
 * @param {Float64Array} y
 * @param {Float64Array} weight of a cell's points the one with the largest is kept
 * @param {import("./viewport.js").Box} box points outside are left out
 * @returns {Pyramid}
 */
export function buildPyramid(x, y, weight, box) {
  const order = sortByWeight(x, y, weight, box);
  const extent = Math.max(box.maxX - box.minX, box.maxY - box.minY) || 1;

  // A level is worth its memory if it leaves out a third.
  /** @type {Level[]} */
  const levels = [];
  for (const count of CELLS) {
    const cell = extent / count;
    const kept = onePerCell(order, x, y, box, cell);
    if (kept.length < order.length * 0.67) levels.push({ cell, ...sortByTile(kept, x, y, box) });
  }
  levels.push({ cell: 0, ...sortByTile(order, x, y, box) });
  return { box, levels };
}

/**
 * Numbers of the points in a box, the weightiest first: a counting sort.
 * @param {Float64Array} x
 * @param {Float64Array} y
 * @param {Float64Array} weight
 * @param {import("./viewport.js").Box} box
 */
function sortByWeight(x, y, weight, box) {
  let largest = 0;
  for (const value of weight) if (value > largest) largest = value;

  // The rank of each point; points outside have none.
  const ranks = new Int16Array(x.length);
  const ends = new Uint32Array(RANKS + 1);
  for (let i = 0; i < x.length; i++) {
    const isInside = x[i] >= box.minX && x[i] <= box.maxX && y[i] >= box.minY && y[i] <= box.maxY;
    const share = largest ? (weight[i] || 0) / largest : 0;
    ranks[i] = isInside ? Math.round((1 - share) * (RANKS - 1)) : -1;
    if (isInside) ends[ranks[i] + 1]++;
  }

  // Each point to the next free place of its rank.
  for (let rank = 0; rank < RANKS; rank++) ends[rank + 1] += ends[rank];
  const order = new Uint32Array(ends[RANKS]);
  for (let i = 0; i < x.length; i++) if (ranks[i] >= 0) order[ends[ranks[i]]++] = i;
  return order;
}

/**
 * The first point of each cell.
 * @param {Uint32Array} order
 * @param {Float64Array} x
 * @param {Float64Array} y
 * @param {import("./viewport.js").Box} box
 * @param {number} cell metres
 */
function onePerCell(order, x, y, box, cell) {
  const columns = Math.floor((box.maxX - box.minX) / cell) + 1;
  const rows = Math.floor((box.maxY - box.minY) / cell) + 1;
  const taken = new Uint8Array(columns * rows);
  const kept = new Uint32Array(Math.min(order.length, taken.length));
  let count = 0;
  for (const i of order) {
    const key =
      Math.floor((y[i] - box.minY) / cell) * columns + Math.floor((x[i] - box.minX) / cell);
    if (taken[key]) continue;
    taken[key] = 1;
    kept[count++] = i;
  }
  return kept.slice(0, count);
}

/**
 * Sort points by tile: a counting sort.
 * @param {Uint32Array} points
 * @param {Float64Array} x
 * @param {Float64Array} y
 * @param {import("./viewport.js").Box} box
 * @returns {{points: Uint32Array, starts: Uint32Array}}
 */
function sortByTile(points, x, y, box) {
  const perX = TILES / (box.maxX - box.minX || 1);
  const perY = TILES / (box.maxY - box.minY || 1);
  const tiles = new Uint16Array(points.length);
  const starts = new Uint32Array(TILES * TILES + 1);
  for (let k = 0; k < points.length; k++) {
    const column = Math.min(Math.floor((x[points[k]] - box.minX) * perX), TILES - 1);
    const row = Math.min(Math.floor((y[points[k]] - box.minY) * perY), TILES - 1);
    tiles[k] = row * TILES + column;
    starts[tiles[k] + 1]++;
  }

  // Each point to the next free place of its tile.
  for (let tile = 0; tile < TILES * TILES; tile++) starts[tile + 1] += starts[tile];
  const sorted = new Uint32Array(points.length);
  const next = starts.slice();
  for (let k = 0; k < points.length; k++) sorted[next[tiles[k]]++] = points[k];
  return { points: sorted, starts };
}

/**
 * Call a function with each range of points that may be seen.
 * @param {Pyramid} pyramid
 * @param {import("./viewport.js").Box} seen
 * @param {number} pixel metres of a pixel
 * @param {(points: Uint32Array, from: number, to: number) => void} visit
 */
export function visitPoints(pyramid, seen, pixel, visit) {
  const { box, levels } = pyramid;
  const coarse = levels.filter(({ cell }) => cell <= pixel);
  const { points, starts } = coarse[0];
  const [left, right] = tileRange(box.minX, box.maxX, seen.minX, seen.maxX);
  const [bottom, top] = tileRange(box.minY, box.maxY, seen.minY, seen.maxY);
  for (let row = bottom; row <= top; row++) {
    visit(points, starts[row * TILES + left], starts[row * TILES + right + 1]);
  }
}

/**
 * First and last tile that a range touches.
 * @param {number} low
 * @param {number} high
 * @param {number} from
 * @param {number} to
 * @returns {[number, number]}
 */
function tileRange(low, high, from, to) {
  if (from > high || to < low) return [0, -1];
  const scale = TILES / (high - low || 1);
  const first = Math.max(Math.floor((from - low) * scale), 0);
  return [Math.min(first, TILES - 1), Math.min(Math.floor((to - low) * scale), TILES - 1)];
}
