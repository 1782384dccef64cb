/**
 * Keys: everything that the mouse can do.
 *
 * @typedef {import("./map.js").App} App
 */

import { setRangeEnd, showAllTimes, zoomToRange } from "./chartgestures.js";
import { clockExtent, clockStep, setClock, togglePlay } from "./clock.js";
import { find, make } from "./dom.js";
import { choosePlace } from "./gestures.js";
import { sceneLayers } from "./layers.js";
import { chooseNext } from "./panel.js";
import { panView, zoomView } from "./viewport.js";

/** Steps of the clock with shift. */
const LARGE_STEP = 10;

/** Zoom of a key, and CSS pixels by which a key moves the map. */
const KEY_ZOOM = 1.5;
const KEY_PIXELS = 80;

/** What the help lists. */
const KEYS = [
  ["space", "Play or pause"],
  ["\u2190 \u2192", "Step back or forward"],
  ["shift \u2190 \u2192", "Ten steps"],
  ["home end", "First or last time"],
  ["+ \u2212", "Zoom the map"],
  ["0", "Show everything"],
  ["w a s d", "Move the map"],
  ["enter", "What is in the middle of the map"],
  ["f", "Follow the agent"],
  ["n p", "Next or previous track"],
  ["[ ]", "Start or end of the range at the clock"],
  ["z x", "Chart of the range, whole chart"],
  ["m", "Light or dark"],
  ["esc", "Clear the range and the place"],
  ["?", "This help"],
];

/**
 * Listen to keys.
 * @param {App} app
 * @param {{fit: () => void, switchTheme: () => void}} actions
 */
export function listenToKeys(app, actions) {
  const commands = makeCommands(app, actions);
  freeFocus();
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || isTyping(event)) return;
    const command = commands.get(event.key.length === 1 ? event.key.toLowerCase() : event.key);
    if (!command || command(event) === false) return;
    event.preventDefault();
  });

  // The help lists the layers, too.
  const { scene } = app;
  const layers = sceneLayers(scene).map(({ key, label }) => [key, label]);
  for (const [key, text] of [...KEYS, ...layers]) {
    find("keys").append(
      make("dt", {}, ...key.split(" ").map((each) => make("kbd", {}, each))),
      make("dd", {}, text),
    );
  }
}

/**
 * Whether a key belongs to the control that has the focus.
 * @param {KeyboardEvent} event
 */
export function isTyping({ target, key }) {
  if (!(target instanceof HTMLElement)) return false;
  if (/** @type {HTMLDialogElement} */ (find("help")).open) return key !== "?";
  const isInput = target instanceof HTMLInputElement;
  if (target instanceof HTMLSelectElement || (isInput && target.type === "text")) return true;
  if (isInput && target.type === "range") return /^(Arrow|Home|End|Page)/.test(key);
  return (key === " " || key === "Enter") && (isInput || target instanceof HTMLButtonElement);
}

/** Take the focus from what was chosen with the mouse: keys are for the page then, space plays. */
function freeFocus() {
  let isMouse = false;
  document.addEventListener("pointerdown", () => (isMouse = true), true);
  document.addEventListener("keydown", () => (isMouse = false), true);
  for (const name of ["click", "change"]) {
    document.addEventListener(name, ({ target }) => {
      if (!isMouse || !(target instanceof Element)) return;
      const kinds = name === "click" ? "button, button *, input:not([type=text])" : "select";
      if (target.matches(kinds)) /** @type {HTMLElement} */ (document.activeElement)?.blur();
    });
  }
}

/**
 * What keys do; false for nothing.
 * @param {App} app
 * @param {{fit: () => void, switchTheme: () => void}} actions
 * @returns {Map<string, (event: KeyboardEvent) => void | false>}
 */
function makeCommands(app, { fit, switchTheme }) {
  const { store } = app;
  const step = (/** @type {number} */ sign) => (/** @type {KeyboardEvent} */ event) =>
    setClock(app, store.state.time + sign * clockStep(app) * (event.shiftKey ? LARGE_STEP : 1));
  const zoom = (/** @type {number} */ factor) => () =>
    store.set({ view: zoomView(store.state.view, factor) });
  const pan = (/** @type {number} */ dx, /** @type {number} */ dy) => () =>
    store.set({ view: panView(store.state.view, dx * KEY_PIXELS, dy * KEY_PIXELS), follow: false });

  /** @type {[string, (event: KeyboardEvent) => void | false][]} */
  const commands = [
    [" ", () => togglePlay(app)],
    ["ArrowLeft", step(-1)],
    ["ArrowRight", step(1)],
    ["Home", () => setClock(app, clockExtent(app)[0])],
    ["End", () => setClock(app, clockExtent(app)[1])],
    ["+", zoom(KEY_ZOOM)],
    ["=", zoom(KEY_ZOOM)],
    ["-", zoom(1 / KEY_ZOOM)],
    ["0", fit],
    ["w", pan(0, 1)],
    ["a", pan(1, 0)],
    ["s", pan(0, -1)],
    ["d", pan(-1, 0)],
    ["Enter", () => choosePlace(app, { x: 0, y: 0 })],
    ["f", () => store.set({ follow: !store.state.follow })],
    ["n", () => chooseNext(app, 1)],
    ["p", () => chooseNext(app, -1)],
    ["[", () => setRangeEnd(app, 0)],
    ["]", () => setRangeEnd(app, 1)],
    ["z", () => zoomToRange(app)],
    ["x", () => showAllTimes(app)],
    ["m", switchTheme],
    ["Escape", () => store.set({ range: null, place: null })],
    ["?", () => toggleHelp()],
    ...sceneLayers(app.scene).map(
      ({ id, key }) =>
        /** @type {[string, () => void]} */ ([
          key,
          () => store.set({ layers: { ...store.state.layers, [id]: !store.state.layers[id] } }),
        ]),
    ),
  ];
  return new Map(commands);
}

/** Open or close the help. */
export function toggleHelp() {
  const help = /** @type {HTMLDialogElement} */ (find("help"));
  if (help.open) help.close();
  else help.showModal();
}
