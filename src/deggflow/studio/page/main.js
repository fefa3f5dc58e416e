// @ts-check
/** Puts the page together. */

import { CertificateView } from "./certificate.js";
import { Connection } from "./connection.js";
import { Controls } from "./controls.js";
import { byId, html } from "./elements.js";
import { Files } from "./files.js";
import { Gallery } from "./gallery.js";
import { spoken } from "./geometry.js";
import { Handles } from "./handles.js";
import { Picture, defineLooks } from "./picture.js";
import { ReplayView } from "./replay.js";
import { Studio } from "./studio.js";

/** @typedef {import("./studio.js").Shown} Shown */
/** @typedef {import("./types.js").Judgement} Judgement */

const RANDOM = { size: 8, family: "changed", seed: 0 }; // the scene that a new page begins with

/** @param {Error | null} error */
const showTrouble = (error) => {
  const place = byId("trouble");
  place.hidden = error === null;
  place.textContent = error ? error.message : "";
};
addEventListener("error", (event) => showTrouble(event.error ?? new Error(event.message)));
addEventListener("unhandledrejection", (event) => showTrouble(event.reason));

/** @param {Judgement} judgement */
const caption = (judgement) =>
  judgement.reason ? spoken(judgement.reason) : `all requirements hold, ${(1000 * judgement.min_margin).toFixed(1)} mm to spare`;

/** @param {import("./types.js").Library} library @param {Connection} connection */
const build = (library, connection) => {
  defineLooks(byId("looks"), library);
  const nominal = new Picture(byId("nominal", SVGElement), library);
  const guided = new Picture(byId("guided", SVGElement), library);
  const studio = new Studio(connection, () => refresh(), showTrouble, (busy) => byId("scene").setAttribute("aria-busy", String(busy)));
  const handles = new Handles(guided, studio);
  const controls = new Controls(studio, library);
  const certificate = new CertificateView((margin) => guided.mark(margin));
  const gallery = new Gallery(studio, library);
  const replay = new ReplayView(
    async () => {
      const { shown } = studio;
      if (!shown || shown.draw === null || shown.origin !== "generated") return null;
      const { condition, poses, draw } = shown;
      try {
        const replay = await connection.ask("replay", { condition, poses, draw, seed: shown.scene.seed });
        // It ends at what is shown, to the last digit.
        replay.guided[replay.guided.length - 1] = poses;
        if (shown.nominal) replay.nominal[replay.nominal.length - 1] = shown.nominal.poses;
        return replay;
      } catch (error) {
        showTrouble(/** @type {Error} */ (error));
        return null;
      }
    },
    (before, after, underway) => {
      if (!studio.shown) return;
      for (const picture of [nominal, guided]) picture.root.classList.toggle("replaying", underway);
      nominal.move(studio.shown.condition, before);
      guided.move(studio.shown.condition, after);
    },
  );
  new Files(studio);
  byId("undo-move").addEventListener("click", () => studio.undoMoves());
  /** @type {Shown | null} */
  let drawn = null;

  const refresh = () => {
    controls.refresh();
    gallery.refresh();
    const { shown } = studio;
    if (shown && shown !== drawn) {
      const started = drawn?.trace !== shown.trace || drawn?.origin !== shown.origin;
      drawn = shown;
      for (const picture of [nominal, guided]) picture.root.classList.remove("replaying");
      guided.draw(shown.condition, shown.poses, shown.judgement);
      guided.nameBreaches(shown.judgement);
      byId("nominal").toggleAttribute("hidden", !shown.nominal);
      if (shown.nominal) nominal.draw(shown.condition, shown.nominal.poses, shown.nominal.judgement);
      if (started) replay.reset(shown.trace);
      certificate.draw(shown);
      report(shown);
    }
    handles.refresh();
    byId("undo-move").hidden = studio.before === null;
    if (studio.slow) say(shown ? "Working." : COMPILING);
    else if (shown) say(summary(shown));
  };

  addEventListener("resize", () => {
    if (!drawn) return;
    guided.draw(drawn.condition, drawn.poses, drawn.judgement);
    guided.nameBreaches(drawn.judgement);
    if (drawn.nominal) nominal.draw(drawn.condition, drawn.nominal.poses, drawn.nominal.judgement);
    certificate.remark();
    handles.refresh();
  });
  return studio;
};

const COMPILING = "Making the first scene. The first one of a size is compiled, which can take half a minute; later ones take milliseconds.";

/** @param {string} words */
const say = (words) => {
  const place = byId("status");
  if (place.textContent !== words) place.textContent = words;
};

/** @param {Shown} shown */
const summary = (shown) => {
  const { judgement, origin, scene } = shown;
  const how = { generated: "Generated", edited: "Edited, not generated anew", moved: "Moved by hand", file: "From a file" }[origin];
  const draws = origin === "generated" ? `; ${scene.certificate.draws} ${scene.certificate.draws === 1 ? "draw" : "draws"}` : "";
  const agree = judgement.satisfied === judgement.oracle_margin >= -1e-9 ? "" : " Shapely disagrees.";
  return `${how}: ${caption(judgement)}${draws}.${agree}`;
};

/** Captions, what is not met, and the command. @param {Shown} shown */
const report = (shown) => {
  byId("guided-caption").textContent = caption(shown.judgement);
  byId("nominal-caption").textContent = shown.nominal ? caption(shown.nominal.judgement) : "not known of a scene from a file";
  byId("unmet").replaceChildren(...shown.judgement.breaches.map((words) => html("li", {}, spoken(words))));
  byId("command").textContent = shown.command ?? "";
  byId("copy").hidden = byId("command").hidden = shown.command === null;
  byId("copy").textContent = "Copy command";
  byId("command-note").textContent = shown.command
    ? "The command that makes this scene:"
    : "No command makes this scene: it was edited, comes from a file, or is a draw chosen by hand. Save it instead.";
};

/** @type {Studio | null} */
let studio = null;
const connection = new Connection("tabletop", async (open) => {
  if (!open) {
    showTrouble(new Error("The studio has stopped, or this page was opened without its token. Start `deggflow studio` and open the address it prints."));
    return;
  }
  showTrouble(null);
  if (studio) {
    if (!studio.shown) studio.generate();
    return;
  }
  say("Loading the objects.");
  studio = build(await connection.ask("library"), connection);
  if (!studio.restore()) studio.condition = (await connection.ask("draw", RANDOM)).condition;
  studio.onChange();
  say(COMPILING);
  studio.generate();
});
