/**
 * A history on the map: places, trips, changes, unusual trips, the usual round.
 *
 * @typedef {import("./map.js").Pane} Pane
 * @typedef {import("./pixels.js").Frame} Frame
 * @typedef {import("./scene.js").Archive} Archive
 * @typedef {import("./scene.js").Lines} Lines
 * @typedef {import("./history.js").History} History
 */

import { CATEGORIES, makePalette } from "./colours.js";
import { drawText } from "./graticule.js";
import { drawLines } from "./lines.js";
import { toScreen } from "./viewport.js";
import { lastAtMost } from "./walks.js";

/** Colours of kinds of changes, of those of CATEGORIES; the list says them in words. */
const KINDS = { closed: 3, "one-way": 3, reopened: 4, new: 2, moved: 5, slower: 1, faster: 0 };

/** CSS pixels of the dots of the shortest and the longest dwell. */
const SMALL_DOT = 3;
const LARGE_DOT = 12;

/** Places that have their names beside them at most, and trips that are numbered. */
const MAX_NAMED = 40;
const MAX_NUMBERED = 20;

/** CSS pixels by which names of places are apart at least. */
const NAME_WIDTH = 40;
const NAME_HEIGHT = 13;

/**
 * Colour of a kind of change.
 * @param {string} kind
 */
export function changeColour(kind) {
  return CATEGORIES[KINDS[/** @type {keyof typeof KINDS} */ (kind)] ?? 0];
}

/**
 * Name of a place for people.
 * @param {import("./history.js").Place} place
 */
export function placeName({ number, role }) {
  return role ? `${number} ${role}?` : String(number);
}

/** Lines that were made for what a history names. @type {WeakMap<object, LinesOfHistory>} */
const linesOf = new WeakMap();

/**
 * @typedef {{lines: Lines, classes: Uint8Array}} Classed
 * @typedef {{trips: Classed, changes: Classed, rounds: Classed}} LinesOfHistory
 */

/**
 * Lines of the trips, the changes and the usual round.
 * @param {Archive} archive
 * @param {History} history
 * @returns {LinesOfHistory}
 */
function makeLines(archive, history) {
  let made = linesOf.get(history);
  if (made) return made;
  const changes = (history.changes ?? []).map(({ edge, kind }) => ({
    edge,
    colour: KINDS[/** @type {keyof typeof KINDS} */ (kind)] ?? 0,
  }));
  const missed = new Set(history.rounds?.missed);
  const rounds = (history.rounds?.edges ?? []).map((edge) => ({
    edge,
    colour: Number(missed.has(edge)),
  }));
  made = {
    trips: tripLines(archive, history),
    changes: edgeLines(archive, changes),
    rounds: edgeLines(archive, rounds),
  };
  linesOf.set(history, made);
  return made;
}

/**
 * Segments of the walks that belong to trips.
 * @param {Archive} archive
 * @param {History} history
 * @returns {Classed}
 */
function tripLines({ knots, tracks }, { trips }) {
  const joined = new Uint8Array(knots.x.length);
  const classes = new Uint8Array(knots.x.length);
  trips.forEach(({ track, start, end }, i) => {
    const last = tracks.offsets[track + 1];
    let k = Math.max(lastAtMost(knots.time, start, tracks.offsets[track], last), 0) + 1;
    for (; k < last && knots.time[k - 1] < end; k++) {
      joined[k] = knots.joined[k];
      classes[k] = i % CATEGORIES.length;
    }
  });
  return { lines: { ...knots, joined }, classes };
}

/**
 * Some edges of the clean map as lines.
 * @param {Archive} archive
 * @param {{edge: number, colour: number}[]} chosen
 * @returns {Classed}
 */
function edgeLines({ clean }, chosen) {
  const joined = new Uint8Array(clean.x.length);
  const classes = new Uint8Array(clean.x.length);
  for (const { edge, colour } of chosen) {
    const [from, to] = [clean.offsets[edge], clean.offsets[edge + 1]];
    joined.fill(1, from + 1, to);
    classes.fill(colour, from, to);
  }
  return { lines: { ...clean, joined }, classes };
}

/**
 * Position in the middle of an edge.
 * @param {Archive} archive
 * @param {number} edge
 */
export function edgeMiddle({ clean }, edge) {
  const k = Math.ceil((clean.offsets[edge] + clean.offsets[edge + 1] - 1) / 2);
  return { x: (clean.x[k] + clean.x[k - 1]) / 2, y: (clean.y[k] + clean.y[k - 1]) / 2 };
}

/**
 * Draw the layers of a history that are on.
 * @param {import("./map.js").App} app
 * @param {Pane} pane
 * @param {Frame} frame
 */
export function drawHistory({ store }, { archive }, frame) {
  const { history } = archive;
  if (!history) return;
  const { layers, track } = store.state;
  const { trips, changes, rounds } = makeLines(archive, history);
  const { theme } = frame;

  // Lines.
  if (layers.rounds && history.rounds)
    drawClassed(frame, rounds, [theme.routes, theme.error], 5, true);
  if (layers.trips) {
    const number = track === null ? -1 : (archive.tracks.numbers.get(track) ?? -1);
    const classes = number < 0 ? trips.classes : trips.classes.slice();
    if (number >= 0) {
      classes.fill(CATEGORIES.length, 0, archive.tracks.offsets[number]);
      classes.fill(CATEGORIES.length, archive.tracks.offsets[number + 1]);
    }
    drawClassed(frame, { ...trips, classes }, [...CATEGORIES, theme.dim], 2, false);
  }
  if (layers.changes) {
    drawClassed(frame, changes, CATEGORIES, 6, true);
    history.changes?.forEach(({ edge, kind }, i) => {
      drawNumber(frame, edgeMiddle(archive, edge), String(i + 1), changeColour(kind));
    });
  }

  // Points.
  if (layers.places && history.places) drawPlaces(frame, history.places);
  if (layers.unusual) {
    history.unusual?.slice(0, MAX_NUMBERED).forEach((part, i) => {
      drawNumber(frame, part, String(i + 1), theme.error);
    });
  }
}

/**
 * @param {Frame} frame
 * @param {Classed} classed
 * @param {string[]} colours
 * @param {number} width CSS pixels
 * @param {boolean} casing
 */
function drawClassed(frame, { lines, classes }, colours, width, casing) {
  const palette = makePalette(colours, frame.theme.dim, frame.theme.ink);
  drawLines(frame, lines, { palette, classes, width, casing });
}

/**
 * Draw a ring with a number beside it.
 * @param {Frame} frame
 * @param {{x: number, y: number}} position
 * @param {string} text
 * @param {string} colour
 */
export function drawNumber(frame, position, text, colour) {
  const { ctx } = frame;
  const [x, y] = toScreen(frame, position);
  ctx.moveTo(x + 6, y);
  ctx.beginPath();
  ctx.arc(x, y, 6, 0, 2 * Math.PI);
  ctx.lineWidth = 1.75;
  ctx.strokeStyle = colour;
  ctx.stroke();
  drawText(frame, text, x + 9, y - 6, "left");
}

/**
 * Draw places: a circle of the spread of their stays, a dot by the time spent there.
 * @param {Frame} frame
 * @param {import("./history.js").Place[]} places
 */
function drawPlaces(frame, places) {
  const { ctx, theme, view, seen } = frame;
  const longest = places.reduce((most, { dwell }) => Math.max(most, dwell), 1);
  const visible = places.filter(
    ({ x, y }) => x >= seen.minX && x <= seen.maxX && y >= seen.minY && y <= seen.maxY,
  );
  const dots = visible.map((place) => {
    const [x, y] = toScreen(frame, place);
    const size = SMALL_DOT + (LARGE_DOT - SMALL_DOT) * Math.sqrt(place.dwell / longest);
    return { place, x, y, size };
  });
  for (const { place, x, y, size } of [...dots].reverse()) {
    // Spread, then dwell; a place without a visit is where trips begin or end.
    ctx.beginPath();
    ctx.arc(x, y, Math.max(place.spread * view.scale, size), 0, 2 * Math.PI);
    ctx.fillStyle = `${theme.accent}2a`;
    ctx.fill();
    ctx.beginPath();
    ctx.arc(x, y, size, 0, 2 * Math.PI);
    ctx.fillStyle = place.visits ? theme.accent : theme.paper;
    ctx.fill();
    ctx.lineWidth = 1.5;
    ctx.strokeStyle = place.visits ? theme.paper : theme.accent;
    ctx.stroke();
  }

  // Names, those of the longest dwell first, where they don't cover each other.
  /** @type {{x: number, y: number}[]} */
  const named = [];
  for (const { place, x, y, size } of dots) {
    if (named.length >= MAX_NAMED) break;
    if (named.some((at) => Math.abs(at.x - x) < NAME_WIDTH && Math.abs(at.y - y) < NAME_HEIGHT))
      continue;
    drawText(frame, placeName(place), x + size + 3, y + 4, "left");
    named.push({ x, y });
  }
}
