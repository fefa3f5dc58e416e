// @ts-check
/** A table of margins; each can be shown on the picture. */

import { button, byId, html, numberCell, svg, table } from "./elements.js";

/** @typedef {import("./types.js").Spot} Spot */
/** @typedef {{margin: number, gap: [Spot, Spot]}} Gap the points whose distance a margin (m) is */

/**
 * What a row of the table says.
 * @typedef {object} Words
 * @property {string} key the same for the same requirement of another scene
 * @property {string} name
 * @property {string[]} cells further columns
 */

const FEW = 12; // margins that are listed at first

/** @template {Gap} M */
export class MarginTable {
  /**
   * @param {string[]} heads of name and further columns
   * @param {(margin: M) => Words} words
   * @param {(margin: M | null, chosen: boolean) => void} onMark null: none is shown; chosen: just now
   */
  constructor(heads, words, onMark) {
    this.words = words;
    this.onMark = onMark;
    this.all = false;
    /** @type {string | null} */
    this.marked = null;
    /** @type {M[]} */
    this.margins = [];
    this.body = html("tbody");
    this.more = button("", {}, () => {
      this.all = !this.all;
      this.draw(this.margins);
    });
    byId("margins").append(table([...heads, "-margin, mm"], this.body), this.more);
  }

  /** @param {M[]} margins the least first */
  draw(margins) {
    this.margins = margins;
    const rows = this.all ? margins : margins.slice(0, FEW);
    this.body.replaceChildren(...rows.map((margin) => this.row(margin)));
    this.more.textContent = this.all ? `Show the ${FEW} least` : `Show all ${margins.length}`;
    this.more.toggleAttribute("hidden", margins.length <= FEW);
    this.remark();
  }

  /** @param {M} margin */
  row(margin) {
    const { key, name, cells } = this.words(margin);
    const choose = button(name, { class: "plain" }, () => {
      this.marked = this.marked === key ? null : key;
      this.remark(true);
    });
    const row = html("tr", { "data-key": key }, html("td", {}, choose), ...cells.map((cell) => html("td", {}, cell)), numberCell(millimetres(margin.margin)));
    row.classList.toggle("wrong", !(margin.margin >= 0));
    return row;
  }

  remark(chosen = false) {
    for (const row of this.body.children) {
      const here = row.getAttribute("data-key") === this.marked;
      row.setAttribute("aria-selected", String(here));
      row.querySelector("button")?.setAttribute("aria-pressed", String(here));
    }
    this.onMark(this.margins.find((margin) => this.words(margin).key === this.marked) ?? null, chosen);
  }
}

/** @param {number} value m */
export const millimetres = (value) => (1000 * value).toFixed(1);

/**
 * Draws a margin where it is, or none.
 * @param {SVGElement} group whose y points up
 * @param {SVGElement} labels whose y points down
 * @param {Gap | null} margin
 * @param {number} pixel m
 * @param {(x: number, words: string) => number} within where the middle of a text has room
 */
export const drawGap = (group, labels, margin, pixel, within) => {
  group.replaceChildren();
  labels.querySelector(".gap-text")?.remove();
  if (!margin) return;
  const [[x1, y1], [x2, y2]] = margin.gap;
  const wrong = !(margin.margin >= 0);
  group.classList.toggle("wrong", wrong);
  const end = 3 * pixel;
  group.append(svg("line", { x1, y1, x2, y2 }), svg("circle", { cx: x1, cy: y1, r: end }), svg("circle", { cx: x2, cy: y2, r: end }));
  const words = `${millimetres(margin.margin)} mm`;
  const text = svg("text", { class: "gap-text", x: within((x1 + x2) / 2, words), y: -(y1 + y2) / 2 - 7 * pixel }, words);
  text.classList.toggle("wrong", wrong);
  labels.append(text);
};
