// @ts-check
/** The page's state: what is asked for, what is shown, and how the one follows the other. */

import { Session, entryOf, latestOnly } from "./session.js";

/** @typedef {import("./types.js").Condition} Condition */
/** @typedef {import("./types.js").Affordance} Affordance */
/** @typedef {import("./types.js").Pose} Pose */
/** @typedef {import("./types.js").Judgement} Judgement */
/** @typedef {import("./types.js").Trace} Trace */
/** @typedef {import("./types.js").Replay} Replay */

/**
 * A scene on the page.
 * @typedef {object} Shown
 * @property {Condition} condition under which it is judged
 * @property {Pose[]} poses
 * @property {Judgement} judgement
 * @property {any} scene its line in a file, parsed
 * @property {string} line as it stands in a file
 * @property {Trace | null} trace
 * @property {{poses: Pose[], judgement: Judgement} | null} nominal of the same z(0); null if it is not known
 * @property {number | null} draw from 0; null if the scene is from a file
 * @property {string[]} refused reasons of the draws before it
 * @property {string | null} command
 * @property {"generated" | "edited" | "moved" | "file"} origin
 */

export class Studio extends Session {
  /** @param {import("./connection.js").Connection} connection @param {import("./session.js").Listeners} listeners */
  constructor(connection, listeners) {
    super(connection, listeners, "deggflow-studio", ["condition", "seed", "maxDraws", "draw", "live"]);
    this.run = latestOnly();
    /** @type {Condition} */
    this.condition = { objects: [] };
    /** @type {number | null} */
    this.draw = null;
    /** @type {string | null} */
    this.selected = null;
    /** @type {Shown | null} */
    this.shown = null;
    /** @type {Shown | null} what was generated before objects were moved by hand */
    this.before = null;
    this.slow = false;
  }

  /**
   * Another condition.
   * @param {Condition} condition
   * @param {{dragging?: boolean}} options while dragging, one draw is made
   */
  edit(condition, { dragging = false } = {}) {
    const same = condition.objects.join() === this.shown?.condition.objects.join();
    this.condition = condition;
    if (this.selected && !condition.objects.includes(this.selected)) this.selected = null;
    if (this.live || !same) this.generate({ dragging });
    else this.judge("edited");
    this.onChange();
  }

  /** @param {string} name @param {Partial<Affordance>} part @param {{dragging?: boolean}} options */
  require(name, part, options = {}) {
    const requirements = { ...this.condition.requirements };
    requirements[name] = { offset_scale: 1, radius_scale: 1, direction: 0, ...requirements[name], ...part };
    this.edit({ ...this.condition, requirements }, options);
  }

  start() {
    return this.generate();
  }

  /** @param {{dragging?: boolean}} options */
  generate({ dragging = false } = {}) {
    return this.work(async () => {
      const { condition, seed, draw } = this;
      if (condition.objects.length === 0) return;
      const max_draws = dragging ? 1 : this.maxDraws;
      const found = await this.connection.ask("generate", { condition, seed, draw, max_draws });
      const scene = JSON.parse(found.line);
      this.before = null;
      this.shown = { ...found, condition, scene, poses: posesOf(scene), origin: "generated" };
    });
  }

  /** Exact geometry on the scene that is shown, under the condition that is asked for. @param {"edited" | "moved"} origin */
  judge(origin) {
    return this.work(async () => {
      const { condition, shown } = this;
      if (!shown || condition.objects.length !== shown.poses.length) return;
      const judgement = await this.connection.ask("judge", { condition, poses: shown.poses });
      let { nominal } = shown;
      if (nominal && origin === "edited") {
        nominal = { ...nominal, judgement: await this.connection.ask("judge", { condition, poses: nominal.poses }) };
      }
      // Objects may have been moved on, or put back, meanwhile.
      if (origin === "moved" && this.shown?.origin !== "moved") return;
      const { poses } = this.shown ?? shown;
      this.shown = { ...shown, condition, poses, judgement, nominal, origin, trace: null, command: null };
    });
  }

  /** @param {string} name @param {Pose} pose */
  moveByHand(name, pose) {
    if (!this.shown) return;
    const index = this.shown.condition.objects.indexOf(name);
    if (index < 0) return;
    this.before ??= this.shown;
    this.condition = this.shown.condition;
    const poses = this.shown.poses.map((each, k) => (k === index ? pose : each));
    this.shown = { ...this.shown, poses, origin: "moved", trace: null, command: null };
    this.judge("moved");
    this.onChange();
  }

  undoMoves() {
    if (this.before) this.shown = this.before;
    this.before = null;
    this.onChange();
  }

  /** The line of the scene that is shown, with a certificate that is true of it. @returns {Promise<string>} */
  async currentLine() {
    if (!this.shown) throw new Error("There is no scene yet.");
    const { origin, line, condition, poses } = this.shown;
    if (origin === "generated" || origin === "file") return line;
    return (await this.connection.ask("line", { condition, poses, seed: this.seed })).line;
  }

  async keepShown() {
    this.add([entryOf(await this.currentLine())]);
  }

  /** Rows of a file that the server has read. @param {{line?: string, condition?: Condition}[]} rows */
  async openRows(rows) {
    const [first] = rows;
    if (first.condition) {
      this.draw = null;
      this.edit(first.condition);
      return;
    }
    const entries = rows.flatMap(({ line }, number) => (line ? [entryOf(line, number)] : []));
    this.add(entries);
    await this.show(entries[0]);
  }

  /** A scene of the gallery. @param {import("./session.js").Entry} entry */
  show({ line }) {
    return this.work(async () => {
      const scene = JSON.parse(line);
      const poses = posesOf(scene);
      const judgement = await this.connection.ask("judge", { condition: scene.condition, poses });
      this.condition = scene.condition;
      this.seed = scene.seed;
      this.before = null;
      this.shown = {
        condition: scene.condition, poses, judgement, scene, line,
        trace: null, nominal: null, draw: null, refused: [], command: null, origin: "file",
      };
    });
  }

  /** @param {() => Promise<void>} task */
  work(task) {
    return this.run(async () => {
      this.onBusy(true);
      const slow = setTimeout(() => {
        this.slow = true;
        this.onChange();
      }, 400);
      await this.attempt(task);
      clearTimeout(slow);
      this.slow = false;
      this.keep();
      this.onChange();
      this.onBusy(false);
    });
  }
}

/** @param {{objects: {x: number, y: number, theta: number}[]}} scene @returns {Pose[]} */
export const posesOf = (scene) => scene.objects.map(({ x, y, theta }) => [x, y, theta]);
