// @ts-check
/** Draws bodies by WebGL: lit from the upper left, seen by a camera that goes around a point. */

import { turned } from "./glb.js";

/** @typedef {import("./glb.js").Body} Body */
/** @typedef {{buffer: WebGLVertexArrayObject, count: number}} Drawable */

/**
 * Where the picture is taken from.
 * @typedef {object} Orbit
 * @property {number[]} target m
 * @property {number} azimuth rad, 0: from the front
 * @property {number} elevation rad above the ground
 * @property {number} distance m
 * @property {number} angle vertical field of view, rad
 */

const NEAR = 0.02; // part of the distance
const VERTEX = `#version 300 es
layout(location = 0) in vec3 point;
layout(location = 1) in vec3 normal;
layout(location = 2) in vec4 colour;
uniform mat4 view;
uniform mat3 turn;
uniform vec3 place;
out vec3 outward;
out vec4 paint;
void main() {
  outward = turn * normal;
  paint = colour;
  gl_Position = view * vec4(turn * point + place, 1.0);
}`;
const FRAGMENT = `#version 300 es
precision highp float;
in vec3 outward;
in vec4 paint;
uniform vec3 eye;
out vec4 shown;
void main() {
  vec3 n = normalize(outward);
  float sky = 0.5 + 0.5 * n.z;
  float sun = max(dot(n, normalize(vec3(-0.35, -0.40, 0.85))), 0.0);
  float lamp = max(dot(n, eye), 0.0);
  vec3 linear = paint.rgb * (0.28 + 0.22 * sky + 0.45 * sun + 0.2 * lamp);
  shown = vec4(pow(min(linear, 1.0), vec3(1.0 / 2.2)), paint.a);
}`;

export class SolidPicture {
  /** @param {HTMLCanvasElement} canvas */
  constructor(canvas) {
    const gl = canvas.getContext("webgl2", { antialias: true, alpha: true, premultipliedAlpha: false });
    if (!gl) throw new Error("This browser has no WebGL 2, which the 3-D view needs; PNG shows the same scene.");
    this.canvas = canvas;
    this.gl = gl;
    this.program = link(gl);
    this.uniforms = Object.fromEntries(["view", "turn", "place", "eye"].map((name) => [name, gl.getUniformLocation(this.program, name)]));
    /** @type {Map<string, {place: number[], turn: number[], solid: Drawable | null, clear: Drawable | null}>} */
    this.bodies = new Map();
    /** @type {Orbit} */
    this.orbit = { target: [0, 0, 0], azimuth: 0, elevation: 0.9, distance: 3, angle: 0.5 };
    this.waiting = 0;
    gl.enable(gl.DEPTH_TEST);
    gl.enable(gl.CULL_FACE);
    gl.blendFuncSeparate(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA, gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    this.observer = new ResizeObserver(() => this.redraw());
    this.observer.observe(canvas);
  }

  /** Draws nothing any more. */
  close() {
    this.observer.disconnect();
    cancelAnimationFrame(this.waiting);
  }

  /** Other bodies. @param {Body[]} bodies */
  load(bodies) {
    for (const { solid, clear } of this.bodies.values()) {
      for (const each of [solid, clear]) if (each) this.gl.deleteVertexArray(each.buffer);
    }
    for (const buffer of this.buffers ?? []) this.gl.deleteBuffer(buffer);
    /** @type {WebGLBuffer[]} */
    this.buffers = [];
    this.bodies = new Map(
      bodies.map(({ name, place, turn, solid, clear }) => [name, { place, turn, solid: this.upload(solid), clear: this.upload(clear) }]),
    );
    this.redraw();
  }

  /** @param {import("./glb.js").Triangles} triangles @returns {Drawable | null} */
  upload({ vertices, indices }) {
    if (!indices.length) return null;
    const { gl } = this;
    const buffer = gl.createVertexArray();
    gl.bindVertexArray(buffer);
    for (const [kind, content] of /** @type {const} */ ([[gl.ARRAY_BUFFER, new Float32Array(vertices)], [gl.ELEMENT_ARRAY_BUFFER, new Uint32Array(indices)]])) {
      const made = gl.createBuffer();
      this.buffers?.push(made);
      gl.bindBuffer(kind, made);
      gl.bufferData(kind, content, gl.STATIC_DRAW);
    }
    for (const [location, size, offset] of [[0, 3, 0], [1, 3, 12], [2, 4, 24]]) {
      gl.enableVertexAttribArray(location);
      gl.vertexAttribPointer(location, size, gl.FLOAT, false, 40, offset);
    }
    gl.bindVertexArray(null);
    return { buffer, count: indices.length };
  }

  /** @param {string} name @param {number} x @param {number} y @param {number} theta */
  move(name, x, y, theta) {
    const body = this.bodies.get(name);
    if (!body) return;
    body.place = [x, y, body.place[2]];
    body.turn = [0, 0, Math.sin(theta / 2), Math.cos(theta / 2)];
    this.redraw();
  }

  /** Once, before the next frame of the screen. */
  redraw() {
    if (!this.waiting) this.waiting = requestAnimationFrame(() => this.draw());
  }

  draw() {
    this.waiting = 0;
    const { gl, canvas, uniforms } = this;
    const scale = devicePixelRatio;
    const [width, height] = [canvas.clientWidth * scale, canvas.clientHeight * scale].map(Math.round);
    if (!width || !height) return;
    if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
    const { view, back } = this.camera(width / height);
    gl.viewport(0, 0, width, height);
    gl.clearColor(0, 0, 0, 0);
    gl.depthMask(true);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.useProgram(this.program);
    gl.uniformMatrix4fv(uniforms.view, false, view);
    gl.uniform3fv(uniforms.eye, back);
    for (const part of /** @type {const} */ (["solid", "clear"])) {
      if (part === "clear") gl.enable(gl.BLEND);
      else gl.disable(gl.BLEND);
      gl.depthMask(part === "solid");
      for (const body of this.bodies.values()) {
        const drawable = body[part];
        if (!drawable) continue;
        gl.uniformMatrix3fv(uniforms.turn, false, [[1, 0, 0], [0, 1, 0], [0, 0, 1]].flatMap((axis) => turned(axis, body.turn)));
        gl.uniform3fv(uniforms.place, body.place);
        gl.bindVertexArray(drawable.buffer);
        gl.drawElements(gl.TRIANGLES, drawable.count, gl.UNSIGNED_INT, 0);
      }
    }
  }

  /** From the world to the picture, column by column, and the direction to the viewer. @param {number} aspect */
  camera(aspect) {
    const { target, azimuth, elevation, distance, angle } = this.orbit;
    const [sa, ca, se, ce] = [Math.sin(azimuth), Math.cos(azimuth), Math.sin(elevation), Math.cos(elevation)];
    const [right, up, back] = [[ca, sa, 0], [-sa * se, ca * se, ce], [sa * ce, -ca * ce, se]];
    const [near, far] = [NEAR * distance, 20 * distance];
    const tall = 1 / Math.tan(angle / 2);
    const [wide, deep, shift] = [tall / aspect, (far + near) / (near - far), (2 * far * near) / (near - far)];
    const place = target.map((each, k) => each + distance * back[k]);
    const along = (/** @type {number[]} */ axis) => -axis.reduce((sum, each, k) => sum + each * place[k], 0);
    const view = [0, 1, 2].flatMap((k) => [wide * right[k], tall * up[k], deep * back[k], -back[k]]);
    return { view: [...view, wide * along(right), tall * along(up), deep * along(back) + shift, -along(back)], back };
  }
}

/** @param {WebGL2RenderingContext} gl */
const link = (gl) => {
  const program = gl.createProgram();
  for (const [kind, text] of /** @type {const} */ ([[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]])) {
    const shader = /** @type {WebGLShader} */ (gl.createShader(kind));
    gl.shaderSource(shader, text);
    gl.compileShader(shader);
    gl.attachShader(program, shader);
  }
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(`the 3-D view can't be compiled: ${gl.getProgramInfoLog(program)}`);
  return program;
};
