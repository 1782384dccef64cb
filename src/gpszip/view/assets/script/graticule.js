/** Degrees or metres over the map: graticule, scale bar, arrow to the north, read-outs. */

import { formatDegrees, formatFixed, formatNumber, lengthUnit, niceStep } from "./format.js";
import { toDegrees, toPlane } from "./geodesy.js";
import { toScreen } from "./viewport.js";

/**
 * @typedef {import("./pixels.js").Frame} Frame
 * @typedef {import("./viewport.js").Area} Area
 */

/** CSS pixels between lines of the graticule, about. */
const GRID_PIXELS = 130;

/** Pieces in which a parallel or meridian is drawn. */
const PIECES = 12;

/** Decimals of degrees at most: a decimetre. */
const DEGREE_DECIMALS = 6;

/** Degrees beyond which no graticule is drawn: the plane is no map of so much. */
const MAX_SPAN = 60;

/** Metres of a degree of latitude. */
const DEGREE = 111200;

/** @typedef {{text: string, x: number, y: number}} Label */

/**
 * Draw the graticule: parallels and meridians, or lines of equal x and y.
 * @param {Frame} frame
 * @param {Area} area
 * @returns {Label[]} to be written above everything else
 */
export function drawGraticule(frame, area) {
  const { ctx, theme } = frame;
  ctx.strokeStyle = theme.grid;
  ctx.lineWidth = 1;
  return area.center ? drawDegrees(frame, area, area.center) : drawMetres(frame);
}

/**
 * Write the labels of the graticule.
 * @param {Frame} frame
 * @param {Label[]} labels
 */
export function drawLabels({ ctx, theme }, labels) {
  ctx.font = "10.5px system-ui, sans-serif";
  ctx.lineWidth = 3;
  ctx.lineJoin = "round";
  ctx.strokeStyle = theme.paper;
  ctx.fillStyle = theme.muted;
  for (const { text, x, y } of labels) {
    ctx.strokeText(text, x, y);
    ctx.fillText(text, x, y);
  }
}

/**
 * Draw parallels with labels on the left, and meridians with labels at the top.
 * @param {Frame} frame
 * @param {Area} area
 * @param {[number, number]} center
 * @returns {Label[]}
 */
function drawDegrees(frame, area, center) {
  const { south, north, west, east } = seenDegrees(frame, area, center);
  if (!(north - south < MAX_SPAN) || !(east - west < MAX_SPAN)) return [];
  const step = GRID_PIXELS / frame.view.scale / DEGREE;
  const stepLat = niceStep(step, 1);
  const narrowing = Math.max(Math.cos(((south + north) / 2) * (Math.PI / 180)), 0.1);
  const stepLon = niceStep(step / narrowing, 1);

  /** @type {Label[]} */
  const labels = [];
  const draw = (
    /** @type {[number, number][]} */ places,
    /** @type {number} */ degrees,
    /** @type {"lat" | "lon"} */ axis,
  ) => {
    const line = places.map(([lat, lon]) => shift(toPlane(lat, lon, center), area.x));
    const decimals = stepDecimals(axis === "lat" ? stepLat : stepLon);
    const text = formatDegrees(degrees, axis, decimals);
    labels.push(...drawGridLine(frame, line, text, axis === "lat" ? "left" : "top"));
  };
  for (let i = Math.ceil(south / stepLat); i * stepLat <= north; i++) {
    draw(
      pieces(west, east).map((lon) => [i * stepLat, lon]),
      i * stepLat,
      "lat",
    );
  }
  for (let i = Math.ceil(west / stepLon); i * stepLon <= east; i++) {
    draw(
      pieces(south, north).map((lat) => [lat, i * stepLon]),
      wrap(i * stepLon),
      "lon",
    );
  }
  return labels;
}

/**
 * Ranges of degrees that are seen; longitudes count on across the antimeridian.
 * @param {Frame} frame
 * @param {Area} area
 * @param {[number, number]} center
 */
function seenDegrees({ seen, view }, area, center) {
  const places = [];
  for (const x of [seen.minX, view.x, seen.maxX]) {
    for (const y of [seen.minY, seen.maxY]) places.push(toDegrees(x - area.x, y, center));
  }
  const lats = places.map(([lat]) => lat);
  const lons = places.map(([, lon]) => center[1] + wrap(lon - center[1]));
  return {
    south: Math.min(...lats),
    north: Math.max(...lats),
    west: Math.min(...lons),
    east: Math.max(...lons),
  };
}

/**
 * A longitude in [-180, 180).
 * @param {number} lon degrees
 */
function wrap(lon) {
  return ((((lon + 180) % 360) + 360) % 360) - 180;
}

/**
 * @param {[number, number]} position
 * @param {number} dx metres
 * @returns {[number, number]}
 */
function shift([x, y], dx) {
  return [x + dx, y];
}

/**
 * Decimals that tell multiples of a step apart.
 * @param {number} step
 */
function stepDecimals(step) {
  return Math.min(Math.max(Math.ceil(-Math.log10(step) - 1e-9), 0), DEGREE_DECIMALS);
}

/**
 * Numbers from a first to a last.
 * @param {number} from
 * @param {number} to
 */
function pieces(from, to) {
  return Array.from({ length: PIECES + 1 }, (_, i) => from + ((to - from) * i) / PIECES);
}

/**
 * @param {Frame} frame
 * @returns {Label[]}
 */
function drawMetres(frame) {
  const { seen, view } = frame;
  const step = niceStep(GRID_PIXELS / view.scale, 1);
  const label = (/** @type {number} */ i) => `${formatNumber(i * step || 0, 6)}\u202fm`;
  /** @type {Label[]} */
  const labels = [];
  for (let i = Math.ceil(seen.minY / step); i * step <= seen.maxY; i++) {
    labels.push(
      ...drawGridLine(
        frame,
        [
          [seen.minX, i * step],
          [seen.maxX, i * step],
        ],
        label(i),
        "left",
      ),
    );
  }
  for (let i = Math.ceil(seen.minX / step); i * step <= seen.maxX; i++) {
    labels.push(
      ...drawGridLine(
        frame,
        [
          [i * step, seen.minY],
          [i * step, seen.maxY],
        ],
        label(i),
        "top",
      ),
    );
  }
  return labels;
}

/**
 * Draw a line of the graticule.
 * @param {Frame} frame
 * @param {[number, number][]} line metres
 * @param {string} text
 * @param {"left" | "top"} side border at which its label stands
 * @returns {Label[]} its label, if there is space
 */
function drawGridLine(frame, line, text, side) {
  const { ctx, width, height } = frame;
  const points = line.map(([x, y]) => toScreen(frame, { x, y }));
  const axis = side === "left" ? 0 : 1;
  snap(points, 1 - axis);
  ctx.beginPath();
  for (const [x, y] of points) ctx.lineTo(x, y);
  ctx.stroke();

  // Where the line crosses the border.
  const sorted = points.slice().sort((a, b) => a[axis] - b[axis]);
  const after = Math.max(
    sorted.findIndex((point) => point[axis] >= 0),
    1,
  );
  const [a, b] = [sorted[after - 1], sorted[after]];
  const share = (0 - a[axis]) / (b[axis] - a[axis] || 1);
  const other = a[1 - axis] + share * (b[1 - axis] - a[1 - axis]);
  const end = side === "left" ? height - 40 : width - 40;
  if (other < (side === "left" ? 30 : 60) || other > end) return [];
  return [side === "left" ? { text, x: 6, y: other - 4 } : { text, x: other + 4, y: 14 }];
}

/**
 * Put a line that is nearly straight onto the middle of pixels, so that it is sharp.
 * @param {number[][]} points CSS pixels
 * @param {number} axis across the line
 */
function snap(points, axis) {
  const values = points.map((point) => point[axis]);
  if (Math.max(...values) - Math.min(...values) > 1) return;
  const middle = Math.floor(values[0]) + 0.5;
  for (const point of points) point[axis] = middle;
}

/** CSS pixels of the longest scale bar. */
const BAR_PIXELS = 120;

/**
 * Draw the scale bar and the arrow to the north.
 * @param {Frame} frame
 * @param {string} units
 */
export function drawScale(frame, units) {
  const { ctx, view, height, theme } = frame;

  // The roundest length that fits.
  const [size, sign] = lengthUnit(BAR_PIXELS / view.scale, units);
  const metres = niceStep((BAR_PIXELS / view.scale / size) * 0.42, 1) * size;
  const pixels = metres * view.scale;
  const [left, bottom] = [14, height - 14];
  ctx.lineWidth = 4;
  ctx.strokeStyle = theme.paper;
  ctx.lineCap = "butt";
  for (const pass of [0, 1]) {
    ctx.beginPath();
    ctx.moveTo(left, bottom - 5);
    ctx.lineTo(left, bottom);
    ctx.lineTo(left + pixels, bottom);
    ctx.lineTo(left + pixels, bottom - 5);
    ctx.stroke();
    if (!pass) [ctx.lineWidth, ctx.strokeStyle] = [1.5, theme.ink];
  }
  drawText(frame, `${formatNumber(metres / size)}\u202f${sign}`, left + 6, bottom - 6, "left");

  // North is up.
  const x = left + pixels + 20;
  ctx.fillStyle = theme.ink;
  ctx.beginPath();
  ctx.moveTo(x, bottom - 12);
  ctx.lineTo(x - 4.5, bottom + 1);
  ctx.lineTo(x, bottom - 2.5);
  ctx.lineTo(x + 4.5, bottom + 1);
  ctx.fill();
  drawText(frame, "N", x, bottom - 15, "center");
}

/**
 * Write on the map, with a border in the colour of the paper.
 * @param {Frame} frame
 * @param {string} text
 * @param {number} x CSS pixels
 * @param {number} y
 * @param {CanvasTextAlign} align
 */
export function drawText({ ctx, theme }, text, x, y, align) {
  ctx.font = "600 11px system-ui, sans-serif";
  ctx.textAlign = align;
  ctx.lineWidth = 3;
  ctx.lineJoin = "round";
  ctx.strokeStyle = theme.paper;
  ctx.strokeText(text, x, y);
  ctx.fillStyle = theme.ink;
  ctx.fillText(text, x, y);
  ctx.textAlign = "left";
}

/**
 * A position as text.
 * @param {number} x metres
 * @param {number} y
 * @param {Area} area
 * @param {number} scale CSS pixels for a metre: decides on the digits
 */
export function formatPosition(x, y, area, scale) {
  const decimals = Math.min(Math.max(Math.ceil(Math.log10(scale || 1)), 0), 3);
  if (!area.center) {
    const [east, north] = [x, y].map((each) => formatFixed(each, decimals));
    return `x ${east}\u202fm, y ${north}\u202fm`;
  }
  const [lat, lon] = toDegrees(x - area.x, y, area.center);
  const digits = Math.min(decimals + 5, 7);
  return `${formatDegrees(lat, "lat", digits)}, ${formatDegrees(lon, "lon", digits)}`;
}
