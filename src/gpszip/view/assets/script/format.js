/** Numbers as people read them: lengths, speeds, durations, counts, degrees. */

/**
 * @typedef {object} Units
 * @property {string} label
 * @property {[number, string][]} lengths metres of each unit and its sign, the smallest first
 * @property {[number, string]} speed metres a second of the unit, and its sign
 */

/** @type {Record<string, Units>} */
export const UNITS = {
  m: {
    label: "m, m/s",
    lengths: [
      [1, "m"],
      [1000, "km"],
    ],
    speed: [1, "m/s"],
  },
  km: {
    label: "km, km/h",
    lengths: [
      [1, "m"],
      [1000, "km"],
    ],
    speed: [1 / 3.6, "km/h"],
  },
  mi: {
    label: "mi, mph",
    lengths: [
      [0.3048, "ft"],
      [1609.344, "mi"],
    ],
    speed: [0.44704, "mph"],
  },
  nm: {
    label: "nm, knots",
    lengths: [
      [1, "m"],
      [1852, "nm"],
    ],
    speed: [1852 / 3600, "kn"],
  },
};

const MINUS = "\u2212";
const THIN_SPACE = "\u202f";

/**
 * A number with about three digits.
 * @param {number} value
 * @param {number} [digits]
 */
export function formatNumber(value, digits = 3) {
  if (!Number.isFinite(value)) return "\u2013";
  const size = Math.abs(value);
  const decimals =
    size >= 10 ** (digits - 1) || !size ? 0 : digits - 1 - Math.floor(Math.log10(size));
  const text = value.toLocaleString("en", {
    maximumFractionDigits: Math.min(Math.max(decimals, 0), 12),
  });
  return text.replace("-", MINUS);
}

/**
 * A number with a fixed count of decimals; 0 has no sign.
 * @param {number} value
 * @param {number} decimals
 */
export function formatFixed(value, decimals) {
  const text = value.toFixed(decimals);
  return Number(text) ? text.replace("-", MINUS) : text.replace("-", "");
}

/**
 * A whole number with commas.
 * @param {number} value
 */
export function formatCount(value) {
  return Math.round(value).toLocaleString("en");
}

/**
 * How many there are of something: 1 track, 2 tracks.
 * @param {number} count
 * @param {string} noun
 * @param {string} [nouns]
 */
export function formatCountOf(count, noun, nouns = `${noun}s`) {
  return `${formatCount(count)} ${count === 1 ? noun : nouns}`;
}

/**
 * Bytes, exact up to 100,000.
 * @param {number} bytes
 */
export function formatBytes(bytes) {
  if (bytes < 1e5) return `${formatCount(bytes)}${THIN_SPACE}bytes`;
  if (bytes < 1e6) return `${formatNumber(bytes / 1e3)}${THIN_SPACE}kB`;
  return `${formatNumber(bytes / 1e6)}${THIN_SPACE}MB`;
}

/**
 * A length, in the largest unit of which it has one.
 * @param {number} metres
 * @param {string} units
 */
export function formatLength(metres, units) {
  if (!Number.isFinite(metres)) return "\u2013";
  if (units === "m" && Math.abs(metres) < 0.995) {
    return `${formatNumber(metres * 100)}${THIN_SPACE}cm`;
  }
  const [size, sign] = lengthUnit(metres, units);
  return `${formatNumber(metres / size)}${THIN_SPACE}${sign}`;
}

/**
 * The unit in which to write a length.
 * @param {number} metres
 * @param {string} units
 * @returns {[number, string]}
 */
export function lengthUnit(metres, units) {
  const { lengths } = UNITS[units];
  const large = lengths.filter(([size]) => Math.abs(metres) >= size * (size > 1 ? 0.9995 : 0));
  return large.length ? large[large.length - 1] : lengths[0];
}

/**
 * A speed, to hundredths of km/h, mph and knots, and to millimetres a second.
 * @param {number} speed metres a second
 * @param {string} units
 */
export function formatSpeed(speed, units) {
  const [size, sign] = UNITS[units].speed;
  const steps = size < 1 ? 100 : 1000;
  return `${formatNumber(Math.round((speed / size) * steps) / steps)}${THIN_SPACE}${sign}`;
}

/**
 * A duration: two parts at most, such as 2 d 4 h or 3 min 20 s.
 * @param {number} seconds
 */
export function formatDuration(seconds) {
  if (!Number.isFinite(seconds)) return "\u2013";
  if (Math.abs(seconds) < 59.95) return `${formatNumber(seconds)}${THIN_SPACE}s`;

  // Whole numbers of the two largest units.
  const rounded = Math.round(seconds);
  /** @type {[number, string, number, string][]} */
  const pairs = [
    [86400, "d", 3600, "h"],
    [3600, "h", 60, "min"],
    [60, "min", 1, "s"],
  ];
  for (const [large, sign, small, smallSign] of pairs) {
    if (rounded < large) continue;
    const count = Math.floor(rounded / large);
    const rest = Math.floor((rounded - count * large) / small);
    const text = `${formatCount(count)}${THIN_SPACE}${sign}`;
    return rest ? `${text} ${rest}${THIN_SPACE}${smallSign}` : text;
  }
  return `${rounded}${THIN_SPACE}s`;
}

/**
 * A latitude or longitude.
 * @param {number} degrees
 * @param {"lat" | "lon"} axis
 * @param {number} decimals
 */
export function formatDegrees(degrees, axis, decimals) {
  const letters = axis === "lat" ? "NS" : "EW";
  return `${Math.abs(degrees).toFixed(decimals)}\u00b0${THIN_SPACE}${letters[degrees < 0 ? 1 : 0]}`;
}

/**
 * Round numbers for an axis: the step 1, 2 or 5 times a power of ten that gives about this many.
 * @param {number} extent
 * @param {number} count
 */
export function niceStep(extent, count) {
  const rough = extent / Math.max(count, 1);
  const power = 10 ** Math.floor(Math.log10(rough || 1));
  const factor = [1, 2, 5, 10].find((each) => each * power >= rough * 0.999) ?? 10;
  return factor * power;
}
