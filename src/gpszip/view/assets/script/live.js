/**
 * The live page of `gpszip listen`: it asks for the map, then listens, and draws what changed.
 */

import { colourScene } from "./colouring.js";
import { fillSelect, find, findInput, make, show } from "./dom.js";
import { Fleet } from "./fleet.js";
import { formatCount, formatCountOf } from "./format.js";
import { areaAt } from "./follow.js";
import { choosePlace, listenToPane } from "./gestures.js";
import { formatPosition } from "./graticule.js";
import { toggleHelp } from "./keys.js";
import { ALL_HOURS } from "./history.js";
import { initialLayers } from "./layers.js";
import { drawLive } from "./livedraw.js";
import { listenToLiveKeys } from "./livekeys.js";
import { LivePanel } from "./livepanel.js";
import { drawMap, makePane, resizePane } from "./map.js";
import { decodeScene } from "./scene.js";
import { startSettings } from "./settings.js";
import { Store } from "./store.js";
import { addressOf, listenToStream } from "./stream.js";
import { emptyBox, extend, findAreas, fitBox, seenBox, zoomView } from "./viewport.js";

/** Zoom of a button. */
const STEP_ZOOM = 1.6;

/** Milliseconds between two changes of lists and ages. */
const LIST_MILLISECONDS = 1000;

/** CSS pixels around a click in which an agent is chosen. */
const AGENT_PIXELS = 18;

/** Metres that are seen at least when the map moves to where agents are. */
const LEAST_METRES = 400;

/** Choices of the tail: seconds and text. @type {[string, string][]} */
const TAIL_CHOICES = [
  ["0", "none"],
  ["60", "1 min"],
  ["300", "5 min"],
  ["900", "15 min"],
];

/** Whether the system prefers dark colours. */
const PREFERS_DARK = window.matchMedia("(prefers-color-scheme: dark)");

/** @typedef {(keyof import("./store.js").State)[]} StateKeys */

/** What the map depends on. @type {StateKeys} */
const LAYER_KEYS = ["theme", "size", "view", "area", "layers", "units"];

/** What moves above it depends on. @type {StateKeys} */
const MOVING_KEYS = ["theme", "size", "view", "area", "time", "tail", "track", "place"];

/**
 * State of a page that was just opened.
 * @param {import("./scene.js").Scene} scene
 * @returns {import("./store.js").State}
 */
function liveState(scene) {
  return {
    view: { x: 0, y: 0, scale: 1 },
    area: 0,
    layers: initialLayers(scene),
    colour: "layer",
    track: null,
    time: 0,
    playing: false,
    speed: "",
    aligned: false,
    skip: false,
    follow: false,
    tail: 300,
    chart: "",
    domain: [0, 1],
    range: null,
    hover: null,
    pointer: null,
    place: null,
    units: scene.geographic || !scene.archives[0].clean.x.length ? "km" : "m",
    zone: "UTC",
    theme: PREFERS_DARK.matches ? "dark" : "light",
    size: 0,
    hour: ALL_HOURS,
    days: "all",
  };
}

/** The page. */
class LivePage {
  /** @param {import("./scene.js").Scene} scene */
  constructor(scene) {
    const store = new Store(liveState(scene));
    const [archive] = scene.archives;
    this.hasMap = archive.clean.x.length > 0 || archive.nodes.x.length > 0;
    const element = make(
      "div",
      { class: "pane" },
      make("canvas"),
      make("canvas", { tabindex: "0", role: "img", "aria-label": mapLabel(scene) }),
    );
    find("panes").append(element);
    this.pane = makePane(archive, element);
    this.app = {
      scene,
      store,
      areas: findAreas(scene),
      colouring: colourScene(scene, store.state),
      worst: [[]],
      panes: [this.pane],
    };
    this.store = store;
    this.fleet = new Fleet(this.app.areas, this.hasMap, scene.geographic);
    this.panel = new LivePanel(this.app, this.fleet, {
      chooseAgent: (name) => this.chooseAgent(name),
      showEvent: (event) => this.showEvent(event),
    });
    /** Place of the event that was clicked. @type {{x: number, y: number} | null} */
    this.mark = null;
    /** Whether the user moved the map: then it stays where it is. */
    this.isMoved = false;
    /** @type {Record<string, number>} */
    this.counts = {};
    this.known = 0;
  }

  /** Build the controls, draw, and listen. */
  start() {
    const { store } = this;
    document.documentElement.setAttribute("data-theme", store.state.theme);
    store.on(["theme"], () =>
      document.documentElement.setAttribute("data-theme", store.state.theme),
    );
    store.on(["place"], () => this.chooseNear());
    store.on(["follow", "time"], () => this.followAgent());
    store.on(["track", "units", "zone"], () => this.panel.refresh());
    store.on(LAYER_KEYS, () => drawMap(this.app, this.pane));
    store.on(MOVING_KEYS, () => drawLive(this.app, this.pane, this.fleet, this.mark));
    store.on(["pointer", "view"], () => this.showPointer());
    store.on(["follow"], () => (findInput("follow").checked = store.state.follow));
    startSettings(this.app, { fit: () => this.fit() });
    find("generator").textContent = this.app.scene.generator;
    this.listenToControls();
    new ResizeObserver(() => this.resize()).observe(this.pane.element);
    this.resize();
    this.fit();
    this.refresh();
    setInterval(() => this.refresh(), LIST_MILLISECONDS);
    this.connect();
  }

  /** Listen to mouse, keys and controls. */
  listenToControls() {
    const { store, app, pane } = this;
    const fit = () => this.fit();
    const switchTheme = () => store.set({ theme: store.state.theme === "dark" ? "light" : "dark" });
    listenToPane(app, pane);
    for (const name of ["pointerdown", "wheel", "keydown"])
      pane.overlay.addEventListener(name, () => (this.isMoved = true), { passive: true });
    for (const name of ["focus", "blur"])
      pane.overlay.addEventListener(name, () => store.set({ size: store.state.size + 1 }));
    listenToLiveKeys(app, {
      fit,
      switchTheme,
      clear: () => this.clear(),
      next: (sign) => this.chooseNext(sign),
      chooseMiddle: () => choosePlace(app, { x: 0, y: 0 }),
    });
    const zoom = (/** @type {number} */ factor) => {
      this.isMoved = true;
      store.set({ view: zoomView(store.state.view, factor) });
    };
    find("zoom-in").addEventListener("click", () => zoom(STEP_ZOOM));
    find("zoom-out").addEventListener("click", () => zoom(1 / STEP_ZOOM));
    find("fit").addEventListener("click", fit);
    find("theme").addEventListener("click", switchTheme);
    find("here-close").addEventListener("click", () => this.clear());
    for (const id of ["help-open", "help-close"]) find(id).addEventListener("click", toggleHelp);
    find("follow").addEventListener("change", () =>
      store.set({ follow: findInput("follow").checked }),
    );
    fillSelect(find("tail"), TAIL_CHOICES, String(store.state.tail));
    find("tail").addEventListener("change", () =>
      store.set({ tail: Number(findInput("tail").value) }),
    );
    PREFERS_DARK.addEventListener("change", () =>
      store.set({ theme: PREFERS_DARK.matches ? "dark" : "light" }),
    );
  }

  /** Listen to the server. */
  connect() {
    const { fleet, panel } = this;
    const listeners = {
      hello: (/** @type {{tail: number}} */ { tail }) => (fleet.tailSeconds = tail),
      tails: (/** @type {any[][]} */ rows) => fleet.follow(rows),
      agents: (/** @type {import("./fleet.js").AgentRow[]} */ rows) => this.move(rows),
      outlooks: (/** @type {import("./fleet.js").LiveEvent[]} */ events) =>
        events.forEach((event) => fleet.foresee(event)),
      events: (/** @type {import("./fleet.js").LiveEvent[]} */ events) => panel.takeEvents(events),
      state: (
        /** @type {{now: number, agents: number, counts: Record<string, number>}} */ state,
      ) => {
        fleet.ahead = state.now - Date.now() / 1000;
        this.counts = state.counts;
        this.known = state.agents;
      },
    };
    listenToStream(listeners, (state) => this.showConnection(state));
  }

  /** @param {import("./fleet.js").AgentRow[]} rows */
  move(rows) {
    const hadNone = !this.fleet.agents.size;
    this.fleet.move(rows);
    this.store.set({ time: this.store.state.time + 1 });
    if (hadNone) this.refresh();
    if (!this.isMoved && !this.hasMap && this.isAnyBeside()) this.fit();
  }

  /** @param {import("./stream.js").Connection} state */
  showConnection(state) {
    const output = find("connection");
    if (output.dataset.state === state) return;
    output.dataset.state = state;
    output.textContent = {
      connecting: "Connecting",
      live: "Live",
      lost: "Connection lost, trying again",
    }[state];
  }

  /** Show what changes with time. */
  refresh() {
    const { fleet } = this;
    const quiet = [...fleet.agents.values()].filter((agent) => fleet.isQuiet(agent)).length;
    const count = Math.max(fleet.agents.size, this.known);
    const rest = quiet ? `, ${formatCount(quiet)} not heard of for 2\u202fmin` : "";
    find("summary").textContent = count ? formatCountOf(count, "agent") + rest : "No agent yet";
    document.title = count
      ? `${formatCountOf(count, "agent")} \u2013 ${this.app.scene.title}`
      : this.app.scene.title;
    find("note").textContent = fleet.isUnlike
      ? `Positions are in ${fleet.geographic ? "metres" : "degrees"}, the map is not: they are listed only.`
      : "";
    show(find("note"), fleet.isUnlike);
    this.panel.refresh();
    this.panel.showSources(this.counts);
    this.store.set({ time: this.store.state.time + 1 });
  }

  /** Keep the canvases as large as their element. */
  resize() {
    resizePane(this.pane);
    this.store.set({ size: this.store.state.size + 1 });
  }

  /** Show all of the map and of the agents. */
  fit() {
    const { area } = this.store.state;
    const { areas } = this.app;
    const box = this.hasMap ? { ...areas[area].box } : emptyBox();
    for (const { at } of this.fleet.agents.values()) {
      if (Number.isFinite(at.x) && areaAt(this.app, at.x) === area) extend(box, at.x, at.y);
    }
    this.isMoved = false;
    if (box.minX > box.maxX) return;
    const margin = this.hasMap ? 0 : LEAST_METRES / 2;
    const wide = {
      minX: box.minX - margin,
      minY: box.minY - margin,
      maxX: box.maxX + margin,
      maxY: box.maxY + margin,
    };
    this.store.set({ view: fitBox(wide, this.pane.width, this.pane.height), follow: false });
  }

  /** Whether an agent is beside what is seen. */
  isAnyBeside() {
    const seen = seenBox(this.store.state.view, this.pane.width, this.pane.height);
    return [...this.fleet.agents.values()].some(
      ({ at: { x, y } }) => x < seen.minX || x > seen.maxX || y < seen.minY || y > seen.maxY,
    );
  }

  /**
   * Choose an agent, and show where it is.
   * @param {string} name
   */
  chooseAgent(name) {
    const agent = this.fleet.agents.get(name);
    if (!agent) return;
    if (!Number.isFinite(agent.at.x)) this.fleet.recentre(agent.at);
    this.isMoved = true;
    this.mark = null;
    this.store.set({ track: name });
    this.showPlace(agent.at);
  }

  /** @param {import("./fleet.js").LiveEvent} event */
  showEvent(event) {
    const place = this.fleet.placeOf(event);
    this.isMoved = true;
    this.mark = place;
    const { agents } = this.fleet;
    this.store.set({ track: agents.has(event.agent) ? event.agent : null, follow: false });
    if (place) this.showPlace(place);
    this.store.set({ time: this.store.state.time + 1 });
  }

  /** @param {{x: number, y: number}} place */
  showPlace({ x, y }) {
    if (!Number.isFinite(x)) return;
    this.store.set({ view: { ...this.store.state.view, x, y }, area: areaAt(this.app, x) });
  }

  /** Choose the agent that is nearest to where the user clicked. */
  chooseNear() {
    const { place, view } = this.store.state;
    if (!place) return;
    let [best, least] = [/** @type {string | null} */ (null), AGENT_PIXELS / view.scale];
    for (const { name, at } of this.fleet.agents.values()) {
      const apart = Math.hypot(at.x - place.x, at.y - place.y);
      if (apart < least) [best, least] = [name, apart];
    }
    this.mark = null;
    this.store.set({ track: best, place: null, follow: best !== null && this.store.state.follow });
  }

  /** @param {number} sign 1 for the next agent of the list, -1 for the one before */
  chooseNext(sign) {
    const names = [...this.panel.rows.keys()];
    if (!names.length) return;
    const { track } = this.store.state;
    const before = track === null ? (sign > 0 ? -1 : 0) : names.indexOf(track);
    this.chooseAgent(names[(before + sign + names.length) % names.length]);
  }

  /** Keep the chosen agent in the middle. */
  followAgent() {
    const { follow, track } = this.store.state;
    const agent = follow && track !== null ? this.fleet.agents.get(track) : undefined;
    if (agent) this.showPlace(agent.at);
  }

  /** Choose nothing. */
  clear() {
    this.mark = null;
    this.store.set({ track: null, follow: false, time: this.store.state.time + 1 });
  }

  /** Show the position under the pointer. */
  showPointer() {
    const { pointer, view, area } = this.store.state;
    const place = this.app.areas[area];
    const isKnown = pointer && (this.fleet.agents.size || this.hasMap);
    find("position").textContent = isKnown
      ? formatPosition(pointer.x, pointer.y, place, view.scale)
      : "";
  }
}

/** @param {import("./scene.js").Scene} scene */
function mapLabel({ title }) {
  const keys = "Drag or w, a, s, d move it, + and \u2212 zoom, n and p choose agents.";
  return `Map of ${title}. ${keys}`;
}

try {
  const answer = await fetch(addressOf("scene"));
  if (!answer.ok) throw new Error(`the map is not there (${answer.status})`);
  const scene = await decodeScene(await answer.json());
  new LivePage({ ...scene, epoch: "unix" }).start();
  document.documentElement.dataset.ready = "true";
} catch (error) {
  find("message").textContent =
    `This page can't be shown: ${error instanceof Error ? error.message : error}`;
  show(find("message"), true);
  throw error;
}
