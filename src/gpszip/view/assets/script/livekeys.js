/** Keys of a live page: everything that the mouse can do. */

import { find, make } from "./dom.js";
import { isTyping, toggleHelp } from "./keys.js";
import { panView, zoomView } from "./viewport.js";

/** Zoom of a key, and CSS pixels by which a key moves the map. */
const LIVE_ZOOM = 1.5;
const LIVE_PIXELS = 80;

/** What the help lists. */
const LIVE_KEYS = [
  ["+ \u2212", "Zoom the map"],
  ["0", "Show everything"],
  ["w a s d", "Move the map"],
  ["enter", "The agent in the middle of the map"],
  ["n p", "Next or previous agent"],
  ["f", "Follow the agent"],
  ["m", "Light or dark"],
  ["esc", "Clear the choice"],
  ["?", "This help"],
];

/**
 * Listen to keys.
 * @param {import("./map.js").App} app
 * @param {{fit: () => void, switchTheme: () => void, clear: () => void,
 *   next: (sign: number) => void, chooseMiddle: () => void}} actions
 */
export function listenToLiveKeys({ store }, actions) {
  const zoom = (/** @type {number} */ factor) => () =>
    store.set({ view: zoomView(store.state.view, factor) });
  const pan = (/** @type {number} */ dx, /** @type {number} */ dy) => () =>
    store.set({
      view: panView(store.state.view, dx * LIVE_PIXELS, dy * LIVE_PIXELS),
      follow: false,
    });
  /** @type {Record<string, () => void>} */
  const commands = {
    "+": zoom(LIVE_ZOOM),
    "=": zoom(LIVE_ZOOM),
    "-": zoom(1 / LIVE_ZOOM),
    0: actions.fit,
    w: pan(0, 1),
    a: pan(1, 0),
    s: pan(0, -1),
    d: pan(-1, 0),
    n: () => actions.next(1),
    p: () => actions.next(-1),
    f: () => store.set({ follow: !store.state.follow }),
    m: actions.switchTheme,
    Enter: actions.chooseMiddle,
    Escape: actions.clear,
    "?": toggleHelp,
  };
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || isTyping(event)) return;
    const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
    if (!Object.hasOwn(commands, key)) return;
    commands[key]();
    event.preventDefault();
  });
  for (const [key, text] of LIVE_KEYS) {
    find("keys").append(
      make("dt", {}, ...key.split(" ").map((each) => make("kbd", {}, each))),
      make("dd", {}, text),
    );
  }
}
