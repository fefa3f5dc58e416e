// @ts-check
/** Files in and out; nothing is read or written but what the user chooses. */

import { byId, html } from "./elements.js";

const MAX_FILE = 3 << 20; // bytes

/** The text of a file, if it is not too large. @param {File} file */
export const textOf = (file) => {
  if (file.size > MAX_FILE) throw new Error(`${file.name}: the studio opens files of up to ${MAX_FILE} bytes; this one has ${file.size}`);
  return file.text();
};

export class Files {
  /** @param {import("./studio.js").Studio} studio */
  constructor(studio) {
    this.studio = studio;
    const input = byId("open", HTMLInputElement);
    input.addEventListener("change", async () => {
      const [file] = input.files ?? [];
      if (file) await this.attempt(() => this.open(file));
      input.value = "";
    });
    byId("save").addEventListener("click", () =>
      this.attempt(async () => save("scene.jsonl", `${await studio.currentLine()}\n`, "application/jsonl")),
    );
    byId("save-all").addEventListener("click", () => {
      save("scenes.jsonl", studio.gallery.map(({ line }) => `${line}\n`).join(""), "application/jsonl");
    });
    byId("keep").addEventListener("click", () => this.attempt(() => studio.keepScene()));
    byId("copy").addEventListener("click", () => this.attempt(copyCommand));
    for (const button of document.querySelectorAll("[data-export]")) {
      button.addEventListener("click", () => this.attempt(() => this.export(button.getAttribute("data-export") ?? "")));
    }
  }

  /** @param {File} file */
  async open(file) {
    const { rows } = await this.studio.connection.ask("open", { name: file.name, text: await textOf(file) });
    await this.studio.openRows(rows);
  }

  /** @param {string} kind */
  async export(kind) {
    const { shown } = this.studio;
    if (!shown) throw new Error("There is no scene yet.");
    const { condition, poses } = shown;
    const made = await this.studio.connection.ask("export", { kind, condition, poses });
    const address = saveMade(made);
    if (kind === "png") {
      const image = html("img", { src: address, alt: "The scene with the objects' bodies, by MuJoCo or matplotlib" });
      byId("render").replaceChildren(image);
    }
  }

  /** @param {() => Promise<unknown>} task */
  async attempt(task) {
    try {
      await task();
    } catch (error) {
      this.studio.onTrouble(/** @type {Error} */ (error));
    }
  }
}

let last = "";

/** Offers a file to the user. @param {string} name @param {BlobPart} content @param {string} type */
export const save = (name, content, type) => {
  URL.revokeObjectURL(last);
  last = URL.createObjectURL(new Blob([content], { type }));
  html("a", { href: last, download: name }).click();
  return last;
};

/** Offers a file that the server has made. @param {{name: string, type: string, content: string}} made in base64 */
export const saveMade = ({ name, type, content }) =>
  save(name, Uint8Array.from(atob(content), (letter) => letter.charCodeAt(0)), type);

/** Puts the command on the clipboard, or selects it where the browser forbids that. */
export const copyCommand = async () => {
  try {
    await navigator.clipboard.writeText(byId("command").textContent ?? "");
    byId("copy").textContent = "Copied";
  } catch {
    getSelection()?.selectAllChildren(byId("command"));
    byId("copy").textContent = "Selected: copy it with Ctrl-C";
  }
};
