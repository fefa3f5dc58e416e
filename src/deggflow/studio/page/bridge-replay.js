// @ts-check
/** Plays a trial, guided and nominal, at the screen's rate. */

import { byId } from "./elements.js";
import { Player } from "./player.js";

/** @typedef {import("./types.js").Pose} Pose */
/** @typedef {{poses: Pose[], twists: Pose[]}} Motion */

export class BridgeReplay {
  /** @param {number} dt s of an action @param {(guided: Pose | null, nominal: Pose | null, time: number) => void} onPoses */
  constructor(dt, onPoses) {
    this.dt = dt;
    this.onPoses = onPoses;
    /** @type {Motion | null} */
    this.guided = null;
    /** @type {Motion | null} */
    this.nominal = null;
    this.slider = byId("time", HTMLInputElement);
    this.player = new Player(
      this.slider,
      (time) => this.show(time),
      () => {
        const from = this.slider.valueAsNumber >= this.duration - 1e-6 ? 0 : this.slider.valueAsNumber;
        this.player.run(from, this.duration, Number(byId("speed", HTMLSelectElement).value));
      },
    );
  }

  get duration() {
    return this.dt * Math.max(this.guided?.twists.length ?? 0, this.nominal?.twists.length ?? 0);
  }

  /** @param {Motion | null} guided @param {Motion | null} nominal @param {number} time s, to be shown */
  reset(guided, nominal, time) {
    this.player.stop();
    this.guided = guided;
    this.nominal = nominal;
    this.slider.max = String(Math.max(this.duration, this.dt));
    this.show(time);
  }

  /** @param {number} time s */
  show(time) {
    this.slider.value = String(time);
    const words = `${time.toFixed(1)} s`;
    byId("time-text").textContent = words;
    this.slider.setAttribute("aria-valuetext", words);
    this.onPoses(this.at(this.guided, time), this.at(this.nominal, time), time);
  }

  /** @param {Motion | null} motion @param {number} time @returns {Pose | null} */
  at(motion, time) {
    if (!motion?.poses.length) return null;
    const k = Math.floor(time / this.dt + 1e-9);
    if (k >= motion.twists.length) return motion.poses[motion.poses.length - 1];
    return moved(motion.poses[k], motion.twists[k], time - k * this.dt);
  }
}

/** A pose after a constant body twist, along its circle. @param {Pose} pose @param {Pose} twist @param {number} seconds @returns {Pose} */
export const moved = ([x, y, theta], [vx, vy, omega], seconds) => {
  const turn = omega * seconds;
  const along = Math.abs(turn) < 1e-6 ? seconds : Math.sin(turn) / omega;
  const across = Math.abs(turn) < 1e-6 ? (turn * seconds) / 2 : (1 - Math.cos(turn)) / omega;
  const [u, v] = [along * vx - across * vy, across * vx + along * vy];
  const [cos, sin] = [Math.cos(theta), Math.sin(theta)];
  return [x + cos * u - sin * v, y + sin * u + cos * v, theta + turn];
};
