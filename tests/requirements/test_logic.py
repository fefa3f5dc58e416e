"""Temporal logic against its recursive definition, and smooth bounds against it."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from deggflow import requirements as req
from deggflow.requirements import Always, Disc, Eventually, Until, Within, Without

A, B = Disc((0.5, 0.0), 0.6), req.Box((-0.3, 0.4), (1.0, 0.8), 0.3)
T = 7
FORMULAS = {
    "always": Always(Within(A), (1, 3)),
    "eventually": Eventually(Within(B)),
    "until": Until(Without(A, 0.1), Within(B), (1, None)),
    "and or": Eventually(Within(A)) & (Always(Without(B)) | Eventually(Within(B, 0.1), (2, 5))),
    "nested": Eventually(Always(Within(A), (0, 1)) & Eventually(Within(B), (1, 2))),
}


def signed(region, x):
    if isinstance(region, Disc):
        return np.linalg.norm(x - region.centre[0]) - region.radius[0]
    angle = region.angle[0]
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    gap = np.abs(turn @ (x - region.centre[0])) - region.size[0] / 2
    return np.linalg.norm(np.maximum(gap, 0)) + min(gap.max(), 0)


def robustness(formula, path, t):
    """By the definition, waypoint by waypoint."""
    if isinstance(formula, Within):
        return -signed(formula.region, path[t]) - formula.radius
    if isinstance(formula, Without):
        return signed(formula.region, path[t]) - formula.radius
    if hasattr(formula, "one"):
        both = robustness(formula.one, path, t), robustness(formula.other, path, t)
        return min(both) if type(formula).__name__ == "Both" else max(both)
    first, last = formula.window
    last = len(path) if last is None else last
    window = [s for s in range(t + first, t + last + 1) if s < len(path)]
    if isinstance(formula, Always):
        return min([robustness(formula.inner, path, s) for s in window], default=1e6)
    if isinstance(formula, Eventually):
        return max([robustness(formula.inner, path, s) for s in window], default=-1e6)
    each = [
        min(
            robustness(formula.then, path, s),
            *(robustness(formula.before, path, r) for r in range(t, s + 1)),
        )
        for s in window
    ]
    return max(each, default=-1e6)


@pytest.mark.parametrize("name", FORMULAS)
def test_robustness_is_the_recursive_one_and_the_bound_is_below(name):
    formula = FORMULAS[name]
    paths = np.random.default_rng(0).normal(size=(60, T, 2)) * 0.6
    with jax.enable_x64(True):
        x = jnp.moveaxis(jnp.asarray(paths), 2, 0)
        exact = np.asarray(formula.robustness(x, None))
        bound = np.asarray(formula.bound(x, None, 0.02))
    for agent, path in enumerate(paths):
        for t in range(T):
            assert exact[agent, t] == pytest.approx(robustness(formula, path, t), abs=1e-12)
    assert (bound[exact < 0] < 0).all()
    # Not empty words: what holds by more than the smoothing of six levels holds by the bound.
    assert (bound[exact > 6 * 0.02] > 0).all()
    assert (exact[:, 0] > 0.12).any()
    assert (exact[:, 0] < 0).any()


def test_a_formula_must_be_one():
    with pytest.raises(TypeError, match="formula"):
        req.satisfies(lambda x: x, layout=req.trajectories(3))
