/**
 * Moving the map to where something is: all of an area, a track, an agent.
 *
 * @typedef {import("./map.js").App} App
 * @typedef {import("./scene.js").Archive} Archive
 * @typedef {import("./history.js").Span} Span
 */

import { clockShift, clockTracks } from "./clock.js";
import { zoomToRange } from "./chartgestures.js";
import { emptyBox, extend, fitBox, seenBox } from "./viewport.js";
import { lastAtMost, positionAt } from "./walks.js";

/** Metres around a place that is jumped to in which passes are listed at most. */
const LISTED_RADIUS = 30;

/**
 * Number of the area of a position.
 * @param {App} app
 * @param {number} x metres
 */
export function areaAt({ areas }, x) {
  let best = 0;
  areas.forEach((area, i) => {
    if (Math.abs(area.x - x) < Math.abs(areas[best].x - x)) best = i;
  });
  return best;
}

/**
 * Move the map so that the first track with a position at the time of the clock is in the middle.
 * @param {App} app
 * @returns {import("./walks.js").Position | null} null if there is none
 */
export function centreOnAgent(app) {
  const { time, view } = app.store.state;
  const [archive] = app.scene.archives;
  for (const track of clockTracks(app, archive)) {
    const position = positionAt(archive, track, time + clockShift(app, archive, track));
    if (!position) continue;
    const { x, y } = position;
    app.store.set({ view: { ...view, x, y }, area: areaAt(app, x) });
    return position;
  }
  return null;
}

/**
 * Show all of the area.
 * @param {App} app
 */
export function fitArea({ store, areas, panes }) {
  const [{ width, height }] = panes;
  store.set({ view: fitBox(areas[store.state.area].box, width, height), follow: false });
}

/**
 * Show nearly all travel of the area: what a few outliers would make small.
 * @param {App} app
 */
export function fitTravel({ store, areas, panes }) {
  const [{ width, height }] = panes;
  store.set({ view: fitBox(areas[store.state.area].main, width, height), follow: false });
}

/**
 * Show all of the chosen track, or of the area if all are chosen.
 * @param {App} app
 */
export function fitMap(app) {
  const box = trackBox(app);
  if (!box) return fitArea(app);
  const [{ width, height }] = app.panes;
  const area = areaAt(app, box.minX);
  app.store.set({ view: fitBox(box, width, height), area, follow: false });
}

/**
 * Show the chosen track if nothing of it is seen.
 * @param {App} app
 */
export function showTrack(app) {
  const box = trackBox(app);
  if (!box) return;
  const [{ width, height }] = app.panes;
  const seen = seenBox(app.store.state.view, width, height);
  const isBeside = box.minX > seen.maxX || box.maxX < seen.minX;
  if (isBeside || box.minY > seen.maxY || box.maxY < seen.minY) fitMap(app);
}

/**
 * Box of the chosen track in the area where it starts.
 * @param {App} app
 * @returns {import("./viewport.js").Box | null} null if all tracks are chosen, or it has no knots
 */
function trackBox(app) {
  const { track } = app.store.state;
  const [archive] = app.scene.archives;
  const number = track === null ? undefined : archive.tracks.numbers.get(track);
  if (number === undefined) return null;
  return spanBox(app, archive, { track: number, start: -Infinity, end: Infinity });
}

/**
 * Box of a part of a track, in the area where it starts.
 * @param {App} app
 * @param {Archive} archive
 * @param {Span} span
 * @returns {import("./viewport.js").Box | null} null if it has no knots
 */
function spanBox(app, archive, { track, start, end }) {
  const { knots, tracks } = archive;
  const [first, last] = [tracks.offsets[track], tracks.offsets[track + 1]];
  const from = Math.max(lastAtMost(knots.time, start, first, last), first);
  const area = areaAt(app, knots.x[from]);
  const box = emptyBox();
  const add = (/** @type {{x: number, y: number} | null} */ position) => {
    if (position && areaAt(app, position.x) === area) extend(box, position.x, position.y);
  };

  // Knots of other areas are far away.
  for (let k = from; k < last && knots.time[k] <= end; k++) {
    if (knots.time[k] >= start) add({ x: knots.x[k], y: knots.y[k] });
  }
  if (Number.isFinite(start)) [start, end].forEach((time) => add(positionAt(archive, track, time)));
  return box.minX <= box.maxX ? box : null;
}

/**
 * Show a part of a track: as the range that is measured, on the chart, and on the map.
 * @param {App} app
 * @param {Archive} archive
 * @param {Span} span
 */
export function jumpToSpan(app, archive, span) {
  const { store } = app;
  const { ids } = archive.tracks;
  store.set({ track: ids.length > 1 ? ids[span.track] : null, playing: false, place: null });
  store.flush();
  const shift = clockShift(app, archive, span.track);
  const range = /** @type {[number, number]} */ ([span.start - shift, span.end - shift]);
  store.set({ range, time: range[0] });
  zoomToRange(app);
  const box = spanBox(app, archive, span);
  const [{ width, height }] = app.panes;
  if (box)
    store.set({ view: fitBox(box, width, height), area: areaAt(app, box.minX), follow: false });
}

/**
 * Show a place, and ask what is there.
 * @param {App} app
 * @param {{x: number, y: number}} place
 * @param {number} radius metres
 */
export function jumpToPlace(app, { x, y }, radius) {
  const [{ width, height }] = app.panes;
  const box = {
    minX: x - 4 * radius,
    minY: y - 4 * radius,
    maxX: x + 4 * radius,
    maxY: y + 4 * radius,
  };
  const { track } = app.store.state;
  app.store.set({
    view: fitBox(box, width, height),
    area: areaAt(app, x),
    place: { x, y, radius: Math.min(radius, LISTED_RADIUS), track },
    follow: false,
    playing: false,
  });
}
