/**
 * The page: it decodes the scene, builds the controls, and draws what changed.
 */

import { drawChart, drawChartOverlay } from "./chart.js";
import { listenToChart, showAllTimes } from "./chartgestures.js";
import { clockExtent, setClock, startClock } from "./clock.js";
import { colourScene } from "./colouring.js";
import { find, make, show } from "./dom.js";
import { findWorst } from "./errors.js";
import { centreOnAgent, fitArea, fitMap, fitTravel, showTrack } from "./follow.js";
import { listenToPane } from "./gestures.js";
import { formatPosition } from "./graticule.js";
import { ALL_HOURS } from "./history.js";
import { startHistory } from "./historypanel.js";
import { listenToKeys, toggleHelp } from "./keys.js";
import { initialLayers } from "./layers.js";
import { drawMap, makePane, resizePane } from "./map.js";
import { drawOverlay } from "./overlay.js";
import { buildBytes, startPanel } from "./panel.js";
import { decodeScene } from "./scene.js";
import { chartKinds } from "./series.js";
import { startSettings } from "./settings.js";
import { Store } from "./store.js";
import { initialTail, startTransport } from "./transport.js";
import { findAreas, zoomView } from "./viewport.js";

/** Zoom of a button. */
const BUTTON_ZOOM = 1.6;

/** @typedef {(keyof import("./store.js").State)[]} Keys */

/** What all canvases depend on. @type {Keys} */
const ALL_KEYS = ["track", "aligned", "theme", "size"];

/** What each canvas depends on. @type {Keys} */
const MAP_KEYS = [...ALL_KEYS, "view", "area", "layers", "colour", "hour", "days", "zone", "units"];
/** @type {Keys} */
const OVERLAY_KEYS = [...ALL_KEYS, "view", "time", "tail", "range", "hover", "pointer", "place"];
/** @type {Keys} */
const CHART_KEYS = [...ALL_KEYS, "chart", "domain", "units", "zone"];
/** @type {Keys} */
const CURSOR_KEYS = [...CHART_KEYS, "range", "time", "hover"];

/** Whether the system prefers dark colours. */
const DARK = window.matchMedia("(prefers-color-scheme: dark)");

/**
 * State of a page that was just opened.
 * @param {import("./scene.js").Scene} scene
 * @returns {import("./store.js").State}
 */
function initialState(scene) {
  return {
    view: { x: 0, y: 0, scale: 1 },
    area: 0,
    layers: initialLayers(scene),
    colour: "layer",
    hour: ALL_HOURS,
    days: "all",
    track: null,
    time: 0,
    playing: false,
    speed: "log/30",
    aligned: false,
    skip: true,
    follow: false,
    tail: 0,
    chart: chartKinds(scene)[0].id,
    domain: [0, 1],
    range: null,
    hover: null,
    pointer: null,
    place: null,
    units: scene.geographic ? "km" : "m",
    zone: scene.archives.find(({ history }) => history?.zone)?.history?.zone ?? "UTC",
    theme: DARK.matches ? "dark" : "light",
    size: 0,
  };
}

/**
 * Everything that the parts of the page share.
 * @param {import("./scene.js").Scene} scene
 * @returns {import("./map.js").App}
 */
function makeApp(scene) {
  const store = new Store(initialState(scene));
  const app = {
    scene,
    store,
    areas: findAreas(scene),
    colouring: colourScene(scene, store.state),
    worst: scene.archives.map(findWorst),
    panes: scene.archives.map((archive) => makePane(archive, addPane(scene, archive))),
  };
  const extent = clockExtent(app);
  store.set({ domain: extent, time: extent[0], tail: initialTail(app) });
  return app;
}

/**
 * Add the elements of a map to the page.
 * @param {import("./scene.js").Scene} scene
 * @param {import("./scene.js").Archive} archive
 */
function addPane(scene, archive) {
  const keys = "Drag or w, a, s, d move it, + and \u2212 zoom, Enter asks what is in the middle.";
  const label = `Map of ${archive.name}. ${keys}`;
  const element = make(
    "div",
    { class: "pane" },
    make("canvas"),
    make("canvas", { tabindex: "0", role: "img", "aria-label": label }),
  );
  if (scene.archives.length > 1)
    element.append(
      make("div", { class: "pane-name" }, `${archive.index ? "B" : "A"}  ${archive.name}`),
    );
  find("panes").append(element);
  return element;
}

/**
 * Change what follows from what the user changed.
 * @param {import("./map.js").App} app
 */
function deriveState(app) {
  const { store } = app;
  store.on(
    ["colour", "hour", "days", "track", "zone", "units", "aligned", "theme"],
    () => (app.colouring = colourScene(app.scene, store.state)),
  );
  store.on(["aligned"], () => setClock(app, clockExtent(app)[0]));
  store.on(["track", "aligned"], () => {
    store.set({ range: null });
    showAllTimes(app);
    setClock(app, store.state.time);
  });
  store.on(["track"], () => showTrack(app));
  store.on(["theme"], () => document.documentElement.setAttribute("data-theme", store.state.theme));
  store.on(["time", "track", "follow", "aligned"], () => {
    if (store.state.follow) centreOnAgent(app);
  });
}

/**
 * Draw the canvases again when what they show changes.
 * @param {import("./map.js").App} app
 * @param {import("./curves.js").Plot} plot
 */
function drawCanvases(app, plot) {
  const { store, panes } = app;
  store.on(MAP_KEYS, () => panes.forEach((pane) => drawMap(app, pane)));
  store.on(OVERLAY_KEYS, () => panes.forEach((pane) => drawOverlay(app, pane)));
  store.on(CHART_KEYS, () => drawChart(app, plot));
  store.on(CURSOR_KEYS, () => drawChartOverlay(app, plot));
  store.on(["pointer", "view"], () => {
    const { pointer, view, area } = store.state;
    find("position").textContent = pointer
      ? formatPosition(pointer.x, pointer.y, app.areas[area], view.scale)
      : "";
  });
}

/**
 * Keep the canvases as large as their elements.
 * @param {import("./map.js").App} app
 * @param {import("./curves.js").Plot} plot
 */
function watchSizes(app, plot) {
  const { store, panes } = app;
  const resize = () => {
    panes.forEach(resizePane);
    plot.ratio = panes[0].ratio;
    plot.width = Math.max(find("plot").clientWidth, 1);
    plot.height = Math.max(find("plot").clientHeight, 1);
    for (const canvas of [plot.canvas, plot.overlay]) {
      canvas.width = Math.round(plot.width * plot.ratio);
      canvas.height = Math.round(plot.height * plot.ratio);
    }
    store.set({ size: store.state.size + 1 });
  };
  const observer = new ResizeObserver(resize);
  for (const element of [...panes.map((pane) => pane.element), find("plot")])
    observer.observe(element);
  resize();
}

/**
 * Print in light colours, whatever the screen shows, and what lies above the map on the map itself:
 * browsers print canvases without what is seen through them.
 * @param {import("./map.js").App} app
 */
function listenToPrinter({ store, panes }) {
  /** @type {"light" | "dark"} */
  let onScreen = "light";
  window.addEventListener("beforeprint", () => {
    onScreen = store.state.theme;
    store.set({ theme: "light", size: store.state.size + 1 });
    store.flush();
    const shape = (panes[0].width * panes.length) / panes[0].height;
    document.documentElement.style.setProperty("--shape", String(shape));
    for (const above of document.querySelectorAll("canvas + canvas")) {
      const below = /** @type {HTMLCanvasElement} */ (above.previousElementSibling);
      const ctx = /** @type {CanvasRenderingContext2D} */ (below.getContext("2d"));
      ctx.setTransform(1, 0, 0, 1, 0, 0);
      ctx.drawImage(/** @type {HTMLCanvasElement} */ (above), 0, 0);
    }
  });
  window.addEventListener("afterprint", () => {
    store.set({ theme: onScreen, size: store.state.size + 1 });
  });
}

/**
 * Hide what a map without tracks has nothing for.
 * @param {import("./scene.js").Scene} scene
 */
function hideEmpty({ archives }) {
  const hasTracks = archives.some(({ tracks }) => tracks.ids.length);
  for (const id of ["timeline", "track-section", "find-section"]) show(find(id), hasTracks);
}

/**
 * Build the page.
 * @param {import("./scene.js").Scene} scene
 */
function startPage(scene) {
  const app = makeApp(scene);
  const { store } = app;
  const [canvas, overlay] = [...find("plot").querySelectorAll("canvas")];
  const plot = { canvas, overlay, width: 1, height: 1, ratio: 1 };
  const fit = () => fitMap(app);
  const switchTheme = () => store.set({ theme: store.state.theme === "dark" ? "light" : "dark" });

  // Listeners are called in this order: what follows from a change is known before it is drawn.
  document.documentElement.setAttribute("data-theme", store.state.theme);
  deriveState(app);
  drawCanvases(app, plot);
  startClock(app);
  startSettings(app, { fit: () => fitArea(app) });
  startTransport(app);
  startPanel(app);
  startHistory(app);
  buildBytes(app);
  hideEmpty(scene);
  watchSizes(app, plot);
  fit();
  fitTravel(app);

  // Mouse, touch, keys, printer.
  app.panes.forEach((pane) => {
    listenToPane(app, pane);
    for (const name of ["focus", "blur"])
      pane.overlay.addEventListener(name, () => drawOverlay(app, pane));
  });
  listenToChart(app, plot);
  listenToKeys(app, { fit, switchTheme });
  listenToPrinter(app);
  find("zoom-in").addEventListener("click", () =>
    store.set({ view: zoomView(store.state.view, BUTTON_ZOOM) }),
  );
  find("zoom-out").addEventListener("click", () =>
    store.set({ view: zoomView(store.state.view, 1 / BUTTON_ZOOM) }),
  );
  find("fit").addEventListener("click", fit);
  find("theme").addEventListener("click", switchTheme);
  for (const id of ["help-open", "help-close"]) find(id).addEventListener("click", toggleHelp);
  DARK.addEventListener("change", () => store.set({ theme: DARK.matches ? "dark" : "light" }));
  document.documentElement.dataset.ready = "true";
}

try {
  startPage(await decodeScene(JSON.parse(find("scene").textContent ?? "")));
} catch (error) {
  find("message").textContent =
    `This page can't be shown: ${error instanceof Error ? error.message : error}`;
  show(find("message"), true);
  throw error;
}
