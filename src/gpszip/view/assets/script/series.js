/**
 * What the chart may show: values over time.
 *
 * @typedef {import("./map.js").App} App
 * @typedef {import("./scene.js").Archive} Archive
 *
 * @typedef {object} Part Values of one track.
 * @property {number} from first number
 * @property {number} to end of the numbers
 * @property {number} shift what to subtract from times to get the clock's
 *
 * @typedef {object} Series
 * @property {string} label
 * @property {"raw" | "clean" | "error" | "tracks" | "routes"} colour of the theme
 * @property {"dots" | "cloud" | "line" | "step"} kind of a cloud some dots are enough; a step has its
 *   value since the number before
 * @property {Float64Array} time
 * @property {Float64Array} value
 * @property {Uint8Array} [joined] 0 where no line leads to a number from the one before
 * @property {Part[]} parts
 *
 * @typedef {object} ChartKind
 * @property {string} id
 * @property {string} label
 * @property {"speed" | "length" | "number" | "bytes"} unit
 */

import { clockShift, clockTracks } from "./clock.js";
import { rawNumber, sampleSpeeds } from "./colouring.js";
import { segmentSpeed } from "./walks.js";

/** What a kept column's name begins with among the kinds of charts. */
const KEPT = "kept:";

/**
 * Kinds of charts that a scene has something for.
 * @param {import("./scene.js").Scene} scene
 * @returns {ChartKind[]}
 */
export function chartKinds({ archives, epoch }) {
  /** @type {ChartKind[]} */
  const kinds = [];
  if (epoch || !archives.some(({ sections }) => sections.length))
    kinds.push({ id: "speed", label: "Speed", unit: "speed" });
  if (archives.some(({ maxError }) => maxError !== null))
    kinds.push({ id: "error", label: "Error", unit: "length" });
  if (archives.some(({ dimension }) => dimension > 2))
    kinds.push({ id: "altitude", label: "Altitude", unit: "length" });
  const columns = new Set(archives.flatMap(({ kept }) => [...(kept?.columns.keys() ?? [])]));
  for (const name of columns) kinds.push({ id: KEPT + name, label: name, unit: "number" });
  if (archives.some(({ sections }) => sections.length))
    kinds.push({ id: "bytes", label: "Bytes by section", unit: "bytes" });
  return kinds;
}

/** @type {WeakMap<object, Float64Array>} */
const cachedSpeeds = new WeakMap();

/**
 * Values that are computed once.
 * @param {object} key
 * @param {() => Float64Array} compute
 */
function cached(key, compute) {
  let values = cachedSpeeds.get(key);
  if (!values) cachedSpeeds.set(key, (values = compute()));
  return values;
}

/**
 * Series of the chart that is chosen.
 * @param {App} app
 * @returns {Series[]} what lies behind first
 */
export function chartSeries(app) {
  const { archives } = app.scene;
  /** @type {Series[]} */
  const series = [];
  for (const archive of archives) {
    const name = archives.length > 1 ? `${archive.index ? "B" : "A"} ` : "";
    const decoded = archive.isLog ? "Log" : "Decoded";
    if (archive.raw && !archive.index && !archive.isLog) series.push(...rawSeries(app, archive));
    series.push(...walkSeries(app, archive, name, decoded));
  }
  return series.filter(({ parts }) => parts.length);
}

/**
 * Series of samples.
 * @param {App} app
 * @param {Archive} archive
 * @returns {Series[]}
 */
function rawSeries(app, archive) {
  const raw = /** @type {import("./scene.js").Raw} */ (archive.raw);
  const parts = rawParts(app, archive);
  switch (app.store.state.chart) {
    case "speed":
      return [
        {
          label: "Raw",
          colour: "raw",
          kind: "cloud",
          time: raw.time,
          value: cached(raw, () => sampleSpeeds(raw)),
          parts,
        },
      ];
    case "altitude":
      return raw.z
        ? [{ label: "Raw", colour: "raw", kind: "cloud", time: raw.time, value: raw.z, parts }]
        : [];
    default:
      return [];
  }
}

/**
 * Series of walks, and of what was measured or kept along them.
 * @param {App} app
 * @param {Archive} archive
 * @param {string} name of the archive, if there are two
 * @param {string} decoded what the walks are called
 * @returns {Series[]}
 */
function walkSeries(app, archive, name, decoded) {
  const { knots, raw, kept } = archive;
  const { chart } = app.store.state;
  /** @type {Series["colour"]} */
  const colour = archive.index ? "tracks" : "clean";
  const ofKnots = { colour, time: knots.time, joined: knots.joined };
  const label = `${name}${decoded}`;
  const parts = walkParts(app, archive, archive.tracks.offsets);
  if (chart === "speed") {
    const value = cached(knots, () => knots.x.map((_, k) => (k ? segmentSpeed(archive, k) : NaN)));
    return [{ ...ofKnots, label, kind: "step", value, parts }];
  }
  if (chart === "altitude" && knots.z) {
    return [{ ...ofKnots, label, kind: "line", value: knots.z, parts }];
  }
  if (chart === "error" && raw) return [errorSeries(app, archive, name)];

  // A column that was kept.
  const column = chart.startsWith(KEPT) ? chart.slice(KEPT.length) : "";
  const value = kept?.columns.get(column);
  if (!kept || !value) return [];
  const ofColumn = { colour, time: kept.time, parts: walkParts(app, archive, kept.offsets) };
  return [{ ...ofColumn, label: `${name}${column}`, kind: "line", value }];
}

/**
 * Errors of the samples.
 * @param {App} app
 * @param {Archive} archive
 * @param {string} name of the archive, if there are two
 * @returns {Series}
 */
function errorSeries(app, archive, name) {
  const { time, error } = /** @type {import("./scene.js").Raw} */ (archive.raw);
  const isSingle = app.scene.archives.length === 1;
  return {
    label: `${name}Error`,
    colour: isSingle ? "error" : archive.index ? "tracks" : "clean",
    kind: "dots",
    time,
    value: error,
    parts: rawParts(app, archive),
  };
}

/**
 * Parts of values that are filed by walks.
 * @param {App} app
 * @param {Archive} archive
 * @param {Float64Array} offsets
 * @returns {Part[]}
 */
function walkParts(app, archive, offsets) {
  return clockTracks(app, archive).map((track) => ({
    from: offsets[track],
    to: offsets[track + 1],
    shift: clockShift(app, archive, track),
  }));
}

/**
 * Parts of samples: of raw tracks whose walks the clock shows.
 * @param {App} app
 * @param {Archive} archive
 * @returns {Part[]}
 */
export function rawParts(app, archive) {
  const { raw } = archive;
  if (!raw) return [];

  // One walk is looked up; of all walks, every raw track is asked.
  const shown = clockTracks(app, archive);
  const numbers = shown.length === 1 ? [rawNumber(archive, shown[0])] : [...raw.walk.keys()];
  const isShown = new Set(shown);
  return numbers
    .filter((i) => i >= 0 && isShown.has(raw.walk[i]))
    .map((i) => ({
      from: raw.tracks.offsets[i],
      to: raw.tracks.offsets[i + 1],
      shift: clockShift(app, archive, raw.walk[i]),
    }));
}
