// @ts-check
/** The certificate as tables; every margin can be shown on the picture. */

import { byId, html, numberCell, table } from "./elements.js";
import { spoken } from "./geometry.js";
import { showFacts } from "./page.js";

/** @typedef {import("./types.js").Margin} Margin */
/** @typedef {import("./studio.js").Shown} Shown */

const FEW = 12; // margins that are listed at first

export class CertificateView {
  /** @param {(margin: Margin | null) => void} onMark */
  constructor(onMark) {
    this.onMark = onMark;
    this.all = false;
    /** @type {string | null} */
    this.marked = null;
    /** @type {Margin[]} */
    this.margins = [];
    const body = html("tbody");
    this.body = body;
    this.more = html("button", { type: "button" });
    this.more.addEventListener("click", () => {
      this.all = !this.all;
      if (this.shown) this.draw(this.shown);
    });
    byId("margins").append(table(["requirement", "between", "-margin, mm"], body), this.more);
    /** @type {Shown | null} */
    this.shown = null;
  }

  /** @param {Shown} shown */
  draw(shown) {
    this.shown = shown;
    const { judgement, condition, scene } = shown;
    this.margins = judgement.margins;
    const generated = shown.origin === "generated";
    showFacts([
      ["requirements", judgement.satisfied ? "all hold" : "NOT satisfied"],
      ["least margin", `${millimetres(judgement.min_margin)} mm`],
      ["V at the end", `${judgement.violation.toPrecision(3)} m²`],
      ["least margin by Shapely", `${millimetres(judgement.oracle_margin)} mm`],
      ["draws", generated ? String(scene.certificate.draws) : "-"],
      ["hypotheses", generated ? hypotheses(scene.certificate.generation) : origins[shown.origin]],
    ]);
    byId("requirements").replaceChildren(...(generated ? [records(scene.certificate.generation)] : []));
    const rows = this.all ? this.margins : this.margins.slice(0, FEW);
    this.body.replaceChildren(...rows.map((margin) => this.row(margin, condition.objects)));
    this.more.textContent = this.all ? `Show the ${FEW} least` : `Show all ${this.margins.length}`;
    this.more.toggleAttribute("hidden", this.margins.length <= FEW);
    this.remark();
  }

  /** @param {Margin} margin @param {string[]} objects */
  row(margin, objects) {
    const key = keyOf(margin);
    const [kind, between] = words(margin, objects);
    const name = html("button", { type: "button", class: "plain" }, kind);
    name.addEventListener("click", () => {
      this.marked = this.marked === key ? null : key;
      this.remark();
    });
    name.setAttribute("aria-pressed", String(this.marked === key));
    const row = html(
      "tr",
      { "data-key": key },
      html("td", {}, name),
      html("td", {}, between),
      numberCell(millimetres(margin.margin)),
    );
    row.classList.toggle("wrong", !(margin.margin >= 0));
    return row;
  }

  remark() {
    for (const row of this.body.children) {
      const here = row.getAttribute("data-key") === this.marked;
      row.setAttribute("aria-selected", String(here));
      row.querySelector("button")?.setAttribute("aria-pressed", String(here));
    }
    this.onMark(this.margins.find((margin) => keyOf(margin) === this.marked) ?? null);
  }
}

const origins = {
  generated: "",
  edited: "edited since it was generated",
  moved: "moved by hand",
  file: "from a file or the gallery, judged anew",
};

/** @param {Margin} margin */
const keyOf = ({ kind, owner, region, other }) => `${kind} ${owner} ${region} ${other}`;

/** @param {number} value */
const millimetres = (value) => (1000 * value).toFixed(1);

/** @param {Margin} margin @param {string[]} objects @returns {[string, string]} */
const words = (margin, objects) => {
  const owner = spoken(objects[margin.owner] ?? "all objects");
  const region = margin.region >= 0 ? `region ${margin.region + 1} of ${owner}` : owner;
  const other = margin.other >= 0 ? spoken(objects[margin.other]) : margin.kind === "balance" ? "circle" : "table's edge";
  const kinds = /** @type {Record<string, string>} */ ({
    separation: "apart from others",
    unobstructed: "region free",
    "object on table": "on the table",
    "region on table": "region on the table",
    balance: "balance",
  });
  return [kinds[margin.kind], `${region}, ${other}`];
};

/** @param {any} generation */
const hypotheses = (generation) => {
  if (!generation) return "-";
  return generation.hypotheses_hold ? `hold at all ${generation.steps + 1} points` : generation.first_failure;
};

/** @param {any} generation */
const records = (generation) => {
  const heads = ["guided by", "-value at the end", "-limit", "-largest excess", "-active at", "-smallest |ell|"];
  const rows = (generation?.requirements ?? []).map((/** @type {any} */ each) => {
    const numbers = [each.value, each.limit, each.excess].map((value) => value.toPrecision(3));
    const norm = each.smallest_ell_norm === null ? "-" : each.smallest_ell_norm.toPrecision(3);
    const cells = [...numbers, `${each.active_points} points`, norm];
    return html("tr", {}, html("td", {}, each.name), ...cells.map(numberCell));
  });
  return table(heads, html("tbody", {}, ...rows));
};
