/**
 * Mouse, touch and wheel on the chart: the clock, ranges, zoom.
 *
 * @typedef {import("./map.js").App} App
 * @typedef {import("./curves.js").Plot} Plot
 */

import { xToTime } from "./curves.js";
import { clockExtent, setClock } from "./clock.js";

/** CSS pixels from which a drag is a range. */
const DRAG_PIXELS = 4;

/** Zoom for a pixel of the wheel. */
const CHART_WHEEL_FACTOR = 1.0025;

/** Seconds that the chart shows at least. */
const SHORTEST_DOMAIN = 1e-3;

/**
 * Let the chart be clicked, dragged and zoomed.
 * @param {App} app
 * @param {Plot} plot
 */
export function listenToChart(app, plot) {
  const { overlay } = plot;
  const { store } = app;
  /** @type {number | null} */
  let start = null;
  let isRange = false;
  const timeOf = (/** @type {number} */ x) => {
    const { domain } = store.state;
    return Math.min(Math.max(xToTime(plot, domain, x), domain[0]), domain[1]);
  };

  overlay.addEventListener("pointerdown", (event) => {
    if (event.button) return;
    start = event.offsetX;
    isRange = false;
    overlay.setPointerCapture(event.pointerId);
  });
  overlay.addEventListener("pointermove", (event) => {
    const time = timeOf(event.offsetX);
    if (start !== null && Math.abs(event.offsetX - start) > DRAG_PIXELS) isRange = true;
    store.set({ hover: isRange ? null : time });
    if (start === null || !isRange) return;
    const other = timeOf(start);
    store.set({ range: [Math.min(time, other), Math.max(time, other)] });
  });
  overlay.addEventListener("pointerup", (event) => {
    if (start !== null && !isRange) setClock(app, timeOf(event.offsetX));
    start = null;
  });
  overlay.addEventListener("pointercancel", () => (start = null));
  overlay.addEventListener("pointerleave", () => store.set({ hover: null }));
  overlay.addEventListener("dblclick", () => showAllTimes(app));
  overlay.addEventListener("wheel", (event) => zoomChart(app, timeOf(event.offsetX), event), {
    passive: false,
  });
}

/**
 * @param {App} app
 * @param {number} time what stays where it is
 * @param {WheelEvent} event
 */
function zoomChart(app, time, event) {
  event.preventDefault();
  const { domain } = app.store.state;
  const factor = CHART_WHEEL_FACTOR ** (event.deltaY * (event.deltaMode ? 30 : 1));
  showTimes(app, [time + (domain[0] - time) * factor, time + (domain[1] - time) * factor]);
}

/**
 * Show a range of times on the chart, as far as there are times.
 * @param {App} app
 * @param {[number, number]} domain
 */
function showTimes(app, domain) {
  const [first, last] = clockExtent(app);
  const from = Math.max(domain[0], first);
  const to = Math.min(domain[1], last);
  if (to - from >= SHORTEST_DOMAIN) app.store.set({ domain: [from, to] });
}

/**
 * Show the whole chart: all times.
 * @param {App} app
 */
export function showAllTimes(app) {
  app.store.set({ domain: clockExtent(app) });
}

/**
 * Set one end of the range to the time of the clock.
 * @param {App} app
 * @param {0 | 1} end
 */
export function setRangeEnd({ store }, end) {
  const { range, domain, time } = store.state;
  const [from, to] = range ?? domain;
  if (end ? time <= from : time >= to)
    return store.set({ range: end ? [domain[0], time] : [time, domain[1]] });
  store.set({ range: end ? [from, time] : [time, to] });
}

/**
 * Show the measured range on the whole chart.
 * @param {App} app
 */
export function zoomToRange(app) {
  const { range } = app.store.state;
  if (range) showTimes(app, range);
}
