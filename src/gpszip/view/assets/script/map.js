/**
 * The map: all layers of one archive on a canvas.
 *
 * @typedef {import("./scene.js").Archive} Archive
 * @typedef {import("./pixels.js").Frame} Frame
 *
 * @typedef {object} App Everything that the parts of the page share.
 * @property {import("./scene.js").Scene} scene
 * @property {import("./store.js").Store} store
 * @property {import("./viewport.js").Area[]} areas
 * @property {import("./colouring.js").Colouring} colouring
 * @property {import("./errors.js").WorstPlace[][]} worst of each archive
 * @property {Pane[]} panes
 *
 * @typedef {object} Pane The map of one archive.
 * @property {Archive} archive
 * @property {HTMLElement} element
 * @property {HTMLCanvasElement} canvas map
 * @property {HTMLCanvasElement} overlay what moves with the clock
 * @property {number} width CSS pixels
 * @property {number} height
 * @property {number} ratio device pixels for a CSS pixel
 * @property {Map<number, import("./pyramid.js").Pyramid>} pyramids of each area
 * @property {Uint8Array} widths half CSS pixels of the edges of the clean map
 */

import { TRACK_COLOURS } from "./colouring.js";
import { THEMES, makePalette, toPixels } from "./colours.js";
import { drawGraticule, drawLabels, drawScale } from "./graticule.js";
import { drawHistory, drawNumber } from "./historymap.js";
import { drawArrows, drawLines } from "./lines.js";
import { countPoints, paintPoints } from "./pixels.js";
import { buildPyramid, visitPoints } from "./pyramid.js";
import { lastAtMost, positionAt } from "./walks.js";
import { seenBox, toScreen } from "./viewport.js";

/** Device pixels for a CSS pixel at most: more cost time, and few see them. */
const MAX_RATIO = 2;

/** Half CSS pixels of the widest edge of the clean map, and of the narrowest. */
const WIDEST = 9;
const NARROWEST = 3;

/** Samples that are joined with their walk at most. */
const MAX_ERROR_LINES = 1500;

/** Knots that are drawn as rings at most; more are dots. */
const MAX_RINGS = 1500;

/**
 * Make the canvases of an archive's map.
 * @param {Archive} archive
 * @param {HTMLElement} element
 * @returns {Pane}
 */
export function makePane(archive, element) {
  const [canvas, overlay] = /** @type {HTMLCanvasElement[]} */ ([
    ...element.querySelectorAll("canvas"),
  ]);
  return {
    archive,
    element,
    canvas,
    overlay,
    width: 1,
    height: 1,
    ratio: 1,
    pyramids: new Map(),
    widths: edgeWidths(archive.clean),
  };
}

/**
 * Width of each edge in half CSS pixels, by the logarithm of its traversals.
 * @param {import("./scene.js").Edges} edges
 */
function edgeWidths(edges) {
  const counts = edges.forward.map((value, i) => value + edges.backward[i]);
  const most = Math.log(counts.reduce((a, b) => Math.max(a, b), 2));
  return Uint8Array.from(
    counts,
    (count) => NARROWEST + Math.round(((WIDEST - NARROWEST) * Math.log(Math.max(count, 1))) / most),
  );
}

/**
 * Fit the canvases to their element.
 * @param {Pane} pane
 */
export function resizePane(pane) {
  pane.ratio = Math.min(window.devicePixelRatio || 1, MAX_RATIO);
  pane.width = Math.max(pane.element.clientWidth, 1);
  pane.height = Math.max(pane.element.clientHeight, 1);
  for (const canvas of [pane.canvas, pane.overlay]) {
    canvas.width = Math.round(pane.width * pane.ratio);
    canvas.height = Math.round(pane.height * pane.ratio);
  }
}

/**
 * What a canvas of a pane shows at the moment.
 * @param {App} app
 * @param {Pane} pane
 * @param {HTMLCanvasElement} canvas
 * @returns {Frame}
 */
export function makeFrame({ store }, pane, canvas) {
  const ctx = /** @type {CanvasRenderingContext2D} */ (
    canvas.getContext("2d", { willReadFrequently: true })
  );
  const { width, height, ratio } = pane;
  const { view, theme } = store.state;
  ctx.setTransform(ratio, 0, 0, ratio, 0, 0);
  return {
    ctx,
    width,
    height,
    ratio,
    view,
    seen: seenBox(view, width, height),
    theme: THEMES[theme],
  };
}

/**
 * Draw the map of a pane.
 * @param {App} app
 * @param {Pane} pane
 */
export function drawMap(app, pane) {
  const { layers, units, area, colour } = app.store.state;
  const frame = makeFrame(app, pane, pane.canvas);
  const { ctx, theme } = frame;
  const { archive } = pane;
  const place = app.areas[area];
  ctx.fillStyle = theme.paper;
  ctx.fillRect(0, 0, frame.width, frame.height);

  // What lies behind.
  if (layers.network && app.scene.network) drawPlain(frame, app.scene.network, theme.network, 2);
  const labels = layers.grid ? drawGraticule(frame, place) : [];

  // Maps on wide routes and on samples, unless colours tell of the samples; what moves on them.
  const isRawAbove = colour !== "layer" && colour in TRACK_COLOURS;
  if (layers.raw && archive.raw && !isRawAbove) drawRaw(app, pane, frame);
  if (layers.routes && archive.routes) drawPlain(frame, archive.routes, theme.routes, 5);
  drawMaps(app, pane, frame);
  if (layers.raw && archive.raw && isRawAbove) drawRaw(app, pane, frame);
  if (layers.tracks) drawTracks(app, pane, frame);
  if (layers.fresh && archive.newEdges) drawPlain(frame, archive.newEdges, theme.fresh, 3.5);
  if (layers.gaps) drawGaps(frame, archive);
  if (layers.knots) drawKnots(frame, archive.nodes);
  drawHistory(app, pane, frame);
  if (layers.errors) drawErrors(app, pane, frame);
  drawLabels(frame, labels);
  if (layers.scale) drawScale(frame, units);
}

/** Zeros: one array for all lines of a single colour. */
let zeros = new Uint8Array(1024);

/**
 * Classes of lines that have one colour.
 * @param {number} count
 */
function noClasses(count) {
  if (zeros.length < count) zeros = new Uint8Array(count);
  return zeros;
}

/**
 * Draw lines in one colour.
 * @param {Frame} frame
 * @param {import("./scene.js").Lines} lines
 * @param {string} colour
 * @param {number} width CSS pixels
 */
function drawPlain(frame, lines, colour, width) {
  drawLines(frame, lines, { palette: [colour], classes: noClasses(lines.x.length), width });
}

/**
 * @param {App} app
 * @param {Pane} pane
 * @param {Frame} frame
 */
function drawRaw(app, pane, frame) {
  const raw = /** @type {import("./scene.js").Raw} */ (pane.archive.raw);
  const { classes, ramp } = app.colouring;
  const palette = makePalette(ramp, frame.theme.dim, frame.theme.raw);
  const pyramid = areaPyramid(app, pane, raw);
  paintPoints(frame, pyramid, raw, classes[pane.archive.index].raw, toPixels(palette));
}

/**
 * The pyramid of the samples in the area that is shown; built when it is first needed.
 * @param {App} app
 * @param {Pane} pane
 * @param {import("./scene.js").Raw} raw
 */
function areaPyramid(app, pane, raw) {
  const { area } = app.store.state;
  let pyramid = pane.pyramids.get(area);
  if (!pyramid) {
    pyramid = buildPyramid(raw.x, raw.y, raw.error, app.areas[area].box);
    pane.pyramids.set(area, pyramid);
  }
  return pyramid;
}

/**
 * Draw the map as archived and the clean map.
 * @param {App} app
 * @param {Pane} pane
 * @param {Frame} frame
 */
function drawMaps(app, pane, frame) {
  const { layers, colour } = app.store.state;
  const { theme } = frame;
  const { archive } = pane;
  const { classes, ramp } = app.colouring;
  if (layers.archived) {
    const palette = makePalette(ramp, theme.dim, theme.archived);
    drawLines(frame, archive.edges, {
      palette,
      classes: classes[archive.index].archived,
      width: 1.25,
    });
  }
  if (layers.clean) {
    const palette = makePalette(ramp, theme.dim, colour === "layer" ? theme.clean : theme.dim);
    const ofEdges = classes[archive.index].clean;
    drawLines(frame, archive.clean, {
      palette,
      classes: ofEdges,
      widths: pane.widths,
      casing: true,
    });
    drawArrows(frame, archive.clean);
  }
}

/**
 * Draw the decoded tracks; those that are not chosen first.
 * @param {App} app
 * @param {Pane} pane
 * @param {Frame} frame
 */
function drawTracks(app, pane, frame) {
  const { archive } = pane;
  const { classes, ramp } = app.colouring;
  const palette = makePalette(ramp, frame.theme.dim, frame.theme.tracks);
  drawLines(frame, archive.knots, { palette, classes: classes[archive.index].tracks, width: 1.75 });
  if (app.store.state.track === null) return;
  const chosen = chosenLines(archive, app.store.state.track);
  if (chosen)
    drawLines(frame, chosen.lines, {
      palette,
      classes: classes[archive.index].tracks.subarray(chosen.from, chosen.to),
      width: 2,
    });
}

/**
 * The walk of one track as lines.
 * @param {Archive} archive
 * @param {string} id
 */
function chosenLines({ tracks, knots }, id) {
  const number = tracks.numbers.get(id);
  if (number === undefined) return null;
  const [from, to] = [tracks.offsets[number], tracks.offsets[number + 1]];
  const lines = {
    x: knots.x.subarray(from, to),
    y: knots.y.subarray(from, to),
    joined: knots.joined.subarray(from, to),
    line: new Int32Array(to - from),
    offsets: Float64Array.of(0, to - from),
  };
  return { lines, from, to };
}

/** Segments over gaps, of the knots of each archive. @type {WeakMap<object, Uint8Array>} */
const gapsOf = new WeakMap();

/**
 * Draw gaps as dashed lines from where a track was lost to where it was found.
 * @param {Frame} frame
 * @param {Archive} archive
 */
function drawGaps(frame, { knots }) {
  let joined = gapsOf.get(knots);
  if (!joined) gapsOf.set(knots, (joined = Uint8Array.from(knots.gap)));
  const classes = noClasses(knots.x.length);
  drawLines(
    frame,
    { ...knots, joined },
    { palette: [frame.theme.muted], classes, width: 1.25, dash: [1, 4] },
  );
}

/**
 * Draw knots as rings, or as dots where there are many.
 * @param {Frame} frame
 * @param {{x: Float64Array, y: Float64Array}} nodes
 */
function drawKnots(frame, { x, y }) {
  const { ctx, seen, view, width, height, theme } = frame;
  const visible = [];
  for (let i = 0; i < x.length; i++) {
    if (x[i] >= seen.minX && x[i] <= seen.maxX && y[i] >= seen.minY && y[i] <= seen.maxY)
      visible.push(i);
  }
  const isFew = visible.length <= MAX_RINGS;
  ctx.beginPath();
  for (const i of visible) {
    const u = width / 2 + (x[i] - view.x) * view.scale;
    const v = height / 2 - (y[i] - view.y) * view.scale;
    if (!isFew) ctx.rect(u - 1, v - 1, 2, 2);
    else {
      ctx.moveTo(u + 2.75, v);
      ctx.arc(u, v, 2.75, 0, 2 * Math.PI);
    }
  }
  ctx.fillStyle = isFew ? theme.paper : theme.ink;
  ctx.strokeStyle = theme.ink;
  ctx.lineWidth = 1.25;
  ctx.fill();
  if (isFew) ctx.stroke();
}

/**
 * Draw lines from samples to their positions on the walk where few are seen, and the worst places.
 * @param {App} app
 * @param {Pane} pane
 * @param {Frame} frame
 */
function drawErrors(app, pane, frame) {
  const { raw } = pane.archive;
  if (!raw) return;
  const { ctx, theme, view } = frame;
  const pyramid = areaPyramid(app, pane, raw);
  ctx.strokeStyle = theme.error;
  ctx.lineWidth = 1;
  ctx.beginPath();
  if (countPoints(frame, pyramid) <= MAX_ERROR_LINES) {
    visitPoints(pyramid, frame.seen, 1 / (view.scale * frame.ratio), (points, from, to) => {
      for (let k = from; k < to; k++) addErrorLine(frame, pane.archive, points[k]);
    });
  }
  ctx.stroke();

  // The worst places, numbered.
  app.worst[pane.archive.index].forEach((place, i) => {
    ctx.lineWidth = 1.75;
    ctx.strokeStyle = theme.error;
    ctx.beginPath();
    addErrorLine(frame, pane.archive, place.sample);
    ctx.stroke();
    drawNumber(frame, place, String(i + 1), theme.error);
  });
}

/**
 * Add the line from a sample to its walk to the path of a canvas.
 * @param {Frame} frame
 * @param {Archive} archive
 * @param {number} sample
 */
export function addErrorLine(frame, archive, sample) {
  const raw = /** @type {import("./scene.js").Raw} */ (archive.raw);
  const walk = raw.walk[raw.track[sample]];
  const position = walk < 0 ? null : positionAt(archive, walk, raw.time[sample]);
  if (!position) return;
  frame.ctx.moveTo(...toScreen(frame, { x: raw.x[sample], y: raw.y[sample] }));
  frame.ctx.lineTo(...toScreen(frame, position));
}

/**
 * Number of the last sample of a raw track at a time; -1 if there is none.
 * @param {import("./scene.js").Raw} raw
 * @param {number} track
 * @param {number} time
 */
export function sampleAt(raw, track, time) {
  const from = raw.tracks.offsets[track];
  const found = lastAtMost(raw.time, time, from, raw.tracks.offsets[track + 1]);
  return found < from ? -1 : found;
}
