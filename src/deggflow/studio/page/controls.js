// @ts-check
/** The panel beside the pictures: everything that can be dragged, as fields, and what else can be asked for. */

import { byId, html } from "./elements.js";
import { numberField, put, randomFields, sampleFields } from "./fields.js";
import { filled, round, spoken, typeName } from "./geometry.js";

/** @typedef {import("./types.js").Library} Library */

const FAMILIES = ["changed", "default", "opposite", "side", "larger", "combined", "balanced"];
export class Controls {
  /** @param {import("./studio.js").Studio} studio @param {Library} library */
  constructor(studio, library) {
    this.studio = studio;
    this.library = library;
    this.boxes = Object.keys(library.objects).map((name) => this.objectBox(name));
    this.selected = byId("selected", HTMLSelectElement);
    this.selected.addEventListener("change", () => {
      studio.selected = this.selected.value;
      studio.onChange();
    });
    this.requirement = this.requirementFields();
    this.shared = this.sharedFields();
    this.refreshSample = sampleFields(studio, "generate", () => studio.generate());
    this.draw = this.drawField();
    this.family = this.familyField();
    randomFields(studio, "objects", { min: 1, max: 12 }, 8, async (asked) => {
      const { condition } = await studio.connection.ask("draw", { ...asked, family: this.family.value });
      studio.draw = null;
      studio.edit(condition);
    });
  }

  /** @param {string} name */
  objectBox(name) {
    const box = /** @type {HTMLInputElement} */ (html("input", { type: "checkbox", "data-object": name }));
    box.addEventListener("change", () => {
      const { condition } = this.studio;
      const objects = box.checked ? [...condition.objects, name] : condition.objects.filter((each) => each !== name);
      if (objects.length === 0) {
        box.checked = true;
        return;
      }
      const requirements = { ...condition.requirements };
      if (!box.checked) delete requirements[name];
      this.studio.edit({ ...condition, objects, requirements });
    });
    byId("objects").append(html("label", {}, box, spoken(name)));
    return box;
  }

  requirementFields() {
    const home = byId("requirement");
    const change = (/** @type {import("./types.js").Affordance} */ part) => {
      if (this.studio.selected) this.studio.require(this.studio.selected, part);
    };
    byId("reset-requirement").addEventListener("click", () => {
      const { condition, selected } = this.studio;
      const requirements = { ...condition.requirements };
      if (selected) delete requirements[selected];
      this.studio.edit({ ...condition, requirements });
    });
    return {
      direction: numberField(home, "direction", "direction, degrees", { min: -360, max: 360, step: 1 }, (value) =>
        change({ direction: round((value * Math.PI) / 180) }),
      ),
      offset_scale: numberField(home, "offset", "offset, times default", { min: 0.01, max: 10, step: 0.01 }, (value) =>
        change({ offset_scale: value }),
      ),
      radius_scale: numberField(home, "radius", "radius, times default", { min: 0.01, max: 10, step: 0.01 }, (value) =>
        change({ radius_scale: value }),
      ),
    };
  }

  sharedFields() {
    const { studio } = this;
    const table = (/** @type {object} */ part) =>
      studio.edit({ ...studio.condition, table: { ...this.library.table, ...studio.condition.table, ...part } });
    const balance = (/** @type {object} */ part) =>
      studio.edit({ ...studio.condition, balance: { x: 0, y: 0, radius: 0.05, ...studio.condition.balance, ...part } });
    const tables = byId("table");
    const balances = byId("balance");
    const balanced = byId("balanced", HTMLInputElement);
    balanced.addEventListener("change", () => {
      const { balance: _, ...rest } = studio.condition;
      studio.edit(balanced.checked ? { ...rest, balance: { x: 0, y: 0, radius: 0.05 } } : rest);
    });
    const size = { min: 0.1, max: 5, step: 0.01 };
    const place = { min: -5, max: 5, step: 0.01 };
    return {
      width: numberField(tables, "width", "width, m", size, (width) => table({ width })),
      depth: numberField(tables, "depth", "depth, m", size, (depth) => table({ depth })),
      balanced,
      x: numberField(balances, "balance-x", "x, m", place, (x) => balance({ x })),
      y: numberField(balances, "balance-y", "y, m", place, (y) => balance({ y })),
      radius: numberField(balances, "balance-radius", "radius, m", { min: 0.001, max: 5, step: 0.001 }, (radius) => balance({ radius })),
    };
  }

  drawField() {
    const { studio } = this;
    const draw = byId("draw", HTMLSelectElement);
    draw.append(html("option", { value: "" }, "first that is satisfied"));
    for (let k = 0; k < 8; k++) draw.append(html("option", { value: k }, `only draw ${k + 1}`));
    draw.addEventListener("change", () => {
      studio.draw = draw.value === "" ? null : Number(draw.value);
      studio.generate();
    });
    return draw;
  }

  familyField() {
    const family = byId("family", HTMLSelectElement);
    family.append(...FAMILIES.map((name) => html("option", { value: name }, name)));
    return family;
  }

  /** Shows the state, but in a field that is being written in. */
  refresh() {
    const { condition, selected, draw } = this.studio;
    for (const box of this.boxes) {
      const name = box.getAttribute("data-object") ?? "";
      box.checked = condition.objects.some((each) => typeName(each) === name);
    }
    if (this.selected.dataset.objects !== condition.objects.join()) {
      this.selected.dataset.objects = condition.objects.join();
      this.selected.replaceChildren(...condition.objects.map((name) => html("option", { value: name }, spoken(name))));
    }
    this.studio.selected ??= condition.objects[0] ?? null;
    this.selected.value = selected ?? condition.objects[0] ?? "";
    const need = filled(condition.requirements?.[this.selected.value]);
    put(this.requirement.direction, round((180 / Math.PI) * need.direction, 1));
    put(this.requirement.offset_scale, round(need.offset_scale, 3));
    put(this.requirement.radius_scale, round(need.radius_scale, 3));
    const { width, depth } = condition.table ?? this.library.table;
    put(this.shared.width, width);
    put(this.shared.depth, depth);
    const circle = { x: 0, y: 0, radius: 0.05, ...condition.balance };
    this.shared.balanced.checked = condition.balance !== undefined;
    byId("balance").toggleAttribute("hidden", condition.balance === undefined);
    for (const name of /** @type {const} */ (["x", "y", "radius"])) put(this.shared[name], round(circle[name], 3));
    this.draw.value = draw === null ? "" : String(draw);
    this.refreshSample();
  }
}
