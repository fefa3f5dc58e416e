"""Demonstrations of the bridge: their generation, their files, and training windows made from them."""

from collections import Counter
from collections.abc import Sequence
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from deggflow.files import StrPath
from deggflow.jsonl import (
    expect_choice,
    expect_integer,
    expect_number,
    expect_object,
)
from deggflow.statistics import Rate
from deggflow.tables import read_results
from deggflow.train import Dataset

from .codec import continuation, spline_coefficients, spline_matrix
from .condition import BridgeCondition, Scales, padded_robots, to_arrays
from .expert import (
    DETOUR,
    PACE,
    SIDES,
    TURNS,
    Approach,
    Demonstration,
    windows,
)
from .formats import parse_condition, parse_twists
from .lines import LINES
from .motion import contact_velocity
from .verdict import integrate
from .world import EXECUTED

SHAKEN = 0.5  # proportion of windows whose continuation is perturbed
SHAKE = (0.06, 0.06, 0.05)  # m/s, m/s, rad/s, largest standard deviation of its spline coefficients
_FEW = 1e-3  # least scale, used where a statistic of the data vanishes


class Example(NamedTuple):
    """A training window: the condition and the body twists that the expert executes from there."""

    condition: BridgeCondition
    twists: Float[Array, "... horizon 3"]


def to_json(demonstration: Demonstration) -> dict[str, Any]:
    """A demonstration as it stands in a file."""
    return {
        "condition": demonstration.condition.to_json(),
        "approach": demonstration.approach._asdict(),
        "twists": demonstration.twists.tolist(),
        "bridged": demonstration.bridged,
        "seed": demonstration.seed,
        "number": demonstration.number,
    }


def parse_demonstration(value: Any) -> Demonstration:
    """A demonstration from its JSON object; raises `InputError` with the field."""
    keys = ("condition", "approach", "twists", "bridged", "seed", "number")
    entries = expect_object(value, "", keys, keys)
    approach = expect_object(entries["approach"], "approach", Approach._fields, Approach._fields)
    return Demonstration(
        parse_condition(entries["condition"], "condition"),
        Approach(
            expect_choice(approach["side"], "approach.side", SIDES),
            expect_choice(approach["turn"], "approach.turn", TURNS),
            expect_number(approach["detour"], "approach.detour", *DETOUR, "m"),
            expect_number(approach["pace"], "approach.pace", *PACE, ""),
        ),
        (twists := parse_twists(entries["twists"], "twists")),
        expect_integer(entries["bridged"], "bridged", 0, len(twists)),
        expect_integer(entries["seed"], "seed", 0, 2**31 - 1),
        expect_integer(entries["number"], "number", 0, 2**31 - 1),
    )


def read_demonstrations(path: StrPath) -> list[Demonstration]:
    """All demonstrations of a file, or `InputError` for the first that is wrong."""
    return read_results(path, parse_demonstration, "bridge demonstration", LINES)


def approaches(path: StrPath) -> dict[str, Rate]:
    """How often each kind of approach occurs among the demonstrations of a file."""
    counts = Counter(f"{d.approach.side}, {d.approach.turn}" for d in read_demonstrations(path))
    ways = [f"{side}, {turn}" for side in SIDES for turn in TURNS]
    return {way: Rate(counts[way], counts.total()) for way in ways}


def _perturbation(count: int, seed: int) -> Float[np.ndarray, "windows horizon 3"]:
    """Smooth perturbations of continuations; the expert's plans are unchanged.

    In closed loop, the continuation is the field's own previous plan with its errors. A field trained only on exact
    continuations would copy these errors.
    """
    rng = np.random.default_rng([seed, 2])
    basis = spline_matrix()
    size = rng.uniform(0.0, 1.0, (count, 1, 1)) * np.array(SHAKE)
    noise = rng.standard_normal((count, basis.shape[1], 3)) * size
    return (rng.random((count, 1, 1)) < SHAKEN) * (basis @ noise)


def _windows(
    demonstrations: Sequence[Demonstration], agents: int, perturbation_seed: int | None
) -> Example:
    start = to_arrays([d.condition for d in demonstrations], agents)
    now, before, current, plank, owner = [], [], [], [], []
    for k, d in enumerate(demonstrations):
        target, previous = windows(d, EXECUTED)
        begins = np.arange(len(target)) * EXECUTED
        now.append(target)
        before.append(previous)
        current.append(np.concatenate([np.zeros((1, 3)), d.twists])[begins])
        plank.append(integrate(np.array(d.condition.plank), d.twists)[begins])
        owner.append(np.full(len(target), k))
    index = np.concatenate(owner)
    motion, previous = np.concatenate(current), np.concatenate(before)
    first = (previous == 0).all((1, 2))
    if perturbation_seed is not None:
        previous = previous + np.where(
            first[:, None, None], 0.0, _perturbation(len(previous), perturbation_seed)
        )
    ahead = continuation(jnp.asarray(previous, jnp.float32), jnp.asarray(motion, jnp.float32))
    condition = BridgeCondition(
        jnp.asarray(np.concatenate(plank), jnp.float32),
        jnp.asarray(motion, jnp.float32),
        start.goal[index],
        start.contacts[index],
        start.mask[index],
        ahead,
    )
    return Example(condition, jnp.asarray(np.concatenate(now), jnp.float32))


def _over_robots(
    twists: Float[Array, "windows horizon 3"], condition: BridgeCondition
) -> Float[np.ndarray, "robots horizon 2"]:
    velocity = contact_velocity(twists[:, None], condition.contacts[:, :, None])
    return np.asarray(velocity)[np.asarray(condition.mask)]


def training_scales(examples: Example) -> Scales:
    """Statistics of the training set."""

    def listed(values: np.ndarray) -> tuple[float, ...]:
        return tuple(float(v) for v in np.asarray(values, np.float64).reshape(-1))

    eta = np.asarray(spline_coefficients(examples.twists - examples.condition.continuation))
    ahead = _over_robots(examples.condition.continuation, examples.condition)
    actions = _over_robots(examples.twists, examples.condition)
    return Scales(
        eta=listed(np.maximum(eta.std(0), _FEW)),
        continuation_mean=listed(ahead.mean(0)),
        continuation_std=listed(np.maximum(ahead.std(0), _FEW)),
        contact=listed(actions.std((0, 1))),
        twist=listed(np.asarray(examples.twists).std((0, 1))),
    )


def load_dataset(path: StrPath, scales: Scales | None, *, perturb: bool) -> tuple[Dataset, Scales]:
    """Windows of a file's demonstrations as encoded training data, and the scales they are encoded with.

    Args:
        path: File of demonstrations.
        scales: Of the training set; taken from this file if None.
        perturb: Perturb the continuations.

    Raises:
        InputError: The file is invalid.
    """
    demonstrations = read_demonstrations(path)
    agents = padded_robots(max(len(d.condition.contacts) for d in demonstrations))
    examples = _windows(demonstrations, agents, demonstrations[0].seed if perturb else None)
    scales = training_scales(examples) if scales is None else scales
    eta = spline_coefficients(examples.twists - examples.condition.continuation)
    z = eta.reshape(len(eta), -1) / jnp.array(scales.eta)[None]
    states = jnp.broadcast_to(z[:, None], (len(z), agents, z.shape[1]))
    return Dataset(states, examples, examples.condition.mask), scales
