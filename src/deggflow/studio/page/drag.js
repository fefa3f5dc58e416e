// @ts-check
/** Elements of a picture that are moved by the mouse, by touch, or by keys. */

/** @typedef {import("./types.js").Spot} Spot */

/**
 * @typedef {object} Grip
 * @property {string} id
 * @property {string} label
 * @property {string} value as it is spoken
 * @property {Spot} at
 * @property {(to: Spot) => void} drag
 * @property {(right: number, up: number) => void} nudge by steps; a tenth with Shift
 * @property {(steps: number) => void} [turn] counter-clockwise
 */

const CLICK = 3; // pixels that a click may wander
const ARROWS = /** @type {Record<string, Spot>} */ ({
  ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1],
});

/** @param {Element} target @returns {Found | null} */
const byGrip = (target) => {
  const element = target.closest("[data-grip]");
  return element && { id: element.getAttribute("data-grip") ?? "", element: /** @type {SVGElement} */ (element) };
};

/** @typedef {{id: string, element: SVGElement | null}} Found a grip, and what takes the focus */

export class Grips {
  /**
   * @param {SVGSVGElement} root its y points down, the world's up
   * @param {() => Grip[]} grips
   * @param {object} options
   * @param {(id: string, moved: boolean) => void} options.onEnd a drag is over
   * @param {(id: string) => void} [options.onStart] a drag begins
   * @param {(target: Element) => Found | null} [options.locate] the grip at an element
   */
  constructor(root, grips, { onEnd, onStart = () => {}, locate = byGrip }) {
    this.root = root;
    this.grips = grips;
    this.onEnd = onEnd;
    this.onStart = onStart;
    this.locate = locate;
    /** @type {{id: string, offset: Spot, start: Spot, moved: boolean} | null} */
    this.dragged = null;
    root.addEventListener("pointerdown", (event) => this.press(event));
    root.addEventListener("pointermove", (event) => this.follow(event));
    root.addEventListener("pointerup", () => this.release());
    root.addEventListener("pointercancel", () => this.release());
    root.addEventListener("keydown", (event) => this.key(event));
  }

  /** Tells assistive software where everything is. @param {(id: string) => Element | null} find */
  describe(find) {
    for (const { id, label, value } of this.grips()) {
      const element = find(id);
      element?.setAttribute("aria-label", label);
      element?.setAttribute("aria-valuetext", value);
    }
  }

  /** @param {string | undefined} id */
  grip(id) {
    return this.grips().find((each) => each.id === id);
  }

  /** @param {PointerEvent} event */
  press(event) {
    if (event.button !== 0 || !(event.target instanceof Element)) return;
    const found = this.locate(event.target);
    const grip = this.grip(found?.id);
    if (!found || !grip) return;
    event.preventDefault();
    const [x, y] = this.spot(event);
    this.onStart(grip.id);
    this.dragged = { id: grip.id, offset: [grip.at[0] - x, grip.at[1] - y], start: [event.clientX, event.clientY], moved: false };
    this.root.setPointerCapture(event.pointerId);
    found.element?.focus({ preventScroll: true });
  }

  /** @param {PointerEvent} event */
  follow(event) {
    const { dragged } = this;
    if (!dragged) return;
    if (!dragged.moved && Math.hypot(event.clientX - dragged.start[0], event.clientY - dragged.start[1]) < CLICK) return;
    dragged.moved = true;
    const [x, y] = this.spot(event);
    this.grip(dragged.id)?.drag([x + dragged.offset[0], y + dragged.offset[1]]);
  }

  release() {
    const { dragged } = this;
    this.dragged = null;
    if (dragged) this.onEnd(dragged.id, dragged.moved);
  }

  /** @param {KeyboardEvent} event */
  key(event) {
    if (!(event.target instanceof Element) || event.ctrlKey || event.metaKey || event.altKey) return;
    const grip = this.grip(this.locate(event.target)?.id);
    const step = event.shiftKey ? 0.1 : 1;
    const arrow = ARROWS[event.key];
    const turn = { q: 1, e: -1 }[event.key.toLowerCase()];
    if (grip && arrow) grip.nudge(step * arrow[0], step * arrow[1]);
    else if (grip?.turn && turn) grip.turn(step * turn);
    else return;
    event.preventDefault();
  }

  /** The pointer in the world. @param {PointerEvent} event @returns {Spot} */
  spot(event) {
    const point = new DOMPoint(event.clientX, event.clientY).matrixTransform(this.root.getScreenCTM()?.inverse());
    return [point.x, -point.y];
  }
}
