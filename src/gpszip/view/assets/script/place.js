/**
 * What is at a place: its position, the edge under it, and everything that passes.
 *
 * @typedef {import("./map.js").App} App
 * @typedef {import("./walks.js").Pass} Pass
 */

import { clockEpoch, clockExtent, clockShift } from "./clock.js";
import { make, makeJumps, makeTable } from "./dom.js";
import { jumpToSpan } from "./follow.js";
import { formatCount, formatCountOf, formatDuration, formatLength, formatSpeed } from "./format.js";
import { formatPosition } from "./graticule.js";
import { lineLength } from "./lines.js";
import { calendar, formatListed } from "./times.js";
import { findPasses, toSegment } from "./walks.js";

/** Passes that are listed. */
const MAX_LISTED = 200;

/** Places of a history that are described at most. */
const MAX_PLACES = 3;

/** Hours of a day. */
const HOURS = 24;

/** Heights of the bars of hours in per cent. */
const FULL_BAR = 100;

/** Headings to eight winds, from the east counterclockwise. */
const ARROWS = ["\u2192", "\u2197", "\u2191", "\u2196", "\u2190", "\u2199", "\u2193", "\u2198"];

/**
 * Elements that describe the chosen place.
 * @param {App} app
 * @param {(pass: Pass, archive: import("./scene.js").Archive) => void} visit shows a pass
 * @returns {HTMLElement[]}
 */
export function describePlace(app, visit) {
  const { place, view, area } = app.store.state;
  if (!place) return [];
  const elements = [
    make("p", { class: "hint" }, formatPosition(place.x, place.y, app.areas[area], view.scale)),
  ];
  for (const archive of app.scene.archives) {
    const name = app.scene.archives.length > 1 ? archive.name : "";
    const edge = nearestEdge(archive.clean, place);
    if (archive.history) elements.push(...describeHistory(app, archive, archive.history, place));
    if (edge >= 0)
      elements.push(
        makeTable(edgeRows(app, archive, edge), `${name} Edge ${edge} of the clean map`.trim()),
      );
    const chosen = place.track === null ? undefined : archive.tracks.numbers.get(place.track);
    const passes = findPasses(archive, place, chosen);
    const timeOf = (/** @type {Pass} */ pass) => pass.time - clockShift(app, archive, pass.track);
    passes.sort((a, b) => timeOf(a) - timeOf(b));
    elements.push(...describePasses(app, archive, passes, visit));
  }
  return elements;
}

/**
 * Tables of the places of a history at a position: what is known of each, and why.
 * @param {App} app
 * @param {import("./scene.js").Archive} archive
 * @param {import("./history.js").History} history
 * @param {{x: number, y: number, radius: number}} at
 * @returns {HTMLElement[]}
 */
function describeHistory(app, archive, { places, stays }, at) {
  const { zone } = app.store.state;
  const near = (places ?? []).filter(({ x, y, spread }) => {
    return Math.hypot(x - at.x, y - at.y) <= at.radius + spread;
  });
  return near.slice(0, MAX_PLACES).flatMap((place) => {
    const own = stays.filter((stay) => stay.place === place.number);
    /** @type {[string, string][]} */
    const rows = [
      ["Visits", formatCount(place.visits)],
      ["Time spent", formatDuration(place.dwell)],
      ["Usual hours", place.usual && `${place.usual} h`],
      ["Perhaps", place.role],
      ["Evidence", place.evidence],
      ["Trips to, from", `${formatCount(place.arrivals)}, ${formatCount(place.departures)}`],
    ];
    const known = rows.filter(([, text]) => text);
    const jumps = own.slice(0, MAX_LISTED).map((stay) => {
      const shift = clockShift(app, archive, stay.track);
      const when = formatListed(stay.start - shift, clockEpoch(app), zone, clockExtent(app));
      const name = archive.tracks.ids.length > 1 ? archive.tracks.ids[stay.track] : "";
      const go = () => jumpToSpan(app, archive, stay);
      return { cells: [when, name, formatDuration(stay.end - stay.start)], go };
    });
    return [
      makeTable(known, `Place ${place.number}`),
      make("ul", { class: "jumps passes" }, ...makeJumps(jumps)),
    ];
  });
}

/**
 * Number of the edge nearest to a place, within its radius; -1 if there is none.
 * @param {import("./scene.js").Edges} edges
 * @param {{x: number, y: number, radius: number}} place
 */
function nearestEdge(edges, { x, y, radius }) {
  let [best, nearest] = [-1, radius];
  for (let k = 1; k < edges.x.length; k++) {
    if (!edges.joined[k]) continue;
    const { distance } = toSegment(edges, k, x, y);
    if (distance <= nearest) [best, nearest] = [edges.line[k], distance];
  }
  return best;
}

/**
 * @param {App} app
 * @param {import("./scene.js").Archive} archive
 * @param {number} edge
 * @returns {[string, string][]}
 */
function edgeRows(app, archive, edge) {
  const { clean } = archive;
  const start = clean.offsets[edge];
  const end = clean.offsets[edge + 1] - 1;
  const heading = Math.atan2(clean.y[end] - clean.y[start], clean.x[end] - clean.x[start]);
  return [
    ["Length", formatLength(lineLength(clean, edge), app.store.state.units)],
    [`Traversals ${arrow(heading)}`, formatCount(clean.forward[edge])],
    [`Traversals ${arrow(heading + Math.PI)}`, formatCount(clean.backward[edge])],
  ];
}

/**
 * Arrow of a heading; none while parked.
 * @param {number} heading radians, counterclockwise from the east, or NaN
 */
function arrow(heading) {
  if (Number.isNaN(heading)) return "";
  return ARROWS[((Math.round(heading / (Math.PI / 4)) % 8) + 8) % 8];
}

/**
 * All passes, and their speeds by hour.
 * @param {App} app
 * @param {import("./scene.js").Archive} archive
 * @param {Pass[]} passes
 * @param {(pass: Pass, archive: import("./scene.js").Archive) => void} visit
 * @returns {HTMLElement[]}
 */
function describePasses(app, archive, passes, visit) {
  if (!passes.length) return [make("p", { class: "hint" }, "No track passes here.")];
  const { zone, units, place } = app.store.state;
  const { epoch } = app.scene;
  const hasNames = archive.tracks.ids.length > 1 && place?.track === null;
  const tracks = new Set(passes.map(({ track }) => track)).size;
  const count = formatCountOf(passes.length, "pass", "passes");
  const of = tracks > 1 ? ` of ${formatCount(tracks)} tracks` : "";
  const elements = [make("p", {}, make("strong", {}, count), of)];
  if (epoch === "unix") elements.push(...speedsByHour(passes, zone, units));

  // One button for each pass, which goes there.
  const jumps = passes.slice(0, MAX_LISTED).map((pass) => {
    const shift = clockShift(app, archive, pass.track);
    const time = formatListed(pass.time - shift, clockEpoch(app), zone, clockExtent(app));
    const name = hasNames ? archive.tracks.ids[pass.track] : "";
    const speed = Number.isNaN(pass.speed) ? "" : formatSpeed(pass.speed, units);
    return {
      cells: [time, name, `${arrow(pass.heading)} ${speed}`],
      go: () => visit(pass, archive),
    };
  });
  elements.push(make("ul", { class: "jumps passes" }, ...makeJumps(jumps)));
  if (passes.length > MAX_LISTED) {
    elements.push(
      make("p", { class: "hint" }, `and ${formatCount(passes.length - MAX_LISTED)} more`),
    );
  }
  return elements;
}

/**
 * Bars of the mean speed in each hour of the day; the numbers are in their labels.
 * @param {Pass[]} passes
 * @param {string} zone
 * @param {string} units
 * @returns {HTMLElement[]}
 */
function speedsByHour(passes, zone, units) {
  const sums = new Float64Array(HOURS);
  const counts = new Uint32Array(HOURS);
  for (const { time, speed } of passes) {
    if (Number.isNaN(speed)) continue;
    const { hour } = calendar(time, zone);
    sums[hour] += speed;
    counts[hour]++;
  }
  const means = sums.map((sum, hour) => (counts[hour] ? sum / counts[hour] : 0));
  const most = Math.max(...means);
  if (counts.filter((count) => count).length < 2 || !most) return [];

  // A picture for eyes, a text for others.
  const texts = [...means].flatMap((mean, hour) =>
    counts[hour]
      ? [`${hour}:00 ${formatSpeed(mean, units)}, ${formatCountOf(counts[hour], "pass", "passes")}`]
      : [],
  );
  const bars = make("div", {
    class: "hours",
    role: "img",
    "aria-label": `Mean speed by hour: ${texts.join("; ")}`,
  });
  means.forEach((mean, hour) => {
    const bar = make("span", {
      title: counts[hour] ? `${hour}:00  ${formatSpeed(mean, units)}` : `${hour}:00`,
    });
    bar.style.height = `${(mean / most) * FULL_BAR}%`;
    bars.append(bar);
  });
  const labels = ["0:00", "6:00", "12:00", "18:00", "24:00"].map((text) => make("span", {}, text));
  const title = make(
    "p",
    { class: "hint" },
    `Mean speed by hour, up to ${formatSpeed(most, units)}`,
  );
  return [title, bars, make("div", { class: "hour-labels" }, ...labels)];
}
