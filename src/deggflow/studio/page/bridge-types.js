// @ts-check
/**
 * Types of what the bridge's page and the server say to each other. Lengths in m, angles in rad.
 *
 * @typedef {import("./types.js").Pose} Pose
 * @typedef {import("./types.js").Spot} Spot
 * @typedef {{x: number, y: number, theta: number}} Place
 * @typedef {{plank: Place, goal: Place, contacts: Spot[]}} Condition
 * @typedef {{q_task: number, bound: number, q_safe: number, draws: number, accepted: boolean, speed: number, generation?: any}} Policy
 * @typedef {{satisfied: boolean, min_margin: number, violation: number, draws: number, reason: string | null, policies: Policy[], speed_limit?: number}} Certificate
 * @typedef {{condition: Condition, dt: number, twists: Pose[], poses: Pose[], outcome: {success: boolean, reason: string | null}, certificate: Certificate, seed: number}} Trial
 * @typedef {{name: string, margin: number, time: number, gap: [Spot, Spot]}} Margin least over a trial
 * @typedef {{poses: Pose[], twists: Pose[], success: boolean, reason: string | null}} Nominal
 * @typedef {{hypotheses_hold: boolean, tau: number[], q_task: number[], beta_task: number[], q_safe: number[], beta_safe: number[]}} Course
 * @typedef {{x_min: number, x_max: number, y_min: number, y_max: number, gap_left: number, gap_right: number, plank_length: number, plank_width: number, robot_radius: number, contact_side: number, centre_side: number, contact_spacing: number, support: number, dt: number, executed: number, min_robots: number, max_robots: number, accents: string[]}} World
 */
export {};
