/**
 * Colours for eyes of all kinds: Okabe and Ito's for categories, cividis and viridis for ramps.
 *
 * A palette has PALETTE_SIZE colours: a ramp, then one for what is not chosen, then a layer's own.
 */

/** Colours of a ramp. */
export const RAMP_SIZE = 32;

/** Number in a palette of the colour of what is not chosen, or has no value. */
export const DIM = RAMP_SIZE;

/** Number in a palette of a layer's own colour. */
export const OWN = RAMP_SIZE + 1;

/** Colours of a palette. */
export const PALETTE_SIZE = RAMP_SIZE + 2;

/** Okabe and Ito 2008, without black and yellow: those that can be told on white and on black. */
export const CATEGORIES = ["#0072b2", "#e69f00", "#009e73", "#d55e00", "#56b4e9", "#cc79a7"];

/** Nine colours of viridis and cividis at equal distances (matplotlib). */
const VIRIDIS = "440154 472d7b 3b528b 2c728e 21918c 28ae80 5ec962 addc30 fde725";
const CIVIDIS = "00224e 123570 3b496c 575d6d 707173 8a8678 a59c74 c3b369 fee838";

/** A day or a circle: the last colour is the first. */
const CYCLE = "4b2a78 3b5aa9 4a93c4 86b8b4 c9b878 d98f4e c05a50 8a356a 4b2a78";

/** Part of a ramp that is told from the paper: dark colours on white, light ones on black. */
const SHOWN_PARTS = { light: [0, 0.9], dark: [0.14, 1] };

/**
 * RAMP_SIZE colours of a ramp.
 * @param {"viridis" | "cividis" | "cycle"} name
 * @param {"light" | "dark"} theme
 */
export function makeRamp(name, theme) {
  const stops = { viridis: VIRIDIS, cividis: CIVIDIS, cycle: CYCLE }[name]
    .split(" ")
    .map((hex) => splitColour(`#${hex}`));
  const [from, to] = name === "cycle" ? [0, 1] : SHOWN_PARTS[theme];
  return Array.from({ length: RAMP_SIZE }, (_, i) => {
    const place = (from + (i / (RAMP_SIZE - 1)) * (to - from)) * (stops.length - 1);
    const left = Math.min(Math.floor(place), stops.length - 2);
    return joinColour(
      stops[left].map((value, c) => value + (stops[left + 1][c] - value) * (place - left)),
    );
  });
}

/**
 * A palette: a ramp, the colour of what is not chosen, and a layer's own.
 * @param {string[]} ramp categories are repeated
 * @param {string} dim
 * @param {string} own
 */
export function makePalette(ramp, dim, own) {
  return [...Array.from({ length: RAMP_SIZE }, (_, i) => ramp[i % ramp.length]), dim, own];
}

/**
 * Colours as pixels of an image, fully opaque.
 * @param {string[]} colours #rrggbb
 */
export function toPixels(colours) {
  return Uint32Array.from(colours, (colour) => {
    const [red, green, blue] = splitColour(colour);
    return (255 << 24) | (blue << 16) | (green << 8) | red;
  });
}

/** @param {string} colour #rrggbb */
function splitColour(colour) {
  return [1, 3, 5].map((start) => parseInt(colour.slice(start, start + 2), 16));
}

/** @param {number[]} parts red, green and blue up to 255 */
function joinColour(parts) {
  return `#${parts.map((part) => Math.round(part).toString(16).padStart(2, "0")).join("")}`;
}

/**
 * @typedef {object} Theme Colours of the canvases.
 * @property {string} paper background
 * @property {string} ink text and knots
 * @property {string} muted labels
 * @property {string} grid graticule
 * @property {string} dim what is not chosen
 * @property {string} raw
 * @property {string} tracks
 * @property {string} clean
 * @property {string} archived
 * @property {string} fresh new edges
 * @property {string} routes
 * @property {string} error
 * @property {string} network
 * @property {string} accent cursor, range
 */

/** @type {Record<"light" | "dark", Theme>} */
export const THEMES = {
  light: {
    paper: "#fbfbf9",
    ink: "#1d2329",
    muted: "#66707a",
    grid: "#e6e7e4",
    dim: "#dcdedc",
    raw: "#8b959f",
    tracks: "#c77c00",
    clean: "#0072b2",
    archived: "#56a0cc",
    fresh: "#b8528a",
    routes: "#009e73",
    error: "#d55e00",
    network: "#dfdcd2",
    accent: "#d55e00",
  },
  dark: {
    paper: "#14181c",
    ink: "#eef1f3",
    muted: "#98a3ad",
    grid: "#242a30",
    dim: "#31383f",
    raw: "#6b7783",
    tracks: "#e69f00",
    clean: "#56b4e9",
    archived: "#3f87b3",
    fresh: "#cc79a7",
    routes: "#1fbf92",
    error: "#ff7a1f",
    network: "#33352f",
    accent: "#ff8a3d",
  },
};
