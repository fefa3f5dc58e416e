"""Times the gradient of V of named requirements, of one sample on one core: `python benchmarks/requirements_speed.py`."""

import os

os.environ.setdefault(
    "XLA_FLAGS", "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1"
)

import time

import jax
import jax.numpy as jnp
import numpy as np

from deggflow import requirements as req

AGENTS, WAYPOINTS, REPEATS = 15, 64, 300


def problem():
    """Robots that cross a disc, with a little noise."""
    rng = np.random.default_rng(0)
    angle = 2 * np.pi * np.arange(AGENTS) / AGENTS
    start = 0.8 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    s = np.linspace(0, 1, WAYPOINTS)[None, :, None]
    paths = start[:, None] * (1 - 2 * s) + 0.02 * rng.normal(size=(AGENTS, WAYPOINTS, 2))
    return jnp.asarray(paths.reshape(AGENTS, -1), jnp.float32)


def median(function, z):
    """Median time of a call, s."""
    jax.block_until_ready(function(z))
    times = []
    for _ in range(REPEATS):
        begin = time.perf_counter()
        jax.block_until_ready(function(z))
        times.append(time.perf_counter() - begin)
    return float(np.median(times)), float(np.min(times))


def main():
    layout = req.trajectories(WAYPOINTS)
    boxes = req.Box(np.array([[0.5, 0.3], [-0.4, 0.2], [0.1, -0.5]]), (0.2, 0.3))
    kinds = {
        "apart, all pairs, swept": req.apart(radius=0.0525, layout=layout),
        "outside 3 boxes, swept": req.outside(boxes, radius=0.05, layout=layout),
        "outside 3 discs, swept": req.outside(
            req.Disc(boxes.centre, 0.1), radius=0.05, layout=layout
        ),
        "outside a polygon, swept": req.outside(
            req.Polygon([(0.0, 0.0), (0.3, 0.0), (0.1, 0.3)]), radius=0.05, layout=layout
        ),
        "speed": req.speed(0.12, layout=layout),
        "curvature": req.curvature(30.0, layout=layout),
        "apart + outside + speed": req.apart(radius=0.0525, layout=layout)
        + req.outside(boxes, radius=0.05, layout=layout)
        + req.speed(0.12, layout=layout),
    }
    z = problem()
    print(f"V and its gradient, {AGENTS} robots, {WAYPOINTS} waypoints, float32, {REPEATS} calls:")
    for name, each in kinds.items():
        judged, buffer = each.margins, each.buffer
        call = jax.jit(lambda z, j=judged, b=buffer: j.violation_and_gradient(z, None, b))
        middle, least = median(call, z)
        print(f"{name:26} median {1e6 * middle:7.0f} us, least {1e6 * least:7.0f} us")


if __name__ == "__main__":
    main()
