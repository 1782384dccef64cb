/**
 * Times as text and back.
 *
 * The kind of a time axis: "unix" counts seconds since 1970 and has a calendar and a zone, "log"
 * counts from the log's own zero, null counts metres along a track without times.
 *
 * @typedef {"unix" | "log" | null} Epoch
 */

import { formatDuration, formatLength, niceStep } from "./format.js";

/** Steps of a time axis in seconds: seconds to weeks. */
const TIME_STEPS = [
  1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 10800, 21600, 43200, 86400, 172800,
  604800,
];

/** @type {Map<string, Intl.DateTimeFormat>} */
const formatters = new Map();

/**
 * Calendar and clock of a time, in a zone.
 * @param {number} time seconds since 1970
 * @param {string} zone IANA name
 * @returns {Record<"year" | "month" | "day" | "hour" | "minute" | "second", number>}
 */
export function calendar(time, zone) {
  let formatter = formatters.get(zone);
  if (!formatter) {
    formatter = new Intl.DateTimeFormat("en-GB", {
      timeZone: zone,
      hourCycle: "h23",
      year: "numeric",
      month: "numeric",
      day: "numeric",
      hour: "numeric",
      minute: "numeric",
      second: "numeric",
    });
    formatters.set(zone, formatter);
  }

  // A date that the calendar doesn't know is as good as its end.
  const milliseconds = Math.min(Math.max(Math.floor(time) * 1000, -8e15), 8e15);
  /** @type {Record<string, number>} */
  const parts = {};
  for (const { type, value } of formatter.formatToParts(milliseconds)) parts[type] = Number(value);
  return /** @type {any} */ (parts);
}

/**
 * Seconds by which a zone is ahead of UTC.
 * @param {number} time seconds since 1970
 * @param {string} zone IANA name
 */
export function zoneOffset(time, zone) {
  if (zone === "UTC") return 0;
  const { year, month, day, hour, minute, second } = calendar(time, zone);
  return Date.UTC(year, month - 1, day, hour, minute, second) / 1000 - Math.floor(time);
}

/**
 * A time, to the digits that a step needs.
 * @param {number} time
 * @param {Epoch} epoch
 * @param {string} zone IANA name
 * @param {number} step seconds that should be told apart
 * @param {"date" | "time" | "both"} [part] which part of a time since 1970
 */
export function formatTime(time, epoch, zone, step, part = "both") {
  if (epoch === null) return formatLength(time, "m");
  const decimals = Math.min(Math.max(Math.ceil(-Math.log10(step || 1) - 1e-9), 0), 3);
  const rounded = Math.round(time * 10 ** decimals) / 10 ** decimals;
  if (epoch === "log") return formatClock(rounded, decimals);

  // Year, month and day; hour and minute; seconds where they matter.
  const { year, month, day, hour, minute, second } = calendar(rounded, zone);
  const date = `${year}-${pad(month)}-${pad(day)}`;
  let clock = `${pad(hour)}:${pad(minute)}`;
  if (step < 60) clock += `:${pad(second)}`;
  if (decimals) clock += (rounded - Math.floor(rounded)).toFixed(decimals).slice(1);
  if (part === "date") return date;
  return part === "time" ? clock : `${date} ${clock}`;
}

/**
 * Seconds as h:mm:ss.
 * @param {number} time
 * @param {number} decimals
 */
function formatClock(time, decimals = 0) {
  const size = Math.abs(time);
  const hours = Math.floor(size / 3600);
  const minutes = Math.floor((size % 3600) / 60);
  const seconds = (size % 60).toFixed(decimals).padStart(decimals ? decimals + 3 : 2, "0");
  return `${time < 0 ? "\u2212" : ""}${hours}:${pad(minutes)}:${seconds}`;
}

/** @param {number} value */
function pad(value) {
  return String(value).padStart(2, "0");
}

/**
 * Read a time: 14:05, 14:05:10.5, 2024-05-03 14:05, a number of seconds, or of metres.
 * @param {string} text
 * @param {Epoch} epoch
 * @param {string} zone IANA name
 * @param {[number, number]} extent first and last time; a time without a date is looked for in it
 * @returns {number | null} null for what is no time
 */
export function parseTime(text, epoch, zone, extent) {
  const trimmed = text.trim().replace("T", " ");
  const match = /^(?:(\d{4})-(\d\d?)-(\d\d?)\s*)?(?:(\d+):(\d\d?)(?::(\d\d?(?:\.\d*)?))?)?$/.exec(
    trimmed,
  );
  if (!trimmed || !match)
    return trimmed && Number.isFinite(Number(trimmed)) ? Number(trimmed) : null;

  // Seconds of the day, or of the log.
  const [, year, month, day, hour = "0", minute = "0", second = "0"] = match;
  const clock = Number(hour) * 3600 + Number(minute) * 60 + Number(second);
  if (epoch !== "unix") return year ? null : clock;
  if (year)
    return toUtc(Date.UTC(Number(year), Number(month) - 1, Number(day)) / 1000 + clock, zone);

  // Without a date: the first day on which the log has this time.
  const local = extent[0] + zoneOffset(extent[0], zone);
  const midnight = Math.floor(local / 86400) * 86400;
  const first = toUtc(midnight + clock, zone);
  const next = toUtc(midnight + 86400 + clock, zone);
  return first < extent[0] && next <= extent[1] ? next : first;
}

/**
 * Seconds since 1970 of a zone's own clock.
 * @param {number} local what a clock in the zone shows, counted as if it were UTC
 * @param {string} zone IANA name
 */
function toUtc(local, zone) {
  const guess = local - zoneOffset(local, zone);
  return local - zoneOffset(guess, zone);
}

/**
 * Ticks of an axis of times.
 * @param {[number, number]} domain
 * @param {number} count about how many
 * @param {Epoch} epoch
 * @param {string} zone IANA name
 * @returns {{times: number[], step: number}}
 */
export function timeTicks(domain, count, epoch, zone) {
  const extent = domain[1] - domain[0];
  const rough = extent / Math.max(count, 1);
  const days = Math.max(Math.ceil(rough / 86400 / 7) * 7, 1) * 86400;
  let step = TIME_STEPS.find((each) => each >= rough) ?? days;
  if (epoch === null || rough < 1) step = niceStep(rough, 1);

  // Multiples of the step on the clock of the zone.
  const shift = epoch === "unix" ? zoneOffset(domain[0], zone) : 0;
  const times = [];
  const first = Math.ceil((domain[0] + shift) / step);
  for (let i = first; i * step - shift <= domain[1] && times.length < 1000; i++)
    times.push(i * step - shift);
  return { times, step };
}

/**
 * A time for a list: with its date only if the list covers more than a day.
 * @param {number} time
 * @param {Epoch} epoch
 * @param {string} zone IANA name
 * @param {[number, number]} extent first and last time of the list
 */
export function formatListed(time, epoch, zone, extent) {
  const isOneDay =
    formatTime(extent[0], epoch, zone, 1, "date") === formatTime(extent[1], epoch, zone, 1, "date");
  return formatTime(time, epoch, zone, 1, isOneDay ? "time" : "both");
}

/**
 * How long a time range is.
 * @param {number} extent
 * @param {Epoch} epoch
 * @param {string} units
 */
export function formatExtent(extent, epoch, units) {
  return epoch === null ? formatLength(extent, units) : formatDuration(extent);
}
