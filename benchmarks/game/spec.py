"""What a problem of the game is made of: names and numbers, which both sides read. No JAX, no deggflow."""

from dataclasses import dataclass, replace

import numpy as np

OBSTACLES = ("apart", "discs", "boxes", "planes", "room", "wall")
OF_WAYPOINTS = ("speed", "length")
FACTORS = ("mean", "total", "spread", "top", "ramp")
BUFFERS = (0.0, 0.005, 0.02, 0.1)
DRIFTS = ("every", "held", "extrapolated", "curved", "midpoint")


@dataclass(frozen=True)
class Private:
    """One private requirement: the margins of its pieces side by side."""

    pieces: tuple[str, ...]
    buffer: float = 0.02
    allocation: str = "pooled"
    reanchored: bool = True
    per_owner: bool = False
    rho: float = 0.75
    kappa: float = 1.15
    omega: tuple[str, float, float] = ("linear", 0.1, 1.8)


@dataclass(frozen=True)
class Factor:
    """One shared factor."""

    kind: str
    moving_end: bool = False  # an end value from the condition, else 0
    slack: float = 0.02
    least: float | None = None
    buffer: float = 0.0
    gain: float | None = None  # of `Recovering`
    part: bool = False  # only some agents belong to it


@dataclass(frozen=True)
class Shared:
    """The factors of one shared requirement."""

    factors: tuple[Factor, ...]
    allocation: str = "pooled"


@dataclass(frozen=True)
class Problem:
    """A program that is compiled once, and fed with many conditions."""

    requirements: tuple[Private | Shared, ...]
    agents: int = 4
    waypoints: int = 1
    padded: bool = False
    stops: bool = False
    control: str | None = None  # "turned", "weak"
    metric: str | None = None  # "one", "each"
    box: float | None = None
    norm: float | None = None
    grid: str = "refined"
    solver: str = "euler"
    guard: str = "default"  # "none", "zero"
    drift: str = "every"  # a name in `wired.DRIFTS`
    dtype: str = "float32"
    x64: bool = False
    nominal: bool = False
    fine: bool = (
        False  # conditions of float64 numbers, which generation rounds and the verdict does not
    )

    @property
    def dim(self) -> int:
        """Of one agent's state: its waypoints in the plane."""
        return 2 * self.waypoints


def names_of(problem):
    """What certificates call the rows."""
    out = []
    for k, each in enumerate(problem.requirements):
        if isinstance(each, Private):
            out.append(f"r{k}")
        else:
            out += [f"r{k}f{j}" for j in range(len(each.factors))]
    return out


def random_private(rng, choices, most=3):
    """One private requirement of some of these pieces."""
    count = min(len(choices), int(rng.integers(1, most + 1)))
    pieces = tuple(str(p) for p in rng.choice(choices, count, replace=False))
    reanchored = bool(rng.random() < 0.7)
    omegas = (("linear", 0.1, 1.8), ("linear", 1.0, 0.0), ("power", 2.0, 0.0), ("power", 0.5, 0.0))
    return Private(
        pieces,
        buffer=float(rng.choice(BUFFERS)),
        allocation=str(rng.choice(["own", "pooled", "local"])),
        reanchored=reanchored,
        per_owner=reanchored and bool(rng.random() < 0.4),
        rho=float(rng.choice([0.5, 0.75, 0.9])),
        kappa=float(rng.choice([1.0, 1.15, 2.0])),
        omega=omegas[rng.integers(len(omegas))],
    )


def random_shared(rng, most=3):
    """One shared requirement of up to three factors of different kinds."""
    kinds = rng.choice(FACTORS, int(rng.integers(1, most + 1)), replace=False)
    factors = tuple(
        Factor(
            str(kind),
            moving_end=bool(rng.random() < 0.5),
            slack=float(rng.choice([0.0, 0.02, 0.5])),
            least=None if rng.random() < 0.5 else float(rng.choice([0.0, 0.3])),
            buffer=float(rng.choice(BUFFERS)),
            gain=None if rng.random() < 0.5 else 20.0,
            part=bool(rng.random() < 0.4),
        )
        for kind in kinds
    )
    return Shared(factors, str(rng.choice(["pooled", "own", "fixed"])))


def random_steps(rng, problem):
    """The same problem with a grid, a scheme, a guard and a drift of its own."""
    grids = ("refined", "short", "uniform", "random64", "random32", "coarse")
    return replace(
        problem,
        grid=str(rng.choice(grids, p=[0.3, 0.2, 0.15, 0.125, 0.125, 0.1])),
        solver=str(rng.choice(["euler", "heun", "rk4"], p=[0.6, 0.25, 0.15])),
        guard=str(rng.choice(["default", "zero", "none"], p=[0.5, 0.2, 0.3])),
        drift=str(rng.choice(DRIFTS, p=[0.4, 0.15, 0.15, 0.15, 0.15])),
    )


def grid_of(problem):
    """Values of tau in float64; None for the default grid. The random ones are a fixed draw."""
    if problem.grid in ("refined", "short"):
        return None
    if problem.grid == "uniform":
        return np.linspace(0.0, 1.0, 61)
    if problem.grid == "coarse":
        return np.linspace(0.0, 1.0, 4)
    steps = np.random.default_rng(11).uniform(0.2, 1.0, 70)
    inside = np.cumsum(steps)[:-1] / steps.sum()
    return np.concatenate([[0.0], inside, [1.0]])
