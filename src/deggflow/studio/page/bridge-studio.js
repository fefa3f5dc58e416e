// @ts-check
/** The bridge page's state: what is asked for, what is shown, and how the one follows the other. */

import { Session, entryOf, latestOnly } from "./session.js";

/** @typedef {import("./bridge-types.js").Condition} Condition */
/** @typedef {import("./bridge-types.js").Trial} Trial */
/** @typedef {import("./bridge-types.js").Nominal} Nominal */
/** @typedef {import("./bridge-types.js").Policy} Policy */
/** @typedef {import("./types.js").Pose} Pose */

/**
 * A trial on the page.
 * @typedef {object} Shown
 * @property {Trial} trial its line in a file, parsed
 * @property {string} line
 * @property {string | null} refuted what independent checks find wrong
 * @property {import("./bridge-types.js").Margin[]} margins the least first
 * @property {Nominal | null} nominal from the same z(0); null if it is not known
 * @property {string | null} command
 * @property {number} number of the trial in its file, from 0
 */

export class BridgeStudio extends Session {
  /** @param {import("./connection.js").Connection} connection @param {import("./session.js").Listeners} listeners */
  constructor(connection, listeners) {
    super(connection, listeners, "deggflow-studio-bridge", ["condition", "seed", "maxDraws", "speedLimit", "live"]);
    this.work = latestOnly();
    this.look = latestOnly();
    /** @type {Condition} */
    this.condition = { plank: { x: 0, y: 0, theta: 0 }, goal: { x: 0, y: 0, theta: 0 }, contacts: [] };
    /** @type {number | null} m/s */
    this.speedLimit = null;
    /** @type {{start: string | null, goal: string | null}} what is wrong with the plank at its start and goal */
    this.wrong = { start: null, goal: null };
    /** @type {Shown | null} */
    this.shown = null;
    /** @type {{poses: Pose[], policies: Policy[]} | null} of the trial under way */
    this.underway = null;
  }

  get asked() {
    const { condition, seed, maxDraws, speedLimit } = this;
    return { condition, seed, max_draws: maxDraws, speed_limit: speedLimit };
  }

  /** Whether the trial that is shown is not what is asked for. */
  get stale() {
    return this.shown !== null && numbersOf(this.shown.trial.condition) !== numbersOf(this.condition);
  }

  /** @param {Partial<Condition>} part @param {{dragging?: boolean}} options while dragging, the trial waits */
  edit(part, { dragging = false } = {}) {
    this.condition = { ...this.condition, ...part };
    this.onChange();
    if (dragging || !this.live) this.place();
    else this.run();
  }

  /** What is wrong with start and goal. */
  place() {
    return this.look(() => this.attempt(async () => {
      this.wrong = await this.connection.ask("placed", { condition: this.condition });
    }));
  }

  start() {
    return this.run();
  }

  run() {
    return this.work(async () => {
      this.onBusy(true);
      await this.attempt(async () => {
        const { asked } = this;
        this.wrong = await this.connection.ask("placed", { condition: asked.condition });
        const { x, y, theta } = asked.condition.plank;
        const underway = { poses: [/** @type {Pose} */ ([x, y, theta])], policies: /** @type {Policy[]} */ ([]) };
        this.underway = underway;
        const found = await this.connection.ask("run", asked, ({ poses, policy }) => {
          underway.poses.push(...poses);
          underway.policies.push(policy);
          this.onChange();
        });
        this.shown = { ...found, trial: JSON.parse(found.line), number: 0 };
      });
      this.underway = null;
      this.keep();
      this.onChange();
      this.onBusy(false);
    });
  }

  /** Both factors while a policy of the trial that is shown was generated. @param {number} policy */
  course(policy) {
    const { line, number } = /** @type {Shown} */ (this.shown);
    return this.connection.ask("course", { line, number, policy });
  }

  /** Rows of a file that the server has read. @param {{line?: string, condition?: Condition}[]} rows */
  openRows(rows) {
    const [first] = rows;
    const entries = rows.flatMap(({ line }, number) => (line ? [entryOf(line, number)] : []));
    if (entries.length) {
      this.add(entries);
      this.show(entries[0]);
    } else if (first.condition) {
      this.condition = first.condition;
      this.run();
    }
  }

  keepShown() {
    if (!this.shown) throw new Error("There is no trial yet.");
    this.add([entryOf(this.shown.line, this.shown.number)]);
  }

  /** A trial of the gallery, examined anew. @param {import("./session.js").Entry} entry */
  show({ line, number }) {
    return this.work(async () => {
      this.onBusy(true);
      await this.attempt(async () => {
        const { rows } = await this.connection.ask("open", { name: "trial.jsonl", text: line });
        const trial = JSON.parse(line);
        this.condition = trial.condition;
        this.seed = trial.seed;
        this.speedLimit = trial.certificate.speed_limit ?? null;
        this.shown = { ...rows[0], trial, line, nominal: null, command: null, number };
        this.wrong = await this.connection.ask("placed", { condition: this.condition });
      });
      this.keep();
      this.onBusy(false);
    });
  }
}

/** A condition as text, whatever the order of its entries. @param {Condition} condition */
const numbersOf = ({ plank, goal, contacts }) => JSON.stringify([plank.x, plank.y, plank.theta, goal.x, goal.y, goal.theta, contacts]);
