/**
 * Numbers of a time range or of a track.
 *
 * @typedef {import("./map.js").App} App
 * @typedef {import("./scene.js").Archive} Archive
 *
 * @typedef {object} Measures
 * @property {number} distance metres along the walks
 * @property {number} moving seconds with a known position
 * @property {number} fastest metres a second, without jumps of the receiver
 * @property {number} jumps how many
 * @property {number} samples how many
 * @property {number} rmse metres; NaN if no sample has an error
 * @property {number} maxError metres; NaN if no sample has an error
 */

import { clockShift, clockTracks } from "./clock.js";
import { formatCount, formatDuration, formatLength, formatSpeed } from "./format.js";
import { rawParts } from "./series.js";
import { formatExtent } from "./times.js";
import { lastAtMost, measureWalk, trackExtent } from "./walks.js";

/**
 * Measure what the shown tracks of an archive do between two times of the clock.
 * @param {App} app
 * @param {Archive} archive
 * @param {[number, number]} range
 * @returns {Measures}
 */
export function measureRange(app, archive, range) {
  // Walks.
  let [distance, moving, fastest, jumps] = [0, 0, 0, 0];
  for (const track of clockTracks(app, archive)) {
    const shift = clockShift(app, archive, track);
    const walk = measureWalk(archive, track, [range[0] + shift, range[1] + shift]);
    distance += walk.distance;
    moving += walk.moving;
    fastest = Math.max(fastest, walk.fastest);
    jumps += walk.jumps;
  }

  // Samples.
  let [samples, known, squares, maxError] = [0, 0, 0, NaN];
  const { raw } = archive;
  for (const { from, to, shift } of raw ? rawParts(app, archive) : []) {
    const { time, error } = /** @type {import("./scene.js").Raw} */ (raw);
    const start = range[0] + shift;
    for (let i = Math.max(lastAtMost(time, start, from, to), from); i < to; i++) {
      if (time[i] > range[1] + shift) break;
      if (time[i] < start) continue;
      samples++;
      if (Number.isNaN(error[i])) continue;
      known++;
      squares += error[i] ** 2;
      if (!(maxError >= error[i])) maxError = error[i];
    }
  }
  return { distance, moving, fastest, jumps, samples, rmse: Math.sqrt(squares / known), maxError };
}

/**
 * Measures as labels and texts.
 * @param {App} app
 * @param {Archive} archive
 * @param {Measures} measures
 * @param {number} extent of the range: seconds, or metres without times
 * @returns {[string, string][]}
 */
export function measureRows(app, archive, measures, extent) {
  const { units } = app.store.state;
  const { epoch } = app.scene;
  /** @type {[string, string][]} */
  const rows = [];
  if (epoch) rows.push(["Duration", formatExtent(extent, epoch, units)]);
  rows.push(["Distance", formatLength(measures.distance, units)]);
  if (epoch && measures.moving > 0) {
    rows.push(["Mean speed", formatSpeed(measures.distance / measures.moving, units)]);
    rows.push(["Top speed", formatSpeed(measures.fastest, units)]);
    if (measures.jumps) rows.push(["Jumps, without speed", formatCount(measures.jumps)]);
  }
  if (epoch && measures.moving < extent * 0.999 && clockTracks(app, archive).length === 1) {
    rows.push(["Without a position", formatDuration(extent - measures.moving)]);
  }
  if (archive.raw) {
    const isThinned = archive.raw.drawn < archive.raw.total;
    rows.push([isThinned ? "Points in this page" : "Points", formatCount(measures.samples)]);
    if (!Number.isNaN(measures.rmse)) {
      rows.push([isThinned ? "RMSE of these" : "RMSE", formatLength(measures.rmse, units)]);
      rows.push(["Largest error", formatLength(measures.maxError, units)]);
    }
  }
  return rows;
}

/**
 * Numbers of the chosen track, or of all.
 * @param {App} app
 * @param {Archive} archive
 * @returns {[string, string][]}
 */
export function trackRows(app, archive) {
  const tracks = clockTracks(app, archive);
  const extents = tracks.map((track) => trackExtent(archive, track));
  const shift = (/** @type {number} */ i) => clockShift(app, archive, tracks[i]);
  const first = extents.reduce((low, [start], i) => Math.min(low, start - shift(i)), Infinity);
  const last = extents.reduce((high, [, end], i) => Math.max(high, end - shift(i)), -Infinity);
  if (first > last) return [["Times", "none"]];
  const rows = measureRows(
    app,
    archive,
    measureRange(app, archive, [-Infinity, Infinity]),
    last - first,
  );

  // Knots and gaps.
  const { offsets } = archive.tracks;
  const gaps = tracks.reduce((sum, track) => {
    for (let k = offsets[track]; k < offsets[track + 1]; k++) sum += archive.knots.gap[k];
    return sum;
  }, 0);
  const knots = tracks.reduce((sum, track) => sum + offsets[track + 1] - offsets[track], 0);
  rows.push(["Knots", formatCount(knots)]);
  if (gaps) rows.push(["Gaps", formatCount(gaps)]);
  return rows;
}
