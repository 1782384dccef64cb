/**
 * The top of the page: title, area, units, time zone, light or dark.
 *
 * @typedef {import("./map.js").App} App
 */

import { fillSelect, find, findInput, make, show } from "./dom.js";
import { UNITS, formatBytes, formatCount, formatCountOf } from "./format.js";

/** Zone that is chosen at first. */
const UTC = "UTC";

/**
 * Build the top of the page.
 * @param {App} app
 * @param {{fit: () => void}} actions
 */
export function startSettings(app, { fit }) {
  const { scene, store, areas } = app;
  find("title").textContent = scene.title;
  find("title").title = scene.title;
  find("summary").append(...summary(scene));

  // Choices.
  fillSelect(
    find("units"),
    Object.entries(UNITS).map(([id, { label }]) => [id, label]),
    store.state.units,
  );
  find("units").addEventListener("change", () => store.set({ units: findInput("units").value }));
  fillSelect(find("zone"), zoneNames(store.state.zone), store.state.zone);
  find("zone").addEventListener("change", () => store.set({ zone: findInput("zone").value }));
  show(find("zone-label"), scene.epoch === "unix");
  fillSelect(
    find("area"),
    areas.map(({ label }, i) => [String(i), label]),
    "0",
  );
  find("area").addEventListener("change", () => {
    store.set({ area: Number(findInput("area").value) });
    fit();
  });
  store.on(["area"], () => (findInput("area").value = String(store.state.area)));
  show(find("area-label"), areas.length > 1);
}

/**
 * What the archive does, in a sentence.
 * @param {import("./scene.js").Scene} scene
 */
function summary({ archives }) {
  const [{ points, bytes, raw, tracks }] = archives;
  if (bytes === null)
    return points === null ? [] : [make("strong", {}, formatCountOf(points, "point"))];
  if (archives.length > 1)
    return [archives.map((each) => `${each.name}: ${formatBytes(each.bytes ?? 0)}`).join(", ")];
  const size = make("strong", {}, formatBytes(bytes));
  if (!points) return [`${formatCountOf(tracks.ids.length, "track")} in `, size];
  const isThinned = raw && raw.drawn < raw.total;
  const rest = isThinned
    ? `; ${formatCount(raw.drawn)} are shown: of neighbours, the largest errors`
    : "";
  return [make("strong", {}, formatCountOf(points, "point")), " as ", size, rest];
}

/**
 * Names of time zones: UTC, the browser's own, that of the page, and all others.
 * @param {string} chosen
 * @returns {[string, string][]}
 */
function zoneNames(chosen) {
  const own = Intl.DateTimeFormat().resolvedOptions().timeZone;
  const names = new Set([UTC, own, chosen, ...Intl.supportedValuesOf("timeZone")]);
  return [...names].map((name) => [name, name === own && own !== UTC ? `${name} (here)` : name]);
}
