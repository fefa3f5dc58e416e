"""The library's side: fields, margins and factors as JAX functions, and a problem as deggflow's objects."""

from contextlib import nullcontext
from functools import cache

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from deggflow import (
    EULER,
    HEUN,
    RK4,
    DecoupledGuidance,
    EveryStep,
    Extrapolated,
    Fixed,
    Held,
    Local,
    Midpoint,
    NoGuidance,
    Own,
    Pooled,
    PrivateRequirement,
    SharedFactor,
    SharedRequirements,
    StepGuard,
    TighteningBound,
    distances,
    generate,
    generate_batch,
    refined_grid,
    safe_norm,
)
from deggflow.guidance import LinearSchedule, PowerSchedule, Recovering

from .spec import Private, grid_of

SOLVERS = {"euler": EULER, "heun": HEUN, "rk4": RK4}
# Of at most three macro steps: the coarse grid has no more steps.
DRIFTS = {
    "every": EveryStep(),
    "held": Held(1),
    "extrapolated": Extrapolated(3),
    "curved": Extrapolated(3, order=3),
    "midpoint": Midpoint(6),
}
GUARDS = {"default": StepGuard(), "zero": StepGuard(0), "none": None}


def field(tau, z, condition):
    """One of the fields of `MODES`, by number."""
    c = condition["field"]
    to_targets = c["targets"] - z
    turned = jnp.stack([-z[:, 1::2], z[:, ::2]], axis=-1).reshape(z.shape)
    to_focus = jnp.tile(c["focus"], z.shape[1] // 2)[None] - z
    speed = jnp.sqrt(jnp.sum(to_focus**2, axis=1, keepdims=True)) + 0.1
    time = jnp.full((len(z), 1), tau)
    hidden = jnp.tanh(jnp.concatenate([z, time], axis=1) @ c["first"])
    each = (
        c["gain"] * to_targets,
        c["gain"] * turned + 0.5 * to_targets,
        80.0 * to_targets,
        3.0 * to_focus / speed,
        to_targets / (1 - tau),
        jnp.where(tau > c["when"], c["what"], to_targets),
        hidden @ c["second"],
        jnp.broadcast_to(c["gain"], z.shape),
        40.0 * z,
    )
    return jnp.stack(each)[c["mode"]]


def still(tau, z, condition):
    """Nobody moves."""
    return jnp.zeros_like(z)


def _points(z):
    return z.reshape(len(z), -1, 2)


def _to_boxes(points, center, half):
    """Signed distance to axis-aligned boxes, negative inside."""
    over = jnp.abs(points[..., None, :] - center) - half
    return safe_norm(jnp.maximum(over, 0.0)) + jnp.minimum(jnp.max(over, axis=-1), 0.0)


def _apart(z, c, mask):
    apart = jax.vmap(lambda p: distances(p, mask), in_axes=1, out_axes=1)(_points(z))
    return apart - c["least"]


def _discs(z, c, mask):
    return safe_norm(_points(z)[:, :, None] - c["center"][None, None]) - c["radius"][None, None]


def _boxes(z, c, mask):
    return _to_boxes(_points(z), c["center"][None, None], c["half"][None, None])


def _planes(z, c, mask):
    return jnp.einsum("nwd,kd->nwk", _points(z), c["normal"]) - c["offset"][None, None]


def _room(z, c, mask):
    return c["half"][None, None] - jnp.abs(_points(z) - c["center"][None, None])


def _speed(z, c, mask):
    return c["most"] - safe_norm(jnp.diff(_points(z), axis=1))


def _length(z, c, mask):
    return c["most"] - jnp.sum(safe_norm(jnp.diff(_points(z), axis=1)), axis=1, keepdims=True)


PIECES = {
    "apart": _apart, "discs": _discs, "boxes": _boxes, "planes": _planes, "room": _room,
    "wall": _boxes, "speed": _speed, "length": _length, "dots": _discs,
}  # fmt: skip


def _mean_point(z, c):
    weight = c["team"].astype(z.dtype)
    return jnp.mean(_points(z), axis=1).T @ weight / jnp.sum(weight)


def _mean(tau, z, c):
    return safe_norm(_mean_point(z, c) - c["center"]) - c["radius"]


def _total(tau, z, c):
    away = jnp.mean(safe_norm(_points(z) - c["center"][None, None]), axis=1)
    return jnp.sum(jnp.where(c["team"], away, 0.0)) - c["most"]


def _spread(tau, z, c):
    weight = c["team"].astype(z.dtype)
    square = jnp.sum((jnp.mean(_points(z), axis=1) - _mean_point(z, c)[None]) ** 2, axis=-1)
    return square @ weight / jnp.sum(weight) - c["most"]


def _top(tau, z, c):
    x = jnp.where(c["team"], c["sharp"] * z[:, 0], -jnp.inf)
    return jax.scipy.special.logsumexp(x) / c["sharp"] - c["most"]


def _ramp(tau, z, c):
    return _mean_point(z, c)[0] + c["rise"] * (1 - tau) - c["most"]


FACTORS = {"mean": _mean, "total": _total, "spread": _spread, "top": _top, "ramp": _ramp}


def _private(spec, key):
    def margins(z, condition):
        parts = [
            PIECES[p](z, condition[key][p], condition.get("mask")).reshape(len(z), -1)
            for p in spec.pieces
        ]
        return jnp.concatenate(parts, axis=1)

    kind, one, two = spec.omega
    return PrivateRequirement(
        margins,
        buffer=spec.buffer,
        allocation={"own": Own(), "pooled": Pooled(), "local": Local()}[spec.allocation],
        reanchored=spec.reanchored,
        per_owner_gain=spec.per_owner,
        rho=spec.rho,
        kappa=spec.kappa,
        omega=LinearSchedule(one, two) if kind == "linear" else PowerSchedule(one),
        name=key,
    )


def _factor(spec, key, part, allocation):
    def value(tau, z, condition):
        return FACTORS[spec.kind](tau, z, condition[key][part])

    options = {"slack": spec.slack, "least": spec.least}
    if spec.moving_end:
        options["end"] = lambda condition: condition[key][part]["end"]
    more = {} if spec.gain is None else {"alpha": Recovering(spec.gain)}
    if spec.part:
        more["incidence"] = lambda condition: condition[key][part]["team"]
    bound = TighteningBound(**options)
    return SharedFactor(
        value, bound, allocation=allocation, buffer=spec.buffer, name=f"{key}{part}", **more
    )


def _shared(spec, key, agents):
    def allocation(j):
        uneven = jnp.asarray(1.0 + (j * agents + np.arange(agents)) % 3)
        return {"pooled": Pooled(), "own": Own(), "fixed": Fixed(uneven)}[spec.allocation]

    factors = enumerate(spec.factors)
    return SharedRequirements(
        tuple(_factor(each, key, f"f{j}", allocation(j)) for j, each in factors)
    )


def _metric(problem):
    if problem.metric is None:
        return None
    rng = np.random.default_rng(5)
    root = rng.normal(size=(problem.agents, problem.dim, problem.dim))
    each = root @ root.swapaxes(1, 2) + np.eye(problem.dim)
    return jnp.asarray(each if problem.metric == "each" else each[0], problem.dtype)


@cache
def guidance_of(problem):
    """The requirements, in a guidance."""
    parts = tuple(
        _private(each, f"r{k}")
        if isinstance(each, Private)
        else _shared(each, f"r{k}", problem.agents)
        for k, each in enumerate(problem.requirements)
    )
    control = (lambda tau, z, condition: condition["control"]) if problem.control else None
    return DecoupledGuidance(parts, control, _metric(problem), box=problem.box, norm=problem.norm)


def precision(problem):
    """The types in which a problem is solved."""
    return jax.enable_x64(True) if problem.x64 else nullcontext()


def steps_of(problem):
    """Grid, scheme, guard and drift as arguments of `generate`."""
    grid = grid_of(problem)
    if problem.grid == "short":
        grid = refined_grid(40)
    elif problem.grid == "random32":
        grid = jnp.asarray(grid, jnp.float32)
    solver, guard = SOLVERS[problem.solver], GUARDS[problem.guard]
    return {"grid": grid, "solver": solver, "guard": guard, "drift": DRIFTS[problem.drift]}


@cache
def program_of(problem, single=False, moves=field):
    """`generate_batch` (or `generate`) of a problem, compiled: (z0, condition, mask, stops) -> Generation."""
    with precision(problem):
        guidance = NoGuidance() if problem.nominal else guidance_of(problem)
        steps = steps_of(problem)
    call = generate if single else generate_batch

    def run(z0, condition, mask, stops):
        return call(moves, guidance, z0, condition, **steps, mask=mask, stops=stops, keep_path=True)

    return eqx.filter_jit(run)
