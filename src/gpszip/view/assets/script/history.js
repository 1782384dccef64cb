/**
 * What a history tells: places, trips, the use of edges by hour, changes, unusual trips, rounds.
 *
 * @typedef {object} Span A part of a track.
 * @property {number} track
 * @property {number} start
 * @property {number} end
 *
 * @typedef {object} Place
 * @property {number} number from 1
 * @property {number} x
 * @property {number} y
 * @property {number} spread metres
 * @property {number} dwell seconds
 * @property {number} visits
 * @property {number} departures
 * @property {number} arrivals
 * @property {string} usual hours
 * @property {string} role home, work or none
 * @property {string} evidence
 *
 * @typedef {object} Usage Travel on each edge in each hour.
 * @property {boolean} weekdays whether slots are hours of a week, not of a day
 * @property {Float64Array} edge
 * @property {Float64Array} slot
 * @property {Float64Array} traversals
 * @property {Float64Array} metres
 * @property {Float64Array} seconds
 *
 * @typedef {{kind: string, edge: number, since: number, agents: number, factor: number | null}} Change
 * @typedef {Span & {x: number, y: number, score: number, reason: string}} Unusual
 *
 * @typedef {object} History
 * @property {string | null} zone whose hours are told
 * @property {Record<string, string>} notes why a part can't be told
 * @property {Place[] | null} places
 * @property {(Span & {place: number})[]} stays
 * @property {(Span & {length: number, origin: number, goal: number})[]} trips
 * @property {Usage | null} usage
 * @property {Change[] | null} changes
 * @property {Unusual[] | null} unusual
 * @property {{edges: number[], missed: number[], rows: (Span & {share: number, missed: number})[]}
 *   | null} rounds
 */

import { decodeBlock } from "./blocks.js";

/** Days of the week that can be chosen: their numbers from Monday. @type {[string, string][]} */
export const DAYS = [
  ["all", "All days"],
  ["01234", "Monday to Friday"],
  ["56", "Saturday, Sunday"],
  ["0", "Monday"],
  ["1", "Tuesday"],
  ["2", "Wednesday"],
  ["3", "Thursday"],
  ["4", "Friday"],
  ["5", "Saturday"],
  ["6", "Sunday"],
];

/** Hour that stands for all. */
export const ALL_HOURS = -1;

/**
 * Decode a history.
 * @param {any} data
 * @returns {Promise<History | null>}
 */
export async function decodeHistory(data) {
  if (!data) return null;
  const { places } = data;
  const [found, stays, trips] = await Promise.all(
    places ? [places, places.stays, places.trips].map(decodeRows) : [null, [], []],
  );
  return {
    ...data,
    places:
      found &&
      found.map((/** @type {any} */ row, /** @type {number} */ i) => ({
        ...row,
        number: i + 1,
        usual: places.usual[i],
        role: places.roles[i],
        evidence: places.evidence[i],
      })),
    stays,
    trips,
    usage: data.usage && { ...data.usage, ...(await decodeColumns(data.usage)) },
  };
}

/**
 * Columns of numbers among other values.
 * @param {any} data
 * @returns {Promise<Record<string, Float64Array>>}
 */
async function decodeColumns(data) {
  const names = Object.keys(data).filter((name) => data[name].type === "number");
  const columns = await Promise.all(names.map((name) => decodeBlock(data[name])));
  return Object.fromEntries(names.map((name, i) => [name, columns[i]]));
}

/**
 * Columns of numbers as rows.
 * @param {any} data
 * @returns {Promise<any[]>}
 */
async function decodeRows(data) {
  const columns = Object.entries(await decodeColumns(data));
  return Array.from({ length: columns[0][1].length }, (_, i) =>
    Object.fromEntries(columns.map(([name, values]) => [name, values[i]])),
  );
}

/**
 * Traversals, or mean speed, of each edge in the chosen hours.
 * @param {Usage} usage
 * @param {number} edges how many
 * @param {{colour: string, hour: number, days: string}} chosen
 * @returns {Float64Array} NaN where nobody travelled
 */
export function usageValues({ edge, slot, traversals, metres, seconds }, edges, chosen) {
  const { colour, hour, days } = chosen;
  const above = new Float64Array(edges);
  const below = new Float64Array(edges);
  const isSpeed = colour === "pace";
  for (let i = 0; i < edge.length; i++) {
    if (hour !== ALL_HOURS && slot[i] % 24 !== hour) continue;
    if (days !== "all" && !days.includes(String(Math.floor(slot[i] / 24)))) continue;
    above[edge[i]] += isSpeed ? metres[i] : traversals[i];
    below[edge[i]] += seconds[i];
  }
  return above.map((value, i) => {
    if (isSpeed) return below[i] > 0 ? value / below[i] : NaN;
    return value > 0 ? value : NaN;
  });
}

/** Most traversals of an edge in an hour, of each use and choice of days. @type {WeakMap<Usage, Map<string, number>>} */
const mostOf = new WeakMap();

/**
 * Most traversals of an edge in any hour: the end of a ramp that stays while the hour changes.
 * @param {Usage} usage
 * @param {number} edges
 * @param {string} days
 */
export function mostTraversals(usage, edges, days) {
  const known = mostOf.get(usage) ?? new Map();
  mostOf.set(usage, known);
  if (!known.has(days)) {
    let most = 0;
    for (let hour = 0; hour < 24; hour++) {
      for (const value of usageValues(usage, edges, { colour: "use", hour, days }))
        if (value > most) most = value;
    }
    known.set(days, most);
  }
  return known.get(days);
}
