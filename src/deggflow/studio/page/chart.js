// @ts-check
/** Values under their bounds over tau, with a cursor. */

import { svg } from "./elements.js";

export const [WIDTH, HEIGHT] = [430, 190];
export const EDGE = { left: 58, right: 12, top: 22, bottom: 34 };
const LEAST = 1e-8; // of a logarithmic axis

/**
 * @typedef {object} Curve
 * @property {string} name "V of affordance"
 * @property {number[]} tau
 * @property {number[]} value
 * @property {number[]} [bound]
 * @property {number[]} [limit] that discrete steps must keep
 * @property {boolean} [logarithmic]
 *
 * @typedef {{root: SVGElement, cursor: SVGElement, title: SVGElement, curve: Curve}} Chart
 */

/** @param {Curve} curve @returns {Chart} */
export const drawChart = (curve) => {
  const { name, tau, value, bound, limit, logarithmic = false } = curve;
  const scale = (/** @type {number} */ number) => (logarithmic ? Math.log10(Math.max(number, LEAST)) : number);
  const all = [...value, ...(bound ?? []), ...(limit ?? [])].map(scale);
  const low = logarithmic ? Math.floor(Math.min(...all)) : Math.min(...all);
  const high = logarithmic ? Math.ceil(Math.max(...all)) : Math.max(...all);
  const y = (/** @type {number} */ number) =>
    HEIGHT - EDGE.bottom - ((scale(number) - low) / Math.max(high - low, 1e-9)) * (HEIGHT - EDGE.top - EDGE.bottom);
  const line = (/** @type {number[]} */ numbers) => "M" + tau.map((each, k) => `${across(each).toFixed(1)} ${y(numbers[k]).toFixed(1)}`).join("L");
  const title = svg("text", { x: EDGE.left, y: 13 });
  const cursor = svg("line", { class: "cursor", y1: EDGE.top, y2: HEIGHT - EDGE.bottom });
  const foot = HEIGHT - EDGE.bottom;
  const root = svg("svg", { class: "chart", viewBox: `0 0 ${WIDTH} ${HEIGHT}`, role: "img", "aria-label": `${name}${bound ? " under its bound" : ""} over tau` });
  if (bound) root.append(svg("path", { class: "below", d: `${line(bound)}L${across(1)} ${foot}L${across(0)} ${foot}Z` }));
  const ticks = logarithmic ? powers(low, high) : [low, ...(apart(0, low, high) ? [0] : []), high];
  for (const tick of ticks) {
    const at = y(logarithmic ? 10 ** tick : tick);
    root.append(svg("line", { class: "grid", x1: across(0), x2: across(1), y1: at, y2: at }));
    root.append(text(logarithmic ? `1e${tick}` : tick.toPrecision(2), { x: EDGE.left - 6, y: at + 4, "text-anchor": "end" }));
  }
  root.append(svg("path", { class: "axis", d: `M${across(0)} ${EDGE.top}V${foot}H${across(1)}` }));
  if (limit) root.append(svg("path", { class: "limit", d: line(limit) }));
  if (bound) root.append(svg("path", { class: "bound", d: line(bound) }));
  root.append(svg("path", { class: "value", d: line(value) }), cursor, title);
  for (const each of [0, 0.5, 1]) root.append(text(String(each), { x: across(each), y: foot + 15, "text-anchor": "middle" }));
  const legend = [bound && "bound dashed", limit && "limit of discrete steps dotted"].filter(Boolean).join(", ");
  root.append(text(`generative time τ${legend && ` (${legend})`}`, { x: across(0.5), y: HEIGHT - 5, "text-anchor": "middle" }));
  const chart = { root, cursor, title, curve };
  moveCursor(chart, 1);
  return chart;
};

/** @param {Chart} chart @param {number} at in [0, 1] */
export const moveCursor = ({ cursor, title, curve: { name, tau, value, bound, limit } }, at) => {
  for (const end of ["x1", "x2"]) cursor.setAttribute(end, String(across(at)));
  const k = tau.findLastIndex((each) => each <= at + 1e-9);
  const words = [`${name}: ${value[k].toPrecision(2)}`];
  if (bound) words.push(`bound ${bound[k].toPrecision(2)}`);
  if (limit) words.push(`limit of steps ${limit[k].toPrecision(2)}`);
  title.textContent = words.join(", ");
};

/** @param {number} tau */
const across = (tau) => EDGE.left + tau * (WIDTH - EDGE.left - EDGE.right);

/** Whether a tick has room between the ends. @param {number} tick @param {number} low @param {number} high */
export const apart = (tick, low, high) => Math.min(tick - low, high - tick) > 0.12 * (high - low);

/** @param {number} low @param {number} high */
const powers = (low, high) => {
  const step = Math.max(1, Math.ceil((high - low) / 4));
  return Array.from({ length: Math.floor((high - low) / step) + 1 }, (_, k) => low + k * step);
};

/** @param {string} words @param {Record<string, string | number>} attributes */
export const text = (words, attributes) => svg("text", attributes, words);
