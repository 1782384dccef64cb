/**
 * Where tracks are at a time: positions on walks are linear in time between two knots.
 *
 * @typedef {import("./scene.js").Archive} Archive
 * @typedef {{x: number, y: number, z: number, time: number}} Position
 */

/** Share of the segments whose speeds jumps are compared with, and how much faster jumps are. */
const FAST_QUANTILE = 0.95;
const JUMP_FACTOR = 4;

/**
 * Number of the last value that is at most a given one, in a sorted part of an array.
 * @param {Float64Array} values
 * @param {number} value
 * @param {number} from first of the part
 * @param {number} to end of the part
 * @returns {number} from - 1 if all are larger
 */
export function lastAtMost(values, value, from, to) {
  let [low, high] = [from - 1, to];
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (values[middle] <= value) low = middle;
    else high = middle;
  }
  return low;
}

/**
 * First and last time of a track; NaN if it has no knots.
 * @param {Archive} archive
 * @param {number} track
 * @returns {[number, number]}
 */
export function trackExtent(archive, track) {
  const { offsets } = archive.tracks;
  if (offsets[track] === offsets[track + 1]) return [NaN, NaN];
  return [archive.knots.time[offsets[track]], archive.knots.time[offsets[track + 1] - 1]];
}

/**
 * Position of a track at a time.
 * @param {Archive} archive
 * @param {number} track
 * @param {number} time
 * @returns {Position | null} null before the first knot, after the last, and in a gap
 */
export function positionAt(archive, track, time) {
  const { knots, tracks } = archive;
  const [from, to] = [tracks.offsets[track], tracks.offsets[track + 1]];
  const k = lastAtMost(knots.time, time, from, to);
  if (k < from || to === from) return null;
  if (k === to - 1) return time > knots.time[k] ? null : knotPosition(archive, k, k, 0);
  if (knots.gap[k + 1]) return time > knots.time[k] ? null : knotPosition(archive, k, k, 0);
  const duration = knots.time[k + 1] - knots.time[k];
  return knotPosition(archive, k, k + 1, duration > 0 ? (time - knots.time[k]) / duration : 0);
}

/**
 * Position between two knots.
 * @param {Archive} archive
 * @param {number} k
 * @param {number} next
 * @param {number} share of the way to the next
 * @returns {Position}
 */
function knotPosition({ knots }, k, next, share) {
  const between = (/** @type {Float64Array} */ values) =>
    values[k] + share * (values[next] - values[k]);
  return {
    x: between(knots.x),
    y: between(knots.y),
    z: knots.z ? between(knots.z) : NaN,
    time: between(knots.time),
  };
}

/**
 * Metres from a knot to the one before; in three dimensions where there are three.
 * @param {Archive} archive
 * @param {number} k
 */
function segmentLength({ knots }, k) {
  const height = knots.z ? knots.z[k] - knots.z[k - 1] : 0;
  return Math.hypot(knots.x[k] - knots.x[k - 1], knots.y[k] - knots.y[k - 1], height);
}

/**
 * Speed on the segment that leads to a knot; NaN in gaps and for tracks without times.
 * @param {Archive} archive
 * @param {number} k
 */
export function segmentSpeed(archive, k) {
  const { knots, tracks } = archive;
  const duration = knots.time[k] - knots.time[k - 1];
  if (!knots.joined[k] || !tracks.timed[knots.line[k]] || duration <= 0) return NaN;
  return segmentLength(archive, k) / duration;
}

/** @type {WeakMap<Archive, number>} */
const speedLimits = new WeakMap();

/**
 * Speed above which a segment is a jump of the receiver: four times the speed that one segment in
 * twenty exceeds, as for cleaning and matching.
 * @param {Archive} archive
 */
function speedLimit(archive) {
  let limit = speedLimits.get(archive);
  if (limit === undefined) {
    const speeds = archive.knots.x
      .map((_, k) => (k ? segmentSpeed(archive, k) : NaN))
      .filter((speed) => speed > 0)
      .sort();
    limit = JUMP_FACTOR * (speeds[Math.floor(FAST_QUANTILE * speeds.length)] ?? Infinity);
    speedLimits.set(archive, limit);
  }
  return limit;
}

/**
 * What a track does in a time range.
 * @param {Archive} archive
 * @param {number} track
 * @param {[number, number]} range
 * @returns {{distance: number, moving: number, fastest: number, jumps: number}} metres, seconds
 *   with a position, the largest speed in metres a second without jumps of the receiver, and the
 *   number of these
 */
export function measureWalk(archive, track, range) {
  const { knots, tracks } = archive;
  const [from, to] = [tracks.offsets[track], tracks.offsets[track + 1]];
  const limit = speedLimit(archive);
  let [distance, moving, fastest, jumps] = [0, 0, 0, 0];
  for (let k = Math.max(lastAtMost(knots.time, range[0], from, to), from) + 1; k < to; k++) {
    if (knots.time[k - 1] >= range[1]) break;
    if (!knots.joined[k]) continue;

    // The share of the segment in the range.
    const duration = knots.time[k] - knots.time[k - 1];
    const inside = Math.min(knots.time[k], range[1]) - Math.max(knots.time[k - 1], range[0]);
    const share = duration > 0 ? inside / duration : 1;
    if (share < 0) continue;
    distance += share * segmentLength(archive, k);
    moving += Math.max(inside, 0);
    const speed = segmentSpeed(archive, k) || 0;
    if (speed > limit) jumps++;
    else fastest = Math.max(fastest, speed);
  }
  return { distance, moving, fastest, jumps };
}

/**
 * Distance from a place to the segment that leads to a point.
 * @param {import("./scene.js").Lines} lines
 * @param {number} k number of the point
 * @param {number} x
 * @param {number} y
 * @returns {{distance: number, share: number}} metres, and the share of the segment before the
 *   nearest position
 */
export function toSegment(lines, k, x, y) {
  const dx = lines.x[k] - lines.x[k - 1];
  const dy = lines.y[k] - lines.y[k - 1];
  const square = dx * dx + dy * dy;
  const along = square ? ((x - lines.x[k - 1]) * dx + (y - lines.y[k - 1]) * dy) / square : 0;
  const share = Math.min(Math.max(along, 0), 1);
  const offX = lines.x[k - 1] + share * dx - x;
  const offY = lines.y[k - 1] + share * dy - y;
  return { distance: Math.hypot(offX, offY), share };
}

/**
 * Heading of the segment that leads to a knot.
 * @param {import("./scene.js").Knots} knots
 * @param {number} k
 * @returns {number} radians, counterclockwise from the east; NaN if the segment has no length
 */
function segmentHeading({ x, y }, k) {
  const [dx, dy] = [x[k] - x[k - 1], y[k] - y[k - 1]];
  return dx || dy ? Math.atan2(dy, dx) : NaN;
}

/**
 * @typedef {object} Pass One time at which a track comes by a place.
 * @property {number} track
 * @property {number} time when it is nearest
 * @property {number} distance metres, when it is nearest
 * @property {number} speed metres a second; NaN without times
 * @property {number} heading radians, counterclockwise from the east; NaN while parked
 */

/**
 * All passes of tracks near a place; knots that follow each other nearby are one pass.
 * @param {Archive} archive
 * @param {{x: number, y: number, radius: number}} place
 * @param {number} [chosen] number of the only track to look at; all if missing
 * @returns {Pass[]} in the order of tracks and times
 */
export function findPasses(archive, place, chosen) {
  const { knots, tracks } = archive;
  const from = chosen === undefined ? 0 : tracks.offsets[chosen];
  const to = chosen === undefined ? knots.x.length : tracks.offsets[chosen + 1];
  /** @type {Pass[]} */
  const passes = [];
  let last = -2;
  for (let k = from + 1; k < to; k++) {
    if (!knots.joined[k] || isFar(knots, k, place)) continue;
    const { distance, share } = toSegment(knots, k, place.x, place.y);
    if (distance > place.radius) continue;
    const pass = {
      track: knots.line[k],
      time: knots.time[k - 1] + share * (knots.time[k] - knots.time[k - 1]),
      distance,
      speed: segmentSpeed(archive, k),
      heading: segmentHeading(knots, k),
    };
    const isNew = last !== k - 1;
    last = k;
    if (isNew) passes.push(pass);
    else if (distance < passes[passes.length - 1].distance) passes[passes.length - 1] = pass;
  }
  return passes;
}

/**
 * Whether the box of a segment is outside of a place.
 * @param {import("./scene.js").Knots} knots
 * @param {number} k
 * @param {{x: number, y: number, radius: number}} place
 */
function isFar({ x, y }, k, place) {
  const { radius } = place;
  if (x[k] < place.x - radius && x[k - 1] < place.x - radius) return true;
  if (x[k] > place.x + radius && x[k - 1] > place.x + radius) return true;
  if (y[k] < place.y - radius && y[k - 1] < place.y - radius) return true;
  return y[k] > place.y + radius && y[k - 1] > place.y + radius;
}

/**
 * Value that is exceeded for a small share of the time only; 0 if there is none.
 * @param {{value: number, duration: number}[]} steps values, and seconds for which each holds; NaN
 *   is left out
 * @param {number} share of the time with values up to the result
 */
export function usualTop(steps, share) {
  const known = steps.filter(({ value, duration }) => value === value && duration > 0);
  const total = known.reduce((sum, { duration }) => sum + duration, 0);

  // From the top until the share is used up.
  known.sort((a, b) => b.value - a.value);
  let above = 0;
  const top = known.find(({ duration }) => (above += duration) > total * (1 - share));
  return top ? top.value : 0;
}
