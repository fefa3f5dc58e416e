// @ts-check
/** Results that were kept or opened, as small pictures. */

import { button, byId, html, svg } from "./elements.js";
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
    this.saver = button("Save all (JSON Lines)", { id: "save-all" }, () => {
      offer(`${what}s.jsonl`, session.gallery.map(({ line }) => `${line}\n`).join(""), "application/jsonl");
    });
    this.home = html("ul", { id: "gallery", "aria-label": `${what}s that were kept or opened` });
    const keep = button(`Keep this ${what}`, { id: "keep" }, () => session.attempt(() => session.keepShown()));
    byId("collection").append(html("div", { class: "buttons" }, keep, this.saver), this.home);
  }

  refresh() {
    const { gallery } = this.session;
    this.saver.toggleAttribute("disabled", gallery.length === 0);
    const items = gallery.map((entry, k) => this.made.get(entry) ?? this.make(entry, k));
    const { children } = this.home;
    if (items.length !== children.length || items.some((each, k) => each !== children[k])) {
      this.home.replaceChildren(...items);
    }
  }

  /** @param {Entry} entry @param {number} number */
  make(entry, number) {
    const root = /** @type {SVGSVGElement} */ (svg("svg", { class: "picture", "aria-hidden": "true" }));
    this.draw(root, JSON.parse(entry.line));
    const words = entry.satisfied ? "all requirements hold" : (entry.reason ?? "not satisfied");
    const caption = html("span", entry.satisfied ? {} : { class: "wrong" }, words);
    const open = button("", { class: "open", "aria-label": `Show ${this.what} ${number + 1}: ${words}` }, () => this.session.show(entry));
    open.append(root, caption);
    const remove = button("×", { class: "remove", "aria-label": `Remove ${this.what} ${number + 1}` }, () => this.session.remove(entry));
    const item = html("li", {}, open, remove);
    this.made.set(entry, item);
    return item;
  }
}
