// @ts-check
/** What the state of every page has in common: what is kept in the tab, errors, and a gallery of results. */

import { Lost } from "./connection.js";

/**
 * A result in the gallery.
 * @typedef {object} Entry
 * @property {string} line as it stands in a file
 * @property {boolean} satisfied
 * @property {string | null} reason
 * @property {number} number of its line in the file that it is from, from 0
 *
 * @typedef {object} Listeners
 * @property {() => void} onChange
 * @property {(error: Error | null) => void} onTrouble
 * @property {(busy: boolean) => void} onBusy
 */

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

export class Session {
  /**
   * @param {import("./connection.js").Connection} connection
   * @param {Listeners} listeners
   * @param {string} key of this tab's storage
   * @param {string[]} kept names of what the storage holds
   */
  constructor(connection, { onChange, onTrouble, onBusy }, key, kept) {
    this.connection = connection;
    this.onChange = onChange;
    this.onTrouble = onTrouble;
    this.onBusy = onBusy;
    this.key = key;
    this.kept = kept;
    this.seed = 0;
    this.maxDraws = 8;
    this.live = true;
    /** @type {Entry[]} */
    this.gallery = [];
  }

  /** What an earlier visit of this tab left. @returns {boolean} whether there was something */
  restore() {
    const state = read(this.key);
    if (state) Object.assign(this, state);
    const gallery = read(`${this.key}-gallery`);
    if (gallery) this.gallery = gallery;
    return state !== null;
  }

  keep() {
    const state = /** @type {Record<string, unknown>} */ (/** @type {unknown} */ (this));
    write(this.key, Object.fromEntries(this.kept.map((name) => [name, state[name]])));
    write(`${this.key}-gallery`, this.gallery);
  }

  /** @param {Entry[]} entries */
  add(entries) {
    this.gallery = [...this.gallery, ...entries];
    this.keep();
    this.onChange();
  }

  /** @param {Entry} entry */
  remove(entry) {
    this.gallery = this.gallery.filter((each) => each !== entry);
    this.keep();
    this.onChange();
  }

  /** Whatever goes wrong is shown, and the page goes on. @param {() => Promise<unknown> | unknown} task */
  async attempt(task) {
    try {
      await task();
      this.onTrouble(null);
      this.onChange();
    } catch (error) {
      if (!(error instanceof Lost)) this.onTrouble(/** @type {Error} */ (error));
    }
  }
}

/** @param {string} line @returns {Entry} */
export const entryOf = (line, number = 0) => {
  const { satisfied, reason } = JSON.parse(line).certificate;
  return { line, satisfied, reason, number };
};

/** @param {string} key */
const read = (key) => {
  try {
    return JSON.parse(sessionStorage.getItem(key) ?? "null");
  } catch {
    return null;
  }
};

/** @param {string} key @param {unknown} value */
const write = (key, value) => {
  try {
    sessionStorage.setItem(key, JSON.stringify(value));
  } catch {
    // The tab's storage is full: the page works without it.
  }
};
