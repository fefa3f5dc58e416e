// @ts-check
/** A sample of any problem in the plane: states over tau, margins, values against bounds, inputs. */

import { drawChart, moveCursor } from "./chart.js";
import { button, byId, html, numberCell, svg, table } from "./elements.js";
import { between, outline } from "./geometry.js";
import { openPage, say } from "./page.js";
import { Player } from "./player.js";

/**
 * @typedef {import("./types.js").Spot} Spot
 * @typedef {{tau: number[], value: number[][], bound: number[][], limit: number[][]}} Trace
 * @typedef {{name: string, margin: number, reason: string | null}} Verdict
 * @typedef {{agents: string[], present: boolean[], heading: boolean, unit: string, tau: number[], states: number[][][][], regions: Spot[][],
 *   inputs: number[][], satisfied: boolean, reason: string | null, hypotheses: string, verdicts: Verdict[], margins: (number | null)[][], trace: Trace | null}} Problem
 */

const DURATION = 4; // s of a replay
const ROUND = 0.06; // of the picture's width, around everything

class SampleView {
  /** @param {Problem} problem */
  constructor(problem) {
    this.problem = problem;
    this.root = byId("picture", SVGSVGElement);
    /** @type {number | null} */
    this.chosen = null;
    this.slider = byId("tau", HTMLInputElement);
    this.build();
    this.tables();
    this.charts();
    const player = new Player(
      this.slider,
      (tau) => this.show(tau),
      () => player.run(0, 1, 1 / DURATION),
    );
    addEventListener("resize", () => this.show(this.slider.valueAsNumber));
    this.show(1);
  }

  build() {
    const { states, regions, agents, present, margins } = this.problem;
    const spots = [...states.flat(2).map(([x, y]) => [x, y]), ...regions.flat()];
    const [xs, ys] = [0, 1].map((axis) => spots.map((spot) => spot[axis]));
    const [left, right, low, high] = [least(xs), -least(xs.map((x) => -x)), least(ys), -least(ys.map((y) => -y))];
    const size = Math.max(right - left, high - low, 1e-6) * (1 + 2 * ROUND);
    this.size = size;
    this.root.setAttribute("viewBox", `${(left + right - size) / 2} ${-(low + high + size) / 2} ${size} ${size}`);
    const up = svg("g", { transform: "scale(1 -1)" }, ...regions.map((corners) => svg("path", { class: "obstacle", d: outline(corners) })));
    this.tags = svg("g", { "aria-hidden": "true" });
    this.marks = agents.map((name, agent) => {
      const wrong = margins.some((row) => (row[agent] ?? 0) < 0);
      const mark = svg("g", { class: wrong ? "agent wrong" : "agent", tabindex: 0, role: "button", "aria-pressed": "false", "data-agent": agent });
      if (!present[agent]) return mark;
      const points = states[0][agent].length;
      if (points === 1) up.append(svg("path", { class: "way", d: line(states.map((each) => each[agent][0])) }));
      else mark.append(svg("path", { class: "trajectory" }));
      mark.append(svg("circle"), ...(this.problem.heading ? [svg("line")] : []));
      mark.addEventListener("click", () => this.choose(agent));
      mark.addEventListener("keydown", (event) => {
        if (event.key !== "Enter" && event.key !== " ") return;
        event.preventDefault();
        this.choose(agent);
      });
      up.append(mark);
      return mark;
    });
    this.root.replaceChildren(up, this.tags);
  }

  /** @param {number} tau */
  show(tau) {
    const { states, agents, present, heading } = this.problem;
    const times = this.problem.tau;
    let k = 0;
    while (k < times.length - 2 && times[k + 1] <= tau) k++;
    const part = Math.min(Math.max((tau - times[k]) / (times[k + 1] - times[k]), 0), 1);
    const pixel = (this.size ?? 1) / Math.max(this.root.clientWidth, 1);
    this.tags?.replaceChildren();
    this.marks?.forEach((mark, agent) => {
      if (!present[agent]) return;
      const now = states[k][agent].map((each, point) => {
        const next = states[k + 1][agent][point];
        return between([each[0], each[1], each[2] ?? 0], [next[0], next[1], next[2] ?? 0], part);
      });
      const [x, y, theta] = now[now.length - 1];
      if (now.length > 1) mark.firstElementChild?.setAttribute("d", line(now));
      const circle = mark.querySelector("circle");
      for (const [name, value] of Object.entries({ cx: x, cy: y, r: 5 * pixel })) circle?.setAttribute(name, String(value));
      if (heading) {
        const ends = { x1: x, y1: y, x2: x + 14 * pixel * Math.cos(theta), y2: y + 14 * pixel * Math.sin(theta) };
        for (const [name, value] of Object.entries(ends)) mark.querySelector("line")?.setAttribute(name, String(value));
      }
      mark.setAttribute("aria-label", `${agents[agent]}, x ${x.toPrecision(3)}, y ${y.toPrecision(3)}`);
      if (this.chosen === agent) {
        const tag = svg("text", { x, y: -y - 9 * pixel, "font-size": 12 * pixel, "stroke-width": 3 * pixel });
        tag.textContent = agents[agent];
        this.tags?.append(tag);
      }
    });
    this.slider.value = String(tau);
    byId("tau-text").textContent = `τ = ${tau.toFixed(2)}`;
    for (const chart of this.drawn ?? []) moveCursor(chart, tau);
  }

  charts() {
    const { trace, verdicts, tau, inputs, agents } = this.problem;
    const column = (/** @type {number[][]} */ rows, /** @type {number} */ row) => rows.map((each) => each[row]);
    this.drawn = !trace ? [] : verdicts.map(({ name }, row) => {
      const value = column(trace.value, row);
      const curve = { name, tau: trace.tau, value, bound: column(trace.bound, row), limit: column(trace.limit, row) };
      return drawChart({ ...curve, logarithmic: value.every((each) => each >= 0) });
    });
    const of = this.chosen === null ? "largest |u| of all agents" : `|u| of ${agents[this.chosen]}`;
    const norms = inputs.map((each) => (this.chosen === null ? Math.max(...each) : each[this.chosen]));
    this.drawn.push(drawChart({ name: of, tau, value: norms }));
    byId("charts").replaceChildren(...this.drawn.map(({ root }) => root));
  }

  /** @param {number} agent */
  choose(agent) {
    this.chosen = this.chosen === agent ? null : agent;
    this.marks?.forEach((mark, k) => {
      mark.classList.toggle("chosen", k === this.chosen);
      mark.setAttribute("aria-pressed", String(k === this.chosen));
    });
    document.querySelectorAll("#margins tbody tr").forEach((row, k) => row.setAttribute("aria-selected", String(k === this.chosen)));
    this.charts();
    this.show(this.slider.valueAsNumber);
  }

  tables() {
    const { verdicts, margins, agents } = this.problem;
    const number = (/** @type {number | null} */ value) => numberCell(value === null ? "-" : value.toPrecision(3));
    const rows = verdicts.map(({ name, margin, reason }) => {
      const row = html("tr", {}, html("td", {}, name), number(margin), html("td", {}, reason ?? "holds"));
      row.classList.toggle("wrong", reason !== null);
      return row;
    });
    byId("verdicts").replaceChildren(table(["requirement", "-least margin", "verdict"], html("tbody", {}, ...rows)));
    const each = agents.map((name, agent) => {
      const choose = button(name, { class: "plain" }, () => this.choose(agent));
      const row = html("tr", {}, html("td", {}, choose), ...margins.map((margin) => number(margin[agent])));
      row.classList.toggle("wrong", margins.some((margin) => (margin[agent] ?? 0) < 0));
      return row;
    });
    const heads = ["agent", ...verdicts.map(({ name }) => `-${name}`)];
    byId("margins").replaceChildren(table(heads, html("tbody", {}, ...each)));
  }
}

/** @param {number[]} numbers many: no spread into arguments */
const least = (numbers) => numbers.reduce((a, b) => Math.min(a, b), Infinity);

/** @param {number[][]} points */
const line = (points) => `M${points.map(([x, y]) => `${x} ${y}`).join("L")}`;

openPage({
  desk: "show",
  first: "problem",
  loading: "Loading the sample.",
  lasting: true,
  gone: "The program that showed this sample has ended.",
  build: (/** @type {Problem} */ problem) => {
    new SampleView(problem);
    const verdict = problem.satisfied ? "Satisfied" : `NOT satisfied: ${problem.reason}`;
    say(`${verdict}. The hypotheses of the theorems: ${problem.hypotheses}.`);
  },
});
