// @ts-check
/** A slider of time with a button that plays it, at the screen's rate. */

import { byId } from "./elements.js";

export class Player {
  /**
   * @param {HTMLInputElement} slider
   * @param {(at: number) => void} show
   * @param {() => void} onPlay the button was pressed: `run` is to be called
   */
  constructor(slider, show, onPlay) {
    this.slider = slider;
    this.show = show;
    this.frame = 0;
    this.button = byId("play");
    slider.addEventListener("input", () => {
      this.stop();
      show(slider.valueAsNumber);
    });
    this.button.addEventListener("click", () => (this.frame ? this.stop() : onPlay()));
  }

  /** @param {number} from @param {number} to @param {number} rate of the slider's units, each second */
  run(from, to, rate) {
    const start = performance.now();
    this.button.textContent = "Stop";
    const step = (/** @type {number} */ now) => {
      const at = Math.min(from + (rate * Math.max(now - start, 0)) / 1000, to);
      this.slider.value = String(at);
      this.show(at);
      if (at < to) this.frame = requestAnimationFrame(step);
      else this.stop();
    };
    this.frame = requestAnimationFrame(step);
  }

  stop() {
    cancelAnimationFrame(this.frame);
    this.frame = 0;
    this.button.textContent = "Play";
  }
}
