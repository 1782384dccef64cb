/**
 * Moving the map to where a track is.
 *
 * @typedef {import("./map.js").App} App
 */

import { clockShift, clockTracks } from "./clock.js";
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
