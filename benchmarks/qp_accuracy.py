"""`min_norm_input` on random instances: KKT residuals, and feasibility against quadprog and linear programs.

Rows differ in length by four orders of magnitude; a tenth of the instances has two nearly opposed rows (within
1e-3 rad), a tenth a row of zeros. A second table has rows and offsets between 1e-20 and 1e20, of one scale in an
instance, of one per row, or of one per offset; feasibility is decided in rational numbers.
Run: python benchmarks/qp_accuracy.py [--instances 100000] [--scales 20000] [--seed 0]
"""

import argparse
from dataclasses import dataclass
from fractions import Fraction
from itertools import product

import jax
import jax.numpy as jnp
import numpy as np
import quadprog
from scipy.optimize import linprog, nnls

from deggflow.guidance import min_norm_input

ROWS, INPUTS = range(7), (2, 3, 24)
SCALED = (1, 3), (2, 3), (2, 24), (3, 3), (4, 3), (3, 4)
KINDS = {
    "instance": "one scale for all rows, one for all offsets",
    "row": "one scale for each row and its offset",
    "offset": "one scale for each offset, half of the entries zero",
}


@dataclass
class Report:
    """Worst figures of some instances."""

    instances: int = 0
    feasible: int = 0
    missed: int = 0  # infeasible ones that were not found
    invented: int = 0  # feasible ones that were called infeasible
    kkt: float = 0.0  # float64, relative to 1 + |u|
    single: float = 0.0  # float32: violation over |ell| |u| + |b| of the same row


def instance(rng, rows, inputs):
    """One QP: ell, b."""
    ell = rng.normal(size=(rows, inputs)) * 10.0 ** rng.uniform(-2, 2, (rows, 1))
    kind = rng.random()
    if kind < 0.1 and rows >= 2:
        aside = rng.normal(size=inputs)
        aside -= aside @ ell[0] * ell[0] / (ell[0] @ ell[0])
        angle = rng.uniform(0, 1e-3)
        back = np.cos(angle) * ell[0] / np.linalg.norm(ell[0])
        back += np.sin(angle) * aside / np.linalg.norm(aside)
        ell[1] = -back * 10.0 ** rng.uniform(-2, 2)
    elif kind < 0.2 and rows:
        ell[rng.integers(rows)] = 0.0
    length = np.linalg.norm(ell, axis=1)
    return ell, rng.normal(size=rows) * np.where(length > 0, length, 1.0)


def live_rows(ell, b):
    """Rows that an input can change, scaled to length one; None if another one is not met."""
    length = np.linalg.norm(ell, axis=1)
    if (b[length == 0] > 0).any():
        return None
    keep = length > 0
    return ell[keep] / length[keep, None], b[keep] / length[keep]


def solvable(unit, distance):
    """Whether half-spaces meet, by quadprog; a linear program decides what quadprog refuses."""
    if not len(unit):
        return True
    try:
        inputs = unit.shape[1]
        quadprog.solve_qp(np.eye(inputs), np.zeros(inputs), -unit.T.copy(), distance)
    except ValueError:
        free = linprog(np.zeros(unit.shape[1]), unit, -distance, bounds=(None, None))
        return free.status == 0
    return True


def kkt_residual(unit, distance, u):
    """Largest violation, and what is left of stationarity for the best nonnegative multipliers."""
    scale = 1 + np.linalg.norm(u)
    slack = unit @ u + distance
    binding = unit[slack > -1e-8 * scale]
    left = np.linalg.norm(u) if not len(binding) else nnls(binding.T, -u)[1]
    return max(left, slack.max(initial=0.0)) / scale


def solve(ell, b, dtype):
    """All instances of one shape in one compiled call."""
    run = jax.jit(jax.vmap(min_norm_input))
    out = run(jnp.asarray(ell, dtype), jnp.asarray(b, dtype))
    return np.asarray(out.u).astype(np.float64), np.asarray(out.feasible)


def check(rng, rows, inputs, count):
    """Draws, solves and judges instances of one shape."""
    drawn = [instance(rng, rows, inputs) for _ in range(count)]
    ell, b = np.array([one[0] for one in drawn]), np.array([one[1] for one in drawn])
    with jax.enable_x64(True):
        u, feasible = solve(ell, b, jnp.float64)
    single, single_feasible = solve(ell, b, jnp.float32)
    report = Report(count)
    for k in range(count):
        live = live_rows(ell[k], b[k])
        solution = live is not None and solvable(*live)
        report.missed += bool(feasible[k] and not solution)
        report.invented += bool(solution and not feasible[k])
        report.feasible += solution
        if not solution or not len(live[0]):
            continue
        report.kkt = max(report.kkt, kkt_residual(live[0], live[1], u[k]))
        if single_feasible[k]:
            report.single = max(report.single, violation(live[0], live[1], single[k]))
    return report


def violation(ell, b, u):
    """Of the worst row, over its own |ell| |u| + |b|; in extended precision."""
    ell, b, u = (np.asarray(each, np.longdouble) for each in (ell, b, u))
    size = np.sqrt((ell**2).sum(-1)) * np.sqrt((u**2).sum()) + np.abs(b)
    over = (ell @ u + b) / np.where(size > 0, size, 1.0)
    return float(over.max(initial=0.0))


def scaled_instances(rng, rows, inputs, kind, count):
    """Instances of any scale that an input within the range of float32 can meet."""
    ell, b = rng.normal(size=(count, rows, inputs)), rng.normal(size=(count, rows))
    if kind == "instance":
        size = 10.0 ** rng.uniform(-20, 20, (count, 1))
        other = np.clip(size * 10.0 ** rng.uniform(-18, 18, (count, 1)), 1e-20, 1e20)
        return ell * size[..., None], b * other
    if kind == "row":
        size = 10.0 ** rng.uniform(-20, 20, (count, rows))
        return ell * size[..., None], b * size
    return ell * (rng.random(ell.shape) < 0.5), b * 10.0 ** rng.uniform(-20, 20, (count, rows))


def possible(ell, b):
    """Whether half-spaces meet: Fourier-Motzkin elimination in rational numbers."""
    rows = [[Fraction(float(x)) for x in (*e, c)] for e, c in zip(ell, b, strict=True)]
    for k in range(len(ell[0])):
        up = [row for row in rows if row[k] > 0]
        down = [row for row in rows if row[k] < 0]
        rows = [row for row in rows if row[k] == 0]
        rows += [[x / p[k] - y / q[k] for x, y in zip(p, q, strict=True)] for p in up for q in down]
    return all(row[-1] <= 0 for row in rows)


@dataclass
class ScaleReport:
    """Worst figures of instances of any scale, in one precision."""

    feasible: int = 0
    missed: int = 0
    invented: int = 0
    worst: float = 0.0  # violation over |ell| |u| + |b| of the same row


def check_scales(rng, rows, inputs, kind, count, dtype):
    """Draws, solves and judges instances of one shape."""
    ell, b = scaled_instances(rng, rows, inputs, kind, count)
    ell, b = ell.astype(dtype), b.astype(dtype)
    with jax.enable_x64(dtype == np.float64):
        u, feasible = solve(ell, b, dtype)
    report = ScaleReport()
    for k in range(count):
        meets = possible(ell[k], b[k])
        report.feasible += meets
        report.missed += bool(feasible[k] and not meets)
        report.invented += bool(meets and not feasible[k])
        if feasible[k]:
            report.worst = max(report.worst, violation(ell[k], b[k], u[k]))
    return report


def sweep_scales(seed, instances):
    """The second table."""
    cases = list(product(KINDS, SCALED))
    each = -(-instances // len(cases))
    print(f"\n{each * len(cases)} instances of scales from 1e-20 to 1e20, seed {seed}")
    for kind, meaning in KINDS.items():
        print(f"  {kind}: {meaning}")
    print("scale     rows inputs  precision  feasible  missed  invented  worst violation of a row")
    for number, (kind, (rows, inputs)) in enumerate(cases):
        for dtype in (np.float32, np.float64):
            rng = np.random.default_rng([seed, number])
            found = check_scales(rng, rows, inputs, kind, each, dtype)
            share = f"{100 * found.feasible / each:5.1f}%"
            print(
                f"{kind:8s}  {rows:4d} {inputs:6d}  {np.dtype(dtype).name:>9s}  {share:>8}  {found.missed:6d}  "
                f"{found.invented:8d}  {found.worst:24.1e}",
                flush=True,
            )


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--instances", type=int, default=100_000)
    parser.add_argument("--scales", type=int, default=20_000, help="instances of any scale")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    shapes = list(product(ROWS, INPUTS))
    each = -(-options.instances // len(shapes))
    print(f"{each * len(shapes)} instances, seed {options.seed}")
    print("rows inputs  feasible  missed  invented  KKT float64  violation float32")
    for number, (rows, inputs) in enumerate(shapes):
        found = check(np.random.default_rng([options.seed, number]), rows, inputs, each)
        share = f"{100 * found.feasible / found.instances:5.1f}%"
        print(
            f"{rows:4d} {inputs:6d}  {share:>8}  {found.missed:6d}  {found.invented:8d}  "
            f"{found.kkt:11.1e}  {found.single:17.1e}",
            flush=True,
        )
    if options.scales:
        sweep_scales(options.seed, options.scales)


if __name__ == "__main__":
    main()
