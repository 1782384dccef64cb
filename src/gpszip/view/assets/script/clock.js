/**
 * The clock: which times there are, and how it runs through them.
 *
 * @typedef {import("./map.js").App} App
 * @typedef {[number, number]} Range
 */

import { niceStep } from "./format.js";
import { trackExtent } from "./walks.js";

/** Speeds of the clock: seconds for a second, or the whole log in some seconds. */
export const SPEEDS = {
  "log/10": "Whole log in 10 s",
  "log/30": "Whole log in 30 s",
  "log/120": "Whole log in 2 min",
  0.01: "0.01\u00d7",
  0.1: "0.1\u00d7",
  1: "1\u00d7",
  2: "2\u00d7",
  5: "5\u00d7",
  10: "10\u00d7",
  30: "30\u00d7",
  100: "100\u00d7",
  300: "300\u00d7",
  1000: "1,000\u00d7",
  10000: "10,000\u00d7",
  100000: "100,000\u00d7",
};

/** Seconds between frames at most: a page that was hidden does not jump. */
const LONGEST_FRAME = 0.25;

/** Times of all tracks that are shorter apart than this share are one. */
const JOIN_SHARE = 1 / 1000;

/** Steps of a clock over the times that the chart shows. */
const STEPS = 500;

/**
 * Numbers of an archive's tracks that are shown by the clock: of all or of the chosen one, those
 * with times (or all, if none has).
 * @param {App} app
 * @param {import("./scene.js").Archive} archive
 * @returns {number[]}
 */
export function clockTracks({ scene, store }, archive) {
  const { ids, timed, numbers } = archive.tracks;
  const { track } = store.state;
  const chosen = track === null ? undefined : (numbers.get(track) ?? -1);
  const all = chosen === undefined ? ids.map((_, i) => i) : chosen < 0 ? [] : [chosen];
  return scene.epoch ? all.filter((i) => timed[i]) : all;
}

/**
 * What to subtract from a track's times to get the clock's.
 * @param {App} app
 * @param {import("./scene.js").Archive} archive
 * @param {number} track
 */
export function clockShift({ store }, archive, track) {
  return store.state.aligned ? trackExtent(archive, track)[0] || 0 : 0;
}

/**
 * Kind of the clock's times: those of aligned tracks count from 0.
 * @param {App} app
 */
export function clockEpoch({ scene, store }) {
  return scene.epoch && store.state.aligned ? "log" : scene.epoch;
}

/**
 * First and last time of the clock.
 * @param {App} app
 * @returns {Range}
 */
export function clockExtent(app) {
  let [first, last] = [Infinity, -Infinity];
  for (const archive of app.scene.archives) {
    for (const track of clockTracks(app, archive)) {
      const [start, end] = trackExtent(archive, track);
      const shift = clockShift(app, archive, track);
      if (start - shift < first) first = start - shift;
      if (end - shift > last) last = end - shift;
    }
  }
  if (first > last) return [0, 1];
  return last > first ? [first, last] : [first, first + 1];
}

/**
 * Ranges of time in which any track has a position, in order; short breaks don't count.
 * @param {App} app
 * @returns {Range[]}
 */
function knownRanges(app) {
  /** @type {Range[]} */
  const ranges = [];
  for (const archive of app.scene.archives) {
    const { knots, tracks } = archive;
    for (const track of clockTracks(app, archive)) {
      const shift = clockShift(app, archive, track);
      let start = NaN;
      for (let k = tracks.offsets[track]; k < tracks.offsets[track + 1]; k++) {
        if (!knots.joined[k]) start = knots.time[k] - shift;
        const isLast = k + 1 === tracks.offsets[track + 1] || !knots.joined[k + 1];
        if (isLast) ranges.push([start, knots.time[k] - shift]);
      }
    }
  }
  return joinRanges(ranges, clockExtent(app));
}

/**
 * Join ranges that overlap or nearly touch.
 * @param {Range[]} ranges
 * @param {Range} extent
 * @returns {Range[]}
 */
function joinRanges(ranges, extent) {
  const near = (extent[1] - extent[0]) * JOIN_SHARE;
  ranges.sort((a, b) => a[0] - b[0]);
  /** @type {Range[]} */
  const joined = [];
  for (const [start, end] of ranges) {
    const last = joined[joined.length - 1];
    if (last && start <= last[1] + near) last[1] = Math.max(last[1], end);
    else joined.push([start, end]);
  }
  return joined;
}

/**
 * Seconds of the log for a second.
 * @param {App} app
 */
function clockSpeed(app) {
  const { speed, skip } = app.store.state;
  const match = /^log\/(\d+)$/.exec(speed);
  if (!match) return Number(speed);
  const [first, last] = clockExtent(app);
  const known = knownRanges(app).reduce((sum, [start, end]) => sum + end - start, 0);
  return (skip && known > 0 ? known : last - first) / Number(match[1]);
}

/**
 * A step of the clock: a round number of seconds, smaller the closer the chart looks.
 * @param {App} app
 */
export function clockStep({ store }) {
  const [from, to] = store.state.domain;
  return niceStep((to - from) / STEPS, 1);
}

/**
 * Move the clock, within its times.
 * @param {App} app
 * @param {number} time
 */
export function setClock(app, time) {
  const [first, last] = clockExtent(app);
  app.store.set({ time: Math.min(Math.max(time, first), last) });
}

/**
 * Run or stop the clock; at the end it starts again.
 * @param {App} app
 */
export function togglePlay(app) {
  const { playing, time } = app.store.state;
  const [first, last] = clockExtent(app);
  if (!playing && time >= last) app.store.set({ time: first });
  app.store.set({ playing: !playing });
}

/**
 * Let the clock run while it is playing.
 * @param {App} app
 */
export function startClock(app) {
  /** @type {number | null} */
  let previous = null;
  let speed = 1;
  /** @type {Range[]} */
  let ranges = [];

  /** @param {number} now milliseconds */
  function tick(now) {
    const { playing, time, skip } = app.store.state;
    if (!playing) return;
    const elapsed = previous === null ? 0 : Math.min((now - previous) / 1000, LONGEST_FRAME);
    previous = now;
    const [, last] = clockExtent(app);
    const next = time + elapsed * speed;
    setClock(app, skip ? skipBreak(ranges, next) : next);
    if (next >= last) app.store.set({ playing: false });
    else requestAnimationFrame(tick);
  }

  app.store.on(["playing", "speed", "skip", "track", "aligned"], () => {
    speed = clockSpeed(app);
    ranges = knownRanges(app);
  });
  app.store.on(["playing"], () => {
    previous = null;
    if (app.store.state.playing) requestAnimationFrame(tick);
  });
}

/**
 * The time itself, or the start of the next range if it lies in none.
 * @param {Range[]} ranges
 * @param {number} time
 */
function skipBreak(ranges, time) {
  const next = ranges.find(([, end]) => end >= time);
  return next && next[0] > time ? next[0] : time;
}
