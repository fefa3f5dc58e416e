// @ts-check
/** The generation over tau: both scenes on their way, and V under its bound. */

import { byId, svg } from "./elements.js";
import { between } from "./geometry.js";

/** @typedef {import("./types.js").Pose} Pose */
/** @typedef {import("./types.js").Trace} Trace */
/** @typedef {import("./types.js").Replay} Replay */

const DURATION = 4000; // ms of a replay
const [WIDTH, HEIGHT] = [430, 190];
const EDGE = { left: 58, right: 12, top: 22, bottom: 34 };
const LEAST = 1e-8; // of a logarithmic axis

export class ReplayView {
  /**
   * @param {() => Promise<Replay | null>} load the generation of the scene that is shown
   * @param {(nominal: Pose[], guided: Pose[], underway: boolean) => void} onPoses
   */
  constructor(load, onPoses) {
    this.load = load;
    this.onPoses = onPoses;
    /** @type {Replay | null} */
    this.replay = null;
    /** @type {Trace | null} */
    this.trace = null;
    /** @type {{cursor: SVGElement, title: SVGElement, name: string, row: number}[]} */
    this.charts = [];
    this.playing = 0;
    this.scene = 0; // counts the scenes that were shown
    this.slider = byId("tau", HTMLInputElement);
    this.button = byId("play");
    this.text = byId("tau-text");
    this.slider.addEventListener("input", () => {
      this.stop();
      this.showAt(this.slider.valueAsNumber);
    });
    this.button.addEventListener("click", () => (this.playing ? this.stop() : this.play()));
  }

  /** Another scene. @param {Trace | null} trace */
  reset(trace) {
    this.stop();
    this.replay = null;
    this.scene += 1;
    this.trace = trace;
    this.slider.value = "1";
    this.drawCharts();
    this.point(1);
  }

  /** @param {number} tau */
  async showAt(tau) {
    const replay = await this.loaded();
    if (!replay) return;
    const last = replay.tau.length - 1;
    let k = 0;
    while (k < last - 1 && replay.tau[k + 1] <= tau) k++;
    const part = Math.min((tau - replay.tau[k]) / (replay.tau[k + 1] - replay.tau[k]), 1);
    const at = (/** @type {Pose[][]} */ path) => path[k].map((pose, i) => between(pose, path[k + 1][i], part));
    this.onPoses(at(replay.nominal), at(replay.guided), tau < 1);
    this.point(tau);
  }

  async loaded() {
    if (!this.replay) {
      const { scene } = this;
      this.text.textContent = "computing the replay";
      const replay = await this.load();
      if (scene !== this.scene) return null; // another one is shown by now
      this.replay = replay;
      this.point(this.slider.valueAsNumber);
    }
    return this.replay;
  }

  async play() {
    if (!(await this.loaded())) return;
    const start = performance.now();
    this.button.textContent = "Stop";
    const step = (/** @type {number} */ now) => {
      const tau = Math.min(Math.max((now - start) / DURATION, 0), 1);
      this.slider.value = String(tau);
      this.showAt(tau);
      if (tau < 1) this.playing = requestAnimationFrame(step);
      else this.stop();
    };
    this.playing = requestAnimationFrame(step);
  }

  stop() {
    cancelAnimationFrame(this.playing);
    this.playing = 0;
    this.button.textContent = "Play";
  }

  drawCharts() {
    const { trace } = this;
    const home = byId("charts");
    this.charts = [];
    home.replaceChildren();
    trace?.names.forEach((name, row) => {
      const chart = drawChart(trace, row, name);
      home.append(chart.root);
      this.charts.push({ ...chart, name, row });
    });
  }

  /** @param {number} tau */
  point(tau) {
    const { trace } = this;
    this.text.textContent = `τ = ${tau.toFixed(2)}`;
    for (const { cursor, title, name, row } of this.charts) {
      if (!trace) continue;
      const x = EDGE.left + tau * (WIDTH - EDGE.left - EDGE.right);
      cursor.setAttribute("x1", String(x));
      cursor.setAttribute("x2", String(x));
      const k = trace.tau.findLastIndex((each) => each <= tau + 1e-9);
      const [value, bound, limit] = [trace.value[k][row], trace.bound[k][row], trace.limit[k][row]];
      const words = [value, bound, limit].map((number) => number.toPrecision(2));
      title.textContent = `${symbol(name)} of ${name}: ${words[0]}, bound ${words[1]}, limit of steps ${words[2]}`;
    }
  }
}

/** @param {string} name */
const symbol = (name) => (name === "balance" ? "q" : "V");

/** @param {Trace} trace @param {number} row @param {string} name */
const drawChart = (trace, row, name) => {
  const value = trace.value.map((each) => each[row]);
  const bound = trace.bound.map((each) => each[row]);
  const logarithmic = symbol(name) === "V";
  const scale = (/** @type {number} */ number) => (logarithmic ? Math.log10(Math.max(number, LEAST)) : number);
  const limit = trace.limit.map((each) => each[row]);
  const all = [...value, ...bound, ...limit].map(scale);
  const low = logarithmic ? Math.floor(Math.min(...all)) : Math.min(...all);
  const high = logarithmic ? Math.ceil(Math.max(...all)) : Math.max(...all);
  const x = (/** @type {number} */ tau) => EDGE.left + tau * (WIDTH - EDGE.left - EDGE.right);
  const y = (/** @type {number} */ number) =>
    HEIGHT - EDGE.bottom - ((scale(number) - low) / Math.max(high - low, 1e-9)) * (HEIGHT - EDGE.top - EDGE.bottom);
  const line = (/** @type {number[]} */ numbers) => "M" + trace.tau.map((tau, k) => `${x(tau).toFixed(1)} ${y(numbers[k]).toFixed(1)}`).join("L");
  const ticks = logarithmic ? powers(low, high) : [low, ...(apart(0, low, high) ? [0] : []), high];
  const title = svg("text", { x: EDGE.left, y: 13 });
  const cursor = svg("line", { class: "cursor", y1: EDGE.top, y2: HEIGHT - EDGE.bottom });
  const foot = HEIGHT - EDGE.bottom;
  const root = svg(
    "svg",
    { class: "chart", viewBox: `0 0 ${WIDTH} ${HEIGHT}`, role: "img", "aria-label": `${symbol(name)} of ${name} under its bound over tau` },
    svg("path", { class: "below", d: `${line(bound)}L${x(1)} ${foot}L${x(0)} ${foot}Z` }),
    ...ticks.map((tick) => svg("line", { class: "grid", x1: x(0), x2: x(1), y1: y(logarithmic ? 10 ** tick : tick), y2: y(logarithmic ? 10 ** tick : tick) })),
    svg("path", { class: "axis", d: `M${x(0)} ${EDGE.top}V${foot}H${x(1)}` }),
    svg("path", { class: "limit", d: line(limit) }),
    svg("path", { class: "bound", d: line(bound) }),
    svg("path", { class: "value", d: line(value) }),
    cursor,
    title,
  );
  for (const tick of ticks) {
    const at = y(logarithmic ? 10 ** tick : tick) + 4;
    root.append(text(logarithmic ? `1e${tick}` : tick.toPrecision(2), { x: EDGE.left - 6, y: at, "text-anchor": "end" }));
  }
  for (const tau of [0, 0.5, 1]) root.append(text(String(tau), { x: x(tau), y: foot + 15, "text-anchor": "middle" }));
  root.append(text("generative time τ (bound dashed, limit of discrete steps dotted)", { x: x(0.5), y: HEIGHT - 5, "text-anchor": "middle" }));
  return { root, cursor, title };
};

/** Whether a tick has room between the ends. @param {number} tick @param {number} low @param {number} high */
const apart = (tick, low, high) => Math.min(tick - low, high - tick) > 0.12 * (high - low);

/** @param {number} low @param {number} high */
const powers = (low, high) => {
  const step = Math.max(1, Math.ceil((high - low) / 4));
  return Array.from({ length: Math.floor((high - low) / step) + 1 }, (_, k) => low + k * step);
};

/** @param {string} words @param {Record<string, string | number>} attributes */
const text = (words, attributes) => svg("text", attributes, words);
