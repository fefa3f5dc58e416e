// @ts-check
/** The certificate as tables; every margin can be shown on the picture. */

import { byId, html, numberCell, table } from "./elements.js";
import { spoken } from "./geometry.js";
import { MarginTable, millimetres } from "./margins.js";
import { showFacts } from "./page.js";

/** @typedef {import("./types.js").Margin} Margin */
/** @typedef {import("./studio.js").Shown} Shown */

export class CertificateView {
  /** @param {(margin: Margin | null) => void} onMark */
  constructor(onMark) {
    /** @type {string[]} */
    this.objects = [];
    /** @type {MarginTable<Margin>} */
    this.table = new MarginTable(["requirement", "between"], (margin) => words(margin, this.objects), onMark);
  }

  /** @param {Shown} shown */
  draw(shown) {
    const { judgement, condition, scene } = shown;
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
    this.objects = condition.objects;
    this.table.draw(judgement.margins);
  }
}

const origins = {
  generated: "",
  edited: "edited since it was generated",
  moved: "moved by hand",
  file: "from a file or the gallery, judged anew",
};

/** @param {Margin} margin @param {string[]} objects @returns {import("./margins.js").Words} */
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
  const key = `${margin.kind} ${margin.owner} ${margin.region} ${margin.other}`;
  return { key, name: kinds[margin.kind], cells: [`${region}, ${other}`] };
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
