/**
 * The worst places of an archive: the samples with the largest errors, far from each other.
 *
 * @typedef {object} WorstPlace
 * @property {number} sample
 * @property {number} track number of the walk
 * @property {number} error metres
 * @property {number} time
 * @property {number} x where the log was
 * @property {number} y
 */

/** Places that are listed. */
const WORST_COUNT = 10;

/** Samples that are sorted at most. */
const WORST_SORTED = 2000;

/** Places of one track are apart by this share of its samples. */
const APART_SHARE = 1 / 50;

/**
 * Find the samples with the largest errors.
 * @param {import("./scene.js").Archive} archive
 * @returns {WorstPlace[]} the worst first
 */
export function findWorst({ raw }) {
  if (!raw) return [];
  /** @type {WorstPlace[]} */
  const worst = [];
  for (const i of largestErrors(raw.error)) {
    const track = raw.track[i];
    const apart = Math.max(
      (raw.tracks.offsets[track + 1] - raw.tracks.offsets[track]) * APART_SHARE,
      2,
    );
    const isNear = worst.some(
      ({ sample }) => raw.track[sample] === track && Math.abs(sample - i) < apart,
    );
    if (isNear) continue;
    worst.push({
      sample: i,
      track: raw.walk[track],
      error: raw.error[i],
      time: raw.time[i],
      x: raw.x[i],
      y: raw.y[i],
    });
    if (worst.length === WORST_COUNT) break;
  }
  return worst;
}

/**
 * Numbers of the samples with the largest errors, the largest first.
 * @param {Float64Array} error
 */
function largestErrors(error) {
  // The error that about as many samples exceed as may be sorted.
  let largest = 0;
  for (const value of error) if (value > largest) largest = value;
  const counts = new Uint32Array(1001);
  for (const value of error) if (value > 0) counts[Math.floor((value / largest) * 1000)]++;
  let [level, above] = [1000, counts[1000]];
  while (level > 0 && above + counts[level - 1] <= WORST_SORTED) above += counts[--level];

  // Many alike: the first of them.
  const numbers = [];
  for (let i = 0; i < error.length && numbers.length < 50 * WORST_SORTED; i++) {
    if (error[i] > 0 && error[i] >= (level / 1000) * largest) numbers.push(i);
  }
  return numbers.sort((a, b) => error[b] - error[a] || a - b);
}
