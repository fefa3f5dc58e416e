"""The paper's library written out, random scenes, and signed distances by another road than the package's."""

import math

import jax
import numpy as np
import pytest
import shapely

from deggflow.tasks.tabletop.changes import random_conditions
from deggflow.tasks.tabletop.field import build_field
from deggflow.tasks.tabletop.generator import TabletopGenerator
from deggflow.tasks.tabletop.requirements import tabletop_guidance

QUARTERS = (-math.pi / 2, math.pi / 2)
TILTS = (-math.pi / 6, math.pi / 6)
ANY_SIDE = (math.pi, *QUARTERS)


def _disk(radius, x=0.0, y=0.0):
    return (radius, radius, radius, x, y)


def _rounded(a, b, corner):
    return (a, b, corner, 0.0, 0.0)


# Paper, Table "Object geometry and default affordance regions for Task 2": C(r) and R(a, b, r_c) with their
# centres, A(x, y, r), and the alternative directions from the text above the table.
PAPER = {
    "drawer_organizer": (
        [_rounded(0.156, 0.090, 0.012)],
        [(x, -0.205, 0.108) for x in (-0.1, 0.0, 0.1)],
        TILTS,
    ),
    "teacup": ([_disk(0.046), _disk(0.019, 0.061, 0.0)], [(0.125, 0.0, 0.055)], ANY_SIDE),
    "desk_lamp": ([_disk(0.06)], [(0.0, -0.147, 0.079)], QUARTERS),
    "laptop": ([_rounded(0.085, 0.065, 0.006)], [(0.155, 0.0, 0.07)], ANY_SIDE),
    "potted_plant": ([_disk(0.078)], [(0.0, -0.123, 0.062)], ANY_SIDE),
    "handled_mug": ([_disk(0.067)], [(0.0, -0.141, 0.054)], QUARTERS),
    "drawing_board": (
        [_rounded(0.135, 0.048, 0.008)],
        [(x, -0.108, 0.05) for x in (-0.065, 0.065)],
        TILTS,
    ),
    "scissors": ([_rounded(0.039, 0.026, 0.016)], [(0.083, 0.0, 0.043)], ANY_SIDE),
    "compact_printer": ([_rounded(0.099, 0.07, 0.009)], [(0.0, -0.133, 0.057)], ANY_SIDE),
    "pencil_case": ([_rounded(0.037, 0.072, 0.007)], [(0.087, 0.0, 0.046)], ANY_SIDE),
    "tissue_box": ([_rounded(0.049, 0.04, 0.009)], [(0.0, -0.103, 0.047)], QUARTERS),
    "pen_cup": ([_disk(0.034)], [(0.083, 0.0, 0.039)], ANY_SIDE),
}

# kg, in the object's origin; the paper has none.
MASSES = {
    "drawer_organizer": 1.2,
    "teacup": 0.35,
    "desk_lamp": 1.6,
    "laptop": 1.4,
    "potted_plant": 2.2,
    "handled_mug": 0.45,
    "drawing_board": 0.8,
    "scissors": 0.1,
    "compact_printer": 2.8,
    "pencil_case": 0.25,
    "tissue_box": 0.3,
    "pen_cup": 0.3,
}


@pytest.fixture(scope="session")
def paper():
    """Of each object: primitives (half x, half y, corner, x, y), regions (x, y, r), directions."""
    return PAPER


@pytest.fixture(scope="session")
def masses():
    """Of each object, kg."""
    return MASSES


def _random_scenes(seed, count, size, family="default", crowding=1.0):
    conditions = random_conditions(size, count, family, seed)
    rng = np.random.default_rng([seed, size, count])
    reach = np.array([[[0.70, 0.47, math.pi]]]) * [crowding, crowding, 1.0]
    return conditions, list(rng.uniform(-reach, reach, (count, size, 3)))


@pytest.fixture(scope="session")
def random_scenes():
    """Conditions and poses spread over the table (or a part of it); most of them break requirements."""
    return _random_scenes


def _core_distance(a, b):
    """Where the origin lies to the Minkowski difference of the corners' hulls: distance, or minus the depth."""
    differences = np.asarray(a)[..., :, None, :] - np.asarray(b)[..., None, :, :]
    points = differences.reshape(*differences.shape[:-3], -1, 2)
    hull = shapely.convex_hull(shapely.multipoints(shapely.points(points)))
    origin = shapely.points(0.0, 0.0)
    depth = shapely.distance(shapely.boundary(hull), origin)
    inside = (shapely.get_dimensions(hull) == 2) & shapely.contains_properly(hull, origin)
    return np.where(inside, -depth, shapely.distance(hull, origin))


@pytest.fixture(scope="session")
def core_distance():
    """Signed distance of convex polygons given by their corners."""
    return _core_distance


def _corners(half_x, half_y, x, y):
    signs = ((1, 1), (-1, 1), (-1, -1), (1, -1))
    return [complex(x + s * half_x, y + t * half_y) for s, t in signs]


def _grown(points, x, y, theta, radius):
    placed = complex(x, y) + np.exp(1j * theta) * np.asarray(points)
    return np.stack([placed.real, placed.imag], axis=-1), radius


def _balance(condition, poses):
    """How far inside its circle the centre of mass lies, in complex numbers; nothing if that is not asked for."""
    if condition.balance is None:
        return np.zeros(0)
    moment = sum(
        MASSES[name] * complex(x, y)
        for name, (x, y, _) in zip(condition.objects, poses, strict=True)
    )
    centre = moment / sum(MASSES[name] for name in condition.objects)
    circle = condition.balance
    return np.array([circle.radius - abs(centre - complex(circle.x, circle.y))])


def _reference(condition, poses):
    """Every margin of a scene from the paper's table and Minkowski differences, by the words of its kind."""
    bodies, regions = [], []
    for name, (x, y, theta) in zip(condition.objects, poses, strict=True):
        primitives, areas, _ = PAPER[name]
        need = condition.affordance(name)
        bodies.append(
            [
                _grown(_corners(a - corner, b - corner, u, v), x, y, theta, corner)
                for a, b, corner, u, v in primitives
            ]
        )
        regions.append(
            [
                _grown(
                    [need.offset_scale * complex(u, v)] * 4,
                    x,
                    y,
                    theta + need.direction,
                    need.radius_scale * radius,
                )
                for u, v, radius in areas
            ]
        )
    half = np.array([condition.width, condition.depth]) / 2
    count = len(bodies)
    pairs = {
        "separation": [
            (a, b) for i in range(count) for j in range(i) for a in bodies[i] for b in bodies[j]
        ],
        "unobstructed": [
            (a, b)
            for i in range(count)
            for j in range(count)
            if i != j
            for a in regions[i]
            for b in bodies[j]
        ],
    }
    out = {"balance": _balance(condition, poses)}
    for kind, chosen in pairs.items():
        first, second = [a for a, _ in chosen], [b for _, b in chosen]
        core = (
            _core_distance([c for c, _ in first], [c for c, _ in second]) if chosen else np.zeros(0)
        )
        out[kind + " of cores"] = core
        out[kind] = core - [a[1] + b[1] for a, b in chosen]
    for kind, shapes in (("object on table", bodies), ("region on table", regions)):
        out[kind] = np.array(
            [half - np.abs(c).max(axis=0) - r for shape in shapes for c, r in shape]
        ).ravel()
    return out


@pytest.fixture(scope="session")
def reference():
    """All margins of a scene, worked out from the paper's table independently of the package."""
    return _reference


STEPS = 12


@pytest.fixture(scope="session")
def field():
    """An untrained field, small so that programs are compiled soon."""
    return build_field(jax.random.key(0), width=16, rounds=1, head_width=16)


@pytest.fixture(scope="session")
def guided(field):
    """Few steps; every module that generates scenes uses this one, and so the same compiled programs."""
    return TabletopGenerator(field, tabletop_guidance(), steps=STEPS)


@pytest.fixture(scope="session")
def nominal(field):
    return TabletopGenerator(field, steps=STEPS)
