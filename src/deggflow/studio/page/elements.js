// @ts-check
/** Elements of the page, made and looked up. */

const SVG = "http://www.w3.org/2000/svg";

/**
 * @param {string} tag
 * @param {Record<string, string | number>} attributes
 * @param {...(Element | string)} children
 */
export const svg = (tag, attributes = {}, ...children) => {
  const element = document.createElementNS(SVG, tag);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, String(value));
  element.append(...children);
  return /** @type {SVGElement} */ (element);
};

/**
 * @param {string} tag
 * @param {Record<string, string | number>} attributes
 * @param {...(Element | string)} children
 */
export const html = (tag, attributes = {}, ...children) => {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, String(value));
  element.append(...children);
  return element;
};

/** @param {string} words @param {Record<string, string>} attributes @param {() => void} onClick */
export const button = (words, attributes, onClick) => {
  const element = html("button", { type: "button", ...attributes }, words);
  element.addEventListener("click", onClick);
  return element;
};

/** A table. @param {string[]} heads those with a leading "-" are of numbers @param {Element} body */
export const table = (heads, body) => {
  const cells = heads.map((name) => html("th", { scope: "col", class: name.startsWith("-") ? "number" : "text" }, name.replace(/^-/, "")));
  return html("table", {}, html("thead", {}, html("tr", {}, ...cells)), body);
};

/** @param {string} words */
export const numberCell = (words) => html("td", { class: "number" }, words);

/**
 * The element with an id.
 * @template {Element} [T=HTMLElement]
 * @param {string} id
 * @param {new () => T} [kind]
 * @returns {T}
 */
export const byId = (id, kind) => {
  const element = document.getElementById(id);
  if (!element || (kind && !(element instanceof kind))) throw new Error(`the page has no #${id}`);
  return /** @type {any} */ (element);
};
