// @ts-check
/** What can be dragged on the guided picture, and the keys that do the same. */

import { Grips } from "./drag.js";
import { svg } from "./elements.js";
import { LIMITS, clamp, filled, local, middle, outline, placed, required, round, spoken, transform, turned, typeName, wrap } from "./geometry.js";

/** @typedef {import("./types.js").Spot} Spot */
/** @typedef {import("./types.js").Pose} Pose */

const OBJECT = "object"; // the grip of the selected object itself
const degrees = (/** @type {number} */ angle) => `${Math.round((180 / Math.PI) * angle)}°`;

export class Handles {
  /**
   * @param {import("./picture.js").Picture} picture
   * @param {import("./studio.js").Studio} studio
   */
  constructor(picture, studio) {
    this.picture = picture;
    this.studio = studio;
    this.ghost = svg("g", { class: "ghost" });
    this.lead = svg("line", { class: "lead" });
    this.group = svg("g");
    picture.extras.append(this.ghost, this.lead, this.group);
    /** @type {Pose | null} where the selected object was when the drag of its requirement began */
    this.held = null;
    const root = /** @type {SVGSVGElement} */ (picture.root);
    this.grips = new Grips(root, () => this.all(), {
      onStart: (id) => (this.held = ["region", "radius"].includes(id) ? this.pose() : null),
      onEnd: (id, moved) => this.end(id, moved),
      locate: (target) => this.locate(target),
    });
    root.addEventListener("focusin", (event) => {
      const name = nameOf(event.target);
      if (name) this.select(name);
    });
  }

  /** @param {string} name */
  select(name) {
    if (this.studio.selected === name) return;
    this.studio.selected = name;
    this.studio.onChange();
  }

  /** The selected object's pose; while its requirement is dragged, the one it had before. @returns {Pose | null} */
  pose() {
    const { shown, selected } = this.studio;
    if (!shown || !selected) return null;
    if (this.held) return this.held;
    return shown.poses[shown.condition.objects.indexOf(selected)] ?? null;
  }

  /** @returns {import("./drag.js").Grip[]} */
  handles() {
    const { studio, picture } = this;
    if (!studio.shown) return [];
    return [...this.ofRequirement(), ...this.ofBalance(), ...ofTable(studio, picture.library.table, this.dragging)];
  }

  get dragging() {
    return { dragging: this.grips.dragged !== null };
  }

  /** @returns {import("./drag.js").Grip[]} */
  ofRequirement() {
    const { studio, picture } = this;
    const { selected, condition } = studio;
    const pose = this.pose();
    if (!selected || !pose) return [];
    const kind = picture.library.objects[typeName(selected)];
    const need = filled(condition.requirements?.[selected]);
    const base = middle(kind);
    const discs = required(kind, need);
    const far = Math.hypot(...base);
    const change = (/** @type {import("./types.js").Affordance} */ part) => studio.require(selected, part, this.dragging);
    const scale = (/** @type {number} */ value) => round(clamp(value, ...limits("radius_scale")));
    const rim = /** @type {Spot} */ ([discs[0].x, discs[0].y]);
    const out = Math.atan2(rim[1], rim[0]);
    const radius = discs[0].radius;
    return [
      {
        id: "region",
        label: `Direction and offset of the region of ${spoken(selected)}`,
        value: `direction ${degrees(need.direction)}, offset ${need.offset_scale}`,
        at: placed(turned([need.offset_scale * base[0], need.offset_scale * base[1]], need.direction), pose),
        drag: (to) => {
          const [x, y] = local(to, pose);
          const direction = round(wrap(Math.atan2(y, x) - Math.atan2(base[1], base[0])));
          change({ direction, offset_scale: round(clamp(Math.hypot(x, y) / far, ...limits("offset_scale"))) });
        },
        nudge: (right, up) =>
          change({
            direction: round(wrap(need.direction - (right * Math.PI) / 36)),
            offset_scale: round(clamp(need.offset_scale + 0.05 * up, ...limits("offset_scale"))),
          }),
      },
      {
        id: "radius",
        label: `Radius of the region of ${spoken(selected)}`,
        value: `${need.radius_scale} times the default`,
        at: placed([rim[0] + radius * Math.cos(out), rim[1] + radius * Math.sin(out)], pose),
        drag: (to) => {
          const [x, y] = local(to, pose);
          change({ radius_scale: scale(Math.hypot(x - rim[0], y - rim[1]) / kind.regions[0].radius) });
        },
        nudge: (right, up) => change({ radius_scale: scale(need.radius_scale + 0.05 * (right + up)) }),
      },
    ];
  }

  /** @returns {import("./drag.js").Grip[]} */
  ofBalance() {
    const { studio } = this;
    const circle = studio.condition.balance;
    if (!circle) return [];
    const { x = 0, y = 0, radius = 0.05 } = circle;
    const change = (/** @type {import("./types.js").Balance} */ part) =>
      studio.edit({ ...studio.condition, balance: { x, y, radius, ...part } }, this.dragging);
    const far = (/** @type {number} */ value) => round(clamp(value, 0.001, 100));
    return [
      {
        id: "balance",
        label: "Circle for the centre of mass",
        value: `x ${round(x, 3)} m, y ${round(y, 3)} m`,
        at: [x, y],
        drag: (to) => change({ x: round(to[0]), y: round(to[1]) }),
        nudge: (right, up) => change({ x: round(x + 0.01 * right), y: round(y + 0.01 * up) }),
      },
      {
        id: "balance-radius",
        label: "Radius of the circle for the centre of mass",
        value: `${round(radius, 3)} m`,
        at: [x + radius, y],
        drag: (to) => change({ radius: far(Math.hypot(to[0] - x, to[1] - y)) }),
        nudge: (right, up) => change({ radius: far(radius + 0.01 * (right + up)) }),
      },
    ];
  }

  /** Puts handles and the ghost where they belong; elements stay, and with them the focus. */
  refresh() {
    const handles = this.handles();
    const size = 6.5 * this.picture.pixel;
    const kept = new Map([...this.group.children].map((each) => [each.getAttribute("data-handle"), each]));
    handles.forEach((handle) => {
      const element = kept.get(handle.id) ?? this.make(handle.id);
      kept.delete(handle.id);
      element.setAttribute("cx", String(handle.at[0]));
      element.setAttribute("cy", String(handle.at[1]));
      element.setAttribute("r", String(size));
      element.setAttribute("aria-label", handle.label);
      element.setAttribute("aria-valuetext", handle.value);
    });
    for (const gone of kept.values()) gone.remove();
    this.drawGhost();
    const [region] = handles.filter(({ id }) => id === "region");
    const pose = this.pose();
    this.lead.toggleAttribute("hidden", !region);
    if (region && pose) {
      const ends = { x1: pose[0], y1: pose[1], x2: region.at[0], y2: region.at[1] };
      for (const [name, value] of Object.entries(ends)) this.lead.setAttribute(name, String(value));
    }
    this.describeObjects();
  }

  /** @param {string} id */
  make(id) {
    const element = svg("circle", { class: "handle", "data-handle": id, tabindex: 0, role: "slider", "aria-valuenow": 0 });
    this.group.append(element);
    return element;
  }

  describeObjects() {
    const { shown, selected } = this.studio;
    shown?.condition.objects.forEach((name, k) => {
      const { object } = this.picture.part(name);
      const [x, y, theta] = shown.poses[k];
      const where = `x ${(100 * x).toFixed(0)} cm, y ${(100 * y).toFixed(0)} cm, turned by ${degrees(wrap(theta))}`;
      object.setAttribute("tabindex", "0");
      object.setAttribute("role", "button");
      object.setAttribute("aria-pressed", String(name === selected));
      object.setAttribute("aria-label", `${spoken(name)}, ${where}`);
      object.classList.toggle("selected", name === selected);
    });
  }

  /** Where the object was when the drag of its requirement began. */
  drawGhost() {
    const { selected, condition } = this.studio;
    this.ghost.replaceChildren();
    if (!selected || !this.held || !this.grips.dragged?.moved) return;
    const kind = this.picture.library.objects[typeName(selected)];
    this.ghost.setAttribute("transform", transform(this.held));
    this.ghost.append(
      svg("path", { d: kind.footprint.map(outline).join("") }),
      ...required(kind, condition.requirements?.[selected]).map(({ x, y, radius }) => svg("circle", { cx: x, cy: y, r: radius })),
    );
  }

  /** The grip at an element; its object is selected. @param {Element} target @returns {import("./drag.js").Found | null} */
  locate(target) {
    const handle = target.closest(".handle");
    if (handle) return { id: handle.getAttribute("data-handle") ?? "", element: /** @type {SVGElement} */ (handle) };
    const region = target.closest(".region");
    const name = nameOf(target) ?? this.ownerOf(region);
    if (!name) return null;
    this.select(name);
    return { id: region ? "region" : OBJECT, element: this.picture.part(name).object };
  }

  /** The selected object, moved by hand. @returns {import("./drag.js").Grip[]} */
  ofObject() {
    const pose = this.pose();
    const { selected } = this.studio;
    if (!pose || !selected) return [];
    const [x, y, theta] = pose;
    const move = (/** @type {number} */ right, /** @type {number} */ up, /** @type {number} */ angle) =>
      this.studio.moveByHand(selected, [round(right, 5), round(up, 5), angle]);
    return [
      {
        id: OBJECT,
        label: spoken(selected),
        value: "",
        at: [x, y],
        drag: (to) => move(...to, theta),
        nudge: (right, up) => move(x + 0.01 * right, y + 0.01 * up, theta),
        turn: (steps) => move(x, y, round(theta + (steps * Math.PI) / 36, 5)),
      },
    ];
  }

  all() {
    return [...this.handles(), ...this.ofObject()];
  }

  /** @param {string} id @param {boolean} moved */
  end(id, moved) {
    this.held = null;
    if (moved && id !== OBJECT) this.studio.edit(this.studio.condition);
    else this.studio.onChange();
  }

  /** @param {Element | null} region */
  ownerOf(region) {
    for (const [name, part] of this.picture.parts) if (region && part.regions.contains(region)) return name;
    return null;
  }
}

/** @param {import("./studio.js").Studio} studio @param {{width: number, depth: number}} usual @param {{dragging: boolean}} options @returns {import("./drag.js").Grip[]} */
const ofTable = (studio, usual, options) => {
  const { width, depth } = studio.condition.table ?? usual;
  const size = (/** @type {number} */ value) => round(clamp(value, 0.1, 5), 3);
  const change = (/** @type {number} */ wide, /** @type {number} */ deep) =>
    studio.edit({ ...studio.condition, table: { width: size(wide), depth: size(deep) } }, options);
  return [
    {
      id: "table",
      label: "Size of the table",
      value: `${width} m wide, ${depth} m deep`,
      at: [width / 2, depth / 2],
      drag: (to) => change(2 * to[0], 2 * to[1]),
      nudge: (right, up) => change(width + 0.05 * right, depth + 0.05 * up),
    },
  ];
};

/** @param {EventTarget | null} target */
const nameOf = (target) =>
  target instanceof Element ? (target.closest(".object")?.getAttribute("data-name") ?? null) : null;

/** @param {keyof typeof LIMITS} name @returns {[number, number]} */
const limits = (name) => /** @type {[number, number]} */ (LIMITS[name]);
