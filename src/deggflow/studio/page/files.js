// @ts-check
/** Files in and out; nothing is read or written but what the user chooses. */

import { button, byId, html } from "./elements.js";
import { Film } from "./film.js";

/**
 * What a page saves.
 * @typedef {object} Made
 * @property {string} what "scene"
 * @property {() => Promise<string> | string} line of what is shown, as in a file
 * @property {() => object} fields that tell the server what is shown; an error if there is nothing
 * @property {() => Promise<object>} film fields of the message for a video
 */

const MAX_FILE = 3 << 20; // bytes
const EXPORTS = { svg: "SVG", png: "PNG, in 3-D", glb: "3-D model (GLB)", mjcf: "MuJoCo (MJCF)" };

/** The text of a file, if it is not too large. @param {File} file */
const textOf = (file) => {
  if (file.size > MAX_FILE) throw new Error(`${file.name}: the studio opens files of up to ${MAX_FILE} bytes; this one has ${file.size}`);
  return file.text();
};

export class Files {
  /** @param {import("./session.js").Session & {openRows(rows: any[]): Promise<void> | void}} session @param {Made} made */
  constructor(session, made) {
    this.session = session;
    this.made = made;
    const { what } = made;
    this.note = html("p", { class: "soft" });
    this.command = html("code", { id: "command" });
    this.copied = button("", { id: "copy" }, () => this.copy());
    this.render = html("div", { id: "render" });
    const save = () => session.attempt(async () => offer(`${what}.jsonl`, `${await made.line()}\n`, "application/jsonl"));
    const exports = Object.entries(EXPORTS).map(([kind, name]) =>
      button(name, { "data-export": kind }, () => session.attempt(() => this.export(kind))),
    );
    const film = new Film(what, made.film, (file) => offerMade(file), session.onTrouble);
    byId("files").append(
      html("div", { class: "buttons" }, this.opener(), button(`Save ${what} (JSON Lines)`, { id: "save" }, save), ...exports, film.button),
      film.progress,
      this.render,
      this.note,
      html("pre", {}, this.command),
      this.copied,
    );
    this.showCommand(null);
  }

  opener() {
    const input = /** @type {HTMLInputElement} */ (html("input", { id: "open", type: "file", accept: ".jsonl,.json,.ndjson" }));
    input.addEventListener("change", async () => {
      const [file] = input.files ?? [];
      if (file) {
        await this.session.attempt(async () => {
          const { rows } = await this.session.connection.ask("open", { name: file.name, text: await textOf(file) });
          await this.session.openRows(rows);
        });
      }
      input.value = "";
    });
    return html("label", { class: "button" }, `Open ${this.made.what}s or conditions`, input);
  }

  /** @param {string} kind */
  async export(kind) {
    const address = offerMade(await this.session.connection.ask("export", { kind, ...this.made.fields() }));
    if (kind === "png") {
      this.render.replaceChildren(html("img", { src: address, alt: `The ${this.made.what} with its bodies, by MuJoCo or matplotlib` }));
    }
  }

  /** @param {string | null} command @param {string} without why there is none */
  showCommand(command, without = "") {
    this.note.textContent = command ? `The command that makes this ${this.made.what}:` : without;
    this.command.textContent = command ?? "";
    this.copied.hidden = this.command.hidden = command === null;
    this.copied.textContent = "Copy command";
  }

  /** Puts the command on the clipboard, or selects it where the browser forbids that. */
  async copy() {
    try {
      await navigator.clipboard.writeText(this.command.textContent ?? "");
      this.copied.textContent = "Copied";
    } catch {
      getSelection()?.selectAllChildren(this.command);
      this.copied.textContent = "Selected: copy it with Ctrl-C";
    }
  }
}

let last = "";

/** Offers a file to the user. @param {string} name @param {BlobPart} content @param {string} type */
export const offer = (name, content, type) => {
  URL.revokeObjectURL(last);
  last = URL.createObjectURL(new Blob([content], { type }));
  html("a", { href: last, download: name }).click();
  return last;
};

/** Bytes of a file that the server has made. @param {{content: string}} made in base64 */
export const bytesOf = ({ content }) => Uint8Array.from(atob(content), (letter) => letter.charCodeAt(0));

/** Offers a file that the server has made. @param {{name: string, type: string, content: string}} made */
const offerMade = (made) => offer(made.name, bytesOf(made), made.type);
