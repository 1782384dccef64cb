/**
 * The strip under the map: clock, speed, chart, range.
 *
 * @typedef {import("./map.js").App} App
 */

import { showAllTimes, zoomToRange } from "./chartgestures.js";
import {
  SPEEDS,
  clockEpoch,
  clockExtent,
  clockShift,
  clockStep,
  clockTracks,
  setClock,
  togglePlay,
} from "./clock.js";
import { THEMES } from "./colours.js";
import { fillSelect, find, findInput, make, show } from "./dom.js";
import { centreOnAgent } from "./follow.js";
import { formatLength, formatSpeed } from "./format.js";
import { formatPosition } from "./graticule.js";
import { measureRange } from "./measures.js";
import { chartKinds, chartSeries } from "./series.js";
import { formatExtent, formatTime, parseTime } from "./times.js";
import { lastAtMost } from "./walks.js";

/** Steps of the slider. */
const SLIDER_STEPS = 10000;

/** Lengths of tails to choose from: seconds, or metres without times. */
const TAILS = [0, 10, 60, 600, 3600, 86400, 604800, Infinity];
const TAILS_IN_METRES = [0, 10, 100, 1000, 10000, Infinity];

/** Share of all times that a tail has at first, at least. */
const TAIL_SHARE = 1 / 60;

/**
 * Build the strip, and keep it up to date.
 * @param {App} app
 */
export function startTransport(app) {
  const { store, scene } = app;
  buildButtons(app);
  buildChoices(app);
  buildFind(app);
  store.on(["time", "track", "aligned", "zone", "units", "domain"], () => updateClock(app));
  store.on(["playing"], () => updatePlaying(app));
  store.on(["range", "track", "aligned", "zone", "units"], () => updateRange(app));
  store.on(["domain", "chart", "track", "theme", "aligned"], () => updateChartHead(app));
  store.on(["follow", "skip", "aligned"], () => updateBoxes(app));
  show(find("aligned-label"), scene.archives[0].tracks.ids.length > 1 && scene.epoch !== null);
  show(
    find("skip-label"),
    scene.archives.some(({ knots }) => knots.gap.includes(1)) ||
      scene.archives[0].tracks.ids.length > 1,
  );
  updateClock(app);
  updateRange(app);
  updateChartHead(app);
  updateBoxes(app);
}

/**
 * Length of a tail at first.
 * @param {App} app
 */
export function initialTail(app) {
  const [first, last] = clockExtent(app);
  const tails = app.scene.epoch ? TAILS : TAILS_IN_METRES;
  return tails.find((tail) => tail >= (last - first) * TAIL_SHARE && tail > 0) ?? Infinity;
}

/** @param {App} app */
function buildButtons(app) {
  const { store } = app;
  find("play").addEventListener("click", () => togglePlay(app));
  find("step-back").addEventListener("click", () =>
    setClock(app, store.state.time - clockStep(app)),
  );
  find("step-forward").addEventListener("click", () =>
    setClock(app, store.state.time + clockStep(app)),
  );
  find("range-zoom").addEventListener("click", () => zoomToRange(app));
  find("range-clear").addEventListener("click", () => store.set({ range: null }));
  find("chart-whole").addEventListener("click", () => showAllTimes(app));
  const slider = findInput("scrubber");
  slider.max = String(SLIDER_STEPS);
  slider.addEventListener("input", () => {
    const [first, last] = clockExtent(app);
    setClock(app, first + (Number(slider.value) / SLIDER_STEPS) * (last - first));
  });
  for (const id of /** @type {const} */ (["follow", "skip", "aligned"])) {
    findInput(id).addEventListener("change", () => store.set({ [id]: findInput(id).checked }));
  }
}

/** @param {App} app */
function buildChoices({ scene, store }) {
  fillSelect(find("speed"), Object.entries(SPEEDS), store.state.speed);
  find("speed").addEventListener("change", () => store.set({ speed: findInput("speed").value }));
  fillSelect(
    find("chart"),
    chartKinds(scene).map(({ id, label }) => [id, label]),
    store.state.chart,
  );
  find("chart").addEventListener("change", () => store.set({ chart: findInput("chart").value }));

  // Tails: none, some durations, all.
  const tails = scene.epoch ? TAILS : TAILS_IN_METRES;
  const text = (/** @type {number} */ tail) =>
    tail === 0 ? "None" : tail === Infinity ? "All" : formatExtent(tail, scene.epoch, "km");
  fillSelect(
    find("tail"),
    tails.map((tail) => [String(tail), text(tail)]),
    String(store.state.tail),
  );
  find("tail").addEventListener("change", () =>
    store.set({ tail: Number(findInput("tail").value) }),
  );
}

/**
 * The field for a time: it moves the clock there.
 * @param {App} app
 */
function buildFind(app) {
  const input = findInput("where-time");
  if (app.scene.epoch === null) find("where-label").textContent = "Where after";
  const showForms = () => (input.placeholder = timeForms(app));
  app.store.on(["aligned"], showForms);
  showForms();

  // No form: browsers let pages in frames send none.
  const answer = () => {
    find("where-answer").textContent = findTime(app, input.value);
  };
  find("where-go").addEventListener("click", answer);
  input.addEventListener("keydown", (event) => {
    if (event.key === "Enter") answer();
  });
}

/**
 * How a time of the clock is written.
 * @param {App} app
 */
function timeForms(app) {
  const epoch = clockEpoch(app);
  if (epoch === null) return "metres";
  return epoch === "unix" ? "14:05 or 2024-05-03 14:05" : "0:14:05 or seconds";
}

/**
 * Move the clock and the map to a time.
 * @param {App} app
 * @param {string} text what the user wrote
 * @returns {string} what was found
 */
function findTime(app, text) {
  const { store, areas } = app;
  const { zone, view } = store.state;
  const epoch = clockEpoch(app);
  const extent = clockExtent(app);
  const time = parseTime(text, epoch, zone, extent);
  const write = (/** @type {number} */ each) => formatTime(each, epoch, zone, 1);
  if (time === null) return `Can't read ${text}: write ${timeForms(app)}.`;
  if (time < extent[0] || time > extent[1]) {
    const what = epoch === null ? "Distances" : "Times";
    return `${what} are from ${write(extent[0])} to ${write(extent[1])}.`;
  }

  // Where the first track is then.
  store.set({ playing: false });
  setClock(app, time);
  const position = centreOnAgent(app);
  if (!position) return `${write(time)}: no track has a position. ${describeNearest(app, time)}`;
  const place = formatPosition(position.x, position.y, areas[store.state.area], view.scale);
  return `${write(time)}: ${place}`;
}

/**
 * Say when a track was last seen before a time without a position, and when next.
 * @param {App} app
 * @param {number} time of the clock
 */
function describeNearest(app, time) {
  const archive = app.scene.archives[0];
  const { offsets } = archive.tracks;
  let [before, after] = [-Infinity, Infinity];
  for (const track of clockTracks(app, archive)) {
    const shift = clockShift(app, archive, track);
    const k = lastAtMost(archive.knots.time, time + shift, offsets[track], offsets[track + 1]);
    if (k >= offsets[track]) before = Math.max(before, archive.knots.time[k] - shift);
    if (k + 1 < offsets[track + 1]) after = Math.min(after, archive.knots.time[k + 1] - shift);
  }
  const texts = [
    ["Last before:", before],
    ["Next:", after],
  ].flatMap(([label, at]) =>
    Number.isFinite(at)
      ? [`${label} ${formatTime(Number(at), clockEpoch(app), app.store.state.zone, 1)}.`]
      : [],
  );
  return texts.join(" ");
}

/** @param {App} app */
function updateClock(app) {
  const { time, zone, domain } = app.store.state;
  const [first, last] = clockExtent(app);
  const step = Math.min((domain[1] - domain[0]) / 2000, 1);
  const text = formatTime(time, clockEpoch(app), zone, step);
  find("clock").textContent = text;
  const slider = findInput("scrubber");
  slider.value = String(Math.round(((time - first) / (last - first)) * SLIDER_STEPS));
  slider.setAttribute("aria-valuetext", text);
}

/** @param {App} app */
function updatePlaying(app) {
  const { playing } = app.store.state;
  find("play").setAttribute("aria-pressed", String(playing));
  find("play").setAttribute("aria-label", playing ? "Pause" : "Play");
}

/** @param {App} app */
function updateBoxes({ store }) {
  for (const id of /** @type {const} */ (["follow", "skip", "aligned"]))
    findInput(id).checked = store.state[id];
}

/**
 * The numbers of the range, or how to get one.
 * @param {App} app
 */
function updateRange(app) {
  const { range, zone, chart, units } = app.store.state;
  const output = find("range");
  show(find("range-buttons"), range !== null);
  show(find("series"), range === null);
  if (!range) {
    output.textContent = chart === "bytes" ? "" : "Drag over the chart to measure a range.";
    return;
  }
  const epoch = clockEpoch(app);
  const step = Math.min((range[1] - range[0]) / 100, 1);
  const [from, to] = range.map((time) => formatTime(time, epoch, zone, step, "time"));
  const texts = [formatExtent(range[1] - range[0], epoch, units)];
  for (const archive of epoch === null ? [] : app.scene.archives) {
    const { distance, moving } = measureRange(app, archive, range);
    texts.push(formatLength(distance, units));
    if (moving > 0) texts.push(formatSpeed(distance / moving, units));
  }
  output.replaceChildren(make("strong", {}, `${from}\u2013${to}`), `  ${texts.join(", ")}`);
}

/** @param {App} app */
function updateChartHead(app) {
  const { chart, domain, theme } = app.store.state;
  const [first, last] = clockExtent(app);
  show(find("plot"), chart !== "bytes");
  show(find("bytes"), chart === "bytes");
  show(find("chart-whole"), chart !== "bytes" && (domain[0] > first || domain[1] < last));
  updateRange(app);
  find("series").replaceChildren(
    ...chartSeries(app).map(({ label, colour }) => {
      const dot = make("span", { class: "dot" });
      dot.style.background = THEMES[theme][colour];
      return make("span", {}, dot, label);
    }),
  );
}
