/**
 * What moves over the map: agents and their tails, cursors, the measured range, the chosen place.
 *
 * @typedef {import("./map.js").App} App
 * @typedef {import("./map.js").Pane} Pane
 * @typedef {import("./pixels.js").Frame} Frame
 */

import { clockShift, clockTracks } from "./clock.js";
import { CATEGORIES } from "./colours.js";
import { rawNumber } from "./colouring.js";
import { drawText } from "./graticule.js";
import { addErrorLine, makeFrame, sampleAt } from "./map.js";
import { toScreen } from "./viewport.js";
import { lastAtMost, positionAt } from "./walks.js";

/** Agents that are drawn with a ring and a tail at most. */
const MAX_LARGE_AGENTS = 400;

/** Agents that have their names beside them at most. */
const MAX_NAMED_AGENTS = 12;

/** Characters of a name on the map. */
const MAX_NAME = 24;

/** Segments of all tails, or of the measured range, at most. */
const MAX_TAIL_SEGMENTS = 20000;

/**
 * Draw what moves over the map of a pane.
 * @param {App} app
 * @param {Pane} pane
 */
export function drawOverlay(app, pane) {
  const frame = makeFrame(app, pane, pane.overlay);
  const { range, pointer, place } = app.store.state;
  frame.ctx.clearRect(0, 0, frame.width, frame.height);
  if (range) drawRange(app, pane, frame, range);
  if (place) drawPlace(frame, place);
  drawAgents(app, pane, frame);
  drawHover(app, pane, frame);
  if (pointer && app.panes.length > 1) drawPointer(frame, pointer);
  if (pane.overlay.matches(":focus-visible")) drawCentre(frame);
}

/**
 * Draw the part of all walks in a time range.
 * @param {App} app
 * @param {Pane} pane
 * @param {Frame} frame
 * @param {[number, number]} range
 */
function drawRange(app, pane, frame, range) {
  const { ctx, theme } = frame;
  ctx.beginPath();
  let space = MAX_TAIL_SEGMENTS;
  for (const track of clockTracks(app, pane.archive)) {
    if (space <= 0) break;
    space -= addPath(app, pane, frame, track, range[0], range[1]);
  }
  strokeTwice(ctx, theme.paper, 6, theme.accent, 3);
}

/**
 * Stroke a path with a border.
 * @param {CanvasRenderingContext2D} ctx
 * @param {string} outer
 * @param {number} outerWidth
 * @param {string} inner
 * @param {number} innerWidth
 */
export function strokeTwice(ctx, outer, outerWidth, inner, innerWidth) {
  ctx.lineCap = ctx.lineJoin = "round";
  ctx.strokeStyle = outer;
  ctx.lineWidth = outerWidth;
  ctx.stroke();
  ctx.strokeStyle = inner;
  ctx.lineWidth = innerWidth;
  ctx.stroke();
}

/**
 * Add the part of a walk between two times of the clock to the path.
 * @param {App} app
 * @param {Pane} pane
 * @param {Frame} frame
 * @param {number} track
 * @param {number} start
 * @param {number} end
 * @returns {number} segments
 */
function addPath(app, pane, frame, track, start, end) {
  const { archive } = pane;
  const { knots, tracks } = archive;
  const shift = clockShift(app, archive, track);
  const [from, to] = [tracks.offsets[track], tracks.offsets[track + 1]];
  const first = positionAt(archive, track, start + shift);
  if (first) frame.ctx.moveTo(...toScreen(frame, first));

  // Knots in between, and the end.
  let k = lastAtMost(knots.time, start + shift, from, to) + 1;
  const begin = k;
  let isJoined = first !== null;
  for (; k < to && knots.time[k] <= end + shift && k - begin < MAX_TAIL_SEGMENTS; k++) {
    const place = toScreen(frame, { x: knots.x[k], y: knots.y[k] });
    if (isJoined && knots.joined[k]) frame.ctx.lineTo(...place);
    else frame.ctx.moveTo(...place);
    isJoined = true;
  }
  const last = positionAt(archive, track, end + shift);
  if (last && isJoined && !knots.gap[Math.min(k, to - 1)])
    frame.ctx.lineTo(...toScreen(frame, last));
  return k - begin + 1;
}

/**
 * Draw every track where it is now, with the path that it came.
 * @param {App} app
 * @param {Pane} pane
 * @param {Frame} frame
 */
function drawAgents(app, pane, frame) {
  const { time, tail } = app.store.state;
  const { archive } = pane;
  const agents = clockTracks(app, archive).map((track) => ({
    track,
    position: positionAt(archive, track, time + clockShift(app, archive, track)),
  }));
  const active = agents.filter(({ position }) => position !== null);
  const isLarge = active.length <= MAX_LARGE_AGENTS;

  // Tails.
  let space = MAX_TAIL_SEGMENTS;
  for (const { track } of isLarge && tail > 0 ? active : []) {
    if (space <= 0) break;
    frame.ctx.beginPath();
    space -= addPath(app, pane, frame, track, time - tail, time);
    strokeTwice(frame.ctx, frame.theme.paper, 5.5, agentColour(app, archive, track, frame), 3);
  }

  // The agents themselves, and the samples beside the walks.
  const isFew = active.length <= MAX_NAMED_AGENTS;
  const isNamed = archive.tracks.ids.length > 1 && isFew;
  for (const { track, position } of active) {
    const [x, y] = toScreen(frame, /** @type {import("./walks.js").Position} */ (position));
    const colour = agentColour(app, archive, track, frame);
    if (!isLarge) {
      frame.ctx.fillStyle = colour;
      frame.ctx.fillRect(x - 2, y - 2, 4, 4);
      continue;
    }
    if (isFew) drawSample(app, pane, frame, track);
    drawDot(frame, x, y, isFew ? 6 : 4, colour);
    if (isNamed) drawText(frame, shorten(archive.tracks.ids[track]), x + 10, y + 4, "left");
  }
}

/**
 * A name, cut if it is long.
 * @param {string} name
 */
export function shorten(name) {
  return name.length > MAX_NAME ? `${name.slice(0, MAX_NAME)}\u2026` : name;
}

/**
 * Colour of a track's agent: vermilion for a single one, else the same on both maps.
 * @param {App} app
 * @param {import("./scene.js").Archive} archive
 * @param {number} track
 * @param {Frame} frame
 */
function agentColour(app, archive, track, frame) {
  const { ids, numbers } = app.scene.archives[0].tracks;
  if (ids.length === 1 || app.store.state.track !== null) return frame.theme.accent;
  const number = numbers.get(archive.tracks.ids[track]) ?? track;
  return CATEGORIES[number % CATEGORIES.length];
}

/**
 * @param {Frame} frame
 * @param {number} x CSS pixels
 * @param {number} y
 * @param {number} radius
 * @param {string} colour
 */
export function drawDot({ ctx, theme }, x, y, radius, colour) {
  ctx.beginPath();
  ctx.arc(x, y, radius, 0, 2 * Math.PI);
  ctx.fillStyle = colour;
  ctx.fill();
  ctx.strokeStyle = theme.paper;
  ctx.lineWidth = 2;
  ctx.stroke();
}

/**
 * Draw the sample of a track at the time of the clock, joined with its walk. Without times nobody
 * knows which position belongs to a sample: distances along the log and the walk differ.
 * @param {App} app
 * @param {Pane} pane
 * @param {Frame} frame
 * @param {number} track
 */
function drawSample(app, pane, frame, track) {
  const { archive } = pane;
  const number = rawNumber(archive, track);
  if (!archive.raw || number < 0 || !archive.raw.tracks.timed[number]) return;
  const sample = sampleAt(
    archive.raw,
    number,
    app.store.state.time + clockShift(app, archive, track),
  );
  if (sample < 0) return;
  const { ctx, theme } = frame;
  const [x, y] = toScreen(frame, { x: archive.raw.x[sample], y: archive.raw.y[sample] });
  ctx.beginPath();
  addErrorLine(frame, archive, sample);
  ctx.strokeStyle = theme.error;
  ctx.lineWidth = 1.5;
  ctx.stroke();
  ctx.beginPath();
  ctx.arc(x, y, 3.5, 0, 2 * Math.PI);
  ctx.fillStyle = theme.paper;
  ctx.fill();
  ctx.strokeStyle = theme.ink;
  ctx.stroke();
}

/**
 * Draw where tracks are at the time under the pointer of the chart.
 * @param {App} app
 * @param {Pane} pane
 * @param {Frame} frame
 */
function drawHover(app, pane, frame) {
  const { hover, pointer } = app.store.state;
  if (hover === null || pointer) return;
  const tracks = clockTracks(app, pane.archive).slice(0, MAX_LARGE_AGENTS);
  for (const track of tracks) {
    const position = positionAt(pane.archive, track, hover + clockShift(app, pane.archive, track));
    if (!position) continue;
    const [x, y] = toScreen(frame, position);
    frame.ctx.beginPath();
    frame.ctx.arc(x, y, 7, 0, 2 * Math.PI);
    strokeTwice(frame.ctx, frame.theme.paper, 4.5, frame.theme.ink, 2);
  }
}

/**
 * Draw a cross at the pointer, which may be over another map.
 * @param {Frame} frame
 * @param {{x: number, y: number}} pointer
 */
function drawPointer(frame, pointer) {
  const [x, y] = toScreen(frame, pointer);
  drawCross(frame, x, y, 9);
}

/**
 * Draw a cross in the middle for those who move the map with the keyboard.
 * @param {Frame} frame
 */
export function drawCentre(frame) {
  drawCross(frame, frame.width / 2, frame.height / 2, 7);
}

/**
 * @param {Frame} frame
 * @param {number} x CSS pixels
 * @param {number} y
 * @param {number} size
 */
function drawCross({ ctx, theme }, x, y, size) {
  ctx.beginPath();
  ctx.moveTo(x - size, y);
  ctx.lineTo(x + size, y);
  ctx.moveTo(x, y - size);
  ctx.lineTo(x, y + size);
  strokeTwice(ctx, theme.paper, 3.5, theme.ink, 1.25);
}

/**
 * Draw a circle around the place where the user clicked.
 * @param {Frame} frame
 * @param {{x: number, y: number, radius: number}} place
 */
function drawPlace(frame, place) {
  const [x, y] = toScreen(frame, place);
  frame.ctx.beginPath();
  frame.ctx.arc(x, y, Math.max(place.radius * frame.view.scale, 3), 0, 2 * Math.PI);
  frame.ctx.fillStyle = `${frame.theme.accent}22`;
  frame.ctx.fill();
  strokeTwice(frame.ctx, frame.theme.paper, 3.5, frame.theme.accent, 1.5);
}
