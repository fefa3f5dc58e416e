// @ts-check
/** What every page of the studio has: tasks to go to, errors, a line that says what is under way, a connection. */

import { Connection } from "./connection.js";
import { byId, html } from "./elements.js";

const STOPPED = "The studio has stopped, or this page was opened without its token. Start `deggflow studio` and open the address it prints.";
const TASKS = { "index.html": "Tabletop", "bridge.html": "Bridge" };

/** @param {Error | null} error */
export const showTrouble = (error) => {
  const place = byId("trouble");
  place.hidden = error === null;
  place.textContent = error ? error.message : "";
};

/** @param {string} words */
export const say = (words) => {
  const place = byId("status");
  if (place.textContent !== words) place.textContent = words;
};

/** Names and values above a certificate. @param {[string, string][]} facts */
export const showFacts = (facts) => {
  byId("facts").replaceChildren(...facts.map(([name, value]) => html("div", {}, html("dt", {}, name), html("dd", {}, value))));
};

/** How a session tells the page. @param {() => void} onChange @returns {import("./session.js").Listeners} */
export const listeners = (onChange) => ({
  onChange,
  onTrouble: showTrouble,
  onBusy: (busy) => document.querySelector("main")?.setAttribute("aria-busy", String(busy)),
});

/**
 * Connects the page; it is built once, and survives a restart of the server.
 * @param {object} options
 * @param {string} options.desk of the server that answers
 * @param {string} options.first what is asked for, to build the page
 * @param {string} options.loading is said meanwhile
 * @param {(answer: any, connection: Connection) => unknown} options.build
 * @param {() => void} [options.resume] the server is back
 * @param {boolean} [options.lasting] a page that needs no server once it is built
 * @param {string} options.gone is said when the server does not answer
 */
export const openPage = ({ desk, first, loading, build, resume = () => {}, lasting = false, gone }) => {
  let built = false;
  new Connection(desk, async (open, connection) => {
    if (!open) {
      if (!(built && lasting)) showTrouble(new Error(gone));
      return;
    }
    showTrouble(null);
    if (built) {
      resume();
      return;
    }
    say(loading);
    const answer = await connection.ask(first);
    built = true;
    await build(answer, connection);
  });
};

/**
 * A page on a task: it begins with what an earlier visit left, or with a random condition.
 * @param {object} options
 * @param {string} options.desk of the server that answers
 * @param {string} options.first what is asked for, to build the page
 * @param {string} options.loading is said meanwhile
 * @param {string} options.compiling is said while the first result is made
 * @param {{ask: string, fields: object}} options.random
 * @param {(answer: any, connection: Connection) => import("./session.js").Session & {condition: any, shown: any, start(): unknown}} options.build
 */
export const openTask = ({ desk, first, loading, compiling, random, build }) => {
  /** @type {ReturnType<typeof build> | null} */
  let session = null;
  openPage({
    desk,
    first,
    loading,
    gone: STOPPED,
    build: async (answer, connection) => {
      session = build(answer, connection);
      if (!session.restore()) session.condition = (await connection.ask(random.ask, random.fields)).condition;
      session.onChange();
      say(compiling);
      session.start();
    },
    resume: () => {
      if (session && !session.shown) session.start();
    },
  });
};

addEventListener("error", (event) => showTrouble(event.error ?? new Error(event.message)));
addEventListener("unhandledrejection", (event) => showTrouble(event.reason));

const here = location.pathname.split("/").pop() || "index.html";
document.querySelector("nav")?.append(
  ...Object.entries(TASKS).flatMap(([address, name]) => [html("a", { href: address, ...(address === here ? { "aria-current": "page" } : {}) }, name), " "]),
);
