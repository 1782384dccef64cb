/**
 * Moving the map to where something is: all of an area, a track, an agent.
 *
 * @typedef {import("./map.js").App} App
 */

import { clockShift, clockTracks } from "./clock.js";
import { emptyBox, extend, fitBox, seenBox } from "./viewport.js";
import { positionAt } from "./walks.js";

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
  const [{ knots, tracks }] = app.scene.archives;
  const number = track === null ? undefined : tracks.numbers.get(track);
  if (number === undefined) return null;

  // Knots of other areas are far away.
  const [from, to] = [tracks.offsets[number], tracks.offsets[number + 1]];
  const start = areaAt(app, knots.x[from]);
  const box = emptyBox();
  for (let k = from; k < to; k++) {
    if (areaAt(app, knots.x[k]) === start) extend(box, knots.x[k], knots.y[k]);
  }
  return from < to ? box : null;
}
