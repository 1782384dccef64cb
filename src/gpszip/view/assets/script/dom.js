/** Elements of the page. Text from data is set as text only, never as markup. */

/**
 * Element with an id.
 * @param {string} id
 * @returns {HTMLElement}
 */
export function find(id) {
  const element = document.getElementById(id);
  if (!element) throw new Error(`no element ${id}`);
  return element;
}

/**
 * Input or select with an id.
 * @param {string} id
 * @returns {HTMLInputElement}
 */
export function findInput(id) {
  return /** @type {HTMLInputElement} */ (find(id));
}

/**
 * Make an element.
 * @param {string} tag
 * @param {Record<string, string>} attributes
 * @param {(string | Node)[]} children text or elements
 * @returns {HTMLElement}
 */
export function make(tag, attributes = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  element.append(...children);
  return element;
}

/**
 * Make a button.
 * @param {string} text
 * @param {() => void} action
 * @param {Record<string, string>} attributes
 */
export function makeButton(text, action, attributes = {}) {
  const button = make("button", { type: "button", ...attributes }, text);
  button.addEventListener("click", action);
  return button;
}

/**
 * @typedef {object} Jump A row of a list that leads somewhere.
 * @property {string[]} cells texts; the second one takes the space that is left
 * @property {() => void} go
 * @property {string} [colour] of a dot in front
 * @property {string} [title]
 */

/**
 * Make items of a list, each a button.
 * @param {Jump[]} jumps
 */
export function makeJumps(jumps) {
  return jumps.map(({ cells, go, colour, title }) => {
    const button = makeButton("", go, title ? { title } : {});
    if (colour) {
      const dot = make("i", { class: "dot" });
      dot.style.background = colour;
      button.append(dot);
    }
    button.append(...cells.map((text, i) => make("span", i === 1 ? { class: "space" } : {}, text)));
    return make("li", {}, button);
  });
}

/**
 * Fill a select with options.
 * @param {HTMLElement} select
 * @param {Iterable<[string, string]>} options value and text
 * @param {string} chosen
 */
export function fillSelect(select, options, chosen) {
  select.replaceChildren(
    ...[...options].map(([value, text]) => {
      const option = /** @type {HTMLOptionElement} */ (make("option", { value }, text));
      option.selected = value === chosen;
      return option;
    }),
  );
}

/**
 * Make a table of labels and values.
 * @param {Iterable<[string, string]>} rows
 * @param {string} caption
 */
export function makeTable(rows, caption) {
  const body = make("tbody");
  for (const [label, value] of rows) {
    body.append(make("tr", {}, make("th", { scope: "row" }, label), make("td", {}, value)));
  }
  return make("table", { class: "facts" }, make("caption", {}, caption), body);
}

/**
 * Show an element or not.
 * @param {HTMLElement} element
 * @param {boolean} isShown
 */
export function show(element, isShown) {
  element.hidden = !isShown;
}
