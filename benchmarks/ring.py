"""Points on a ring, |x|^2 = 1 to 1e-3, in several formulations, and in a half plane: `python benchmarks/ring.py [--count 1000]`.

The field is exact, from N(0, I) to a mixture of Gaussians around the ring; each sample is one agent. The problem is that
of latent or physics-constrained flow matching (PCFM; LDF) in its smallest form. Rows marked elsewhere are measurements of
the authors' own code and model.
"""

import argparse

import jax
import jax.numpy as jnp
import numpy as np

from deggflow import PrivateRequirement, SharedFactor, SharedRequirements, TighteningBound, sample
from deggflow import requirements as req

TOLERANCE, STD, CENTRES = 1e-3, 0.1, 16
RING_ELSEWHERE = (
    ("LDF, 20 evaluations", "1%", "-"),
    ("LDF, 200 evaluations", "28%", "-"),
    ("PCFM, 10 + 100 evaluations with projections", "100%", "2e-07"),
)
HALF_PLANE_ELSEWHERE = (("LDF, 200 evaluations", "89%", "-"),)


def ring(z, condition):
    """One equation for each agent."""
    return jnp.sum(z**2, axis=1, keepdims=True) - 1.0


def field(tau, z, condition):
    """Of a mixture of Gaussians around the ring."""
    angle = 2 * jnp.pi * jnp.arange(CENTRES, dtype=z.dtype) / CENTRES
    centre = jnp.stack([jnp.cos(angle), jnp.sin(angle)], axis=-1)
    variance = (tau * STD) ** 2 + (1 - tau) ** 2
    offset = z[:, None] - tau * centre[None]
    weight = jax.nn.softmax(-jnp.sum(offset**2, axis=-1) / (2 * variance), axis=1)
    end = centre[None] + tau * STD**2 / variance * offset
    return (jnp.sum(weight[..., None] * end, axis=1) - z) / jnp.maximum(1 - tau, 1e-3)


def signed(sign):
    """Q = sign g - tolerance, of the one agent."""
    return lambda tau, z, condition: sign * ring(z, condition)[0, 0]


def formulations():
    """The same requirement, said in different ways."""
    bound = TighteningBound(end=lambda condition: TOLERANCE)
    return {
        "equal(g, tolerance): V = g^2 / 2": req.equal(ring, TOLERANCE),
        "two margins, tolerance +- g": PrivateRequirement(
            lambda z, c: TOLERANCE + jnp.concatenate([ring(z, c), -ring(z, c)], axis=1), TOLERANCE / 2
        ),
        "two factors, +-g": SharedRequirements(
            tuple(SharedFactor(signed(s), bound, name=f"{s:+d} g") for s in (1, -1))
        ),
        r"one factor, \|g\|": SharedRequirements(
            (SharedFactor(lambda tau, z, c: jnp.abs(ring(z, c)[0, 0]), bound, buffer=TOLERANCE / 2),)
        ),
    }  # fmt: skip


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=1000, help="samples of each row")
    count = parser.parse_args().count
    settings = {"key": jax.random.key(1), "count": count, "shape": (1, 2), "max_draws": 1}
    print(f"| {count} samples, seed 1 | within the tolerance | largest deviation |")
    print("|---|---|---|")

    def row(name, z):
        error = np.abs(np.sum(np.asarray(z, np.float64) ** 2, axis=-1) - 1)
        print(f"| {name} | {np.mean(error <= TOLERANCE):.1%} | {error.max():.2g} |", flush=True)

    for name, requirement in formulations().items():
        if name.startswith("equal"):
            row("nominal", sample(field, (requirement,), guided=False, **settings).z)
        result = sample(field, (requirement,), **settings)
        row(name, result.z)
        if name.startswith("equal"):
            solution = req.solve(result.z, ring)
            row("the same, then solve(z, g)", solution.z)
    elsewhere(RING_ELSEWHERE)
    print(f"\n| half plane x_0 >= 0, {count} samples, seed 1 | satisfied | least margin |")
    print("|---|---|---|")
    half_plane = PrivateRequirement(lambda z, c: z[:, :1], buffer=0.01)
    for name, guided in (("nominal", False), ("x_0 >= 0, buffer 0.01", True)):
        z = sample(field, (half_plane,), guided=guided, **settings).z
        print(f"| {name} | {np.mean(z[..., 0] >= 0):.1%} | {np.min(z[..., 0]):.2g} |", flush=True)
    elsewhere(HALF_PLANE_ELSEWHERE)


def elsewhere(rows):
    """Measurements of the authors' own code and model."""
    for name, *rest in rows:
        print(f"| {name}, elsewhere | {' | '.join(rest)} |")


if __name__ == "__main__":
    main()
