/**
 * The layers of the map: names, keys, and what there is to show.
 *
 * @typedef {object} Layer
 * @property {string} id
 * @property {string} key
 * @property {string} label
 * @property {string} [alone] label where there is no archive
 * @property {keyof import("./colours.js").Theme} colour
 * @property {"dots" | "line" | "dash" | "ring" | "none"} sign how the list shows it
 * @property {(scene: import("./scene.js").Scene) => boolean} exists
 */

/** @type {Layer[]} */
export const LAYERS = [
  {
    id: "raw",
    key: "1",
    label: "Raw points",
    alone: "Points",
    colour: "raw",
    sign: "dots",
    exists: (scene) => scene.archives.some(({ raw }) => raw),
  },
  {
    id: "tracks",
    key: "2",
    label: "Decoded tracks",
    alone: "Tracks",
    colour: "tracks",
    sign: "line",
    exists: (scene) => scene.archives.some(({ tracks }) => tracks.ids.length),
  },
  {
    id: "clean",
    key: "3",
    label: "Clean map",
    colour: "clean",
    sign: "line",
    exists: (scene) => scene.archives.some(({ clean }) => clean.x.length),
  },
  {
    id: "archived",
    key: "4",
    label: "Map as archived",
    alone: "Map",
    colour: "archived",
    sign: "line",
    exists: (scene) => scene.archives.some(({ edges }) => edges.x.length),
  },
  {
    id: "knots",
    key: "5",
    label: "Knots",
    alone: "Nodes",
    colour: "ink",
    sign: "ring",
    exists: (scene) => scene.archives.some(({ nodes }) => nodes.x.length),
  },
  {
    id: "gaps",
    key: "6",
    label: "Gaps",
    colour: "muted",
    sign: "dash",
    exists: (scene) => scene.archives.some(({ knots }) => knots.gap.includes(1)),
  },
  {
    id: "fresh",
    key: "7",
    label: "New edges",
    colour: "fresh",
    sign: "line",
    exists: (scene) => scene.archives.some(({ newEdges }) => newEdges),
  },
  {
    id: "routes",
    key: "8",
    label: "Matched routes",
    colour: "routes",
    sign: "line",
    exists: (scene) => scene.archives.some(({ routes }) => routes),
  },
  {
    id: "errors",
    key: "9",
    label: "Largest errors",
    colour: "error",
    sign: "ring",
    exists: (scene) => scene.archives.some(({ maxError }) => maxError !== null),
  },
  {
    id: "network",
    key: "b",
    label: "Roads",
    colour: "network",
    sign: "line",
    exists: (scene) => scene.network !== null,
  },
  {
    id: "places",
    key: "o",
    label: "Places",
    colour: "accent",
    sign: "ring",
    exists: (scene) => scene.archives.some(({ history }) => history?.places?.length),
  },
  {
    id: "trips",
    key: "t",
    label: "Trips",
    colour: "tracks",
    sign: "line",
    exists: (scene) => scene.archives.some(({ history }) => history?.trips.length),
  },
  {
    id: "changes",
    key: "c",
    label: "Changes",
    colour: "fresh",
    sign: "line",
    exists: (scene) => scene.archives.some(({ history }) => history?.changes?.length),
  },
  {
    id: "unusual",
    key: "u",
    label: "Unusual trips",
    colour: "error",
    sign: "ring",
    exists: (scene) => scene.archives.some(({ history }) => history?.unusual?.length),
  },
  {
    id: "rounds",
    key: "r",
    label: "Usual round",
    colour: "routes",
    sign: "line",
    exists: (scene) => scene.archives.some(({ history }) => history?.rounds),
  },
  { id: "grid", key: "g", label: "Graticule", colour: "grid", sign: "line", exists: () => true },
  {
    id: "scale",
    key: "l",
    label: "Scale bar, north",
    colour: "muted",
    sign: "none",
    exists: () => true,
  },
];

/**
 * Layers that are on at first: the learned map over what was recorded, or what there is instead.
 * @param {import("./scene.js").Scene} scene
 * @returns {Record<string, boolean>}
 */
export function initialLayers(scene) {
  const hasRaw = scene.archives.some(({ raw }) => raw);
  const on = new Set("raw clean fresh routes network grid scale places changes rounds".split(" "));
  if (!hasRaw) on.add("gaps");
  if (scene.archives.every(({ clean }) => !clean.x.length)) on.add("archived");
  return Object.fromEntries(LAYERS.map(({ id }) => [id, on.has(id)]));
}

/**
 * Layers that a scene has something for.
 * @param {import("./scene.js").Scene} scene
 * @returns {Layer[]}
 */
export function sceneLayers(scene) {
  const isAlone = scene.archives.every(({ bytes }) => bytes === null);
  const shown = LAYERS.filter(({ exists }) => exists(scene));
  return isAlone ? shown.map((layer) => ({ ...layer, label: layer.alone ?? layer.label })) : shown;
}
