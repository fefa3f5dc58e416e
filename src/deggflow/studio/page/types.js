// @ts-check
/**
 * Types of what the page and the server say to each other. Lengths in m, angles in rad.
 *
 * @typedef {{offset_scale?: number, radius_scale?: number, direction?: number}} Affordance
 * @typedef {{x?: number, y?: number, radius?: number}} Balance
 * @typedef {{objects: string[], requirements?: Record<string, Affordance>, table?: {width: number, depth: number}, balance?: Balance}} Condition
 * @typedef {[number, number, number]} Pose  x, y, theta
 * @typedef {[number, number]} Spot  x, y
 * @typedef {{kind: string, owner: number, region: number, other: number, margin: number, gap: [Spot, Spot]}} Margin
 * @typedef {{satisfied: boolean, min_margin: number, violation: number, reason: string | null, oracle_margin: number, margins: Margin[], breaches: string[], blocked: [number, number][], outlined: number[], unbalanced: boolean}} Judgement
 * @typedef {{names: string[], tau: number[], value: number[][], bound: number[][], limit: number[][]}} Trace
 * @typedef {{line: string, trace: Trace | null, draw: number, refused: string[], judgement: Judgement, nominal: {poses: Pose[], judgement: Judgement}, command: string | null}} Generated
 * @typedef {{tau: number[], apart: number, nominal: Pose[][], guided: Pose[][]}} Replay
 * @typedef {{footprint: Spot[][], looks: {outline: Spot[], colour: string}[], mass: number, regions: {x: number, y: number, radius: number}[]}} Kind
 * @typedef {{objects: Record<string, Kind>, table: {width: number, depth: number}, buffer: number}} Library
 */
export {};
