// @ts-check
/** Points, angles and requirements in the plane. */

/** @typedef {import("./types.js").Spot} Spot */
/** @typedef {import("./types.js").Pose} Pose */
/** @typedef {import("./types.js").Kind} Kind */
/** @typedef {import("./types.js").Affordance} Affordance */

export const LIMITS = { offset_scale: [0.01, 10], radius_scale: [0.01, 10], direction: [-Math.PI, Math.PI] };

/** @param {number} value @param {number} low @param {number} high */
export const clamp = (value, low, high) => Math.min(Math.max(value, low), high);

/** @param {number} value @param {number} digits */
export const round = (value, digits = 4) => Number(value.toFixed(digits));

/** The angle in [-pi, pi). @param {number} angle */
export const wrap = (angle) => {
  const turn = 2 * Math.PI;
  return ((((angle + Math.PI) % turn) + turn) % turn) - Math.PI;
};

/** @param {Spot} point @param {number} angle @returns {Spot} */
export const turned = ([x, y], angle) => [
  Math.cos(angle) * x - Math.sin(angle) * y,
  Math.sin(angle) * x + Math.cos(angle) * y,
];

/** A point of a body frame in the world. @param {Spot} point @param {Pose} pose @returns {Spot} */
export const placed = (point, [x, y, theta]) => {
  const [u, v] = turned(point, theta);
  return [x + u, y + v];
};

/** A point of the world in a body frame. @param {Spot} point @param {Pose} pose @returns {Spot} */
export const local = ([x, y], pose) => turned([x - pose[0], y - pose[1]], -pose[2]);

/** The type of an object by its name. @param {string} name */
export const typeName = (name) => name.split("#")[0];

/** @param {string} name */
export const spoken = (name) => name.replaceAll("_", " ");

/** What is asked of an object, with defaults. @param {Affordance | undefined} need @returns {Required<Affordance>} */
export const filled = (need) => ({ offset_scale: 1, radius_scale: 1, direction: 0, ...need });

/**
 * Regions of an object as its user requires them, in the body frame.
 * @param {Kind} kind
 * @param {Affordance | undefined} need
 */
export const required = (kind, need) => {
  const { offset_scale, radius_scale, direction } = filled(need);
  return kind.regions.map((region) => {
    const [x, y] = turned([offset_scale * region.x, offset_scale * region.y], direction);
    return { x, y, radius: radius_scale * region.radius };
  });
};

/** Mean of an object's default region centres: where its handle is. @param {Kind} kind @returns {Spot} */
export const middle = (kind) => {
  const count = kind.regions.length;
  return [
    kind.regions.reduce((sum, region) => sum + region.x, 0) / count,
    kind.regions.reduce((sum, region) => sum + region.y, 0) / count,
  ];
};

/** A polygon as the data of an SVG path. @param {Spot[]} points */
export const outline = (points) => `M${points.map(([x, y]) => `${x} ${y}`).join("L")}Z`;

/** @param {Pose} pose */
export const transform = ([x, y, theta]) =>
  `translate(${round(x, 5)} ${round(y, 5)}) rotate(${round((180 / Math.PI) * theta, 3)})`;

/** Between two poses, the shorter way round. @param {Pose} a @param {Pose} b @param {number} part @returns {Pose} */
export const between = (a, b, part) =>
  part === 1 ? b : [a[0] + part * (b[0] - a[0]), a[1] + part * (b[1] - a[1]), a[2] + part * wrap(b[2] - a[2])];
