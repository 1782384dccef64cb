/**
 * What colours stand for: a class of the palette for each sample, segment and edge.
 *
 * @typedef {import("./scene.js").Scene} Scene
 * @typedef {import("./scene.js").Archive} Archive
 * @typedef {import("./store.js").State} State
 *
 * @typedef {object} Classes Numbers in the palette.
 * @property {Uint8Array} raw of each sample
 * @property {Uint8Array} tracks of the segment that leads to each knot
 * @property {Uint8Array} clean of each point of the clean map
 * @property {Uint8Array} archived of each point of the map as archived
 *
 * @typedef {object} Legend
 * @property {string} title
 * @property {string[]} [ramp] colours from the lowest to the highest value
 * @property {string[]} [labels] at equal distances along the ramp
 * @property {[string, string][]} [items] colour and text
 *
 * @typedef {{classes: Classes[], ramp: string[], legend: Legend | null}} Colouring
 */

import { CATEGORIES, DIM, OWN, RAMP_SIZE, makeRamp } from "./colours.js";
import { formatCount, formatCountOf, formatLength, formatSpeed } from "./format.js";
import { ALL_HOURS, mostTraversals, usageValues } from "./history.js";
import { formatTime, zoneOffset } from "./times.js";
import { lastAtMost, segmentSpeed, usualTop } from "./walks.js";

/** What colours of samples and tracks may stand for. */
export const TRACK_COLOURS = {
  track: "Track",
  speed: "Speed",
  error: "Error",
  time: "Time",
  hour: "Time of day",
  direction: "Direction",
};

/** What colours may stand for. */
const COLOURS = {
  layer: "Layer",
  ...TRACK_COLOURS,
  traversals: "Traversals",
  use: "Traversals by hour",
  pace: "Speed by hour",
};

/** Share of the values that a ramp reaches; those above have its last colour. */
const RAMP_SHARE = 0.98;

/** Values that are sorted at most to find this share. */
const SORTED_VALUES = 20000;

/** Seconds over which speeds of samples are measured at least: of less, noise is what remains. */
const SPEED_SECONDS = 0.5;

/** Tracks that a legend names at most. */
const NAMED_TRACKS = 6;

/** Seconds for which a time zone's offset is looked up once. */
const ZONE_BLOCK = 3600;

/**
 * What colours may stand for in a scene.
 * @param {Scene} scene
 * @returns {[string, string][]} id and label
 */
export function sceneColours({ archives, epoch }) {
  const hasTracks = archives.some(({ tracks }) => tracks.ids.length);
  const hasUsage = archives.some(({ history }) => history?.usage);
  /** @type {Record<string, boolean>} */
  const exists = {
    layer: true,
    track: archives[0].tracks.ids.length > 1,
    speed: epoch !== null,
    error: archives.some(({ maxError }) => maxError !== null),
    time: hasTracks,
    hour: epoch === "unix",
    traversals: archives.some(({ edges }) => edges.x.length),
    use: hasUsage,
    pace: hasUsage,
    direction: hasTracks,
  };
  const labels = epoch === null ? { ...COLOURS, time: "Distance" } : COLOURS;
  return Object.entries(labels).filter(([id]) => exists[id]);
}

/**
 * Colour a scene.
 * @param {Scene} scene
 * @param {State} state
 * @returns {Colouring}
 */
export function colourScene(scene, state) {
  const { archives } = scene;
  if (state.colour === "layer") {
    return {
      classes: archives.map((each) => plainClasses(each, state)),
      ramp: CATEGORIES,
      legend: null,
    };
  }
  if (state.colour === "track") return colourByTrack(scene, state);

  // Values of everything, and the range that the ramp covers.
  const values = archives.map((archive) => valuesOf(archive, state));
  const chosen = archives.map((archive, i) =>
    chosenValues(values[i], plainClasses(archive, state)),
  );
  const [low, high] = valueRange(chosen, scene, state);
  const isCircle = state.colour === "hour" || state.colour === "direction";
  const ramp = makeRamp(
    isCircle ? "cycle" : state.colour === "time" ? "cividis" : "viridis",
    state.theme,
  );
  const isLog = state.colour === "traversals" || state.colour === "use";
  const classes = archives.map((archive, i) => {
    const all = plainClasses(archive, state);
    for (const key of /** @type {(keyof Classes)[]} */ (Object.keys(values[i]))) {
      const ofKey = /** @type {Float64Array} */ (values[i][key]);
      classify(all[key], ofKey, low, high, isLog);
    }
    return all;
  });
  return { classes, ramp, legend: makeLegend(scene, state, ramp, low, high) };
}

/**
 * Classes where each layer has its own colour, and tracks that are not chosen are dim.
 * @param {Archive} archive
 * @param {State} state
 * @returns {Classes}
 */
function plainClasses(archive, state) {
  const tracks = new Uint8Array(archive.knots.x.length).fill(OWN);
  const raw = new Uint8Array(archive.raw ? archive.raw.x.length : 0).fill(OWN);
  if (state.track !== null) {
    fillOthers(tracks, archive.tracks, state.track);
    if (archive.raw) fillOthers(raw, archive.raw.tracks, rawId(archive, state.track));
  }
  return {
    raw,
    tracks,
    clean: new Uint8Array(archive.clean.x.length).fill(OWN),
    archived: new Uint8Array(archive.edges.x.length).fill(OWN),
  };
}

/**
 * Id of the raw track of a walk.
 * @param {Archive} archive
 * @param {string} id
 */
function rawId(archive, id) {
  const number = rawNumber(archive, archive.tracks.numbers.get(id) ?? -1);
  return archive.raw && number >= 0 ? archive.raw.tracks.ids[number] : id;
}

/**
 * Number of the raw track of a walk; -1 if there is none.
 * @param {Archive} archive
 * @param {number} walk
 */
export function rawNumber(archive, walk) {
  return archive.raw && walk >= 0 ? archive.raw.walk.indexOf(walk) : -1;
}

/**
 * Make all tracks but one dim.
 * @param {Uint8Array} classes
 * @param {import("./scene.js").Tracks} tracks
 * @param {string} id
 */
function fillOthers(classes, tracks, id) {
  const number = tracks.numbers.get(id);
  if (number === undefined) return void classes.fill(DIM);
  classes.fill(DIM, 0, tracks.offsets[number]);
  classes.fill(DIM, tracks.offsets[number + 1]);
}

/**
 * @param {Scene} scene
 * @param {State} state
 * @returns {Colouring}
 */
function colourByTrack(scene, state) {
  const ids = scene.archives[0].tracks.ids;
  const classes = scene.archives.map((archive) => {
    const all = plainClasses(archive, state);
    const classOf = archive.tracks.ids.map((id) => {
      const number = scene.archives[0].tracks.numbers.get(id);
      return number === undefined ? DIM : number % CATEGORIES.length;
    });
    const { raw, knots } = archive;
    for (let k = 0; k < all.tracks.length; k++) {
      if (all.tracks[k] !== DIM) all.tracks[k] = classOf[knots.line[k]];
    }
    for (let i = 0; raw && i < all.raw.length; i++) {
      if (all.raw[i] !== DIM) all.raw[i] = classOf[raw.walk[raw.track[i]]] ?? DIM;
    }
    return all;
  });

  /** @type {[string, string][]} */
  const items = ids.slice(0, NAMED_TRACKS).map((id, i) => [CATEGORIES[i], id]);
  if (ids.length > NAMED_TRACKS) {
    const rest = ids.length - NAMED_TRACKS;
    items.push(["", `and ${formatCountOf(rest, "more track")} in the same colours`]);
  }
  return { classes, ramp: CATEGORIES, legend: { title: "Track", items } };
}

/**
 * Values for which colours stand.
 * @param {Archive} archive
 * @param {State} state
 * @returns {Partial<Record<keyof Classes, Float64Array>>}
 */
function valuesOf(archive, state) {
  const { raw, knots } = archive;
  const none = new Float64Array(0);
  switch (state.colour) {
    case "speed":
      return {
        raw: raw ? sampleSpeeds(raw) : none,
        tracks: knots.x.map((_, k) => (k ? segmentSpeed(archive, k) : NaN)),
      };
    case "error":
      return { raw: raw ? raw.error : none, tracks: segmentErrors(archive) };
    case "time":
      return {
        raw: raw ? sinceStart(raw.time, raw.tracks, raw.track, state.aligned) : none,
        tracks: sinceStart(knots.time, archive.tracks, knots.line, state.aligned),
      };
    case "hour":
      return {
        raw: raw ? hours(raw.time, state.zone) : none,
        tracks: hours(knots.time, state.zone),
      };
    case "direction":
      return { raw: raw ? headings(raw, raw.track) : none, tracks: headings(knots, knots.line) };
    case "use":
    case "pace":
      return { clean: usageOf(archive, state) };
    default:
      return { clean: traversals(archive.clean), archived: traversals(archive.edges) };
  }
}

/**
 * Values of what is not dim; NaN for the rest.
 * @param {Partial<Record<keyof Classes, Float64Array>>} values
 * @param {Classes} classes
 * @returns {Partial<Record<keyof Classes, Float64Array>>}
 */
function chosenValues(values, classes) {
  const chosen = /** @type {(keyof Classes)[]} */ (Object.keys(values)).map((key) => {
    const ofKey = /** @type {Float64Array} */ (values[key]);
    return classes[key].includes(DIM)
      ? [key, ofKey.map((value, i) => (classes[key][i] === DIM ? NaN : value))]
      : [key, ofKey];
  });
  return Object.fromEntries(chosen);
}

/**
 * Speeds of samples since the last one that is old enough, in metres a second.
 * @param {import("./scene.js").Raw} raw
 */
export function sampleSpeeds(raw) {
  const speeds = new Float64Array(raw.x.length).fill(NaN);
  for (let i = 1, j = 0; i < speeds.length; i++) {
    if (raw.track[i] !== raw.track[j]) j = i;
    while (j + 1 < i && raw.time[i] - raw.time[j + 1] >= SPEED_SECONDS) j++;
    const duration = raw.time[i] - raw.time[j];
    if (!raw.tracks.timed[raw.track[i]] || duration <= 0) continue;
    const height = raw.z ? raw.z[i] - raw.z[j] : 0;
    speeds[i] = Math.hypot(raw.x[i] - raw.x[j], raw.y[i] - raw.y[j], height) / duration;
  }
  return speeds;
}

/**
 * Largest error of the samples on the segment that leads to each knot.
 * @param {Archive} archive
 */
function segmentErrors({ raw, knots, tracks }) {
  const errors = new Float64Array(knots.x.length).fill(NaN);
  if (!raw) return errors;
  for (let i = 0; i < raw.x.length; i++) {
    const walk = raw.walk[raw.track[i]];
    if (walk < 0 || Number.isNaN(raw.error[i])) continue;
    const end = tracks.offsets[walk + 1];
    const k = Math.min(lastAtMost(knots.time, raw.time[i], tracks.offsets[walk], end) + 1, end - 1);
    if (!(errors[k] >= raw.error[i])) errors[k] = raw.error[i];
  }
  return errors;
}

/**
 * Times, or times since each track's start.
 * @param {Float64Array} time
 * @param {import("./scene.js").Tracks} tracks
 * @param {Int32Array} numbers
 * @param {boolean} isAligned
 */
function sinceStart(time, tracks, numbers, isAligned) {
  return isAligned ? time.map((value, i) => value - time[tracks.offsets[numbers[i]]]) : time;
}

/**
 * Hours of the day.
 * @param {Float64Array} time seconds since 1970
 * @param {string} zone IANA name
 */
function hours(time, zone) {
  let [block, offset] = [NaN, 0];
  return time.map((value) => {
    if (Math.floor(value / ZONE_BLOCK) !== block) {
      block = Math.floor(value / ZONE_BLOCK);
      offset = zoneOffset(value, zone);
    }
    return ((((value + offset) % 86400) + 86400) % 86400) / 3600;
  });
}

/**
 * Headings in degrees, clockwise from the north.
 * @param {{x: Float64Array, y: Float64Array}} positions
 * @param {Int32Array} numbers of the lines
 */
function headings({ x, y }, numbers) {
  return x.map((_, i) => {
    const isSame = i && numbers[i] === numbers[i - 1] && (x[i] !== x[i - 1] || y[i] !== y[i - 1]);
    if (!isSame) return NaN;
    return ((Math.atan2(x[i] - x[i - 1], y[i] - y[i - 1]) / Math.PI) * 180 + 360) % 360;
  });
}

/**
 * Traversals of the edge of each point.
 * @param {import("./scene.js").Edges} edges
 */
function traversals(edges) {
  return edges.x.map((_, i) => edges.forward[edges.line[i]] + edges.backward[edges.line[i]]);
}

/**
 * Use of the edge of each point in the chosen hours.
 * @param {Archive} archive
 * @param {State} state
 */
function usageOf({ clean, history }, state) {
  const count = clean.offsets.length - 1;
  const values = history?.usage ? usageValues(history.usage, count, state) : null;
  return clean.x.map((_, i) => (values ? values[clean.line[i]] : NaN));
}

/**
 * Range of values that a ramp covers.
 * @param {Partial<Record<keyof Classes, Float64Array>>[]} chosen of each archive
 * @param {Scene} scene
 * @param {State} state
 * @returns {[number, number]}
 */
function valueRange(chosen, { archives }, state) {
  if (state.colour === "hour") return [0, 24];
  if (state.colour === "direction") return [0, 360];
  if (state.colour === "use" && state.hour !== ALL_HOURS) {
    const most = archives.map(({ history, clean }) =>
      history?.usage ? mostTraversals(history.usage, clean.offsets.length - 1, state.days) : 0,
    );
    return [1, Math.max(2, ...most)];
  }

  // All values of time and traversals; of others up to a share of them.
  const values = chosen.flatMap((each) => Object.values(each));
  let [low, high] = [Infinity, -Infinity];
  for (const each of values) {
    for (const value of each) {
      if (value < low) low = value;
      if (value > high) high = value;
    }
  }
  if (low > high) return [0, 1];
  if (state.colour === "pace") {
    const all = archives.map((archive) => usageOf(archive, { ...state, hour: ALL_HOURS }));
    return [0, percentile(all, RAMP_SHARE) || 1];
  }
  if (state.colour === "time") return [low, high > low ? high : low + 1];
  if (state.colour === "traversals" || state.colour === "use") return [1, Math.max(high, 2)];

  // Speeds of walks most of the time: those between close samples are noise.
  const steps = chosen.flatMap(({ tracks = new Float64Array(0) }, i) => {
    const { time } = archives[i].knots;
    return Array.from(tracks, (value, k) => ({ value, duration: k ? time[k] - time[k - 1] : 0 }));
  });
  const usual = state.colour === "speed" ? usualTop(steps, RAMP_SHARE) : 0;
  return [0, usual || percentile(values, RAMP_SHARE) || 1];
}

/**
 * Value below which a share of values lies.
 * @param {Float64Array[]} values NaN is left out
 * @param {number} share
 */
function percentile(values, share) {
  const count = values.reduce((sum, each) => sum + each.length, 0);
  const step = Math.max(Math.floor(count / SORTED_VALUES), 1);
  const known = values.flatMap((each) =>
    Array.from(each.filter((value, i) => i % step === 0 && value === value)),
  );
  const sorted = Float64Array.from(known).sort();
  return sorted.length ? sorted[Math.floor((sorted.length - 1) * share)] : NaN;
}

/**
 * Put values into classes of a ramp.
 * @param {Uint8Array} classes those that are dim stay so
 * @param {Float64Array} values
 * @param {number} low
 * @param {number} high
 * @param {boolean} isLog
 */
function classify(classes, values, low, high, isLog) {
  const scale = (value = 0) => (isLog ? Math.log(Math.max(value, low)) : value);
  const start = scale(low);
  const factor = RAMP_SIZE / (scale(high) - start);
  for (let i = 0; i < values.length; i++) {
    if (classes[i] === DIM) continue;
    const place = Math.floor((scale(values[i]) - start) * factor);
    classes[i] = values[i] === values[i] ? Math.min(Math.max(place, 0), RAMP_SIZE - 1) : DIM;
  }
}

/**
 * @param {Scene} scene
 * @param {State} state
 * @param {string[]} ramp
 * @param {number} low
 * @param {number} high
 * @returns {Legend}
 */
function makeLegend(scene, state, ramp, low, high) {
  const { units, zone } = state;
  const middle = (low + high) / 2;
  const time = (/** @type {number} */ value) =>
    formatTime(value, state.aligned && scene.epoch ? "log" : scene.epoch, zone, (high - low) / 100);
  switch (state.colour) {
    case "speed":
    case "pace":
      return {
        title: "Speed",
        ramp,
        labels: [low, middle, high].map((each) => formatSpeed(each, units)),
      };
    case "error":
      return {
        title: "Error",
        ramp,
        labels: [low, middle, high].map((each) => formatLength(each, units)),
      };
    case "time":
      return { title: scene.epoch ? "Time" : "Distance", ramp, labels: [time(low), time(high)] };
    case "hour":
      return { title: "Time of day", ramp, labels: ["0:00", "6:00", "12:00", "18:00", "24:00"] };
    case "direction":
      return { title: "Direction", ramp, labels: ["N", "E", "S", "W", "N"] };
    default:
      return {
        title: "Traversals",
        ramp,
        labels: [low, Math.sqrt(low * high), high].map((each) => formatCount(each)),
      };
  }
}
