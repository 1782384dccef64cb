/**
 * The panel: layers, colours and legends, the chosen track, largest errors, numbers.
 *
 * @typedef {import("./map.js").App} App
 */

import { TRACK_COLOURS, sceneColours } from "./colouring.js";
import { CATEGORIES, THEMES } from "./colours.js";
import { clockEpoch, clockShift, setClock } from "./clock.js";
import { fillSelect, find, findInput, make, makeJumps, makeTable, show } from "./dom.js";
import { areaAt } from "./follow.js";
import { formatBytes, formatCount, formatLength } from "./format.js";
import { LAYERS, sceneLayers } from "./layers.js";
import { measureRange, measureRows, trackRows } from "./measures.js";
import { describePlace } from "./place.js";
import { formatListed } from "./times.js";
import { positionAt } from "./walks.js";

/** CSS pixels for a metre at least when the map jumps to an error. */
const ERROR_PIXELS = 60;

/** Value of the select of tracks that stands for all: no number. */
const ALL_TRACKS = "all";

/**
 * Build the panel, and keep it up to date.
 * @param {App} app
 */
export function startPanel(app) {
  const { store } = app;
  buildLayers(app);
  buildTracks(app);
  buildColours(app);
  buildWorst(app);
  buildNumbers(app);
  store.on(["layers", "theme"], () => updateLayers(app));
  store.on(["track", "units", "aligned"], () => updateTrack(app));
  store.on(["colour", "hour", "days", "track", "units", "zone", "aligned", "theme"], () =>
    updateLegend(app),
  );
  store.on(["range", "track", "units", "zone", "aligned"], () => updateRangeFacts(app));
  store.on(["place", "units", "zone", "aligned"], () => updatePlace(app));
  store.on(["units", "zone", "aligned"], () => buildWorst(app));
  store.on(["units"], () => buildNumbers(app));
  find("here-close").addEventListener("click", () => store.set({ place: null }));
  updateLayers(app);
  updateTrack(app);
  updateLegend(app);
}

/** @param {App} app */
function buildLayers({ scene, store }) {
  for (const layer of sceneLayers(scene)) {
    const box = /** @type {HTMLInputElement} */ (
      make("input", { type: "checkbox", id: `layer-${layer.id}` })
    );
    box.addEventListener("change", () => {
      store.set({ layers: { ...store.state.layers, [layer.id]: box.checked } });
    });
    const swatch = document.createElementNS("http://www.w3.org/2000/svg", "svg");
    swatch.setAttribute("class", "swatch");
    swatch.setAttribute("viewBox", "0 0 18 10");
    swatch.setAttribute("aria-hidden", "true");
    swatch.dataset.layer = layer.id;
    const name = make("span", { class: "space" }, layer.label);
    find("layers").append(
      make("label", {}, box, swatch, name, make("kbd", { title: `Key ${layer.key}` }, layer.key)),
    );
  }
}

/** @param {App} app */
function updateLayers({ store }) {
  const { layers, theme } = store.state;
  for (const { id, sign, colour } of LAYERS) {
    const box = document.getElementById(`layer-${id}`);
    if (!box) continue;
    /** @type {HTMLInputElement} */ (box).checked = layers[id];
    const swatch = /** @type {SVGElement} */ (
      document.querySelector(`.swatch[data-layer="${id}"]`)
    );
    swatch.replaceChildren(...signShapes(sign, THEMES[theme][colour]));
  }
}

/**
 * Shapes of a layer's sign.
 * @param {string} sign
 * @param {string} colour
 */
function signShapes(sign, colour) {
  const shape = (/** @type {string} */ tag, /** @type {Record<string, string>} */ attributes) => {
    const element = document.createElementNS("http://www.w3.org/2000/svg", tag);
    for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
    return element;
  };
  if (sign === "dots")
    return ["2,7", "7,3", "12,6", "16,2"].map((at) =>
      shape("circle", { cx: at.split(",")[0], cy: at.split(",")[1], r: "1.5", fill: colour }),
    );
  if (sign === "ring")
    return [
      shape("circle", {
        cx: "9",
        cy: "5",
        r: "3.4",
        fill: "none",
        stroke: colour,
        "stroke-width": "1.6",
      }),
    ];
  if (sign === "none") return [];
  const dash = sign === "dash" ? "1.5 3.5" : "none";
  return [
    shape("path", {
      d: "M1 5h16",
      stroke: colour,
      "stroke-width": "3",
      "stroke-linecap": "round",
      "stroke-dasharray": dash,
    }),
  ];
}

/** @param {App} app */
function buildTracks(app) {
  const { ids } = app.scene.archives[0].tracks;
  const select = findInput("track");
  const all =
    ids.length === 1
      ? []
      : [/** @type {[string, string]} */ ([ALL_TRACKS, `All ${formatCount(ids.length)} tracks`])];
  fillSelect(
    select,
    [
      ...all,
      ...ids.map((id, i) => /** @type {[string, string]} */ ([String(i), id || "(no name)"])),
    ],
    ALL_TRACKS,
  );
  select.addEventListener("change", () => {
    app.store.set({ track: select.value === ALL_TRACKS ? null : ids[Number(select.value)] });
  });
  for (const id of ["previous", "next"]) show(find(id), ids.length > 1);
  find("previous").addEventListener("click", () => chooseNext(app, -1));
  find("next").addEventListener("click", () => chooseNext(app, 1));
}

/**
 * Choose the next track or the one before; before the first and after the last are all.
 * @param {App} app
 * @param {number} step 1 or -1
 */
export function chooseNext({ scene, store }, step) {
  const { ids, numbers } = scene.archives[0].tracks;
  if (ids.length < 2) return;
  const { track } = store.state;
  const number = track === null ? -1 : (numbers.get(track) ?? -1);
  const next = ((number + 1 + step + ids.length + 1) % (ids.length + 1)) - 1;
  store.set({ track: next < 0 ? null : ids[next] });
}

/** @param {App} app */
function updateTrack(app) {
  const { track } = app.store.state;
  const { archives } = app.scene;
  const number = track === null ? -1 : (archives[0].tracks.numbers.get(track) ?? -1);
  if (archives[0].tracks.ids.length > 1)
    findInput("track").value = number < 0 ? ALL_TRACKS : String(number);
  find("track-facts").replaceChildren(
    ...archives.map((archive) =>
      makeTable(trackRows(app, archive), archives.length > 1 ? archive.name : ""),
    ),
  );
}

/**
 * Numbers of the measured range.
 * @param {App} app
 */
function updateRangeFacts(app) {
  const { range } = app.store.state;
  const { archives } = app.scene;
  show(find("range-section"), range !== null);
  if (!range) return;
  find("range-facts").replaceChildren(
    ...archives.map((archive) => {
      const rows = measureRows(
        app,
        archive,
        measureRange(app, archive, range),
        range[1] - range[0],
      );
      return makeTable(rows, archives.length > 1 ? archive.name : "");
    }),
  );
}

/** @param {App} app */
function buildColours({ scene, store }) {
  const select = findInput("colour");
  fillSelect(select, sceneColours(scene), store.state.colour);
  select.addEventListener("change", () => {
    const { layers } = store.state;
    const hasRaw = layers.raw && scene.archives.some(({ raw }) => raw);
    const needsTracks = select.value in TRACK_COLOURS && !hasRaw;
    store.set({
      colour: select.value,
      layers: { ...layers, tracks: layers.tracks || needsTracks },
    });
  });
}

/** @param {App} app */
function updateLegend({ colouring }) {
  const { legend } = colouring;
  const element = find("legend");
  if (!legend) return element.replaceChildren();
  if (legend.items) {
    const list = make("ul", { class: "items", "aria-label": legend.title });
    for (const [colour, text] of legend.items) {
      const dot = make("span", { class: "dot" });
      dot.style.background = colour || "none";
      list.append(make("li", {}, dot, text));
    }
    return element.replaceChildren(list);
  }
  const labels = legend.labels ?? [];
  const ramp = make("div", {
    class: "ramp",
    role: "img",
    "aria-label": `${legend.title}: ${labels.join(", ")}`,
  });
  ramp.style.background = `linear-gradient(to right, ${(legend.ramp ?? []).join(", ")})`;
  element.replaceChildren(
    ramp,
    make("div", { class: "ramp-labels" }, ...labels.map((text) => make("span", {}, text))),
  );
}

/** @param {App} app */
function updatePlace(app) {
  const { place } = app.store.state;
  show(find("here"), place !== null);
  const elements = describePlace(app, (pass, archive) => {
    const track = archive.tracks.ids[pass.track];
    app.store.set({ track: archive.tracks.ids.length > 1 ? track : null });
    setClock(app, pass.time - clockShift(app, archive, pass.track));
  });
  find("here-facts").replaceChildren(...elements);
  if (place) find("here").scrollIntoView({ block: "nearest" });
}

/** @param {App} app */
function buildWorst(app) {
  const { units, zone } = app.store.state;
  const { archives } = app.scene;

  // Times of the clock, which may count from each track's start.
  const times = archives.map((archive, index) =>
    app.worst[index].map(({ time, track }) => time - clockShift(app, archive, track)),
  );
  const extent = /** @type {[number, number]} */ ([
    Math.min(...times.flat()),
    Math.max(...times.flat()),
  ]);

  const jumps = archives.flatMap((archive, index) =>
    app.worst[index].map((place, i) => {
      const name = archives.length > 1 ? `${archive.index ? "B" : "A"} ` : "";
      const time = formatListed(times[index][i], clockEpoch(app), zone, extent);
      return {
        cells: [`${name}${i + 1}`, formatLength(place.error, units), time],
        go: () => goToError(app, index, i),
      };
    }),
  );
  find("worst").replaceChildren(...makeJumps(jumps));
  show(find("worst-section"), jumps.length > 0);
}

/**
 * Show a worst place: on the map, on the chart and by the clock.
 * @param {App} app
 * @param {number} index of the archive
 * @param {number} number of the place
 */
function goToError(app, index, number) {
  const { store } = app;
  const archive = app.scene.archives[index];
  const place = app.worst[index][number];
  const position = positionAt(archive, place.track, place.time) ?? place;
  const scale = Math.max(ERROR_PIXELS / Math.max(place.error, 1e-3), store.state.view.scale);
  const area = areaAt(app, place.x);
  store.set({
    area,
    view: { x: (place.x + position.x) / 2, y: (place.y + position.y) / 2, scale },
    layers: { ...store.state.layers, errors: true, raw: true, tracks: true },
    track: archive.tracks.ids.length > 1 ? archive.tracks.ids[place.track] : null,
    playing: false,
  });
  setClock(app, place.time - clockShift(app, archive, place.track));
}

/** @param {App} app */
function buildNumbers({ scene, store }) {
  const { units } = store.state;
  const write = (/** @type {string | number} */ value) =>
    typeof value === "number" ? formatLength(value, units) : value;
  find("numbers").replaceChildren(
    ...scene.archives.map(({ facts, name }) =>
      makeTable(
        facts.map(([label, value]) => [label, write(value)]),
        scene.archives.length > 1 ? name : "",
      ),
    ),
  );
  find("generator").textContent = scene.generator;
}

/**
 * Bars of the bytes of each section, with their numbers as text.
 * @param {App} app
 */
export function buildBytes({ scene }) {
  find("bytes").replaceChildren(
    ...scene.archives.flatMap(({ name, sections, bytes }) => {
      const bar = make("div", { class: "bar", "aria-hidden": "true" });
      const list = make("ul", { class: "bar-items" });
      sections.forEach(([label, count], i) => {
        const piece = make("span", { title: `${label} ${formatBytes(count)}` });
        const dot = make("span", { class: "dot" });
        piece.style.background = dot.style.background = CATEGORIES[i % CATEGORIES.length];
        piece.style.flex = String(count);
        bar.append(piece);
        list.append(
          make("li", { class: "row" }, dot, label, make("strong", {}, formatBytes(count))),
        );
      });
      return [make("p", {}, make("strong", {}, formatBytes(bytes ?? 0)), ` ${name}`), bar, list];
    }),
  );
}
