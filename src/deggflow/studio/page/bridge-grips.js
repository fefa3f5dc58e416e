// @ts-check
/** What of a trial can be moved: plank, goal, and contact points. */

import { centreOf, poseOf } from "./bridge-picture.js";
import { clamp, local, placed, round, wrap } from "./geometry.js";

/** @typedef {import("./bridge-studio.js").BridgeStudio} BridgeStudio */
/** @typedef {import("./bridge-types.js").World} World */
/** @typedef {import("./bridge-types.js").Place} Place */
/** @typedef {import("./types.js").Spot} Spot */

const STEP = 0.1; // m of an arrow key
const TURN = Math.PI / 36; // rad of Q and E
const NAMES = { plank: "Plank at the start", goal: "Goal of the plank" };

/** @param {BridgeStudio} studio @param {World} world @param {() => boolean} dragging @returns {import("./drag.js").Grip[]} */
export const bridgeGrips = (studio, world, dragging) => [
  ...plankGrips(studio, world, "plank", dragging),
  ...plankGrips(studio, world, "goal", dragging),
  ...studio.condition.contacts.map((_, k) => contactGrip(studio, world, k, dragging)),
];

/**
 * @param {BridgeStudio} studio
 * @param {World} world
 * @param {"plank" | "goal"} which
 * @param {() => boolean} dragging
 * @returns {import("./drag.js").Grip[]}
 */
const plankGrips = (studio, world, which, dragging) => {
  const { x, y, theta } = studio.condition[which];
  const change = (/** @type {Partial<Place>} */ part) => {
    const next = { x, y, theta, ...part };
    const place = {
      x: round(clamp(next.x, world.x_min, world.x_max)),
      y: round(clamp(next.y, world.y_min, world.y_max)),
      theta: round(wrap(next.theta)),
    };
    studio.edit({ [which]: place }, { dragging: dragging() });
  };
  const angle = `${Math.round((180 / Math.PI) * theta)}°`;
  const turn = (/** @type {number} */ steps) => change({ theta: theta + steps * TURN });
  return [
    {
      id: which,
      label: NAMES[which],
      value: `x ${round(x, 2)} m, y ${round(y, 2)} m, turned by ${angle}`,
      at: [x, y],
      drag: (to) => change({ x: to[0], y: to[1] }),
      nudge: (right, up) => change({ x: x + STEP * right, y: y + STEP * up }),
      turn,
    },
    {
      id: `${which}-turn`,
      label: `Direction: ${NAMES[which].toLowerCase()}`,
      value: angle,
      at: placed([world.plank_length / 2, 0], [x, y, theta]),
      drag: (to) => change({ theta: Math.atan2(to[1] - y, to[0] - x) }),
      nudge: (right, up) => turn(up - right),
      turn,
    },
  ];
};

/** @param {BridgeStudio} studio @param {World} world @param {number} k @param {() => boolean} dragging @returns {import("./drag.js").Grip} */
const contactGrip = (studio, world, k, dragging) => {
  const { condition } = studio;
  const [along, side] = condition.contacts[k];
  const pose = poseOf(condition.plank);
  const move = (/** @type {number} */ x, /** @type {number} */ y) => moveContact(studio, world, k, [x, y], dragging());
  return {
    id: `contact-${k}`,
    label: `Contact point of robot ${k + 1}`,
    value: `${round(along, 2)} m along the plank, ${side < 0 ? "right" : "left"} side`,
    at: placed(centreOf(condition.contacts[k], world), pose),
    drag: (to) => move(...local(to, pose)),
    nudge: (right, up) => move(along + (STEP / 2) * right, up || side),
  };
};

/**
 * Puts a contact point on an edge of the plank, beside the other robots of that edge.
 * @param {BridgeStudio} studio
 * @param {World} world
 * @param {number} k
 * @param {Spot} to along the plank, and a number with the sign of the side
 * @param {boolean} dragging
 */
export const moveContact = (studio, world, k, [x, y], dragging) => {
  const { contacts } = studio.condition;
  const edge = y < 0 ? -world.contact_side : world.contact_side;
  const half = world.plank_length / 2;
  const at = round(clamp(x, -half, half), 3);
  const free = contacts.every(([other, side], j) => j === k || side * edge < 0 || Math.abs(other - at) >= world.contact_spacing - 1e-9);
  if (!free) return;
  studio.edit({ contacts: contacts.map((each, j) => (j === k ? [at, edge] : each)) }, { dragging });
};

/** A place for another robot: the first free one from the plank's rear end. @param {import("./bridge-types.js").Spot[]} contacts @param {World} world @returns {Spot | null} */
export const freeContact = (contacts, world) => {
  for (let x = -2.65; x <= -0.1; x += 0.05) {
    for (const side of [world.contact_side, -world.contact_side]) {
      if (contacts.every(([other, edge]) => edge * side < 0 || Math.abs(other - x) >= world.contact_spacing)) return [round(x, 3), side];
    }
  }
  return null;
};
