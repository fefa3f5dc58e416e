// @ts-check
/** The panel beside the bridge: everything that can be dragged, as fields, and what else can be asked for. */

import { freeContact, moveContact } from "./bridge-grips.js";
import { byId, html } from "./elements.js";
import { numberField, put, randomFields, sampleFields } from "./fields.js";
import { round } from "./geometry.js";

/** @typedef {import("./bridge-types.js").World} World */

const SPEED = 0.3; // m/s, the first limit that is offered

export class BridgeControls {
  /** @param {import("./bridge-studio.js").BridgeStudio} studio @param {World} world */
  constructor(studio, world) {
    this.studio = studio;
    this.world = world;
    this.places = { plank: this.placeFields("plank"), goal: this.placeFields("goal") };
    this.refreshSample = sampleFields(studio, "run", () => studio.run());
    this.limit = this.limitFields();
    this.robotButtons();
    randomFields(studio, "robots", { min: world.min_robots, max: world.max_robots }, 4, async (asked) =>
      studio.edit((await studio.connection.ask("random", asked)).condition),
    );
  }

  /** @param {"plank" | "goal"} which */
  placeFields(which) {
    const { studio, world } = this;
    const home = byId(`${which}-fields`);
    const change = (/** @type {object} */ part) => studio.edit({ [which]: { ...studio.condition[which], ...part } });
    return {
      x: numberField(home, `${which}-x`, "x, m", { min: world.x_min, max: world.x_max, step: 0.01 }, (x) => change({ x })),
      y: numberField(home, `${which}-y`, "y, m", { min: world.y_min, max: world.y_max, step: 0.01 }, (y) => change({ y })),
      theta: numberField(home, `${which}-theta`, "angle, degrees", { min: -180, max: 180, step: 0.1 }, (value) =>
        change({ theta: round((value * Math.PI) / 180) }),
      ),
    };
  }

  robotButtons() {
    const { studio, world } = this;
    byId("add-robot").addEventListener("click", () => {
      const { contacts } = studio.condition;
      const contact = freeContact(contacts, world);
      if (contact && contacts.length < world.max_robots) studio.edit({ contacts: [...contacts, contact] });
    });
    byId("remove-robot").addEventListener("click", () => {
      const { contacts } = studio.condition;
      if (contacts.length > world.min_robots) studio.edit({ contacts: contacts.slice(0, -1) });
    });
  }

  limitFields() {
    const { studio } = this;
    const change = (/** @type {number | null} */ limit) => {
      studio.speedLimit = limit;
      studio.run();
    };
    const limited = byId("limited", HTMLInputElement);
    limited.addEventListener("change", () => change(limited.checked ? SPEED : null));
    return { limited, value: numberField(byId("limit"), "speed-limit", "at most, m/s", { min: 0.01, max: 10, step: 0.01 }, change) };
  }

  /** Shows the state, but in a field that is being written in. */
  refresh() {
    const { condition, speedLimit } = this.studio;
    for (const which of /** @type {const} */ (["plank", "goal"])) {
      const { x, y, theta } = condition[which];
      put(this.places[which].x, round(x, 2));
      put(this.places[which].y, round(y, 2));
      put(this.places[which].theta, round((180 / Math.PI) * theta, 1));
    }
    this.refreshSample();
    this.limit.limited.checked = speedLimit !== null;
    byId("limit").toggleAttribute("hidden", speedLimit === null);
    put(this.limit.value, speedLimit ?? SPEED);
    byId("add-robot", HTMLButtonElement).disabled = condition.contacts.length >= this.world.max_robots;
    byId("remove-robot", HTMLButtonElement).disabled = condition.contacts.length <= this.world.min_robots;
    this.refreshContacts();
  }

  refreshContacts() {
    const { contacts } = this.studio.condition;
    const home = byId("contacts");
    while (home.children.length > contacts.length) home.lastChild?.remove();
    while (home.children.length < contacts.length) home.append(this.contactFields(home.children.length));
    contacts.forEach(([x, y], k) => {
      const [, along, side] = home.children[k].children;
      put(/** @type {HTMLInputElement} */ (along), round(x, 2));
      /** @type {HTMLSelectElement} */ (side).value = y < 0 ? "-1" : "1";
    });
  }

  /** @param {number} k */
  contactFields(k) {
    const { studio, world } = this;
    const robot = `robot ${k + 1}`;
    const half = world.plank_length / 2;
    const attributes = { type: "number", min: -half, max: half, step: 0.01, "aria-label": `${robot}, along the plank, m` };
    const along = /** @type {HTMLInputElement} */ (html("input", attributes));
    const side = /** @type {HTMLSelectElement} */ (html("select", { "aria-label": `${robot}, side` }));
    side.append(html("option", { value: "1" }, "left"), html("option", { value: "-1" }, "right"));
    const move = (/** @type {number} */ x) => {
      moveContact(studio, world, k, [x, Number(side.value)], false);
      this.refresh(); // another robot may be in the way
    };
    along.addEventListener("change", () => {
      if (along.value !== "" && along.reportValidity()) move(along.valueAsNumber);
    });
    side.addEventListener("change", () => move(studio.condition.contacts[k][0]));
    const badge = html("b", { "aria-hidden": "true" }, String(k + 1));
    badge.style.background = world.accents[k % world.accents.length];
    return html("div", { class: "contact" }, badge, along, side);
  }
}
