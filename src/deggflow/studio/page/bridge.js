// @ts-check
/** Puts the bridge's page together. */

import { BridgeControls } from "./bridge-controls.js";
import { bridgeGrips } from "./bridge-grips.js";
import { BridgePicture, poseOf } from "./bridge-picture.js";
import { PoliciesView } from "./bridge-policies.js";
import { BridgeReplay } from "./bridge-replay.js";
import { BridgeStudio } from "./bridge-studio.js";
import { Connection } from "./connection.js";
import { Grips } from "./drag.js";
import { byId, html } from "./elements.js";
import { copyCommand, save, saveMade, textOf } from "./files.js";

/** @typedef {import("./bridge-studio.js").Shown} Shown */
/** @typedef {import("./bridge-types.js").World} World */

const RANDOM = { size: 4, seed: 1 }; // the trial that a new page begins with
const COMPILING = "Running the first trial. Its program is compiled, which can take half a minute; later trials take less than a second.";

/** @param {Error | null} error */
const showTrouble = (error) => {
  const place = byId("trouble");
  place.hidden = error === null;
  place.textContent = error ? error.message : "";
};
addEventListener("error", (event) => showTrouble(event.error ?? new Error(event.message)));
addEventListener("unhandledrejection", (event) => showTrouble(event.reason));

/** @param {string} words */
const say = (words) => {
  const place = byId("status");
  if (place.textContent !== words) place.textContent = words;
};

/** @param {{reason: string | null}} outcome @param {number} actions @param {number} dt */
const ended = ({ reason }, actions, dt) => reason ?? `bridge built in ${(actions * dt).toFixed(1)} s`;

/** Robots that a reason names, from 0. @param {string | null} reason */
const blamed = (reason) => [...(reason ?? "").matchAll(/robots? (\d+(?:, \d+)*)/g)].flatMap((match) => match[1].split(", ").map((each) => Number(each) - 1));

/** @param {World} world @param {Connection} connection */
const build = (world, connection) => {
  const picture = new BridgePicture(byId("world", SVGSVGElement), world);
  const studio = new BridgeStudio(connection, () => refresh(), showTrouble, (busy) => byId("trial").setAttribute("aria-busy", String(busy)));
  const grips = new Grips(picture.root, () => bridgeGrips(studio, world, () => grips.dragged !== null), (dragged) => {
    if (dragged && studio.live) studio.run();
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
      replay.stop();
      replay.show(Math.min(policy * world.executed * world.dt, replay.duration));
    },
  );
  const ghost = byId("ghost", HTMLInputElement);
  const replay = new BridgeReplay(world.dt, (guided, nominal) => {
    const start = poseOf(studio.condition.plank);
    picture.team.move(guided ?? start);
    picture.twin.root.toggleAttribute("hidden", nominal === null || !ghost.checked);
    if (nominal) picture.twin.move(nominal);
  });
  ghost.addEventListener("change", () => replay.show(replay.slider.valueAsNumber));
  files(studio);
  /** @type {Shown | null} */
  let drawn = null;
  let stale = false;

  const refresh = () => {
    controls.refresh();
    picture.drawCondition(studio.condition, studio.wrong);
    grips.describe((id) => picture.find(id));
    const { shown, underway } = studio;
    if (underway) {
      drawn = null;
      picture.team.draw(studio.condition.contacts);
      picture.team.drawPath(underway.poses);
      picture.twin.drawPath([]);
      picture.twin.root.setAttribute("hidden", "");
      replay.stop();
      picture.team.move(underway.poses[underway.poses.length - 1]);
      policies.draw([...underway.policies]);
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
      replay.reset(trial, nominal, trial.twists.length * trial.dt);
      report(shown);
    }
    stale = studio.stale;
  };
  addEventListener("resize", () => picture.drawCondition(studio.condition, studio.wrong));
  ghost.addEventListener("change", () => picture.twin.drawPath(drawn?.nominal && ghost.checked ? drawn.nominal.poses : []));
  return studio;
};

/** Outcome, certificate, and the command. @param {Shown} shown */
const report = ({ trial, nominal, refuted, command }) => {
  const { certificate, outcome } = trial;
  const how = ended(outcome, trial.twists.length, trial.dt);
  byId("guided-caption").textContent = how;
  byId("nominal-caption").textContent = nominal ? ended(nominal, nominal.twists.length, trial.dt) : "not known of a trial from a file";
  const { reason } = certificate;
  byId("unmet").textContent = reason ?? "";
  byId("unmet").hidden = reason === null;
  say(`${command ? "Run" : "From a file"}: ${certificate.satisfied ? `${how}, every policy below its bounds` : how}.`);
  const facts = [
    ["certificate", certificate.satisfied ? "all hold" : "NOT satisfied"],
    ["least margin", `${(1000 * certificate.min_margin).toFixed(0)} mm`],
    ["policies", String(certificate.policies.length)],
    ["draws at most", String(certificate.draws)],
    ["speed limit", certificate.speed_limit === undefined ? "none" : `${certificate.speed_limit} m/s`],
    ["independent replay", refuted === null ? "agrees" : `finds that ${refuted}`],
  ];
  byId("facts").replaceChildren(...facts.map(([name, value]) => html("div", {}, html("dt", {}, name), html("dd", {}, value))));
  byId("command").textContent = command ?? "";
  byId("copy").hidden = byId("command").hidden = command === null;
  byId("copy").textContent = "Copy command";
  byId("command-note").textContent = command ? "The command that makes this trial:" : "This trial comes from a file.";
};

/** @param {BridgeStudio} studio */
const files = (studio) => {
  const attempt = (/** @type {() => Promise<void> | void} */ task) => () => studio.attempt(async () => task());
  const shown = () => {
    if (!studio.shown) throw new Error("There is no trial yet.");
    return studio.shown;
  };
  byId("save").addEventListener("click", attempt(() => void save("trial.jsonl", `${shown().line}\n`, "application/jsonl")));
  byId("copy").addEventListener("click", attempt(copyCommand));
  for (const button of document.querySelectorAll("[data-export]")) {
    const kind = button.getAttribute("data-export");
    button.addEventListener("click", attempt(async () => {
      const address = saveMade(await studio.connection.ask("export", { kind, line: shown().line }));
      if (kind === "png") byId("render").replaceChildren(html("img", { src: address, alt: "The end of the trial, by MuJoCo or matplotlib" }));
    }));
  }
  const rows = byId("row", HTMLSelectElement);
  rows.addEventListener("change", () => studio.showRow(Number(rows.value)));
  const input = byId("open", HTMLInputElement);
  input.addEventListener("change", async () => {
    const [file] = input.files ?? [];
    if (file) {
      await studio.attempt(async () => {
        const { rows: read } = await studio.connection.ask("open", { name: file.name, text: await textOf(file) });
        studio.openRows(read);
        rows.replaceChildren(...studio.rows.map((_, k) => html("option", { value: k }, `trial ${k + 1} of ${studio.rows.length}`)));
        byId("opened").hidden = studio.rows.length < 2;
      });
    }
    input.value = "";
  });
};

/** @type {BridgeStudio | null} */
let studio = null;
const connection = new Connection("bridge", async (open) => {
  if (!open) {
    showTrouble(new Error("The studio has stopped, or this page was opened without its token. Start `deggflow studio` and open the address it prints."));
    return;
  }
  showTrouble(null);
  if (studio) {
    if (!studio.shown) studio.run();
    return;
  }
  say("Loading the world.");
  studio = build(await connection.ask("world"), connection);
  if (!studio.restore()) studio.condition = (await connection.ask("random", RANDOM)).condition;
  studio.onChange();
  say(COMPILING);
  studio.run();
});
