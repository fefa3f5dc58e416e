"""`min_norm_input` on random instances: KKT residuals, and feasibility against quadprog and linear programs.

Rows differ in length by four orders of magnitude; a tenth of the instances has two nearly opposed rows (within
1e-3 rad), a tenth a row of zeros. Run: python benchmarks/qp_accuracy.py [--instances 100000] [--seed 0]
"""

import argparse
from dataclasses import dataclass
from itertools import product

import jax
import jax.numpy as jnp
import numpy as np
import quadprog
from scipy.optimize import linprog, nnls

from deggflow.guidance import min_norm_input

ROWS, INPUTS = range(7), (2, 3, 24)


@dataclass
class Report:
    """Worst figures of some instances."""

    instances: int = 0
    feasible: int = 0
    missed: int = 0  # infeasible ones that were not found
    invented: int = 0  # feasible ones that were called infeasible
    kkt: float = 0.0  # float64, relative to 1 + |u|
    single: float = 0.0  # float32: violation over |ell| |u| + |b|


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
    return np.asarray(out.u, np.float64), np.asarray(out.feasible)


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
        possible = live is not None and solvable(*live)
        report.missed += bool(feasible[k] and not possible)
        report.invented += bool(possible and not feasible[k])
        report.feasible += possible
        if not possible or not len(live[0]):
            continue
        report.kkt = max(report.kkt, kkt_residual(*live, u[k]))
        if single_feasible[k]:
            over = live[0] @ single[k] + live[1]
            size = np.linalg.norm(single[k]) + np.abs(live[1])
            report.single = max(report.single, float((over / np.maximum(size, 1e-30)).max()))
    return report


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--instances", type=int, default=100_000)
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


if __name__ == "__main__":
    main()
