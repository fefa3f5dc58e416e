// @ts-check
/** What can be dragged on the guided picture, and the keys that do the same. */

import { svg } from "./elements.js";
import { LIMITS, clamp, filled, local, middle, outline, placed, required, round, spoken, transform, turned, typeName, wrap } from "./geometry.js";

/** @typedef {import("./types.js").Spot} Spot */
/** @typedef {import("./types.js").Pose} Pose */

/**
 * @typedef {object} Handle
 * @property {string} id
 * @property {string} label
 * @property {string} value as it is spoken
 * @property {Spot} at
 * @property {(to: Spot) => void} drag
 * @property {(right: number, up: number) => void} nudge by steps; a tenth with Shift
 */

const CLICK = 3; // pixels that a click may wander
const degrees = (/** @type {number} */ angle) => `${Math.round((180 / Math.PI) * angle)}°`;
const ARROWS = /** @type {Record<string, Spot>} */ ({
  ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1],
});

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
    /** @type {{handle: string | null, name: string | null, pose: Pose | null, offset: Spot, start: Spot, moved: boolean} | null} */
    this.dragged = null;
    const { root } = picture;
    root.addEventListener("pointerdown", (event) => this.press(event));
    root.addEventListener("pointermove", (event) => this.follow(event));
    root.addEventListener("pointerup", () => this.release());
    root.addEventListener("pointercancel", () => this.release());
    root.addEventListener("keydown", (event) => this.key(event));
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
    if (this.dragged?.pose && this.dragged.name === selected) return this.dragged.pose;
    return shown.poses[shown.condition.objects.indexOf(selected)] ?? null;
  }

  /** @returns {Handle[]} */
  handles() {
    const { studio, picture } = this;
    if (!studio.shown) return [];
    return [...this.ofRequirement(), ...this.ofBalance(), ...ofTable(studio, picture.library.table, this.dragging)];
  }

  get dragging() {
    return { dragging: this.dragged !== null };
  }

  /** @returns {Handle[]} */
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

  /** @returns {Handle[]} */
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
    if (!selected || !this.dragged?.pose || !this.dragged.moved) return;
    const kind = this.picture.library.objects[typeName(selected)];
    this.ghost.setAttribute("transform", transform(this.dragged.pose));
    this.ghost.append(
      svg("path", { d: kind.footprint.map(outline).join("") }),
      ...required(kind, condition.requirements?.[selected]).map(({ x, y, radius }) => svg("circle", { cx: x, cy: y, r: radius })),
    );
  }

  /** @param {PointerEvent} event */
  press(event) {
    if (event.button !== 0 || !(event.target instanceof Element)) return;
    const handle = event.target.closest(".handle")?.getAttribute("data-handle") ?? null;
    const region = event.target.closest(".region");
    const name = nameOf(event.target) ?? this.ownerOf(region);
    if (!handle && !name) return;
    event.preventDefault();
    if (name) this.select(name);
    const at = this.spot(event);
    const which = handle ?? (region ? "region" : null);
    const pose = which === "region" || which === "radius" ? this.pose() : null;
    const anchor = which ? this.handles().find(({ id }) => id === which)?.at : this.pose();
    if (!anchor) return;
    const offset = /** @type {Spot} */ ([anchor[0] - at[0], anchor[1] - at[1]]);
    this.dragged = { handle: which, name: name ?? this.studio.selected, pose, offset, start: [event.clientX, event.clientY], moved: false };
    this.picture.root.setPointerCapture(event.pointerId);
    const focus = handle ? this.group.querySelector(`[data-handle="${handle}"]`) : name && this.picture.part(name).object;
    if (focus) /** @type {SVGElement} */ (focus).focus({ preventScroll: true });
  }

  /** @param {PointerEvent} event */
  follow(event) {
    const { dragged } = this;
    if (!dragged) return;
    if (!dragged.moved && Math.hypot(event.clientX - dragged.start[0], event.clientY - dragged.start[1]) < CLICK) return;
    dragged.moved = true;
    const at = this.spot(event);
    const to = /** @type {Spot} */ ([at[0] + dragged.offset[0], at[1] + dragged.offset[1]]);
    if (dragged.handle) this.handles().find(({ id }) => id === dragged.handle)?.drag(to);
    else this.moveTo(to);
  }

  release() {
    const { dragged } = this;
    this.dragged = null;
    if (dragged?.moved && dragged.handle) this.studio.edit(this.studio.condition);
    else this.studio.onChange();
  }

  /** @param {Spot} to */
  moveTo([x, y]) {
    const pose = this.pose();
    const { selected } = this.studio;
    if (pose && selected) this.studio.moveByHand(selected, [round(x, 5), round(y, 5), pose[2]]);
  }

  /** @param {KeyboardEvent} event */
  key(event) {
    if (!(event.target instanceof Element) || event.ctrlKey || event.metaKey || event.altKey) return;
    const step = event.shiftKey ? 0.1 : 1;
    const arrow = ARROWS[event.key];
    const handle = event.target.getAttribute("data-handle");
    const pose = this.pose();
    const turn = { q: 1, e: -1 }[event.key.toLowerCase()];
    if (handle && arrow) {
      this.handles().find(({ id }) => id === handle)?.nudge(step * arrow[0], step * arrow[1]);
    } else if (nameOf(event.target) && pose && arrow) {
      this.moveTo([pose[0] + 0.01 * step * arrow[0], pose[1] + 0.01 * step * arrow[1]]);
    } else if (nameOf(event.target) && pose && turn && this.studio.selected) {
      this.studio.moveByHand(this.studio.selected, [pose[0], pose[1], round(pose[2] + (step * turn * Math.PI) / 36, 5)]);
    } else return;
    event.preventDefault();
  }

  /** @param {Element | null} region */
  ownerOf(region) {
    for (const [name, part] of this.picture.parts) if (region && part.regions.contains(region)) return name;
    return null;
  }

  /** The pointer on the table, m. @param {PointerEvent} event @returns {Spot} */
  spot(event) {
    const root = /** @type {SVGSVGElement} */ (this.picture.root);
    const point = new DOMPoint(event.clientX, event.clientY).matrixTransform(root.getScreenCTM()?.inverse());
    return [point.x, -point.y];
  }
}

/** @param {import("./studio.js").Studio} studio @param {{width: number, depth: number}} usual @param {{dragging: boolean}} options @returns {Handle[]} */
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
