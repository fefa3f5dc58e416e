"""What holds for every named requirement: sound floors, finite and correct gradients, dependence, masks, labels."""

from functools import cache
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from requirement_cases import AGENTS, CASES

from deggflow import DecoupledGuidance
from deggflow.recording import verdicts_of

COUNT, SMOOTH, STEP = 300, 40, 1e-6
PRESENT = np.array([True, False, True, True])
ROUNDING = 1e-9


class Evaluated(NamedTuple):
    """One case at random states, and at two at which everything coincides."""

    margins: np.ndarray
    parts: np.ndarray
    gradient: np.ndarray
    slopes: np.ndarray
    dependence: np.ndarray
    ahead: np.ndarray
    behind: np.ndarray
    present: np.ndarray
    moved: np.ndarray


def states(case):
    """Some of them closer to each other, which is where margins are violated."""
    rng = np.random.default_rng(0)
    z = rng.normal(size=(COUNT, AGENTS, case.dim)) * rng.uniform(0.1, 1.0, (COUNT, 1, 1))
    same = np.stack([np.full((AGENTS, case.dim), where) for where in (0.0, 0.5)])
    return np.concatenate([z * case.scale, same])


def along(case):
    return np.random.default_rng(1).normal(size=(AGENTS, case.dim))


@cache
def evaluated(name):
    """In float64, as verdicts are."""
    case = CASES[name]
    requirement, buffer = case.requirement, case.requirement.buffer

    def one(z, condition):
        judged, masked = requirement._judged(None), requirement._judged(jnp.asarray(PRESENT))
        moved = jnp.where(PRESENT[:, None], z, 3.0 * z + 0.1)
        aside = STEP * along(case)
        # Mapped over both states, a function is traced and compiled once.
        v = jax.vmap(lambda z: jnp.sum(judged.violation(z, condition, buffer)))
        m = jax.vmap(lambda z: masked(z, condition))
        return Evaluated(
            judged(z, condition),
            *judged.violation_and_gradient(z, condition, buffer),
            jax.jacrev(lambda z: judged.violation(z, condition, buffer))(z),
            judged.dependence(z, condition, buffer),
            *v(jnp.stack([z + aside, z - aside])),
            *m(jnp.stack([z, moved])),
        )

    with jax.enable_x64(True):
        condition = jax.tree.map(lambda leaf: np.asarray(leaf, np.float64), case.condition)
        out = jax.jit(jax.vmap(one, in_axes=(0, None)))(states(case), condition)
        return jax.tree.map(np.asarray, out)


@pytest.fixture(params=CASES)
def name(request):
    return request.param


def test_v_at_its_floor_implies_every_margin(name):
    """The contrapositive, of each agent: a negative exact margin means V_j above buffer^2 / 2."""
    out = evaluated(name)
    violated = (out.margins < -ROUNDING).any(axis=-1)
    assert (out.parts[violated] >= CASES[name].requirement.floor * (1 - ROUNDING)).all()
    assert violated.any()
    assert not violated.all()


def test_guidance_asks_for_nothing_well_beyond_the_buffers(name):
    """But for the smoothing, of at most a tenth of a buffer; a grid falls short by cells and spacings of samples."""
    out, case = evaluated(name), CASES[name]
    most = max(getattr(case.requirement.margins, "buffers", (case.requirement.buffer,)))
    clear = (out.margins > 1.11 * most + case.coarse).all(axis=-1)
    assert (out.parts[clear] == 0).all()


def test_gradients_are_finite_and_those_of_v(name):
    out = evaluated(name)
    assert np.isfinite(out.parts).all()
    assert np.isfinite(out.gradient).all()
    assert not np.isnan(out.margins).any()
    slope = (out.ahead - out.behind) / (2 * STEP)
    expected = (out.gradient * along(CASES[name])).sum(axis=(1, 2))
    # Curvatures are large where smoothing is sharp, and kinks lie between two of the states now and then.
    close = np.abs(slope - expected) <= 1e-3 * (1e-3 + np.abs(out.gradient).sum(axis=(1, 2)))
    assert close[:COUNT].mean() >= 0.97
    assert np.allclose(out.slopes.sum(axis=1), out.gradient, atol=1e-9)


def test_dependence_covers_whoever_changes_v(name):
    out = evaluated(name)
    assert (out.dependence | ~(out.slopes != 0).any(axis=-1)).all()
    assert out.dependence[:, np.arange(AGENTS), np.arange(AGENTS)].all()


def test_absent_agents_change_nothing(name):
    out = evaluated(name)
    here, moved = out.present[:, PRESENT], out.moved[:, PRESENT]
    assert np.allclose(here, moved, rtol=1e-12, atol=1e-12)
    assert np.isinf(out.present[:, ~PRESENT]).all()


def test_a_reason_names_margin_and_unit(name):
    case, out = CASES[name], evaluated(name)
    k = int(out.margins.min(axis=(1, 2)).argmin())
    guidance = DecoupledGuidance((case.requirement,))
    [verdict] = verdicts_of((out.margins[k],), guidance.names, guidance.margin_names(), None)
    assert verdict.margin == out.margins.min()
    assert verdict.reason.startswith("agent ")
    assert f" misses {case.requirement.name}" in verdict.reason
    assert verdict.reason.endswith(f" {case.unit}")
