// @ts-check
/** Puts the bridge's page together. */

import { BridgeControls } from "./bridge-controls.js";
import { bridgeGrips } from "./bridge-grips.js";
import { BridgePicture, centreOf, poseOf, thumbnail } from "./bridge-picture.js";
import { PoliciesView } from "./bridge-policies.js";
import { BridgeReplay } from "./bridge-replay.js";
import { BridgeStudio } from "./bridge-studio.js";
import { Grips } from "./drag.js";
import { byId } from "./elements.js";
import { Files } from "./files.js";
import { Gallery } from "./gallery.js";
import { MarginTable } from "./margins.js";
import { listeners, openTask, say, showFacts, showTrouble } from "./page.js";
import { SolidView } from "./solid-view.js";

/** @typedef {import("./bridge-studio.js").Shown} Shown */
/** @typedef {import("./bridge-types.js").World} World */

const RANDOM = { size: 4, seed: 1 }; // the trial that a new page begins with
const COMPILING = "Running the first trial. Its program is compiled, which can take half a minute; later trials take less than a second.";

/** @param {{reason: string | null}} outcome @param {number} actions @param {number} dt */
const ended = ({ reason }, actions, dt) => reason ?? `bridge built in ${(actions * dt).toFixed(1)} s`;

/** Robots that a reason names, from 0. @param {string | null} reason */
const blamed = (reason) => [...(reason ?? "").matchAll(/robots? (\d+(?:, \d+)*)/g)].flatMap((match) => match[1].split(", ").map((each) => Number(each) - 1));

/** @param {World} world @param {import("./connection.js").Connection} connection */
const build = (world, connection) => {
  const picture = new BridgePicture(byId("world", SVGSVGElement), world);
  const studio = new BridgeStudio(connection, listeners(() => refresh()));
  /** @type {Grips} */
  const grips = new Grips(picture.root, () => bridgeGrips(studio, world, () => grips.dragged !== null), {
    onEnd: (_, moved) => {
      if (moved && studio.live) studio.run();
    },
  });
  const controls = new BridgeControls(studio, world);
  const policies = new PoliciesView(
    async (policy) => {
      try {
        return await studio.course(policy);
      } catch (error) {
        showTrouble(/** @type {Error} */ (error));
        return null;
      }
    },
    (policy) => {
      replay.player.stop();
      replay.show(Math.min(policy * world.executed * world.dt, replay.duration));
    },
  );
  /** @type {MarginTable<import("./bridge-types.js").Margin>} */
  const margins = new MarginTable(["least distance", "at, s"], ({ name, time }) => ({ key: name, name, cells: [time.toFixed(1)] }), (margin, chosen) => {
    if (margin && chosen) {
      replay.player.stop();
      replay.show(margin.time);
    }
    picture.mark(margin);
  });
  const ghost = byId("ghost", HTMLInputElement);
  const replay = new BridgeReplay(world.dt, (guided, nominal) => {
    const start = poseOf(studio.condition.plank);
    picture.team.move(guided ?? start);
    picture.twin.root.toggleAttribute("hidden", nominal === null || !ghost.checked);
    if (nominal) picture.twin.move(nominal);
    solid.moveTeam(guided ?? start, studio.condition.contacts.map((contact) => centreOf(contact, world)));
  });
  ghost.addEventListener("change", () => replay.show(replay.slider.valueAsNumber));
  const shownFields = () => {
    if (!studio.shown) throw new Error("There is no trial yet.");
    return { line: studio.shown.line };
  };
  const solid = new SolidView(studio, shownFields);
  const files = new Files(studio, { what: "trial", line: () => shownFields().line, fields: shownFields, film: async () => shownFields() });
  const gallery = new Gallery(studio, "trial", (root, trial) => thumbnail(root, world, trial));
  /** @type {Shown | null} */
  let drawn = null;
  let stale = false;

  const refresh = () => {
    controls.refresh();
    gallery.refresh();
    picture.drawCondition(studio.condition, studio.wrong);
    grips.describe((id) => picture.find(id));
    const { shown, underway } = studio;
    if (underway) {
      drawn = null;
      picture.team.draw(studio.condition.contacts);
      picture.team.drawPath(underway.poses);
      picture.twin.drawPath([]);
      picture.twin.root.setAttribute("hidden", "");
      replay.player.stop();
      picture.team.move(underway.poses[underway.poses.length - 1]);
      policies.draw([...underway.policies]);
      margins.draw([]);
      say(underway.policies.length ? `Running: policy ${underway.policies.length + 1}.` : COMPILING);
      return;
    }
    if (!shown) return;
    if (studio.stale) {
      if (!stale) replay.reset(null, null, 0);
      picture.team.draw(studio.condition.contacts);
      picture.team.drawPath([]);
      picture.twin.drawPath([]);
      picture.team.move(poseOf(studio.condition.plank));
      margins.draw([]);
      const { start, goal } = studio.wrong;
      say(start ? `At the start, ${start}.` : goal ? `At the goal, ${goal}.` : "Edited; the trial has not been run yet.");
      drawn = null;
    } else if (shown !== drawn) {
      drawn = shown;
      const { trial, nominal } = shown;
      const { reason } = trial.outcome;
      picture.team.draw(trial.condition.contacts, blamed(reason), reason !== null);
      picture.team.drawPath(trial.poses);
      picture.twin.draw(trial.condition.contacts);
      picture.twin.drawPath(nominal && ghost.checked ? nominal.poses : []);
      policies.draw(trial.certificate.policies);
      margins.draw(shown.margins);
      replay.reset(trial, nominal, trial.twists.length * trial.dt);
      solid.refresh();
      report(shown);
      files.showCommand(shown.command, "This trial comes from a file or the gallery.");
    }
    stale = studio.stale;
  };
  addEventListener("resize", () => picture.drawCondition(studio.condition, studio.wrong));
  ghost.addEventListener("change", () => picture.twin.drawPath(drawn?.nominal && ghost.checked ? drawn.nominal.poses : []));
  return studio;
};

/** Outcome and certificate. @param {Shown} shown */
const report = ({ trial, nominal, refuted, command }) => {
  const { certificate, outcome } = trial;
  const how = ended(outcome, trial.twists.length, trial.dt);
  byId("guided-caption").textContent = how;
  byId("nominal-caption").textContent = nominal ? ended(nominal, nominal.twists.length, trial.dt) : "not known of a trial from a file";
  const { reason } = certificate;
  byId("unmet").textContent = reason ?? "";
  byId("unmet").hidden = reason === null;
  say(`${command ? "Run" : "From a file"}: ${certificate.satisfied ? `${how}, every policy below its bounds` : how}.`);
  showFacts([
    ["certificate", certificate.satisfied ? "all hold" : "NOT satisfied"],
    ["least margin", `${(1000 * certificate.min_margin).toFixed(0)} mm`],
    ["policies", String(certificate.policies.length)],
    ["draws at most", String(certificate.draws)],
    ["speed limit", certificate.speed_limit === undefined ? "none" : `${certificate.speed_limit} m/s`],
    ["independent replay", refuted === null ? "agrees" : `finds that ${refuted}`],
  ]);
};

openTask({ desk: "bridge", first: "world", loading: "Loading the world.", compiling: COMPILING, random: { ask: "random", fields: RANDOM }, build });
