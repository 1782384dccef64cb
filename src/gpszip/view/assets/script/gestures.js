/**
 * Mouse, touch and wheel on the maps.
 *
 * @typedef {import("./map.js").App} App
 * @typedef {import("./map.js").Pane} Pane
 */

import { clockShift, clockTracks } from "./clock.js";
import { toSegment } from "./walks.js";
import { panView, zoomView } from "./viewport.js";

/** CSS pixels that a click may move. */
const CLICK_PIXELS = 4;

/** Zoom for a pixel of the wheel, and for the strongest turn. */
const WHEEL_FACTOR = 1.0018;
const WHEEL_LIMIT = 240;

/** CSS pixels from a walk at which the chart shows the time. */
const NEAR_PIXELS = 14;

/** CSS pixels around a click in which tracks pass. */
const PLACE_PIXELS = 9;

/**
 * Let a pane be dragged, zoomed and clicked.
 * @param {App} app
 * @param {Pane} pane
 */
export function listenToPane(app, pane) {
  const { overlay } = pane;
  /** @type {Map<number, {x: number, y: number}>} */
  const fingers = new Map();
  let moved = 0;

  overlay.addEventListener("pointerdown", (event) => {
    if (event.button) return;
    if (!fingers.size) moved = 0;
    fingers.set(event.pointerId, placeOf(pane, event));
    overlay.setPointerCapture(event.pointerId);
  });
  overlay.addEventListener("pointermove", (event) => {
    const place = placeOf(pane, event);
    const before = fingers.get(event.pointerId);
    if (!before) return hoverMap(app, pane, place);
    moved += Math.hypot(place.x - before.x, place.y - before.y);
    const others = [...fingers].filter(([id]) => id !== event.pointerId).map(([, other]) => other);
    fingers.set(event.pointerId, place);
    if (moved > CLICK_PIXELS) dragMap(app, pane, before, place, others[0]);
  });
  for (const name of /** @type {const} */ (["pointerup", "pointercancel"])) {
    overlay.addEventListener(name, (event) => {
      const place = fingers.get(event.pointerId);
      fingers.delete(event.pointerId);
      pane.element.classList.remove("dragged");
      if (name === "pointerup" && place && !fingers.size && moved <= CLICK_PIXELS)
        choosePlace(app, place);
    });
  }
  overlay.addEventListener("pointerleave", () => app.store.set({ pointer: null, hover: null }));
  overlay.addEventListener("wheel", (event) => turnWheel(app, pane, event), { passive: false });
  overlay.addEventListener("dblclick", (event) => {
    const { x, y } = placeOf(pane, event);
    app.store.set({ view: zoomView(app.store.state.view, event.shiftKey ? 0.5 : 2, x, y) });
  });
}

/**
 * Place of an event in CSS pixels from the middle of a pane.
 * @param {Pane} pane
 * @param {MouseEvent} event
 */
function placeOf(pane, event) {
  return { x: event.offsetX - pane.width / 2, y: event.offsetY - pane.height / 2 };
}

/**
 * Move the map with one finger, or turn two fingers' distance into a zoom.
 * @param {App} app
 * @param {Pane} pane
 * @param {{x: number, y: number}} before
 * @param {{x: number, y: number}} place
 * @param {{x: number, y: number} | undefined} other second finger
 */
function dragMap({ store }, pane, before, place, other) {
  pane.element.classList.add("dragged");
  if (!other) {
    const view = panView(store.state.view, place.x - before.x, place.y - before.y);
    return store.set({ view, follow: false });
  }
  const distance = Math.hypot(place.x - other.x, place.y - other.y);
  const factor = distance / Math.max(Math.hypot(before.x - other.x, before.y - other.y), 1);
  store.set({ view: zoomView(store.state.view, factor, other.x, other.y) });
}

/**
 * @param {App} app
 * @param {Pane} pane
 * @param {WheelEvent} event
 */
function turnWheel({ store }, pane, event) {
  event.preventDefault();
  const pixels = event.deltaY * (event.deltaMode ? 30 : 1);
  const turn = Math.min(Math.max(pixels, -WHEEL_LIMIT), WHEEL_LIMIT);
  const { x, y } = placeOf(pane, event);
  const { view, follow } = store.state;
  store.set({ view: zoomView(view, WHEEL_FACTOR ** -turn, follow ? 0 : x, follow ? 0 : y) });
}

/**
 * Position in metres of a place in pixels from the middle.
 * @param {App} app
 * @param {{x: number, y: number}} place
 */
function toWorld({ store }, place) {
  const { view } = store.state;
  return { x: view.x + place.x / view.scale, y: view.y - place.y / view.scale };
}

/**
 * Show the position under the pointer, and on the chart when a track was there.
 * @param {App} app
 * @param {Pane} pane
 * @param {{x: number, y: number}} place
 */
function hoverMap(app, pane, place) {
  const pointer = toWorld(app, place);
  const radius = NEAR_PIXELS / app.store.state.view.scale;
  app.store.set({ pointer, hover: nearestTime(app, pane, pointer, radius) });
}

/**
 * Time of the clock at which a track was nearest to a position; null if none was near.
 * @param {App} app
 * @param {Pane} pane
 * @param {{x: number, y: number}} pointer metres
 * @param {number} radius metres
 */
function nearestTime(app, pane, pointer, radius) {
  const { archive } = pane;
  const { knots, tracks } = archive;
  let [best, nearest] = [-1, radius];
  for (const track of clockTracks(app, archive)) {
    for (let k = tracks.offsets[track] + 1; k < tracks.offsets[track + 1]; k++) {
      if (!knots.joined[k]) continue;
      if (Math.min(knots.x[k], knots.x[k - 1]) > pointer.x + nearest) continue;
      if (Math.max(knots.x[k], knots.x[k - 1]) < pointer.x - nearest) continue;
      const { distance } = toSegment(knots, k, pointer.x, pointer.y);
      if (distance >= nearest) continue;
      [best, nearest] = [k, distance];
    }
  }
  if (best < 0) return null;
  const { share } = toSegment(knots, best, pointer.x, pointer.y);
  const time = knots.time[best - 1] + share * (knots.time[best] - knots.time[best - 1]);
  return time - clockShift(app, archive, knots.line[best]);
}

/**
 * Ask what is at a place.
 * @param {App} app
 * @param {{x: number, y: number}} place CSS pixels from the middle
 */
export function choosePlace(app, place) {
  const radius = PLACE_PIXELS / app.store.state.view.scale;
  const { track } = app.store.state;
  app.store.set({ place: { ...toWorld(app, place), radius, track } });
}
