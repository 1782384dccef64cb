/**
 * Lists of a history in the panel, each row with a jump, and the choice of hours.
 *
 * @typedef {import("./map.js").App} App
 * @typedef {import("./scene.js").Archive} Archive
 * @typedef {import("./history.js").History} History
 * @typedef {import("./dom.js").Jump} Jump
 */

import { clockEpoch, clockExtent, clockShift } from "./clock.js";
import { fillSelect, find, findInput, make, makeJumps, show } from "./dom.js";
import { jumpToPlace, jumpToSpan } from "./follow.js";
import { formatCount, formatCountOf, formatDuration, formatLength } from "./format.js";
import { ALL_HOURS, DAYS } from "./history.js";
import { changeColour, edgeMiddle, placeName } from "./historymap.js";
import { lineLength } from "./lines.js";
import { formatListed } from "./times.js";

/** Rows of a list at most. */
const MAX_ROWS = 300;

/** Metres around a place that its jump shows at least. */
const PLACE_RADIUS = 60;

/** Lists: the layer of each and its label, how many rows it has, and how to make them. */
const LISTS = {
  places: {
    label: "Places",
    rows: (/** @type {History} */ { places }) => places ?? [],
    make: placeRow,
  },
  trips: { label: "Trips", rows: (/** @type {History} */ { trips }) => trips, make: tripRow },
  changes: {
    label: "Changes",
    rows: (/** @type {History} */ { changes }) => changes ?? [],
    make: changeRow,
  },
  unusual: {
    label: "Unusual trips",
    rows: (/** @type {History} */ { unusual }) => unusual ?? [],
    make: unusualRow,
  },
  rounds: {
    label: "Rounds",
    rows: (/** @type {History} */ { rounds }) => rounds?.rows ?? [],
    make: roundRow,
  },
};

/**
 * Build the lists and the choice of hours, and keep them up to date.
 * @param {App} app
 */
export function startHistory(app) {
  const { scene, store } = app;
  const histories = scene.archives.flatMap(({ history }) => (history ? [history] : []));
  show(find("history-section"), histories.length > 0);
  startHours(app);
  if (!histories.length) return;

  // The lists that have rows, and why others have none.
  const counts = Object.entries(LISTS).map(([id, { label, rows }]) => {
    const count = histories.reduce((sum, history) => sum + rows(history).length, 0);
    return { id, label, count };
  });
  const listed = counts.filter(({ count }) => count);
  fillSelect(
    find("history-list"),
    listed.map(({ id, label, count }) => [id, `${label} (${formatCount(count)})`]),
    listed[0]?.id ?? "",
  );
  show(find("history-list"), listed.length > 0);
  const notes = histories.flatMap((history) =>
    Object.entries(history.notes).map(([part, text]) => {
      const label = LISTS[/** @type {keyof typeof LISTS} */ (part)]?.label ?? part;
      return `No ${label.toLowerCase()}: ${text}.`;
    }),
  );
  find("history-notes").textContent = [...new Set(notes)].join(" ");

  // A list that is chosen is shown on the map, too; of trips, the one that is jumped to.
  const update = () => buildRows(app);
  findInput("history-list").addEventListener("change", () => {
    const id = findInput("history-list").value;
    if (id !== "trips") store.set({ layers: { ...store.state.layers, [id]: true } });
    update();
  });
  store.on(["track", "units", "zone", "aligned"], update);
  update();
}

/** @param {App} app */
function buildRows(app) {
  const { archives } = app.scene;
  const list = LISTS[/** @type {keyof typeof LISTS} */ (findInput("history-list").value)];
  if (!list) return;
  const chosen = app.store.state.track;
  const jumps = archives.flatMap((archive) => {
    if (!archive.history) return [];
    const { ids } = archive.tracks;
    const numbered = list.rows(archive.history).map((row, i) => ({ row, i }));
    const own = numbered.filter(
      ({ row }) => chosen === null || !("track" in row) || ids[row.track] === chosen,
    );
    const sign = archives.length > 1 ? `${archive.index ? "B" : "A"} ` : "";
    return own.slice(0, MAX_ROWS).map(({ row, i }) => {
      const jump = list.make(app, archive, /** @type {never} */ (row), i);
      return { ...jump, cells: [`${sign}${jump.cells[0]}`, ...jump.cells.slice(1)] };
    });
  });
  const total = archives.reduce(
    (sum, { history }) => sum + (history ? list.rows(history).length : 0),
    0,
  );
  const rest = chosen === null ? total - jumps.length : 0;
  find("history-rows").replaceChildren(...makeJumps(jumps));
  if (rest > 0) {
    find("history-rows").append(make("li", { class: "hint" }, `and ${formatCount(rest)} more`));
  }
}

/**
 * When a part of a track begins, as a list says it.
 * @param {App} app
 * @param {Archive} archive
 * @param {import("./history.js").Span} span
 */
function whenOf(app, archive, { track, start }) {
  const time = start - clockShift(app, archive, track);
  return formatListed(time, clockEpoch(app), app.store.state.zone, clockExtent(app));
}

/**
 * @param {App} app
 * @param {Archive} _archive
 * @param {import("./history.js").Place} place
 * @returns {Jump}
 */
function placeRow(app, _archive, place) {
  const { visits, dwell, usual, evidence, spread } = place;
  return {
    cells: [placeName(place), formatCountOf(visits, "visit"), formatDuration(dwell)],
    title: [usual && `usually ${usual} h`, evidence].filter(Boolean).join("; "),
    go: () => jumpToPlace(app, place, Math.max(2 * spread, PLACE_RADIUS)),
  };
}

/**
 * @param {App} app
 * @param {Archive} archive
 * @param {import("./history.js").Span & {length: number, origin: number, goal: number}} trip
 * @returns {Jump}
 */
function tripRow(app, archive, trip) {
  const { origin, goal, length, start, end } = trip;
  const way = `${origin} \u2192 ${goal}, ${formatLength(length, app.store.state.units)}`;
  return {
    cells: [whenOf(app, archive, trip), way, formatDuration(end - start)],
    title: archive.tracks.ids[trip.track],
    go: () => jumpToSpan(app, archive, trip),
  };
}

/**
 * @param {App} app
 * @param {Archive} archive
 * @param {import("./history.js").Change} change
 * @param {number} number
 * @returns {Jump}
 */
function changeRow(app, archive, change, number) {
  const { kind, edge, since, agents, factor } = change;
  const { zone } = app.store.state;
  const when = formatListed(since, app.scene.epoch, zone, clockExtent(app));
  const much = factor === null ? "" : ` \u00d7${factor}`;
  return {
    cells: [`${number + 1}`, `${kind}${much}`, when],
    colour: changeColour(kind),
    title: `edge ${edge}, ${formatCountOf(agents, "observation")}`,
    go: () => {
      const radius = Math.max(lineLength(archive.clean, edge) / 2, PLACE_RADIUS);
      jumpToPlace(app, edgeMiddle(archive, edge), radius);
    },
  };
}

/**
 * @param {App} app
 * @param {Archive} archive
 * @param {import("./history.js").Unusual} part
 * @param {number} number
 * @returns {Jump}
 */
function unusualRow(app, archive, part, number) {
  return {
    cells: [`${number + 1}`, part.reason, `${formatCount(part.score)} bits`],
    title: `${archive.tracks.ids[part.track]}, ${whenOf(app, archive, part)}`,
    go: () => jumpToSpan(app, archive, part),
  };
}

/**
 * @param {App} app
 * @param {Archive} archive
 * @param {import("./history.js").Span & {share: number, missed: number}} round
 * @returns {Jump}
 */
function roundRow(app, archive, round) {
  const { share, missed, start, end } = round;
  const what = missed ? `misses ${formatCountOf(missed, "edge")}` : "complete";
  const duration = Number.isFinite(end - start) ? `, ${formatDuration(end - start)}` : "";
  return {
    cells: [whenOf(app, archive, round), `${what}${duration}`, `${Math.round(100 * share)} %`],
    title: archive.tracks.ids[round.track],
    go: () => jumpToSpan(app, archive, round),
  };
}

/** @param {App} app */
function startHours({ scene, store }) {
  const usage = scene.archives.map(({ history }) => history?.usage).filter((each) => each);
  const hasDays = usage.every((each) => each?.weekdays);
  fillSelect(find("days"), DAYS, "all");
  show(find("days-label"), hasDays);
  find("days").addEventListener("change", () => store.set({ days: findInput("days").value }));
  find("hour").addEventListener("input", () =>
    store.set({ hour: Number(findInput("hour").value) }),
  );
  const update = () => {
    const { colour, hour } = store.state;
    show(find("hours"), colour === "use" || colour === "pace");
    const zone = scene.archives[0].history?.zone;
    find("hour-text").textContent =
      hour === ALL_HOURS ? "all hours" : `${hour}\u2013${hour + 1} h${zone ? ` ${zone}` : ""}`;
  };
  store.on(["colour", "hour"], update);
  update();
}
