// @ts-check
/** Reads the GLB files that the server makes: bodies with their triangles, and a camera. */

/**
 * Triangles of one body, all of its parts together, in its own frame.
 * @typedef {object} Triangles
 * @property {number[]} vertices of each corner: place (3), normal (3), linear colour (3), opacity
 * @property {number[]} indices three a triangle
 *
 * @typedef {{name: string, place: number[], turn: number[], solid: Triangles, clear: Triangles}} Body turn: quaternion x, y, z, w
 * @typedef {{name: string, place: number[], turn: number[], angle: number}} Camera angle: vertical field of view, rad
 */

const [JSON_CHUNK, HEAD] = [0x4e4f534a, 12];

/** @param {Uint8Array} bytes @returns {{bodies: Body[], cameras: Camera[]}} */
export const readGlb = (bytes) => {
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  const length = view.getUint32(HEAD, true);
  if (view.getUint32(HEAD + 4, true) !== JSON_CHUNK) throw new Error("the 3-D model is not a GLB file");
  const file = JSON.parse(new TextDecoder().decode(bytes.subarray(HEAD + 8, HEAD + 8 + length)));
  const start = HEAD + 8 + length + 8;
  const numbers = (/** @type {number} */ accessor) => {
    const { bufferView, componentType, count, type } = file.accessors[accessor];
    const from = bytes.byteOffset + start + file.bufferViews[bufferView].byteOffset;
    const many = count * (type === "VEC3" ? 3 : 1);
    const end = from + 4 * many;
    return componentType === 5126 ? new Float32Array(bytes.buffer.slice(from, end)) : new Uint32Array(bytes.buffer.slice(from, end));
  };
  const surfaces = file.meshes.map((/** @type {any} */ { primitives: [{ attributes, indices, material }] }) => ({
    points: numbers(attributes.POSITION),
    normals: numbers(attributes.NORMAL),
    faces: numbers(indices),
    colour: file.materials[material].pbrMetallicRoughness.baseColorFactor,
  }));
  const [root] = file.scenes[file.scene].nodes;
  const top = file.nodes[root].children.map((/** @type {number} */ k) => file.nodes[k]);
  const cameras = top.flatMap((/** @type {any} */ node) =>
    node.camera === undefined
      ? []
      : [{ name: node.name, place: node.translation, turn: node.rotation, angle: file.cameras[node.camera].perspective.yfov }],
  );
  const bodies = top.flatMap((/** @type {any} */ node) => (node.children ? [bodyOf(node, file.nodes, surfaces)] : []));
  return { bodies, cameras };
};

/** @param {any} node @param {any[]} nodes @param {any[]} surfaces @returns {Body} */
const bodyOf = (node, nodes, surfaces) => {
  const body = { name: node.name, place: node.translation, turn: node.rotation, solid: empty(), clear: empty() };
  for (const child of node.children) {
    const { mesh, translation, rotation, scale = [1, 1, 1] } = nodes[child];
    const { points, normals, faces, colour } = surfaces[mesh];
    const into = colour[3] < 1 ? body.clear : body.solid;
    const first = into.vertices.length / 10;
    for (let k = 0; k < points.length; k += 3) {
      const at = turned([points[k] * scale[0], points[k + 1] * scale[1], points[k + 2] * scale[2]], rotation);
      const normal = turned([normals[k] / scale[0], normals[k + 1] / scale[1], normals[k + 2] / scale[2]], rotation);
      const size = Math.hypot(...normal);
      into.vertices.push(...at.map((each, axis) => each + translation[axis]), ...normal.map((each) => each / size), ...colour);
    }
    for (const face of faces) into.indices.push(first + face);
  }
  return body;
};

/** @returns {Triangles} */
const empty = () => ({ vertices: [], indices: [] });

/** A vector turned by a quaternion x, y, z, w. @param {number[]} v @param {number[]} q */
export const turned = ([x, y, z], [a, b, c, w]) => {
  const [u, v, t] = [2 * (b * z - c * y), 2 * (c * x - a * z), 2 * (a * y - b * x)];
  return [x + w * u + b * t - c * v, y + w * v + c * u - a * t, z + w * t + a * v - b * u];
};
