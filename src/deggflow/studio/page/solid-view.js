// @ts-check
/** The 3-D view: the bodies that the server exports as GLB, from any side. It is loaded when it is opened. */

import { byId, html } from "./elements.js";
import { bytesOf } from "./files.js";
import { clamp, placed } from "./geometry.js";
import { readGlb, turned } from "./glb.js";
import { latestOnly } from "./session.js";
import { SolidPicture } from "./webgl.js";

/** @typedef {import("./types.js").Pose} Pose */
/** @typedef {import("./types.js").Spot} Spot */

const TURN = Math.PI / 24; // of an arrow key
const ZOOM = 1.1; // of + and -, and of a step of the wheel
const NARROW = 4 / 3; // of the width over the height that the camera's own picture fits
const HELP = "Drag it, or use the arrow keys, to look from another side; + and - or the wheel with Ctrl zoom; 0 goes back.";

export class SolidView {
  /** @param {import("./session.js").Session} session @param {() => object} fields of the export of what is shown */
  constructor(session, fields) {
    this.session = session;
    this.fields = fields;
    this.run = latestOnly();
    this.outdated = true; // what is shown is not what was loaded
    /** @type {SolidPicture | null} */
    this.picture = null;
    /** @type {import("./webgl.js").Orbit | null} of the file's own camera */
    this.home = null;
    this.canvas = /** @type {HTMLCanvasElement} */ (html("canvas", { class: "solid", tabindex: 0, role: "img", "aria-label": `3-D view. ${HELP}` }));
    this.details = /** @type {HTMLDetailsElement} */ (
      html("details", {}, html("summary", {}, "Show it with its bodies"), this.canvas, html("p", { class: "soft" }, HELP))
    );
    byId("solid").append(this.details);
    this.details.addEventListener("toggle", () => this.refresh());
    this.canvas.addEventListener("pointermove", (event) => {
      if (event.buttons & 1) this.turn((-event.movementX * Math.PI) / 400, (event.movementY * Math.PI) / 400);
    });
    this.canvas.addEventListener("pointerdown", (event) => this.canvas.setPointerCapture(event.pointerId));
    this.canvas.addEventListener("wheel", (event) => {
      if (!event.ctrlKey) return;
      event.preventDefault();
      this.zoom(event.deltaY < 0 ? 1 / ZOOM : ZOOM);
    }, { passive: false });
    this.canvas.addEventListener("keydown", (event) => this.key(event));
    this.canvas.addEventListener("webglcontextlost", (event) => {
      event.preventDefault(); // the browser may give another one
      this.picture?.close();
    });
    this.canvas.addEventListener("webglcontextrestored", () => {
      const orbit = this.picture?.orbit;
      this.picture = new SolidPicture(this.canvas);
      if (orbit) this.picture.orbit = orbit;
      this.refresh();
    });
  }

  /** Loads what is shown, unless the view is closed. */
  refresh() {
    if (!this.details.open) return;
    this.outdated = false;
    this.run(() => this.session.attempt(async () => {
      this.picture ??= new SolidPicture(this.canvas);
      const { bodies, cameras } = readGlb(bytesOf(await this.session.connection.ask("export", { kind: "glb", ...this.fields() })));
      this.picture.load(bodies);
      const [camera] = cameras;
      const first = this.home === null;
      this.home = orbitOf(camera);
      if (first) this.back();
      this.canvas.dataset.bodies = bodies.map(({ name }) => name).join(" ");
    }));
  }

  /**
   * What is shown may be another scene, or have other requirements.
   * @param {boolean} dragged bodies are only moved until the drag is over: pictures from above come first
   * @param {string[]} names
   * @param {Pose[]} poses
   */
  follow(dragged, names, poses) {
    if (dragged) this.move(names, poses);
    else if (this.outdated) this.refresh();
  }

  /** @param {string[]} names @param {Pose[]} poses */
  move(names, poses) {
    names.forEach((name, k) => this.picture?.move(name, ...poses[k]));
  }

  /** A plank and its robots. @param {Pose} plank @param {Spot[]} centres of the robots, in the plank's frame */
  moveTeam(plank, centres) {
    this.move(["plank", ...centres.map((_, k) => `robot_${k + 1}`)], [plank, ...centres.map((each) => /** @type {Pose} */ ([...placed(each, plank), plank[2]]))]);
  }

  /** @param {number} azimuth @param {number} elevation */
  turn(azimuth, elevation) {
    if (!this.picture) return;
    const { orbit } = this.picture;
    orbit.azimuth += azimuth;
    orbit.elevation = clamp(orbit.elevation + elevation, 0.02, Math.PI / 2);
    this.picture.redraw();
  }

  /** @param {number} factor of the distance */
  zoom(factor) {
    if (!this.picture || !this.home) return;
    this.picture.orbit.distance = clamp(this.picture.orbit.distance * factor, this.home.distance / 8, 4 * this.home.distance);
    this.picture.redraw();
  }

  back() {
    if (!this.picture || !this.home) return;
    const aspect = this.canvas.clientWidth / this.canvas.clientHeight;
    this.picture.orbit = { ...this.home, distance: this.home.distance * Math.max(1, NARROW / aspect) };
    this.picture.redraw();
  }

  /** @param {KeyboardEvent} event */
  key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const turns = /** @type {Record<string, [number, number]>} */ ({
      ArrowLeft: [-TURN, 0], ArrowRight: [TURN, 0], ArrowUp: [0, TURN], ArrowDown: [0, -TURN],
    });
    if (turns[event.key]) this.turn(...turns[event.key]);
    else if (event.key === "+") this.zoom(1 / ZOOM);
    else if (event.key === "-") this.zoom(ZOOM);
    else if (event.key === "0") this.back();
    else return;
    event.preventDefault();
  }
}

/** The camera's way around the point of the ground that it looks at. @param {import("./glb.js").Camera} camera @returns {import("./webgl.js").Orbit} */
const orbitOf = ({ place, turn, angle }) => {
  const back = turned([0, 0, 1], turn);
  const distance = place[2] / back[2];
  const target = place.map((each, k) => each - distance * back[k]);
  return { target, distance, angle, elevation: Math.asin(back[2]), azimuth: Math.atan2(back[0], -back[1]) };
};
