// @ts-check
/** Scenes that were kept or opened, as small pictures. */

import { byId, html, svg } from "./elements.js";
import { Picture } from "./picture.js";

export class Gallery {
  /** @param {import("./studio.js").Studio} studio @param {import("./types.js").Library} library */
  constructor(studio, library) {
    this.studio = studio;
    this.library = library;
    /** @type {WeakMap<object, Element>} */
    this.made = new WeakMap();
  }

  refresh() {
    const { gallery } = this.studio;
    byId("save-all", HTMLButtonElement).disabled = gallery.length === 0;
    const items = gallery.map((entry, k) => this.made.get(entry) ?? this.make(entry, k));
    const home = byId("gallery");
    if (items.length !== home.children.length || items.some((each, k) => each !== home.children[k])) {
      home.replaceChildren(...items);
    }
  }

  /** @param {import("./studio.js").Studio["gallery"][number]} entry @param {number} number */
  make(entry, number) {
    const root = svg("svg", { class: "picture", "aria-hidden": "true" });
    new Picture(root, this.library, { labels: false }).draw(entry.condition, entry.poses, null);
    const words = entry.satisfied ? "all requirements hold" : (entry.reason ?? "not satisfied");
    const caption = html("span", entry.satisfied ? {} : { class: "wrong" }, words);
    const open = html("button", { type: "button", class: "open", "aria-label": `Show scene ${number + 1}: ${words}` }, root, caption);
    open.addEventListener("click", () => this.studio.show(entry.line));
    const remove = html("button", { type: "button", class: "remove", "aria-label": `Remove scene ${number + 1}` }, "×");
    remove.addEventListener("click", () => {
      this.studio.gallery = this.studio.gallery.filter((each) => each !== entry);
      this.studio.keep();
      this.studio.onChange();
    });
    const item = html("li", {}, open, remove);
    this.made.set(entry, item);
    return item;
  }
}
