// @ts-check
/** Results that were kept or opened, as small pictures. */

import { byId, html, svg } from "./elements.js";
import { offer } from "./files.js";

/** @typedef {import("./session.js").Entry} Entry */

/** @typedef {import("./session.js").Session & {show(entry: Entry): unknown, keepShown(): unknown}} Keeper */

export class Gallery {
  /**
   * @param {Keeper} session
   * @param {string} what "scene"
   * @param {(root: SVGSVGElement, line: any) => void} draw a result's small picture
   */
  constructor(session, what, draw) {
    this.session = session;
    this.what = what;
    this.draw = draw;
    /** @type {WeakMap<Entry, Element>} */
    this.made = new WeakMap();
    byId("keep").addEventListener("click", () => session.attempt(() => session.keepShown()));
    byId("save-all").addEventListener("click", () => {
      offer(`${what}s.jsonl`, session.gallery.map(({ line }) => `${line}\n`).join(""), "application/jsonl");
    });
  }

  refresh() {
    const { gallery } = this.session;
    byId("save-all", HTMLButtonElement).disabled = gallery.length === 0;
    const items = gallery.map((entry, k) => this.made.get(entry) ?? this.make(entry, k));
    const home = byId("gallery");
    if (items.length !== home.children.length || items.some((each, k) => each !== home.children[k])) {
      home.replaceChildren(...items);
    }
  }

  /** @param {Entry} entry @param {number} number */
  make(entry, number) {
    const root = /** @type {SVGSVGElement} */ (svg("svg", { class: "picture", "aria-hidden": "true" }));
    this.draw(root, JSON.parse(entry.line));
    const words = entry.satisfied ? "all requirements hold" : (entry.reason ?? "not satisfied");
    const caption = html("span", entry.satisfied ? {} : { class: "wrong" }, words);
    const open = html("button", { type: "button", class: "open", "aria-label": `Show ${this.what} ${number + 1}: ${words}` }, root, caption);
    open.addEventListener("click", () => this.session.show(entry));
    const remove = html("button", { type: "button", class: "remove", "aria-label": `Remove ${this.what} ${number + 1}` }, "×");
    remove.addEventListener("click", () => this.session.remove(entry));
    const item = html("li", {}, open, remove);
    this.made.set(entry, item);
    return item;
  }
}
