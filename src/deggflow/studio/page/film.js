// @ts-check
/** A video that the server makes beside everything else: its progress, and a way to stop it. */

import { Connection } from "./connection.js";
import { button, html } from "./elements.js";

/** @typedef {{name: string, type: string, content: string}} Made a file, in base64 */

export class Film {
  /**
   * @param {string} what is filmed
   * @param {() => Promise<object>} fields of the message
   * @param {(made: Made) => void} onMade
   * @param {(error: Error | null) => void} onTrouble
   */
  constructor(what, fields, onMade, onTrouble) {
    this.what = what;
    this.fields = fields;
    this.onMade = onMade;
    this.onTrouble = onTrouble;
    /** @type {Connection | null} of its own: other questions do not wait for the video */
    this.connection = null;
    this.button = /** @type {HTMLButtonElement} */ (button("Video (MP4)", { id: "film" }, () => this.begin()));
    this.bar = /** @type {HTMLProgressElement} */ (html("progress", { "aria-label": "Progress of the video" }));
    this.text = html("span", { role: "status" });
    const stop = button("Stop the video", { id: "stop-film" }, () => this.end());
    this.progress = html("div", { class: "film", hidden: "" }, this.bar, this.text, stop);
  }

  async begin() {
    this.onTrouble(null);
    try {
      const fields = await this.fields();
      this.button.disabled = true;
      this.progress.hidden = false;
      this.show({ frame: 0, frames: 0 });
      this.connection = new Connection("film", (open, connection) => {
        if (open) this.ask(connection, fields);
        else this.end();
      });
    } catch (error) {
      this.onTrouble(/** @type {Error} */ (error));
    }
  }

  /** @param {Connection} connection @param {object} fields */
  async ask(connection, fields) {
    try {
      this.onMade(await connection.ask(this.what, fields, (part) => this.show(part)));
    } catch (error) {
      if (this.connection) this.onTrouble(/** @type {Error} */ (error)); // else it was stopped
    }
    this.end();
  }

  /** @param {{frame: number, frames: number}} part frames 0: it has not begun */
  show({ frame, frames }) {
    if (frames) this.bar.value = frame / frames;
    else this.bar.removeAttribute("value");
    this.text.textContent = frames ? `picture ${frame} of ${frames}` : "starting the video";
  }

  end() {
    const { connection } = this;
    this.connection = null;
    connection?.close();
    this.button.disabled = false;
    this.progress.hidden = true;
  }
}
