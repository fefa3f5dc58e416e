// @ts-check
/** The policies of a trial: their factors under their bounds, at their ends and while they were generated. */

import { EDGE, HEIGHT, WIDTH, apart, drawChart, text } from "./chart.js";
import { button, byId, html, numberCell, svg, table } from "./elements.js";

/** @typedef {import("./bridge-types.js").Policy} Policy */
/** @typedef {import("./bridge-types.js").Course} Course */

const HEADS = ["policy", "-q_task", "-bound", "-q_safe (bound 0)", "-draws", "-fastest contact, m/s", "-hypotheses"];

export class PoliciesView {
  /** @param {(policy: number) => Promise<Course | null>} load @param {(policy: number) => void} onChoose */
  constructor(load, onChoose) {
    this.load = load;
    this.onChoose = onChoose;
    /** @type {Policy[]} */
    this.policies = [];
    /** @type {number | null} */
    this.chosen = null;
    this.body = html("tbody");
    byId("policies").append(table(HEADS, this.body));
  }

  /** @param {Policy[]} policies */
  draw(policies) {
    const grown = policies.length > this.policies.length && this.policies.every((each, k) => each === policies[k]);
    this.policies = policies;
    if (!grown) {
      this.chosen = null;
      this.body.replaceChildren();
      byId("courses").replaceChildren();
    }
    policies.slice(this.body.children.length).forEach((policy) => this.body.append(this.row(policy, this.body.children.length)));
    this.drawFactors();
  }

  drawFactors() {
    const task = { name: "q_task", value: this.policies.map((each) => each.q_task), bound: this.policies.map((each) => each.bound) };
    const safe = { name: "q_safe", value: this.policies.map((each) => each.q_safe), bound: this.policies.map(() => 0) };
    byId("factors").replaceChildren(...(this.policies.length ? [factorChart(task, this.chosen), factorChart(safe, this.chosen)] : []));
  }

  /** @param {Policy} policy @param {number} k */
  row(policy, k) {
    const name = button(`${k + 1}${policy.accepted ? "" : ", refused"}`, { class: "plain", "aria-pressed": "false" }, () => this.choose(k));
    const numbers = [policy.q_task, policy.bound, policy.q_safe].map((value) => value.toFixed(4));
    const hold = policy.generation ? (policy.generation.hypotheses_hold ? "hold" : policy.generation.first_failure) : "-";
    const cells = [...numbers, policy.draws, policy.speed.toFixed(3), hold];
    const row = html("tr", {}, html("td", {}, name), ...cells.map((cell) => numberCell(String(cell))));
    row.classList.toggle("wrong", policy.q_task > policy.bound || policy.q_safe > 0 || !policy.accepted);
    return row;
  }

  /** @param {number} k */
  async choose(k) {
    this.chosen = this.chosen === k ? null : k;
    this.drawFactors();
    [...this.body.children].forEach((row, j) => {
      row.setAttribute("aria-selected", String(j === this.chosen));
      row.querySelector("button")?.setAttribute("aria-pressed", String(j === this.chosen));
    });
    const home = byId("courses");
    home.replaceChildren();
    if (this.chosen === null) return;
    this.onChoose(k);
    home.append(html("p", { class: "soft" }, `Computing how policy ${k + 1} was generated.`));
    const { policies } = this;
    const course = await this.load(k);
    if (policies !== this.policies || this.chosen !== k) return; // another one is shown by now
    home.replaceChildren(...(course ? courseCharts(course, k) : []));
  }
}

/** @param {Course} course @param {number} k */
const courseCharts = (course, k) => [
  drawChart({ name: `q_task of policy ${k + 1}`, tau: course.tau, value: course.q_task, bound: course.beta_task }).root,
  drawChart({ name: `q_safe of policy ${k + 1}`, tau: course.tau, value: course.q_safe, bound: course.beta_safe }).root,
];

/** Values at the ends of all policies, each under its bound. @param {{name: string, value: number[], bound: number[]}} factor @param {number | null} chosen */
const factorChart = ({ name, value, bound }, chosen) => {
  const count = value.length;
  const all = [...value, ...bound];
  const [low, high] = [Math.min(...all), Math.max(...all)];
  const foot = HEIGHT - EDGE.bottom;
  const wide = (WIDTH - EDGE.left - EDGE.right) / count;
  const x = (/** @type {number} */ k) => EDGE.left + (k + 0.5) * wide;
  const y = (/** @type {number} */ number) => foot - 6 - ((number - low) / Math.max(high - low, 1e-9)) * (foot - 12 - EDGE.top);
  const worst = value.filter((each, k) => each > bound[k]).length;
  const root = svg("svg", { class: "chart", viewBox: `0 0 ${WIDTH} ${HEIGHT}`, role: "img", "aria-label": `${name} at the end of every policy; above its bound in ${worst} of ${count}` });
  if (chosen !== null) root.append(svg("rect", { class: "chosen", x: x(chosen) - wide / 2, y: EDGE.top, width: wide, height: foot - EDGE.top }));
  const ticks = [low, ...(apart(0, low, high) ? [0] : []), high];
  for (const tick of ticks) {
    root.append(svg("line", { class: "grid", x1: EDGE.left, x2: WIDTH - EDGE.right, y1: y(tick), y2: y(tick) }));
    root.append(text(tick.toPrecision(2), { x: EDGE.left - 6, y: y(tick) + 4, "text-anchor": "end" }));
  }
  root.append(svg("path", { class: "axis", d: `M${EDGE.left} ${EDGE.top}V${foot}H${WIDTH - EDGE.right}` }));
  const half = Math.min(0.4 * wide, 9);
  value.forEach((each, k) => {
    root.append(svg("line", { class: "mark", x1: x(k) - half, x2: x(k) + half, y1: y(bound[k]), y2: y(bound[k]) }));
    root.append(svg("circle", { class: each > bound[k] ? "dot wrong" : "dot", cx: x(k), cy: y(each), r: Math.min(0.3 * wide, 3.6) }));
  });
  root.append(text(`${name} at the end of every policy; its bound is a dash`, { x: EDGE.left, y: 13 }));
  const step = Math.ceil(count / 10);
  value.forEach((_, k) => {
    if (k % step === 0) root.append(text(String(k + 1), { x: x(k), y: foot + 15, "text-anchor": "middle" }));
  });
  root.append(text("policy", { x: (EDGE.left + WIDTH - EDGE.right) / 2, y: HEIGHT - 5, "text-anchor": "middle" }));
  return root;
};
