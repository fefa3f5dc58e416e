// @ts-check
/** The page's state: what is asked for, what is shown, and how the one follows the other. */

import { Lost } from "./connection.js";

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

const KEY = "deggflow-studio"; // of this tab's storage

/** Runs one task at a time; of those that come meanwhile, the last. */
export const latestOnly = () => {
  let busy = false;
  /** @type {(() => Promise<void>) | null} */
  let next = null;
  /** @param {() => Promise<void>} task */
  const run = async (task) => {
    if (busy) {
      next = task;
      return;
    }
    busy = true;
    try {
      await task();
    } finally {
      busy = false;
      const waiting = next;
      next = null;
      if (waiting) run(waiting);
    }
  };
  return run;
};

export class Studio {
  /**
   * @param {import("./connection.js").Connection} connection
   * @param {() => void} onChange
   * @param {(error: Error | null) => void} onTrouble
   * @param {(busy: boolean) => void} onBusy
   */
  constructor(connection, onChange, onTrouble, onBusy) {
    this.connection = connection;
    this.onChange = onChange;
    this.onTrouble = onTrouble;
    this.onBusy = onBusy;
    this.run = latestOnly();
    /** @type {Condition} */
    this.condition = { objects: [] };
    this.seed = 0;
    this.maxDraws = 8;
    /** @type {number | null} */
    this.draw = null;
    this.live = true;
    /** @type {string | null} */
    this.selected = null;
    /** @type {Shown | null} */
    this.shown = null;
    /** @type {Shown | null} what was generated before objects were moved by hand */
    this.before = null;
    /** @type {{line: string, condition: Condition, poses: Pose[], satisfied: boolean, reason: string | null}[]} */
    this.gallery = [];
    this.slow = false;
  }

  /** What an earlier visit of this tab left. @returns {boolean} whether there was something */
  restore() {
    try {
      const kept = JSON.parse(sessionStorage.getItem(KEY) ?? "null");
      if (!kept) return false;
      Object.assign(this, kept);
      return true;
    } catch {
      return false;
    }
  }

  keep() {
    const { condition, seed, maxDraws, draw, live, gallery } = this;
    try {
      sessionStorage.setItem(KEY, JSON.stringify({ condition, seed, maxDraws, draw, live, gallery }));
    } catch {
      // The tab's storage is full: the page works without it.
    }
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

  async keepScene() {
    if (!this.shown) return;
    const { condition, poses, judgement } = this.shown;
    const { satisfied, reason } = judgement;
    this.gallery.push({ line: await this.currentLine(), condition, poses, satisfied, reason });
    this.onChange();
  }

  /** Rows of a file that the server has read. @param {{line?: string, condition?: Condition}[]} rows */
  async openRows(rows) {
    const [first] = rows;
    if (first.condition) {
      this.draw = null;
      this.edit(first.condition);
      return;
    }
    for (const { line } of rows) {
      if (!line) continue;
      const { condition, certificate, ...scene } = JSON.parse(line);
      const { satisfied, reason } = certificate;
      this.gallery.push({ line, condition, poses: posesOf(scene), satisfied, reason });
    }
    await this.show(this.gallery[this.gallery.length - rows.length].line);
  }

  /** A scene of the gallery. @param {string} line */
  show(line) {
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
      try {
        await task();
        this.onTrouble(null);
      } catch (error) {
        if (!(error instanceof Lost)) this.onTrouble(/** @type {Error} */ (error));
      } finally {
        clearTimeout(slow);
        this.slow = false;
        this.keep();
        this.onChange();
        this.onBusy(false);
      }
    });
  }
}

/** @param {{objects: {x: number, y: number, theta: number}[]}} scene @returns {Pose[]} */
export const posesOf = (scene) => scene.objects.map(({ x, y, theta }) => [x, y, theta]);
