// @ts-check
/** The generation over tau: both scenes on their way, and V under its bound. */

import { drawChart, moveCursor } from "./chart.js";
import { byId } from "./elements.js";
import { between } from "./geometry.js";
import { Player } from "./player.js";

/** @typedef {import("./types.js").Pose} Pose */
/** @typedef {import("./types.js").Trace} Trace */
/** @typedef {import("./types.js").Replay} Replay */

const DURATION = 4; // s of a replay

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
    /** @type {import("./chart.js").Chart[]} */
    this.charts = [];
    this.scene = 0; // counts the scenes that were shown
    this.slider = byId("tau", HTMLInputElement);
    this.text = byId("tau-text");
    this.player = new Player(
      this.slider,
      (tau) => this.showAt(tau),
      async () => {
        if (await this.loaded()) this.player.run(0, 1, 1 / DURATION);
      },
    );
  }

  /** Another scene. @param {Trace | null} trace */
  reset(trace) {
    this.player.stop();
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

  drawCharts() {
    const { trace } = this;
    const home = byId("charts");
    this.charts = [];
    home.replaceChildren();
    trace?.names.forEach((name, row) => {
      const column = (/** @type {number[][]} */ rows) => rows.map((each) => each[row]);
      const chart = drawChart({
        name: `${symbol(name)} of ${name}`,
        tau: trace.tau,
        value: column(trace.value),
        bound: column(trace.bound),
        limit: column(trace.limit),
        logarithmic: symbol(name) === "V",
      });
      home.append(chart.root);
      this.charts.push(chart);
    });
  }

  /** @param {number} tau */
  point(tau) {
    this.text.textContent = `τ = ${tau.toFixed(2)}`;
    for (const chart of this.charts) moveCursor(chart, tau);
  }
}

/** @param {string} name */
const symbol = (name) => (name === "balance" ? "q" : "V");
