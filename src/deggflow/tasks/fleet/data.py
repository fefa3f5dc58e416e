"""Demonstrations of the fleet: drawn conditions with planned paths, their files, and training data made from them."""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from deggflow.files import StrPath
from deggflow.jsonl import InputError, expect_integer, expect_object
from deggflow.statistics import Rate
from deggflow.tables import read_results
from deggflow.task.options import MAX_SEED
from deggflow.train import Dataset

from .choice import least_distance
from .condition import APART, FleetCondition, Robot, to_arrays
from .formats import parse_condition
from .lines import LINES
from .maps import NAMED, SPEED_LIMITS, FloorMap, random_map
from .paths import DIM, MODES, WAYPOINTS, to_modes
from .planner import demonstrate
from .schemes import OWN, own_scheme, random_scheme

DIGITS = 4  # of coordinates in files: 0.1 mm where a robot is 10 cm wide
SHARES = {
    "empty": 0.12,
    "conveyor": 0.2,
    "highways": 0.18,
    "drop_region": 0.18,
    "dense": 0.17,
    "random": 0.15,
}  # of the maps among demonstrations
OWN_SHARE = 0.5  # of MMD's own schemes, on maps that have one
RINGS = (3, 6, 9, 12, 15, 20, 30, 40)  # sizes of teams from whose own schemes robots are taken
OBSTACLES = (3, 10)  # fewest and most on a random map
RANDOM_LIMITS = (0.05, 0.12)  # speed limits on random maps
LEAST_SPREAD = 0.02  # in z, where demonstrations hardly differ


@dataclass(frozen=True)
class Demonstration:
    """A team's paths.

    Attributes:
        condition: What they were planned for.
        paths: In map units.
        seed: Of the data.
        number: Among the demonstrations of this size and seed.
    """

    condition: FleetCondition
    paths: Float[np.ndarray, "robots 64 2"]
    seed: int
    number: int

    def to_json(self) -> dict[str, Any]:
        """The demonstration as it stands in a file."""
        return {
            "condition": self.condition.to_json(),
            "paths": self.paths.tolist(),
            "seed": self.seed,
            "number": self.number,
        }


def draw_condition(size: int, rng: np.random.Generator) -> FleetCondition:
    """A condition for a demonstration: a map by `SHARES`, starts and goals of a scheme."""
    name = str(rng.choice(list(SHARES), p=list(SHARES.values())))
    floor = NAMED.get(name) or random_map(rng, int(rng.integers(OBSTACLES[0], OBSTACLES[1] + 1)))
    if name in OWN and size <= RINGS[-1] and rng.uniform() < OWN_SHARE:
        ring = int(rng.choice([count for count in RINGS if count >= size]))
        taken = rng.choice(ring, size, replace=False)
        start, goal = (points[taken] for points in own_scheme(name, ring))
    else:
        start, goal = random_scheme(floor, size, rng)
    limit = SPEED_LIMITS.get(name) or round(rng.uniform(*RANDOM_LIMITS), 3)
    return FleetCondition(
        name if name in NAMED else _rounded(floor),
        tuple(
            Robot((a, b), (c, d))
            for (a, b), (c, d) in zip(
                start.round(DIGITS).tolist(), goal.round(DIGITS).tolist(), strict=True
            )
        ),
        speed_limit=limit,
    )


def _rounded(floor: FloorMap) -> FloorMap:
    boxes, discs = (
        tuple(tuple(round(value, DIGITS) for value in each) for each in kind)
        for kind in (floor.boxes, floor.discs)
    )
    return FloorMap(floor.bounds, boxes, discs)  # type: ignore[arg-type]  # of the same lengths


def make_demonstrations(size: int, first: int, count: int, seed: int) -> list[Demonstration]:
    """Demonstrations number `first` to `first + count - 1`; each depends on seed, size and its number alone."""
    made = []
    for number in range(first, first + count):
        rng = np.random.default_rng([seed, size, number])
        condition = draw_condition(size, rng)
        paths = demonstrate(condition, rng).paths.round(DIGITS)
        made.append(Demonstration(condition, paths, seed, number))
    return made


def parse_demonstration(value: Any) -> Demonstration:
    """A demonstration from its JSON object; raises `InputError` with the field."""
    keys = ("condition", "paths", "seed", "number")
    entries = expect_object(value, "", keys, keys)
    condition = parse_condition(entries["condition"], "condition")
    shape = (len(condition.robots), WAYPOINTS, 2)
    try:
        paths = np.array(entries["paths"], float)
    except (TypeError, ValueError):
        paths = np.zeros(0)
    if paths.shape != shape or not np.all(np.isfinite(paths)):
        raise InputError(f"must be finite numbers of shape {shape}", field="paths")
    return Demonstration(
        condition,
        paths,
        expect_integer(entries["seed"], "seed", 0, MAX_SEED),
        expect_integer(entries["number"], "number", 0, MAX_SEED),
    )


def read_demonstrations(path: StrPath) -> list[Demonstration]:
    """All demonstrations of a file, or `InputError` for the first that is wrong."""
    return read_results(path, parse_demonstration, "fleet demonstration", LINES)


def conflict_free(demonstrations: Sequence[Demonstration]) -> Mapping[str, Rate]:
    """How many demonstrations of each map keep their robots apart."""
    apart = defaultdict(list)
    for each in demonstrations:
        name = each.condition.map if isinstance(each.condition.map, str) else "random"
        apart[name].append(least_distance(each.paths) >= APART * each.condition.radius)
    return {name: Rate(sum(apart[name]), len(apart[name])) for name in sorted(apart)}


def load_dataset(path: StrPath) -> Dataset:
    """Demonstrations of a file as encoded training data; `InputError` if the file is invalid."""
    demonstrations = read_demonstrations(path)
    arrays = to_arrays([each.condition for each in demonstrations])
    z = np.zeros((*arrays.mask.shape, DIM), np.float32)
    for row, each in zip(z, demonstrations, strict=True):
        row[: len(each.paths)] = to_modes(each.paths)
    return Dataset(jnp.asarray(z), arrays, arrays.mask)


def spread(data: Dataset) -> tuple[float, ...]:
    """Standard deviation of each mode, about the straight line."""
    z = np.asarray(data.z)[np.asarray(data.mask)].reshape(-1, MODES, 2)
    values = np.sqrt(np.mean(z.astype(float) ** 2, axis=(0, 2)))
    return tuple(round(max(float(value), LEAST_SPREAD), 4) for value in values)
