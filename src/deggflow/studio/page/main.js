// @ts-check
/** Puts the page together. */

import { CertificateView } from "./certificate.js";
import { Controls } from "./controls.js";
import { byId, html } from "./elements.js";
import { Files } from "./files.js";
import { Gallery } from "./gallery.js";
import { spoken } from "./geometry.js";
import { Handles } from "./handles.js";
import { listeners, openTask, say, showTrouble } from "./page.js";
import { Picture, defineLooks } from "./picture.js";
import { ReplayView } from "./replay.js";
import { SolidView } from "./solid-view.js";
import { Studio, posesOf } from "./studio.js";

/** @typedef {import("./studio.js").Shown} Shown */
/** @typedef {import("./types.js").Judgement} Judgement */

const RANDOM = { size: 8, family: "changed", seed: 0 }; // the scene that a new page begins with
const COMPILING = "Making the first scene. The first one of a size is compiled, which can take half a minute; later ones take milliseconds.";

/** @param {Judgement} judgement */
const caption = (judgement) =>
  judgement.reason ? spoken(judgement.reason) : `all requirements hold, ${(1000 * judgement.min_margin).toFixed(1)} mm to spare`;

/** @param {import("./types.js").Library} library @param {import("./connection.js").Connection} connection */
const build = (library, connection) => {
  defineLooks(byId("looks"), library);
  const nominal = new Picture(byId("nominal", SVGElement), library);
  const guided = new Picture(byId("guided", SVGElement), library);
  const studio = new Studio(connection, listeners(() => refresh()));
  const handles = new Handles(guided, studio);
  const controls = new Controls(studio, library);
  const certificate = new CertificateView((margin) => guided.mark(margin));
  const gallery = new Gallery(studio, "scene", (root, { condition, ...scene }) =>
    new Picture(root, library, { labels: false }).draw(condition, posesOf(scene), null),
  );
  const shownFields = () => {
    if (!studio.shown) throw new Error("There is no scene yet.");
    const { condition, poses } = studio.shown;
    return { condition, poses };
  };
  const solid = new SolidView(studio, shownFields);
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
      solid.move(studio.shown.condition.objects, after);
    },
  );
  const files = new Files(studio, {
    what: "scene",
    line: () => studio.currentLine(),
    fields: shownFields,
    film: async () => {
      const found = studio.shown?.origin === "generated" ? await replay.loaded() : null;
      if (!found) throw new Error("A video shows how a scene was generated: generate this one first.");
      const { tau, nominal: before, guided: after } = found;
      return { condition: shownFields().condition, tau, nominal: before, guided: after };
    },
  });
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
      solid.outdated = true;
      report(shown);
      files.showCommand(shown.command, "No command makes this scene: it was edited, comes from a file, or is a draw chosen by hand. Save it instead.");
    }
    handles.refresh();
    if (shown) solid.follow(handles.dragging.dragging, shown.condition.objects, shown.poses);
    byId("undo-move").hidden = studio.before === null;
    if (studio.slow) say(shown ? "Working." : COMPILING);
    else if (shown) say(summary(shown));
  };

  addEventListener("resize", () => {
    if (!drawn) return;
    guided.draw(drawn.condition, drawn.poses, drawn.judgement);
    guided.nameBreaches(drawn.judgement);
    if (drawn.nominal) nominal.draw(drawn.condition, drawn.nominal.poses, drawn.nominal.judgement);
    certificate.table.remark();
    handles.refresh();
  });
  return studio;
};

/** @param {Shown} shown */
const summary = (shown) => {
  const { judgement, origin, scene } = shown;
  const how = { generated: "Generated", edited: "Edited, not generated anew", moved: "Moved by hand", file: "From a file" }[origin];
  const draws = origin === "generated" ? `; ${scene.certificate.draws} ${scene.certificate.draws === 1 ? "draw" : "draws"}` : "";
  const agree = judgement.satisfied === judgement.oracle_margin >= -1e-9 ? "" : " Shapely disagrees.";
  return `${how}: ${caption(judgement)}${draws}.${agree}`;
};

/** Captions, and what is not met. @param {Shown} shown */
const report = (shown) => {
  byId("guided-caption").textContent = caption(shown.judgement);
  byId("nominal-caption").textContent = shown.nominal ? caption(shown.nominal.judgement) : "not known of a scene from a file";
  byId("unmet").replaceChildren(...shown.judgement.breaches.map((words) => html("li", {}, spoken(words))));
};

openTask({ desk: "tabletop", first: "library", loading: "Loading the objects.", compiling: COMPILING, random: { ask: "draw", fields: RANDOM }, build });
