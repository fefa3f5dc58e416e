"""Generations that are changed before they are certified, and trajectories made elsewhere."""

from dataclasses import replace

import jax
import numpy as np

from deggflow import Trajectory, certify, certify_batch

from .draw import draw
from .generated import epsilon, judge_rows, problem_rng
from .spec import OBSTACLES, Private, Problem, Shared, random_private, random_shared, random_steps
from .tally import judge_hypotheses, judge_verdicts
from .truth import exact, take, verdict
from .wired import guidance_of, precision, program_of

CHANGES = ("none", "end of another", "end moved", "last digit", "both ends", "other condition")
WAYS = ("ours", "moved", "straight", "rounded", "dummy", "two points", "still", "detour", "hole")
POINTS = 60  # of trajectories that are not of a grid


def tampered(kind, structure):
    """Some of the requirements of the other kinds; the grid is short."""
    rng = problem_rng(kind, structure)
    parts = (random_private(rng, OBSTACLES, 2), random_shared(rng, 2))
    parts = (parts[:1], parts[1:], parts)[structure % 3]
    return replace(random_steps(rng, Problem(parts, agents=3)), grid="short")


def otherwise(problem):
    """The same requirements with other numbers: what a sample may be certified under by mistake."""

    def other(each):
        if isinstance(each, Private):
            return replace(each, buffer=0.1 if each.buffer < 0.1 else 0.005)
        return Shared(
            tuple(
                replace(f, buffer=0.05 + f.buffer, slack=0.3 - 0.5 * f.slack) for f in each.factors
            )
        )

    return replace(problem, requirements=tuple(map(other, problem.requirements)))


def play_tampered(case, problem, tally):
    """The verdict follows what is certified, and hypotheses are never said to hold of what is not the end of its generation."""
    rng = case.rng()
    condition, z0, _, _ = draw(problem, rng, case.batch)
    asked = otherwise(problem) if case.number % 4 == 3 else problem
    with precision(problem):
        made = jax.tree.map(np.asarray, program_of(problem)(z0, condition, None, None))
    z, last = made.z.copy(), made.summary.z.copy()
    change = rng.choice(len(CHANGES), case.batch)
    other = rng.permutation(case.batch)
    at = rng.integers(z.shape[1], size=case.batch), rng.integers(z.shape[2], size=case.batch)
    where = np.arange(case.batch), *at
    z[change == 1] = made.z[other][change == 1]
    z[where] += np.where(change == 2, rng.choice([-1, 1], case.batch) * 1e-3, 0.0)
    z[where] = np.where(change == 3, np.nextafter(z[where], np.float32(9.0)), z[where])
    z[change == 4] = made.z[other][change == 4]
    last[change == 4] = made.z[other][change == 4]
    swap = np.where(change == 5, other, np.arange(case.batch))
    condition = jax.tree.map(lambda leaf: leaf[swap], condition)
    changed = made._replace(z=z, summary=made.summary._replace(z=last))
    with precision(problem):
        said = certify_batch(changed, guidance_of(asked), condition)
    judge_verdicts(tally, case, asked, z, condition, None, said)
    path = made.path.copy()
    path[:, -1] = z
    tau = made.trace.tau[0]
    labels = [CHANGES[c] + (", other numbers" if asked is not problem else "") for c in change]
    hold = judge_hypotheses(
        tally, case, asked, tau, path, condition, None, said, epsilon(problem), labels=labels
    )
    same = ((z == made.summary.z) | (np.isnan(z) & np.isnan(made.summary.z))).all(axis=(1, 2))
    for k in np.flatnonzero(hold & ~same & (change < 4)):
        tally.note("false hypotheses", case=case, sample=int(k), why=CHANGES[change[k]])


def trajectories(kind, structure):
    """Requirements that trajectories are judged by."""
    rng = problem_rng(kind, structure)
    parts = (random_private(rng, OBSTACLES, 3), random_shared(rng, 2))
    parts = (parts[:1], parts[:1], parts[1:], parts)[structure % 4]
    if structure % 4 == 1:  # limits of lengths, which NaN must not pass
        parts = (replace(parts[0], pieces=("length", "speed")),)
    points = 3 if structure % 4 == 1 else 1
    return Problem(parts, agents=3, waypoints=points, grid="short", guard="none")


def _way(kind, rng, path, tau, z0, target):
    """One trajectory of a kind: tau and z in float64."""
    many = np.linspace(0.0, 1.0, POINTS)
    straight = z0 + many[:, None, None] * (target - z0)
    if kind == "ours":
        return tau, path
    if kind == "moved":
        path = path.copy()
        spot = rng.integers(len(path)), rng.integers(path.shape[1])
        path[spot] += rng.normal(scale=rng.choice([1e-4, 0.1, 1.0]), size=path.shape[2])
        return tau, path
    if kind == "rounded":
        return many, straight.astype(np.float32).astype(np.float64)
    if kind == "dummy":
        straight[:, -1] = 1e6
        return many, straight
    if kind == "two points":
        return np.array([0.0, 1.0]), straight[[0, -1]]
    if kind == "still":
        return many, np.broadcast_to(target, straight.shape).copy()
    if kind == "hole":
        spot = rng.integers(1, POINTS - 1), rng.integers(straight.shape[1])
        straight[spot] = rng.choice([np.nan, np.inf])
        return many, straight
    if kind == "detour":
        aside = rng.normal(size=straight.shape[1:]) * np.sin(np.pi * many)[:, None, None]
        return many, straight + aside
    return many, straight


def play_trajectories(case, problem, tally):
    """`certify(Trajectory(tau, z))`: verdict, values at every point, rows, and how far points are apart."""
    rng = case.rng()
    condition, z0, _, _ = draw(problem, rng, case.batch)
    made = jax.tree.map(np.asarray, program_of(problem)(z0, condition, None, None))
    known = exact(condition)
    z0, target = z0.astype(np.float64), known["field"]["targets"]
    # Some that begin and end where nothing is violated.
    clear = np.where(verdict(problem, target, known, None).min(axis=1) >= 0, 0.9, 0.0)
    near = rng.random(case.batch) < clear
    z0[near] = target[near] + rng.normal(scale=0.02, size=z0[near].shape)
    guidance = guidance_of(problem)
    for k in range(case.batch):
        kind = WAYS[rng.integers(len(WAYS))]
        path = made.path[k].astype(np.float64)
        tau, z = _way(kind, rng, path, made.trace.tau[k].astype(np.float64), z0[k], target[k])
        one = take(condition, k)
        said = certify(Trajectory(tau, z), guidance, one)
        many = take(condition, [k])
        judge_verdicts(tally, case, problem, z[-1:], many, None, [said])
        eps = float(np.finfo(np.float64).eps)
        hold = judge_hypotheses(tally, case, problem, tau, z[None], many, None, [said], eps)
        single = np.array_equal(z.astype(np.float32), z, equal_nan=True)
        rounding = float(np.finfo(np.float32).eps) if single else eps
        judge_rows(tally, case, problem, tau, z[None], many, None, hold, rounding)
        if not np.isfinite(z).all():
            continue
        # Files hold numbers up to 1e12; states that go farther have diverged.
        far = min(np.sqrt((np.diff(z, axis=0) ** 2).sum(axis=-1)).max(), 1e12)
        if not np.isclose(said.generation.largest_step, far, rtol=1e-6):
            tally.note("broken promises", case=case, sample=k, why=f"largest step of {kind}")
