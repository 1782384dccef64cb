/**
 * What moves over the map of a live page: agents, the ways that they came, and where they go.
 *
 * @typedef {import("./map.js").App} App
 * @typedef {import("./map.js").Pane} Pane
 * @typedef {import("./pixels.js").Frame} Frame
 * @typedef {import("./fleet.js").Agent} Agent
 * @typedef {import("./fleet.js").Fleet} Fleet
 */

import { nextEdges } from "./fleet.js";
import { formatDuration } from "./format.js";
import { drawText } from "./graticule.js";
import { makeFrame } from "./map.js";
import { drawCentre, drawDot, shorten, strokeTwice } from "./overlay.js";
import { toScreen } from "./viewport.js";

/** Colours of agents: those of Okabe and Ito that no map has, and violet. */
const AGENT_COLOURS = ["#d55e00", "#009e73", "#cc79a7", "#e69f00", "#8f63c9"];

/** Agents that are drawn large, with their ways, at most. */
const MAX_LARGE = 400;

/** Agents whose goals are all shown at most; of more, that of the chosen one. */
const MAX_GOALS = 12;

/** Segments of all ways at most. */
const MAX_SEGMENTS = 20000;

/** CSS pixels of a name: its height, and the width of a letter. */
const AGENT_NAME_HEIGHT = 14;
const LETTER_WIDTH = 6.6;

/** Names that are looked at, and written, at most. */
const MAX_NAMES = 60;

/** Width of the likeliest next edge in CSS pixels. */
const NEXT_WIDTH = 7;

/**
 * Draw what moves.
 * @param {App} app
 * @param {Pane} pane
 * @param {Fleet} fleet
 * @param {{x: number, y: number} | null} mark place of the event that was clicked
 */
export function drawLive(app, pane, fleet, mark) {
  const frame = makeFrame(app, pane, pane.overlay);
  const { track, tail } = app.store.state;
  frame.ctx.clearRect(0, 0, frame.width, frame.height);
  const seen = [...fleet.agents.values()].filter(({ at }) => isSeen(frame, at));
  const isLarge = seen.length <= MAX_LARGE;
  const chosen = track === null ? undefined : fleet.agents.get(track);

  // Ways, and where agents go.
  if (isLarge && tail > 0) drawWays(frame, fleet, tail);
  if (chosen) drawNext(frame, pane.archive.clean, chosen);
  const going = fleet.agents.size <= MAX_GOALS ? fleet.agents.values() : chosen ? [chosen] : [];
  for (const agent of going) drawGoal(frame, fleet, agent);
  if (mark) drawMark(frame, mark);

  // Agents; those that were not heard of lie below.
  const isQuiet = new Map(seen.map((agent) => [agent, fleet.isQuiet(agent)]));
  seen.sort((a, b) => Number(isQuiet.get(b)) - Number(isQuiet.get(a)));
  for (const agent of seen) {
    const colour = isQuiet.get(agent) ? frame.theme.muted : agentColourOf(agent);
    const place = toScreen(frame, agent.at);
    if (agent === chosen) drawRing(frame, place);
    if (isLarge) drawAgent(frame, place, agent.heading, colour);
    else drawSmall(frame, place, colour);
  }
  if (isLarge) drawNames(frame, fleet, seen, chosen);
  if (pane.overlay.matches(":focus-visible")) drawCentre(frame);
}

/**
 * Colour of an agent, in the order in which they came.
 * @param {Agent} agent
 */
export function agentColourOf({ number }) {
  return AGENT_COLOURS[number % AGENT_COLOURS.length];
}

/**
 * @param {Frame} frame
 * @param {{x: number, y: number}} place NaN for what can't be drawn
 */
function isSeen({ seen }, { x, y }) {
  return x >= seen.minX && x <= seen.maxX && y >= seen.minY && y <= seen.maxY;
}

/**
 * @param {Frame} frame
 * @param {Fleet} fleet
 * @param {number} seconds
 */
function drawWays(frame, fleet, seconds) {
  const { ctx, theme } = frame;
  let space = MAX_SEGMENTS;
  for (const agent of fleet.agents.values()) {
    const from = agent.at.time - seconds;
    const points = agent.tail.filter(({ time, x }) => time >= from && Number.isFinite(x));
    space -= points.length;
    if (space <= 0) break;
    if (points.length < 2) continue;
    ctx.beginPath();
    for (const point of points) ctx.lineTo(...toScreen(frame, point));
    const colour = fleet.isQuiet(agent) ? theme.dim : agentColourOf(agent);
    strokeTwice(ctx, theme.paper, 5, colour, 2.5);
  }
}

/**
 * Draw the edges that are likely to follow, the likelier the wider.
 * @param {Frame} frame
 * @param {import("./scene.js").Edges} edges
 * @param {Agent} agent
 */
function drawNext(frame, edges, { outlook }) {
  const { ctx, theme } = frame;
  for (const { edge, probability } of nextEdges(outlook)) {
    if (!(edge >= 0 && edge + 1 < edges.offsets.length)) continue;
    ctx.beginPath();
    for (let k = edges.offsets[edge]; k < edges.offsets[edge + 1]; k++)
      ctx.lineTo(...toScreen(frame, { x: edges.x[k], y: edges.y[k] }));
    ctx.lineCap = ctx.lineJoin = "round";
    ctx.strokeStyle = `${theme.accent}88`;
    ctx.lineWidth = 2 + NEXT_WIDTH * Math.min(Math.max(probability, 0), 1);
    ctx.stroke();
  }
}

/**
 * Draw where an agent goes: a ring there, and a dashed line to it.
 * @param {Frame} frame
 * @param {Fleet} fleet
 * @param {Agent} agent
 */
function drawGoal(frame, fleet, agent) {
  const goal = agent.outlook && fleet.placeOf(agent.outlook);
  if (!goal || fleet.isQuiet(agent) || !Number.isFinite(agent.at.x)) return;
  const { ctx, theme } = frame;
  const [x, y] = toScreen(frame, goal);
  ctx.setLineDash([2, 5]);
  ctx.beginPath();
  ctx.moveTo(...toScreen(frame, agent.at));
  ctx.lineTo(x, y);
  ctx.strokeStyle = agentColourOf(agent);
  ctx.lineWidth = 1.25;
  ctx.stroke();
  ctx.setLineDash([]);
  ctx.beginPath();
  ctx.arc(x, y, 5 + 3.5 * (agent.number % AGENT_COLOURS.length), 0, 2 * Math.PI);
  strokeTwice(ctx, theme.paper, 4, agentColourOf(agent), 2);
}

/**
 * Draw a ring around the place of an event.
 * @param {Frame} frame
 * @param {{x: number, y: number}} mark
 */
function drawMark(frame, mark) {
  const [x, y] = toScreen(frame, mark);
  frame.ctx.beginPath();
  frame.ctx.arc(x, y, 16, 0, 2 * Math.PI);
  frame.ctx.fillStyle = `${frame.theme.accent}22`;
  frame.ctx.fill();
  strokeTwice(frame.ctx, frame.theme.paper, 4, frame.theme.accent, 1.75);
}

/**
 * @param {Frame} frame
 * @param {[number, number]} place
 */
function drawRing({ ctx, theme }, [x, y]) {
  ctx.beginPath();
  ctx.arc(x, y, 12, 0, 2 * Math.PI);
  strokeTwice(ctx, theme.paper, 4.5, theme.ink, 2);
}

/**
 * @param {Frame} frame
 * @param {[number, number]} place
 * @param {string} colour
 */
function drawSmall({ ctx }, [x, y], colour) {
  ctx.fillStyle = colour;
  ctx.fillRect(x - 2, y - 2, 4, 4);
}

/**
 * Draw an agent: an arrow in its heading, a dot without one.
 * @param {Frame} frame
 * @param {[number, number]} place
 * @param {number | null} heading
 * @param {string} colour
 */
function drawAgent(frame, [x, y], heading, colour) {
  if (heading === null) return drawDot(frame, x, y, 6, colour);
  const { ctx, theme } = frame;
  const angle = (heading * Math.PI) / 180;
  const [sin, cos] = [Math.sin(angle), Math.cos(angle)];
  ctx.beginPath();
  for (const [side, ahead] of [
    [0, 10],
    [6.5, -7],
    [0, -3.5],
    [-6.5, -7],
  ])
    ctx.lineTo(x + side * cos + ahead * sin, y + side * sin - ahead * cos);
  ctx.closePath();
  ctx.lineJoin = "round";
  ctx.strokeStyle = theme.paper;
  ctx.lineWidth = 3.5;
  ctx.stroke();
  ctx.fillStyle = colour;
  ctx.fill();
}

/**
 * Write names where there is space: that of the chosen agent first.
 * @param {Frame} frame
 * @param {Fleet} fleet
 * @param {Agent[]} seen
 * @param {Agent | undefined} chosen
 */
function drawNames(frame, fleet, seen, chosen) {
  /** @type {[number, number, number][]} left, right and height of each name */
  const written = [];
  const first = chosen && seen.includes(chosen) ? [chosen] : [];
  for (const agent of [...first, ...seen.filter((each) => each !== chosen)].slice(0, MAX_NAMES)) {
    const [x, y] = toScreen(frame, agent.at);
    const since = fleet.isQuiet(agent) ? `  ${formatDuration(fleet.now() - agent.heard)}` : "";
    const text = shorten(agent.name) + since;
    const [left, right] = [x + 13, x + 13 + text.length * LETTER_WIDTH];
    const isFree = written.every(
      ([from, to, height]) => left > to || right < from || Math.abs(height - y) > AGENT_NAME_HEIGHT,
    );
    if (!isFree) continue;
    written.push([left, right, y]);
    drawText(frame, text, left, y + 4, "left");
  }
}
