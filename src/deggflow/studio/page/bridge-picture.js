// @ts-check
/** The bridge from above, as SVG in metres. */

import { svg } from "./elements.js";
import { clamp, placed, transform } from "./geometry.js";
import { drawGap } from "./margins.js";

/** @typedef {import("./bridge-types.js").World} World */
/** @typedef {import("./bridge-types.js").Condition} Condition */
/** @typedef {import("./bridge-types.js").Place} Place */
/** @typedef {import("./types.js").Pose} Pose */
/** @typedef {import("./types.js").Spot} Spot */

const AROUND = 0.3; // m around the workspace

/** @param {Place} place @returns {Pose} */
export const poseOf = ({ x, y, theta }) => [x, y, theta];

/** A robot's centre in the plank's frame. @param {Spot} contact @param {World} world @returns {Spot} */
export const centreOf = ([x, y], world) => [x, y < 0 ? -world.centre_side : world.centre_side];

export class BridgePicture {
  /** @param {SVGSVGElement} root @param {World} world */
  constructor(root, world) {
    this.root = root;
    this.world = world;
    const { x_min, x_max, y_min, y_max, gap_left, gap_right } = world;
    this.width = x_max - x_min + 2 * AROUND;
    root.setAttribute("viewBox", `${x_min - AROUND} ${-y_max - AROUND} ${this.width} ${y_max - y_min + 2 * AROUND}`);
    const lines = [];
    for (let x = Math.ceil(x_min); x < x_max; x++) lines.push(`M${x} ${y_min}V${y_max}`);
    for (let y = Math.ceil(y_min) + 1; y < y_max; y++) lines.push(`M${x_min} ${y}H${x_max}`);
    this.twin = new Team("twin", world);
    this.team = new Team("team", world);
    this.start = this.plankGrip("plank", "start-place");
    this.goal = this.plankGrip("goal", "goal-place");
    this.turns = { plank: this.grip("plank-turn", "handle"), goal: this.grip("goal-turn", "handle") };
    this.contacts = svg("g");
    this.tags = svg("g", { "aria-hidden": "true" });
    this.gap = svg("g", { class: "gap" });
    this.labels = svg("g", { "aria-hidden": "true" });
    const size = { width: x_max - x_min, height: y_max - y_min };
    const up = svg("g", { transform: "scale(1 -1)" });
    up.append(
      svg("rect", { class: "ground", x: x_min, y: y_min, ...size }),
      svg("path", { class: "gridline", d: lines.join("") }),
      svg("rect", { class: "border", x: x_min, y: y_min, ...size }),
      svg("rect", { class: "pit", x: gap_left, y: y_min - AROUND, width: gap_right - gap_left, height: size.height + 2 * AROUND }),
      this.team.root, this.twin.root, this.goal, this.start, this.turns.goal, this.turns.plank, this.contacts, this.gap,
    );
    root.replaceChildren(up, this.tags, this.labels);
  }

  /** Metres of a pixel. */
  get pixel() {
    return this.width / Math.max(this.root.clientWidth, 1);
  }

  /** @param {string} id @param {string} kind */
  grip(id, kind) {
    return svg("circle", { class: kind, "data-grip": id, tabindex: 0, role: "slider", "aria-valuenow": 0 });
  }

  /** @param {string} id @param {string} kind */
  plankGrip(id, kind) {
    const { plank_length: length, plank_width: width } = this.world;
    return svg("rect", {
      class: kind, "data-grip": id, tabindex: 0, role: "slider", "aria-valuenow": 0,
      x: -length / 2, y: -width / 2, width: length, height: width,
    });
  }

  /** Where trials begin and end. @param {Condition} condition @param {{start: string | null, goal: string | null}} wrong */
  drawCondition({ plank, goal, contacts }, wrong) {
    this.start.setAttribute("transform", transform(poseOf(plank)));
    this.goal.setAttribute("transform", transform(poseOf(goal)));
    this.start.classList.toggle("wrong", wrong.start !== null);
    this.goal.classList.toggle("wrong", wrong.goal !== null);
    const size = 6.5 * this.pixel;
    for (const [element, pose] of /** @type {[SVGElement, Pose][]} */ ([[this.turns.plank, poseOf(plank)], [this.turns.goal, poseOf(goal)]])) {
      const [cx, cy] = placed([this.world.plank_length / 2, 0], pose);
      place(element, { cx, cy, r: size });
    }
    while (this.contacts.children.length > contacts.length) this.contacts.lastChild?.remove();
    while (this.contacts.children.length < contacts.length) {
      this.contacts.append(this.grip(`contact-${this.contacts.children.length}`, "contact-place"));
    }
    this.tags.replaceChildren();
    const { accents, robot_radius } = this.world;
    contacts.forEach((contact, k) => {
      const [cx, cy] = placed(centreOf(contact, this.world), poseOf(plank));
      place(this.contacts.children[k], { cx, cy, r: Math.max(robot_radius, size), fill: accents[k % accents.length] });
      const tag = svg("text", { class: "tag", x: cx, y: -cy + 4 * this.pixel, "font-size": 11 * this.pixel });
      tag.textContent = String(k + 1);
      this.tags.append(tag);
    });
  }

  /** Shows where a margin is. @param {import("./margins.js").Gap | null} margin */
  mark(margin) {
    const size = { "font-size": 12 * this.pixel, "stroke-width": 3 * this.pixel };
    for (const [name, value] of Object.entries(size)) this.labels.setAttribute(name, String(value));
    const { x_min, x_max } = this.world;
    drawGap(this.gap, this.labels, margin, this.pixel, (x) => clamp(x, x_min + 30 * this.pixel, x_max - 30 * this.pixel));
  }

  /** @param {string} id */
  find(id) {
    return this.root.querySelector(`[data-grip="${id}"]`);
  }
}

/** A plank with its robots, and the way it has come. */
class Team {
  /** @param {string} kind @param {World} world */
  constructor(kind, world) {
    this.world = world;
    const { plank_length: length, plank_width: width } = world;
    this.plank = svg("rect", { class: "plank", x: -length / 2, y: -width / 2, width: length, height: width });
    this.robots = svg("g");
    this.body = svg("g", {}, this.plank, this.robots);
    this.path = svg("path", { class: "path" });
    this.root = svg("g", { class: kind }, this.body, this.path);
  }

  /** @param {Spot[]} contacts @param {number[]} blamed robots that failed, from 0 @param {boolean} failed */
  draw(contacts, blamed = [], failed = false) {
    const { accents, robot_radius } = this.world;
    this.body.classList.toggle("failed", failed);
    this.robots.replaceChildren(
      ...contacts.map((contact, k) => {
        const [cx, cy] = centreOf(contact, this.world);
        const robot = svg("circle", { class: "robot", cx, cy, r: robot_radius, fill: accents[k % accents.length] });
        return svg("g", blamed.includes(k) ? { class: "blamed" } : {}, robot);
      }),
    );
  }

  /** @param {Pose[]} poses */
  drawPath(poses) {
    this.path.setAttribute("d", poses.length ? `M${poses.map(([x, y]) => `${x} ${y}`).join("L")}` : "");
  }

  /** @param {Pose} pose */
  move(pose) {
    this.body.setAttribute("transform", transform(pose));
  }
}

/** A small picture of a trial's end, and of its way. @param {SVGSVGElement} root @param {World} world @param {import("./bridge-types.js").Trial} trial */
export const thumbnail = (root, world, { condition, poses, outcome }) => {
  const picture = new BridgePicture(root, world);
  for (const each of [picture.start, picture.turns.plank, picture.turns.goal, picture.twin.root]) each.remove();
  for (const name of ["tabindex", "role", "data-grip"]) picture.goal.removeAttribute(name);
  picture.goal.setAttribute("transform", transform(poseOf(condition.goal)));
  picture.team.draw(condition.contacts, [], outcome.reason !== null);
  picture.team.drawPath(poses);
  picture.team.move(poses[poses.length - 1]);
};

/** @param {Element} element @param {Record<string, string | number>} attributes */
const place = (element, attributes) => {
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, String(value));
};
