"""Conditions and initial samples of a problem, drawn in NumPy. No JAX, no deggflow."""

import numpy as np

from .spec import Private

HIDDEN = 6  # units of the random networks
DOTS = 1500  # little discs of "dots"
MODES = (
    "pull",
    "swirl",
    "stiff",
    "against",
    "straight",
    "broken",
    "network",
    "constant",
    "blow-up",
)
SHARES = (0.25, 0.1, 0.08, 0.14, 0.2, 0.04, 0.1, 0.06, 0.03)


def draw(problem, rng, samples, modes=SHARES):
    """Condition, z(0), mask and stops of many samples; floating-point numbers of the problem's type."""
    n, d = problem.agents, problem.dim
    mask = None
    if problem.padded:
        present = rng.integers(1, n + 1, samples)
        mask = rng.permuted(np.arange(n)[None] < present[:, None], axis=1)
    condition = {"field": _field(problem, rng, samples, modes)}
    for k, each in enumerate(problem.requirements):
        if isinstance(each, Private):
            condition[f"r{k}"] = {p: PIECES[p](rng, samples, problem) for p in each.pieces}
            continue
        parts = {}
        for j, factor in enumerate(each.factors):
            parts[f"f{j}"] = FACTORS[factor.kind](rng, samples)
            parts[f"f{j}"]["end"] = rng.uniform(-0.2, 0.3, samples) * factor.moving_end
            team = rng.random((samples, n)) < (0.6 if factor.part else 2.0)
            team[np.arange(samples), rng.integers(n, size=samples)] = True
            if mask is not None:
                both = team & mask
                team = np.where(both.any(axis=1, keepdims=True), both, mask)
            parts[f"f{j}"]["team"] = team
        condition[f"r{k}"] = parts
    if mask is not None:
        condition["mask"] = mask
    if problem.control:
        condition["control"] = _control(problem, rng, samples)
    dtype = np.dtype(problem.dtype)
    condition = _cast(condition, np.dtype(np.float64) if problem.fine else dtype)
    spread = rng.choice([0.5, 1.0, 2.0], (samples, 1, 1))
    z0 = (rng.normal(size=(samples, n, d)) * spread).astype(dtype)
    stops = None
    if problem.stops:
        stops = np.where(rng.random((samples, n)) < 0.4, rng.uniform(0.2, 1.0, (samples, n)), 2.0)
        stops = stops.astype(dtype)
    return condition, z0, mask, stops


def _cast(tree, dtype):
    if isinstance(tree, dict):
        return {name: _cast(leaf, dtype) for name, leaf in tree.items()}
    return tree.astype(dtype) if np.issubdtype(tree.dtype, np.floating) else tree


def _field(problem, rng, samples, modes):
    n, d = problem.agents, problem.dim
    around = rng.uniform(-1.2, 1.2, (samples, n, 1, 2))
    close = rng.random((samples, 1, 1, 1)) < 0.3
    around = np.where(close, around[:, :1] + 0.2 * around, around)
    along = np.cumsum(rng.normal(scale=0.2, size=(samples, n, problem.waypoints, 2)), axis=2)
    return {
        "mode": rng.choice(len(modes), samples, p=np.asarray(modes) / np.sum(modes)).astype(
            np.int32
        ),
        "targets": (around + along).reshape(samples, n, d),
        "focus": rng.uniform(-0.7, 0.7, (samples, 2)),
        "gain": rng.uniform(0.3, 5.0, samples),
        "when": rng.uniform(0.0, 1.0, samples),
        "what": rng.choice([np.nan, np.inf, -np.inf], samples),
        "first": rng.normal(size=(samples, d + 1, HIDDEN)),
        "second": rng.normal(size=(samples, HIDDEN, d)) * rng.choice([0.5, 3.0], (samples, 1, 1)),
    }


def _control(problem, rng, samples):
    n, d = problem.agents, problem.dim
    turned = np.linalg.qr(rng.normal(size=(samples, n, d, d)))[0]
    size = rng.uniform(0.5, 2.0, (samples, n, 1, d))
    if problem.control == "weak":  # one input of most agents does nothing
        size[..., -1] *= rng.choice([0.0, 0.0, 1e-3, 1.0], (samples, n, 1))
    return turned * size


def _apart(rng, samples, problem):
    return {"least": rng.uniform(0.02, 0.6, samples)}


def _discs(rng, samples, problem):
    return {
        "center": rng.uniform(-1.2, 1.2, (samples, 3, 2)),
        "radius": rng.uniform(0.05, 0.5, (samples, 3)),
    }


def _boxes(rng, samples, problem):
    return {
        "center": rng.uniform(-1.2, 1.2, (samples, 2, 2)),
        "half": rng.uniform(0.05, 0.5, (samples, 2, 2)),
    }


def _planes(rng, samples, problem):
    angle = rng.uniform(0, 2 * np.pi, (samples, 2))
    normal = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    return {"normal": normal, "offset": rng.uniform(-1.5, 0.1, (samples, 2))}


def _room(rng, samples, problem):
    return {
        "center": rng.uniform(-0.3, 0.3, (samples, 2)),
        "half": rng.uniform(0.7, 2.0, (samples, 2)),
    }


def _wall(rng, samples, problem):
    long, thin = rng.uniform(0.3, 2.0, samples), rng.choice([0.001, 0.005, 0.02], samples)
    upright = rng.random((samples, 1)) < 0.5
    half = np.where(upright, np.stack([thin, long], -1), np.stack([long, thin], -1))
    return {"center": rng.uniform(-0.5, 0.5, (samples, 1, 2)), "half": half[:, None]}


def _speed(rng, samples, problem):
    return {"most": rng.uniform(0.1, 0.8, samples)}


def _length(rng, samples, problem):
    return {"most": rng.uniform(0.2, 0.6, samples) * problem.waypoints}


def _dots(rng, samples, problem):
    return {
        "center": rng.uniform(-2, 2, (samples, DOTS, 2)),
        "radius": rng.uniform(0.005, 0.04, (samples, 1)),
    }


PIECES = {
    "apart": _apart,
    "discs": _discs,
    "boxes": _boxes,
    "planes": _planes,
    "room": _room,
    "wall": _wall,
    "speed": _speed,
    "length": _length,
    "dots": _dots,
}


def _mean(rng, samples):
    return {
        "center": rng.uniform(-0.8, 0.8, (samples, 2)),
        "radius": rng.uniform(0.05, 0.6, samples),
    }


def _total(rng, samples):
    return {"center": rng.uniform(-0.5, 0.5, (samples, 2)), "most": rng.uniform(0.8, 5.0, samples)}


def _spread(rng, samples):
    return {"most": rng.uniform(0.02, 1.0, samples)}


def _top(rng, samples):
    return {"sharp": rng.uniform(1.0, 30.0, samples), "most": rng.uniform(-0.3, 1.2, samples)}


def _ramp(rng, samples):
    return {"rise": rng.uniform(-1.5, 1.5, samples), "most": rng.uniform(-0.8, 0.8, samples)}


FACTORS = {"mean": _mean, "total": _total, "spread": _spread, "top": _top, "ramp": _ramp}
