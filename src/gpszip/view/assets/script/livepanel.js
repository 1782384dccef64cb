/**
 * The panel of a live page: the chosen agent, all agents, events, sources.
 *
 * @typedef {import("./map.js").App} App
 * @typedef {import("./fleet.js").Agent} Agent
 * @typedef {import("./fleet.js").Fleet} Fleet
 * @typedef {import("./fleet.js").LiveEvent} LiveEvent
 */

import { fillSelect, find, findInput, make, makeTable, show } from "./dom.js";
import { nextEdges } from "./fleet.js";
import { formatCount, formatCountOf, formatDegrees, formatDuration } from "./format.js";
import { formatNumber, formatSpeed } from "./format.js";
import { agentColourOf } from "./livedraw.js";
import { formatTime } from "./times.js";

/** Agents and events that are listed at most. */
const LISTED_ROWS = 100;

/** Events that are kept. */
const MAX_KEPT = 1000;

/** Kinds of events that come with all travel on a map. */
const ROUTINE = new Set(["edge.enter", "edge.leave", "predicted"]);

/** Times below count from a zero of the agent's own. */
const FIRST_DATE = 1e8;

/** Choices of the list of events beside single kinds. */
const NOTABLE = "but edges and predictions";
const EVERY_KIND = "all";

/** Lists of a page, and what happens when something in them is chosen. */
export class LivePanel {
  /**
   * @param {App} app
   * @param {Fleet} fleet
   * @param {{chooseAgent: (name: string) => void, showEvent: (event: LiveEvent) => void}} actions
   */
  constructor(app, fleet, actions) {
    this.app = app;
    this.fleet = fleet;
    this.actions = actions;
    /** @type {Map<string, {item: HTMLElement, fact: HTMLElement, button: HTMLElement}>} */
    this.rows = new Map();
    this.listed = "";
    /** @type {Map<string, LiveEvent>} */
    this.events = new Map();
    /** @type {Map<string, HTMLElement>} */
    this.items = new Map();
    /** @type {Set<string>} */
    this.kinds = new Set();
    this.fillKinds();
    find("kinds").addEventListener("change", () => this.listEvents());
    find("agents-find").addEventListener("input", () => this.showAgents());
    app.store.on(["zone"], () => this.listEvents());
  }

  /** Show what changes with time: agents, the chosen one, and sources. */
  refresh() {
    this.showAgents();
    this.showChosen();
  }

  /** List agents by name; rows are changed in place, so that the focus stays. */
  showAgents() {
    const { agents } = this.fleet;
    const wanted = findInput("agents-find").value.trim().toLowerCase();
    const found = [...agents.values()].filter(({ name }) => name.toLowerCase().includes(wanted));
    found.sort((a, b) => a.name.localeCompare(b.name, "en", { numeric: true }));
    const shown = found.slice(0, LISTED_ROWS);

    // Other agents than before.
    const listed = JSON.stringify(shown.map(({ name }) => name));
    if (listed !== this.listed) {
      this.listed = listed;
      const old = this.rows;
      this.rows = new Map(
        shown.map((agent) => [agent.name, old.get(agent.name) ?? this.makeRow(agent)]),
      );
      find("agents").replaceChildren(...[...this.rows.values()].map(({ item }) => item));
    }
    for (const agent of shown) this.updateRow(agent);
    const rest = found.length - shown.length;
    show(find("agents-more"), rest > 0);
    find("agents-more").textContent = `and ${formatCount(rest)} more`;
  }

  /** @param {Agent} agent */
  makeRow(agent) {
    const fact = make("span", { class: "fact" });
    const dot = make("span", { class: "dot" });
    dot.style.background = agentColourOf(agent);
    const name = make("span", { class: "space" }, agent.name);
    const button = make("button", { type: "button", "aria-pressed": "false" }, dot, name, fact);
    button.addEventListener("click", () => this.actions.chooseAgent(agent.name));
    return { item: make("li", {}, button), fact, button };
  }

  /** @param {Agent} agent */
  updateRow(agent) {
    const row = this.rows.get(agent.name);
    if (!row) return;
    const isQuiet = this.fleet.isQuiet(agent);
    const { track, units } = this.app.store.state;
    const age = formatDuration(Math.max(Math.round(this.fleet.now() - agent.heard), 0));
    const text = isQuiet
      ? `${age} ago`
      : agent.speed === null
        ? ""
        : formatSpeed(agent.speed, units);
    if (row.fact.textContent !== text) row.fact.textContent = text;
    row.button.classList.toggle("is-quiet", isQuiet);
    row.button.setAttribute("aria-pressed", String(agent.name === track));
  }

  /** Show what is known of the chosen agent. */
  showChosen() {
    const { track } = this.app.store.state;
    const agent = track === null ? undefined : this.fleet.agents.get(track);
    show(find("here"), agent !== undefined);
    if (!agent) return;
    find("here-title").textContent = agent.name;
    find("here-facts").replaceChildren(makeTable(this.facts(agent), ""));
  }

  /**
   * @param {Agent} agent
   * @returns {[string, string][]}
   */
  facts(agent) {
    const { units } = this.app.store.state;
    const { at, heading, speed, source } = agent;
    const age = Math.max(Math.round(this.fleet.now() - agent.heard), 0);
    /** @type {[string, string][]} */
    const facts = [
      ["Heard", `${formatDuration(age)} ago`],
      ["Position at", this.formatTime(at.time)],
      ["Position", this.formatPlace(at)],
      ["Source", source],
    ];
    if (speed !== null) facts.push(["Speed", formatSpeed(speed, units)]);
    if (heading !== null) facts.push(["Heading", `${Math.round((heading + 360) % 360)}\u00b0`]);
    return [...facts, ...this.outlook(agent)];
  }

  /**
   * Where an agent goes, and when it arrives.
   * @param {Agent} agent
   * @returns {[string, string][]}
   */
  outlook({ outlook, at }) {
    if (!outlook) return [];
    const { arrival, low, high, node } = outlook.details ?? {};
    const likely = outlook.confidence === undefined ? "" : ` (${percent(outlook.confidence)})`;
    /** @type {[string, string][]} */
    const facts = [["Goes to", `node ${node}${likely}`]];
    if (Number.isFinite(arrival)) {
      const left = arrival - at.time;
      const isLate = left < 0 ? "expected" : `in ${formatDuration(Math.round(left))},`;
      facts.push(["Arrives", `${isLate} ${this.formatTime(arrival, "time")}`]);
      const range = [low, high].map((time) => this.formatTime(time, "time")).join(" to ");
      facts.push(["80\u202f% arrive", range]);
    }
    const edges = nextEdges(outlook);
    if (edges.length)
      facts.push([
        "Next edges",
        edges.map(({ edge, probability }) => `${edge} (${percent(probability)})`).join(", "),
      ]);
    return facts;
  }

  /**
   * @param {number} time
   * @param {"both" | "time"} [part]
   */
  formatTime(time, part = "both") {
    const epoch = time < FIRST_DATE ? "log" : "unix";
    return formatTime(time, epoch, this.app.store.state.zone, 1, part);
  }

  /** @param {import("./fleet.js").Point} point */
  formatPlace({ a, b }) {
    if (!this.fleet.geographic) return `${formatNumber(a, 6)}, ${formatNumber(b, 6)}\u202fm`;
    return `${formatDegrees(a, "lat", 5)}, ${formatDegrees(b, "lon", 5)}`;
  }

  /**
   * Take events: one that revises another takes its place, and one that is withdrawn goes.
   * @param {LiveEvent[]} events
   */
  takeEvents(events) {
    for (const event of events) {
      this.fleet.foresee(event);
      if (event.revises !== undefined) this.removeEvent(event.revises);
      if (event.withdrawn || this.events.has(event.id)) continue;
      this.events.set(event.id, event);
      if (!this.kinds.has(event.kind)) this.fillKinds(event.kind);
      if (this.isWanted(event)) this.listEvent(event);
    }
    for (const id of this.events.keys()) {
      if (this.events.size <= MAX_KEPT) break;
      this.removeEvent(id);
    }
    show(find("events-none"), !this.items.size);
  }

  /** @param {string} id */
  removeEvent(id) {
    this.events.delete(id);
    this.items.get(id)?.remove();
    this.items.delete(id);
  }

  /** @param {LiveEvent} event */
  isWanted({ kind }) {
    const wanted = findInput("kinds").value;
    return wanted === NOTABLE ? !ROUTINE.has(kind) : wanted === EVERY_KIND || wanted === kind;
  }

  /** List all events anew. */
  listEvents() {
    find("events").replaceChildren();
    this.items.clear();
    for (const event of this.events.values()) if (this.isWanted(event)) this.listEvent(event);
    show(find("events-none"), !this.items.size);
  }

  /**
   * Put an event at the top of the list.
   * @param {LiveEvent} event
   */
  listEvent(event) {
    const button = make(
      "button",
      { type: "button" },
      make("span", { class: "fact" }, this.formatTime(event.time, "time")),
      make(
        "span",
        { class: "space" },
        make("span", { class: "kind" }, kindText(event.kind)),
        event.agent ? `  ${event.agent}` : "",
      ),
    );
    if (event.why) button.append(make("span", { class: "why" }, event.why));
    button.addEventListener("click", () => this.actions.showEvent(event));
    const item = make("li", {}, button);
    find("events").prepend(item);
    this.items.set(event.id, item);
    for (const [id, oldest] of this.items) {
      if (this.items.size <= LISTED_ROWS) break;
      oldest.remove();
      this.items.delete(id);
    }
  }

  /**
   * Fill the choice of kinds.
   * @param {string} [kind] one more
   */
  fillKinds(kind) {
    const chosen = findInput("kinds").value || NOTABLE;
    if (kind !== undefined) this.kinds.add(kind);
    /** @type {[string, string][]} */
    const single = [...this.kinds].sort().map((each) => [each, kindText(each)]);
    fillSelect(
      find("kinds"),
      [[NOTABLE, "All but edges and predictions"], [EVERY_KIND, "All"], ...single],
      chosen,
    );
  }

  /**
   * Show how sources are.
   * @param {Record<string, number>} counts
   */
  showSources(counts) {
    /** @type {Map<string, number>} */
    const agents = new Map();
    for (const { source } of this.fleet.agents.values())
      agents.set(source, (agents.get(source) ?? 0) + 1);
    const rows = [...agents]
      .sort()
      .map(
        ([source, count]) =>
          /** @type {[string, string]} */ ([source || "unknown", formatCountOf(count, "agent")]),
      );
    const told = Object.entries(counts)
      .sort((a, b) => b[1] - a[1])
      .map(([what, count]) => /** @type {[string, string]} */ ([what, formatCount(count)]));
    find("sources").replaceChildren(
      makeTable(rows, ""),
      makeTable(told, "Since the listener began"),
    );
  }
}

/**
 * A kind of events as words.
 * @param {string} kind
 */
function kindText(kind) {
  return kind.replace(/[._]/g, " ");
}

/** @param {number} share */
function percent(share) {
  return `${Math.round(100 * share)}\u202f%`;
}
