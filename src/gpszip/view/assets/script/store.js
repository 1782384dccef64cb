/**
 * What the user chose, and who is told when it changes.
 *
 * @typedef {object} Viewport
 * @property {number} x metres of the centre
 * @property {number} y
 * @property {number} scale CSS pixels for a metre
 *
 * @typedef {object} State
 * @property {Viewport} view
 * @property {number} area number of the area (plane) that is shown
 * @property {Record<string, boolean>} layers which layers are on
 * @property {string} colour what colours stand for
 * @property {number} hour of the day for which the use of edges is shown; -1 for all
 * @property {string} days of the week for which it is shown
 * @property {string | null} track id of the chosen track; null for all
 * @property {number} time of the clock
 * @property {boolean} playing
 * @property {string} speed seconds for a second, or "log/30": the whole log in 30 s
 * @property {boolean} aligned whether all tracks start at 0
 * @property {boolean} skip whether the clock skips times at which no track has a position
 * @property {boolean} follow whether the map moves with the clock
 * @property {number} tail seconds of the tail; Infinity for all before
 * @property {string} chart what the chart shows
 * @property {[number, number]} domain times that the chart shows
 * @property {[number, number] | null} range times that are measured
 * @property {number | null} hover time under the pointer
 * @property {{x: number, y: number} | null} pointer metres under the pointer
 * @property {{x: number, y: number, radius: number, track: string | null} | null} place where the
 *   user clicked, and the track that was chosen then
 * @property {string} units
 * @property {string} zone IANA name of the time zone
 * @property {"light" | "dark"} theme
 * @property {number} size counts changes of the layout
 */

/** A state whose listeners are called once a frame. */
export class Store {
  /** @param {State} state */
  constructor(state) {
    this.state = state;
    /** @type {{keys: (keyof State)[], listener: () => void}[]} */
    this.listeners = [];
    /** @type {Set<keyof State>} */
    this.changed = new Set();
    this.isScheduled = false;
    this.isFlushing = false;
  }

  /**
   * Change values; listeners hear of it in the next frame.
   * @param {Partial<State>} values
   */
  set(values) {
    for (const key of /** @type {(keyof State)[]} */ (Object.keys(values))) {
      if (this.state[key] !== values[key]) this.changed.add(key);
    }
    Object.assign(this.state, values);
    if (!this.changed.size || this.isScheduled || this.isFlushing) return;
    this.isScheduled = true;
    requestAnimationFrame(() => this.flush());
  }

  /**
   * Call a function after changes of any of these values.
   * @param {(keyof State)[]} keys
   * @param {() => void} listener
   */
  on(keys, listener) {
    this.listeners.push({ keys, listener });
  }

  /** Tell all listeners what changed; what one of them changes, those after it hear of, too. */
  flush() {
    this.isScheduled = false;
    this.isFlushing = true;
    for (const { keys, listener } of this.listeners) {
      if (keys.some((key) => this.changed.has(key))) listener();
    }
    this.isFlushing = false;
    this.changed.clear();
  }
}
