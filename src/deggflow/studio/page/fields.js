// @ts-check
/** Fields of a panel: numbers with names, seeds, and random conditions. */

import { byId, html } from "./elements.js";

const MAX_SEED = 2 ** 31 - 1;
const SEEDS = { min: 0, max: MAX_SEED, step: 1 };

/**
 * A number with a name.
 * @param {Element} home
 * @param {string} id
 * @param {string} label
 * @param {{min: number, max: number, step: number}} range
 * @param {(value: number) => void} onChange
 */
export const numberField = (home, id, label, range, onChange) => {
  const input = /** @type {HTMLInputElement} */ (html("input", { id, type: "number", ...range }));
  input.addEventListener("change", () => {
    if (input.value !== "" && input.checkValidity()) onChange(input.valueAsNumber);
    else input.reportValidity();
  });
  home.append(html("label", { class: "row", for: id }, html("span", {}, label), input));
  return input;
};

/** Shows a value, but not in a field that is being written in. @param {HTMLInputElement} input @param {number} value */
export const put = (input, value) => {
  if (document.activeElement !== input || input.valueAsNumber === value) input.value = String(value);
};

/**
 * Seed, number of draws, whether every edit is followed, and the button that asks anew.
 * @param {import("./session.js").Session} session
 * @param {string} button its id
 * @param {() => void} again asks anew
 */
export const sampleFields = (session, button, again) => {
  const home = byId("sample");
  const seed = numberField(home, "seed", "seed", SEEDS, (value) => {
    session.seed = value;
    again();
  });
  const draws = numberField(home, "max-draws", "draws at most", { min: 1, max: 8, step: 1 }, (value) => {
    session.maxDraws = value;
    again();
  });
  const live = byId("live", HTMLInputElement);
  live.addEventListener("change", () => (session.live = live.checked));
  byId(button).addEventListener("click", again);
  return () => {
    put(seed, session.seed);
    put(draws, session.maxDraws);
    live.checked = session.live;
  };
};

/**
 * A random condition by size and seed; each press takes the next seed.
 * @param {import("./session.js").Session} session
 * @param {string} label of the size
 * @param {{min: number, max: number}} range
 * @param {number} first size
 * @param {(asked: {size: number, seed: number}) => Promise<void>} take
 */
export const randomFields = (session, label, range, first, take) => {
  const home = byId("random");
  const size = numberField(home, "size", label, { ...range, step: 1 }, () => {});
  const seed = numberField(home, "random-seed", "seed", SEEDS, () => {});
  size.value = String(first);
  seed.value = "1";
  byId("randomise").addEventListener("click", () => {
    if (!size.reportValidity() || !seed.reportValidity()) return;
    const asked = { size: size.valueAsNumber, seed: seed.valueAsNumber };
    seed.value = String((seed.valueAsNumber + 1) % MAX_SEED);
    session.attempt(() => take(asked));
  });
};
