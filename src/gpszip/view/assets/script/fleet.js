/**
 * The agents of a live page: where they are, the ways that they came, and where they go.
 *
 * @typedef {object} Point A point of a way.
 * @property {number} time
 * @property {number} a latitude, or x in metres
 * @property {number} b longitude, or y in metres
 * @property {number} x metres on the plane
 * @property {number} y
 *
 * @typedef {object} LiveEvent An event, as docs/events.md describes its fields.
 * @property {string} kind
 * @property {string} id
 * @property {string} agent
 * @property {number} time
 * @property {string} [revises]
 * @property {boolean} [withdrawn]
 * @property {number} [lat]
 * @property {number} [lon]
 * @property {number} [x]
 * @property {number} [y]
 * @property {number} [confidence]
 * @property {string} [why]
 * @property {Record<string, any>} [details]
 *
 * @typedef {object} Agent
 * @property {string} name
 * @property {number} number in the order in which they came
 * @property {string} source
 * @property {number} heard seconds since 1970 on the clock of the server
 * @property {Point} at
 * @property {number | null} heading degrees clockwise from north
 * @property {number | null} speed metres a second
 * @property {Point[]} tail
 * @property {LiveEvent | null} outlook
 *
 * @typedef {[string, string, number, number, number, number, number | null, number | null, number]}
 *   AgentRow name, source, time, heard, two coordinates, heading, speed, whether in degrees
 */

import { toPlane } from "./geodesy.js";

/** Points of a way that are kept. */
const MAX_POINTS = 400;

/** Agents that are known, as many as the server knows. */
const MAX_AGENTS = 10000;

/** Seconds since an agent was heard of, after which it is grey. */
const QUIET_SECONDS = 120;

/** Metres of a step that tells a heading. */
const HEADING_STEP = 5;

/** Metres from the middle of the plane beyond which positions are too distorted to be drawn. */
const FAR = 2e6;

/** Least probability of a next edge that is shown. */
const LIKELY = 0.01;

/** Kinds of events after which a prediction no longer holds. */
const OUTLOOK_ENDS = new Set(["stay.start", "trip.end", "silent", "off_map.start"]);

/**
 * The edges that are likely to follow, the likeliest first.
 * @param {LiveEvent | null} outlook
 * @returns {{edge: number, probability: number}[]}
 */
export function nextEdges(outlook) {
  const next = outlook?.details?.next;
  return Array.isArray(next) ? next.filter(({ probability }) => probability >= LIKELY) : [];
}

/** Agents on the planes of a map, or on a plane about the first position. */
export class Fleet {
  /**
   * @param {import("./viewport.js").Area[]} areas
   * @param {boolean} hasMap
   * @param {boolean} geographic whether the map is in degrees
   */
  constructor(areas, hasMap, geographic) {
    this.areas = areas;
    this.hasMap = hasMap;
    this.geographic = geographic;
    /** @type {Map<string, Agent>} */
    this.agents = new Map();
    this.count = 0;
    /** Seconds that the clock of the server is ahead of the browser's. */
    this.ahead = 0;
    this.tailSeconds = 900;
    /** Whether positions are of another kind than the map. */
    this.isUnlike = false;
  }

  /** Seconds since 1970 on the clock of the server. */
  now() {
    return Date.now() / 1000 + this.ahead;
  }

  /**
   * Whether an agent was not heard of for a while.
   * @param {Agent} agent
   */
  isQuiet(agent) {
    return this.now() - agent.heard > QUIET_SECONDS;
  }

  /**
   * Take where agents are.
   * @param {AgentRow[]} rows
   */
  move(rows) {
    for (const [name, source, time, heard, a, b, heading, speed, inDegrees] of rows) {
      this.learnPlane(a, b, inDegrees === 1);
      const at = this.point(time, a, b);
      const known = this.agents.get(name);
      const agent = known ?? this.add(name, at);
      const isNew = !known || at.time !== agent.at.time;
      Object.assign(agent, { source, heard, at, speed });
      if (!isNew) continue;
      agent.heading = heading ?? this.headingTo(agent, at);
      this.lengthen(agent);
    }
  }

  /**
   * Take the ways that agents came.
   * @param {(string | number)[][]} rows
   */
  follow(rows) {
    for (const [name, ...numbers] of rows) {
      const values = /** @type {number[]} */ (numbers);
      const points = [];
      for (let i = 0; i + 2 < values.length; i += 3) {
        // Degrees or metres are told with the agents, and the first of them may come later.
        points.push({ time: values[i], a: values[i + 1], b: values[i + 2], x: NaN, y: NaN });
      }
      const last = points[points.length - 1];
      if (!last) continue;
      const agent = this.agents.get(String(name)) ?? this.add(String(name), last);
      agent.tail = points;
      this.placeAgent(agent);
    }
  }

  /**
   * Take where an agent goes, or that it is there.
   * @param {LiveEvent} event
   */
  foresee(event) {
    const agent = this.agents.get(event.agent);
    if (!agent) return;
    if (event.kind === "predicted") agent.outlook = event.withdrawn ? null : event;
    else if (OUTLOOK_ENDS.has(event.kind) && !event.withdrawn) {
      if (agent.outlook && event.time >= agent.outlook.time) agent.outlook = null;
    }
  }

  /**
   * Place of an event on the plane; null if it has none.
   * @param {LiveEvent} event
   */
  placeOf({ lat, lon, x, y }) {
    const [a, b] = [lat ?? x, lon ?? y];
    if (a === undefined || b === undefined || this.isUnlike) return null;
    const place = this.project(a, b);
    return Number.isFinite(place.x) ? place : null;
  }

  /**
   * Put a plane without a map about another position.
   * @param {Point} point
   */
  recentre({ a, b }) {
    if (this.hasMap || !this.geographic) return;
    this.areas[0].center = [a, b];
    for (const agent of this.agents.values()) this.placeAgent(agent);
  }

  /**
   * @param {string} name
   * @param {Point} at
   * @returns {Agent}
   */
  add(name, at) {
    /** @type {Agent} */
    const agent = {
      name,
      number: this.count++,
      source: "",
      heard: 0,
      at,
      heading: null,
      speed: null,
      tail: [],
      outlook: null,
    };
    this.agents.set(name, agent);
    if (this.agents.size > MAX_AGENTS) this.forget();
    return agent;
  }

  /** Forget a tenth of the agents: those that were heard of least recently. */
  forget() {
    const oldest = [...this.agents.values()].sort((a, b) => a.heard - b.heard);
    for (const { name } of oldest.slice(0, MAX_AGENTS / 10)) this.agents.delete(name);
  }

  /**
   * Learn from the first position whether there are degrees, and where the plane is.
   * @param {number} a
   * @param {number} b
   * @param {boolean} inDegrees
   */
  learnPlane(a, b, inDegrees) {
    if (this.hasMap) {
      this.isUnlike = inDegrees !== this.geographic;
      return;
    }
    if (!inDegrees || this.areas[0].center) return;
    this.geographic = true;
    this.areas[0].center = [a, b];
    for (const agent of this.agents.values()) this.placeAgent(agent);
  }

  /**
   * @param {number} time
   * @param {number} a
   * @param {number} b
   * @returns {Point}
   */
  point(time, a, b) {
    return { time, a, b, ...this.project(a, b) };
  }

  /**
   * Position on the plane; NaN for what can't be drawn.
   * @param {number} a
   * @param {number} b
   */
  project(a, b) {
    if (this.isUnlike) return { x: NaN, y: NaN };
    if (!this.geographic) return { x: a, y: b };

    // The plane whose centre is nearest.
    let [best, least] = [this.areas[0], Infinity];
    for (const area of this.areas) {
      if (!area.center) continue;
      const [lat, lon] = area.center;
      const apart = Math.abs(a - lat) + Math.abs(((((b - lon + 180) % 360) + 360) % 360) - 180);
      if (apart < least) [best, least] = [area, apart];
    }
    if (!best.center) return { x: NaN, y: NaN };
    const [x, y] = toPlane(a, b, best.center);
    const isFar = !(Math.hypot(x, y) < FAR);
    return isFar ? { x: NaN, y: NaN } : { x: x + best.x, y };
  }

  /** @param {Agent} agent */
  placeAgent(agent) {
    for (const point of [agent.at, ...agent.tail])
      Object.assign(point, this.project(point.a, point.b));
  }

  /**
   * Add where an agent is to its way.
   * @param {Agent} agent
   */
  lengthen(agent) {
    const { tail, at } = agent;
    const last = tail[tail.length - 1];
    if (last && last.time > at.time) tail.length = 0;
    if (last?.time !== at.time) tail.push(at);
    let first = 0;
    while (tail[first].time < at.time - this.tailSeconds) first++;
    tail.splice(0, Math.max(first, tail.length - MAX_POINTS));
  }

  /**
   * Heading of an agent that moved; the one before if it hardly did.
   * @param {Agent} agent
   * @param {Point} at
   */
  headingTo(agent, at) {
    for (let i = agent.tail.length - 1; i >= 0; i--) {
      const [dx, dy] = [at.x - agent.tail[i].x, at.y - agent.tail[i].y];
      if (Math.hypot(dx, dy) >= HEADING_STEP) return (Math.atan2(dx, dy) * 180) / Math.PI;
    }
    return agent.heading;
  }
}
