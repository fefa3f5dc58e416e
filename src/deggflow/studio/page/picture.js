// @ts-check
/** One scene from above, as SVG in metres. What is there already is moved, not made anew. */

import { svg } from "./elements.js";
import { outline, required, spoken, transform, typeName } from "./geometry.js";
import { drawGap } from "./margins.js";

/** @typedef {import("./types.js").Condition} Condition */
/** @typedef {import("./types.js").Pose} Pose */
/** @typedef {import("./types.js").Judgement} Judgement */
/** @typedef {import("./types.js").Library} Library */
/** @typedef {import("./types.js").Margin} Margin */

/** What a breach of each kind is called in a few letters. */
const NAMES = /** @type {Record<string, string>} */ ({
  separation: "overlap",
  unobstructed: "blocked",
  "object on table": "over the edge",
  "region on table": "over the edge",
  balance: "off balance",
});
const AROUND = 0.06; // m around the table
const CROSS = 0.02; // m, half the size of the centre of mass's cross

/** Draws every object's look once, for all pictures. @param {Element} home @param {Library} library */
export const defineLooks = (home, library) => {
  const hatch = svg("pattern", { id: "hatch", width: 0.014, height: 0.014, patternUnits: "userSpaceOnUse", patternTransform: "rotate(45)" });
  hatch.append(svg("line", { class: "hatch", x1: 0, y1: 0, x2: 0, y2: 0.014 }));
  const defs = svg("defs", {}, hatch);
  for (const [name, kind] of Object.entries(library.objects)) {
    const shape = kind.footprint.map(outline).join("");
    const looks = kind.looks.map((each) => svg("path", { d: outline(each.outline), fill: each.colour }));
    defs.append(svg("path", { id: `shape-${name}`, d: shape, "vector-effect": "non-scaling-stroke" }), svg("g", { id: `look-${name}` }, ...looks));
  }
  home.replaceChildren(defs);
};

export class Picture {
  /**
   * @param {SVGElement} root
   * @param {Library} library
   * @param {{labels?: boolean}} options
   */
  constructor(root, library, { labels = true } = {}) {
    this.root = root;
    this.library = library;
    this.labelled = labels;
    this.table = svg("rect", { class: "table" });
    this.regions = svg("g");
    this.objects = svg("g");
    this.balance = svg("g", { class: "balance" });
    this.gap = svg("g", { class: "gap" });
    this.breaches = svg("g", { class: "gap wrong breaches" });
    this.extras = svg("g");
    this.labels = svg("g", { "aria-hidden": "true" });
    const world = svg("g", { transform: "scale(1 -1)" });
    world.append(this.table, this.regions, this.objects, this.balance, this.breaches, this.gap, this.extras);
    root.replaceChildren(world, this.labels);
    /** @type {Map<string, {regions: SVGElement, object: SVGElement, label: SVGElement}>} */
    this.parts = new Map();
    this.width = this.depth = 1;
    this.pixel = 1; // m; asking for it on the way would lay the page out once for every object
  }

  /**
   * @param {Condition} condition
   * @param {Pose[]} poses
   * @param {Judgement | null} judgement decides what is marked; nothing if null
   */
  draw(condition, poses, judgement) {
    const { width, depth } = condition.table ?? this.library.table;
    this.width = width + 2 * AROUND;
    this.depth = depth + 2 * AROUND;
    const view = [-this.width / 2, -this.depth / 2, this.width, this.depth];
    set(this.root, { viewBox: view.join(" ") });
    const { clientWidth, clientHeight } = this.root;
    this.pixel = Math.max(this.width / Math.max(clientWidth, 1), this.depth / Math.max(clientHeight, 1));
    set(this.table, { x: -width / 2, y: -depth / 2, width, height: depth });
    set(this.labels, { "font-size": 11 * this.pixel, "stroke-width": 2.5 * this.pixel });
    this.keepOnly(condition.objects);
    const blocked = new Set((judgement?.blocked ?? []).map(([owner, region]) => `${owner} ${region}`));
    const outlined = new Set(judgement?.outlined ?? []);
    condition.objects.forEach((name, k) => {
      const part = this.part(name);
      const discs = required(this.library.objects[typeName(name)], condition.requirements?.[name]);
      discs.forEach((disc, region) => {
        const circle = part.regions.children[region];
        set(circle, { cx: disc.x, cy: disc.y, r: disc.radius });
        circle.classList.toggle("blocked", blocked.has(`${k} ${region}`));
      });
      part.object.classList.toggle("outlined", outlined.has(k));
    });
    this.drawBalance(condition, judgement);
    this.move(condition, poses);
  }

  /** Other poses of the same scene. @param {Condition} condition @param {Pose[]} poses */
  move(condition, poses) {
    condition.objects.forEach((name, k) => {
      const part = this.part(name);
      const place = transform(poses[k]);
      set(part.regions, { transform: place });
      set(part.object, { transform: place });
      const below = reach(this.library.objects[typeName(name)], poses[k][2]);
      set(part.label, { x: poses[k][0], y: -poses[k][1] + below + 12 * this.pixel });
    });
    this.moveCross(condition, poses);
  }

  /** @param {Condition} condition @param {Judgement | null} judgement */
  drawBalance(condition, judgement) {
    const circle = condition.balance;
    if (!circle) {
      this.balance.replaceChildren();
      return;
    }
    if (!this.balance.firstChild) {
      this.balance.append(svg("circle", { class: "circle" }), svg("path", { class: "cross" }));
    }
    const { x = 0, y = 0, radius = 0.05 } = circle;
    set(this.balance.children[0], { cx: x, cy: y, r: radius });
    this.balance.classList.toggle("unbalanced", judgement?.unbalanced ?? false);
  }

  /** @param {Condition} condition @param {Pose[]} poses */
  moveCross(condition, poses) {
    const cross = this.balance.children[1];
    if (!cross) return;
    let [mass, x, y] = [0, 0, 0];
    condition.objects.forEach((name, k) => {
      const own = this.library.objects[typeName(name)].mass;
      mass += own;
      x += own * poses[k][0];
      y += own * poses[k][1];
    });
    const place = `M${x / mass - CROSS} ${y / mass}h${2 * CROSS}M${x / mass} ${y / mass - CROSS}v${2 * CROSS}`;
    set(cross, { d: place });
  }

  /** Shows where a margin is. @param {Margin | null} margin */
  mark(margin) {
    drawGap(this.gap, this.labels, margin, this.pixel, (x, words) => this.within(x, words));
  }

  /** Names the worst breaches where they are, numbered as in the list below. @param {Judgement | null} judgement */
  nameBreaches(judgement) {
    this.labels.querySelectorAll(".breach").forEach((each) => each.remove());
    this.breaches.replaceChildren();
    const line = 13 * this.pixel;
    /** @type {import("./types.js").Spot[]} */
    const taken = [];
    judgement?.margins.slice(0, judgement.breaches.length).forEach(({ kind, margin, gap: [[x1, y1], [x2, y2]] }, k) => {
      const words = `${k + 1}: ${NAMES[kind]} ${(-1000 * margin).toFixed(0)} mm`;
      const x = this.within((x1 + x2) / 2, words);
      let y = -(y1 + y2) / 2 - line / 3;
      while (taken.some((other) => Math.abs(other[1] - y) < line && Math.abs(other[0] - x) < 9 * line)) y -= line;
      taken.push([x, y]);
      const text = svg("text", { class: "breach wrong", x, y });
      text.textContent = words;
      this.labels.append(text);
      this.breaches.append(svg("line", { x1, y1, x2, y2 }));
    });
  }

  /** The middle of a text, so far inside that the picture holds all of it. @param {number} x @param {string} words */
  within(x, words) {
    const half = Math.max(this.width / 2 - 3.1 * words.length * this.pixel, 0);
    return Math.min(Math.max(x, -half), half);
  }

  /** @param {string} name */
  part(name) {
    const known = this.parts.get(name);
    if (known) return known;
    const kind = typeName(name);
    const regions = svg("g", {}, ...this.library.objects[kind].regions.map(() => svg("circle", { class: "region" })));
    const object = svg(
      "g",
      { class: "object", "data-name": name },
      svg("use", { class: "rim", href: `#shape-${kind}` }),
      svg("use", { class: "footprint", href: `#shape-${kind}` }),
      svg("use", { href: `#look-${kind}` }),
    );
    const label = svg("text");
    if (this.labelled) label.textContent = spoken(name);
    this.regions.append(regions);
    this.objects.append(object);
    this.labels.append(label);
    const part = { regions, object, label };
    this.parts.set(name, part);
    return part;
  }

  /** @param {string[]} names */
  keepOnly(names) {
    for (const [name, part] of this.parts) {
      if (names.includes(name)) continue;
      Object.values(part).forEach((each) => each.remove());
      this.parts.delete(name);
    }
  }
}

/** How far an object reaches below its centre. @param {import("./types.js").Kind} kind @param {number} theta */
const reach = (kind, theta) => {
  let low = 0;
  for (const part of kind.footprint) {
    for (const [x, y] of part) low = Math.min(low, Math.sin(theta) * x + Math.cos(theta) * y);
  }
  return -low;
};

/** Writes what differs. @param {Element} element @param {Record<string, string | number>} attributes */
const set = (element, attributes) => {
  for (const [name, value] of Object.entries(attributes)) {
    if (element.getAttribute(name) !== String(value)) element.setAttribute(name, String(value));
  }
};
