/**
 * The scene: everything that the page shows, as typed arrays.
 *
 * All positions are metres, all times seconds (metres along a track without times).
 *
 * @typedef {object} Lines Polylines, one after the other.
 * @property {Float64Array} x
 * @property {Float64Array} y
 * @property {Uint8Array} joined 1 where a segment leads to this point from the one before
 * @property {Int32Array} line number of each point's line
 * @property {Float64Array} offsets line i has the points offsets[i] to offsets[i + 1]
 *
 * @typedef {Lines & {forward: Float64Array, backward: Float64Array}} Edges
 *   Edges of a map; traversals along and against the line.
 *
 * @typedef {object} Tracks
 * @property {string[]} ids
 * @property {boolean[]} timed
 * @property {Float64Array} offsets
 * @property {Map<string, number>} numbers number of each id
 *
 * @typedef {Lines & {z: Float64Array | null, time: Float64Array, gap: Float64Array}} Knots
 *   Knots of all walks; the lines are the tracks, not joined across gaps.
 *
 * @typedef {object} Raw Samples of the log.
 * @property {Tracks} tracks
 * @property {Float64Array} walk number of each track's walk, or -1
 * @property {Float64Array} x
 * @property {Float64Array} y
 * @property {Float64Array | null} z
 * @property {Float64Array} time
 * @property {Float64Array} error metres; NaN where the walk claims no position
 * @property {Int32Array} track number of each sample's track
 * @property {number} total samples of the log
 * @property {number} drawn samples in the page
 *
 * @typedef {object} Kept Columns that the archive keeps.
 * @property {Float64Array} offsets
 * @property {Float64Array} time
 * @property {Map<string, Float64Array>} columns
 *
 * @typedef {object} Archive
 * @property {number} index 0 or 1
 * @property {string} name
 * @property {[string, string | number][]} facts label and text, or metres
 * @property {boolean} isLog whether this is a log without an archive
 * @property {number | null} bytes
 * @property {number | null} logBytes
 * @property {number | null} points
 * @property {[string, number][]} sections
 * @property {string | null} bound
 * @property {number | null} rmse
 * @property {number | null} maxError
 * @property {number} dimension 2 or 3
 * @property {{x: Float64Array, y: Float64Array, z: Float64Array | null}} nodes
 * @property {Edges} edges the map as archived
 * @property {Edges} clean the clean map
 * @property {Lines | null} newEdges
 * @property {Lines | null} routes
 * @property {Tracks} tracks
 * @property {Knots} knots
 * @property {Raw | null} raw
 * @property {Kept | null} kept
 * @property {import("./history.js").History | null} history
 *
 * @typedef {object} Scene
 * @property {string} title
 * @property {string} generator
 * @property {boolean} geographic
 * @property {[number, number][]} planes
 * @property {number} spread metres in x from one plane to the next
 * @property {"unix" | "log" | null} epoch
 * @property {Archive[]} archives
 * @property {Lines | null} network
 */

import { decodeBlock } from "./blocks.js";
import { decodeHistory } from "./history.js";

/** Version of the data that this script reads. */
const SCENE_VERSION = 1;

/**
 * Decode the scene that the page holds.
 * @param {any} data parsed JSON
 * @returns {Promise<Scene>}
 */
export async function decodeScene(data) {
  if (data.version !== SCENE_VERSION) throw new Error(`data of version ${data.version}`);
  return {
    title: data.title,
    generator: data.generator,
    geographic: data.geographic,
    planes: data.planes,
    spread: data.plane_spread,
    epoch: data.epoch,
    archives: await Promise.all(data.archives.map(decodeArchive)),
    network: await decodeLines(data.network),
  };
}

/**
 * @param {any} data
 * @param {number} index
 * @returns {Promise<Archive>}
 */
async function decodeArchive(data, index) {
  const nodes = await decodePositions(data.nodes);
  const [edges, clean, newEdges, routes] = await Promise.all([
    decodeEdges(data.edges, nodes),
    decodeCleanMap(data.clean),
    decodeLines(data.new_edges),
    decodeLines(data.routes),
  ]);
  const raw = data.raw && (await decodeRaw(data.raw));
  const isLog = raw && !data.tracks.ids.length;
  const tracks = isLog ? raw.tracks : await decodeTracks(data.tracks);
  return {
    index,
    name: data.name,
    isLog: Boolean(isLog),
    facts: data.facts,
    bytes: data.bytes,
    logBytes: data.log_bytes,
    points: data.points,
    sections: data.sections,
    bound: data.bound,
    rmse: data.rmse,
    maxError: data.max_error,
    dimension: data.dimension,
    nodes,
    edges,
    clean,
    newEdges,
    routes,
    tracks,
    knots: isLog ? samplesAsKnots(raw) : await decodeKnots(data.knots, tracks, nodes),
    raw,
    kept: data.kept && (await decodeKept(data.kept)),
    history: await decodeHistory(data.history),
  };
}

/**
 * @param {any} data
 * @returns {Promise<{x: Float64Array, y: Float64Array, z: Float64Array | null}>}
 */
async function decodePositions(data) {
  const [x, y, z] = await Promise.all([
    decodeBlock(data.x),
    decodeBlock(data.y),
    data.z ? decodeBlock(data.z) : null,
  ]);
  return { x, y, z };
}

/**
 * @param {any} data
 * @returns {Promise<Lines | null>}
 */
async function decodeLines(data) {
  if (!data) return null;
  const [x, y, offsets] = await Promise.all([data.x, data.y, data.offsets].map(decodeBlock));
  return toLines(x, y, offsets);
}

/**
 * @param {any} data
 * @returns {Promise<Edges>}
 */
async function decodeCleanMap(data) {
  const [x, y, offsets, forward, backward] = await Promise.all(
    [data.x, data.y, data.offsets, data.forward, data.backward].map(decodeBlock),
  );
  return { ...toLines(x, y, offsets), forward, backward };
}

/**
 * Edges between nodes, as lines of two points.
 * @param {any} data
 * @param {{x: Float64Array, y: Float64Array}} nodes
 * @returns {Promise<Edges>}
 */
async function decodeEdges(data, nodes) {
  const [from, to, forward, backward] = await Promise.all(
    [data.from, data.to, data.forward, data.backward].map(decodeBlock),
  );
  const x = new Float64Array(2 * from.length);
  const y = new Float64Array(2 * from.length);
  for (let i = 0; i < from.length; i++) {
    x[2 * i] = nodes.x[from[i]];
    y[2 * i] = nodes.y[from[i]];
    x[2 * i + 1] = nodes.x[to[i]];
    y[2 * i + 1] = nodes.y[to[i]];
  }
  const offsets = Float64Array.from({ length: from.length + 1 }, (_, i) => 2 * i);
  return { ...toLines(x, y, offsets), forward, backward };
}

/**
 * @param {any} data
 * @returns {Promise<Tracks>}
 */
async function decodeTracks(data) {
  const offsets = await decodeBlock(data.offsets);
  /** @type {Map<string, number>} */
  const numbers = new Map();
  data.ids.forEach((/** @type {string} */ id, /** @type {number} */ i) => numbers.set(id, i));
  return { ids: data.ids, timed: data.timed, offsets, numbers };
}

/**
 * @param {any} data
 * @param {Tracks} tracks
 * @param {{x: Float64Array, y: Float64Array, z: Float64Array | null}} nodes
 * @returns {Promise<Knots>}
 */
async function decodeKnots(data, tracks, nodes) {
  const [node, time, gap] = await Promise.all([data.node, data.time, data.gap].map(decodeBlock));
  const x = node.map((i) => nodes.x[i]);
  const y = node.map((i) => nodes.y[i]);
  const z = nodes.z && node.map((i) => /** @type {Float64Array} */ (nodes.z)[i]);
  const lines = toLines(x, y, tracks.offsets);
  for (let k = 0; k < gap.length; k++) if (gap[k]) lines.joined[k] = 0;
  return { ...lines, z, time, gap };
}

/**
 * Samples as knots: the tracks of a log that has no archive.
 * @param {Raw} raw its tracks become their own walks
 * @returns {Knots}
 */
function samplesAsKnots(raw) {
  raw.walk.forEach((_, i) => (raw.walk[i] = i));
  const lines = toLines(raw.x, raw.y, raw.tracks.offsets);
  return { ...lines, z: raw.z, time: raw.time, gap: new Float64Array(raw.x.length) };
}

/**
 * @param {any} data
 * @returns {Promise<Raw>}
 */
async function decodeRaw(data) {
  const tracks = await decodeTracks(data.tracks);
  const [walk, time, error] = await Promise.all(
    [data.walk, data.time, data.error].map(decodeBlock),
  );
  const positions = await decodePositions(data);
  const track = lineNumbers(tracks.offsets, time.length);
  return { tracks, walk, ...positions, time, error, track, total: data.total, drawn: data.drawn };
}

/**
 * @param {any} data
 * @returns {Promise<Kept>}
 */
async function decodeKept(data) {
  const columns = new Map();
  for (const name of Object.keys(data.columns)) {
    columns.set(name, await decodeBlock(data.columns[name]));
  }
  return { offsets: await decodeBlock(data.offsets), time: await decodeBlock(data.time), columns };
}

/**
 * @param {Float64Array} x
 * @param {Float64Array} y
 * @param {Float64Array} offsets
 * @returns {Lines}
 */
function toLines(x, y, offsets) {
  const joined = new Uint8Array(x.length).fill(1);
  for (const start of offsets) if (start < joined.length) joined[start] = 0;
  return { x, y, joined, line: lineNumbers(offsets, x.length), offsets };
}

/**
 * Number of the line that each point belongs to.
 * @param {Float64Array} offsets
 * @param {number} count
 * @returns {Int32Array}
 */
function lineNumbers(offsets, count) {
  const numbers = new Int32Array(count);
  for (let i = 0; i + 1 < offsets.length; i++) numbers.fill(i, offsets[i], offsets[i + 1]);
  return numbers;
}
