"""How fast a field lets two states part: its Jacobian's norm between them, by power iteration."""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float

from deggflow.flow import Field

from .coupling import Coupled

ITERATIONS = 4  # per grid point, each from what the last grid point's found
REPEATED = 5  # times that the first grid point is gone through before
SEGMENT = 3  # points on the way from the nominal state to the guided one, both included

Vector = Float[Array, " size"]


class Growth(NamedTuple):
    """Of each pair (nominal y, guided z) at the same tau; J is the field's Jacobian."""

    lipschitz: Float[Array, "samples points"]  # largest |J| found on the way from y to z
    quotient: Float[Array, "samples points"]  # |f(z) - f(y)| / |z - y|
    secant: Float[Array, "samples points"]  # (z - y) . (f(z) - f(y)) / |z - y|^2


class Linearised(NamedTuple):
    """A joint field at one state."""

    value: Vector
    norm: Float[Array, ""]  # of its Jacobian
    direction: Vector  # that is stretched so much


def linearised(
    field: Callable[[Vector], Vector], x: Vector, start: Vector, iterations: int
) -> Linearised:
    """Spectral norm of a Jacobian by power iteration, from below.

    Args:
        field: Joint field.
        x: Where it is linearised.
        start: A unit vector.
        iterations: Products with the Jacobian and as many with its transpose; the matrix is not made.
    """
    value, forward = jax.linearize(field, x)
    backward = jax.linear_transpose(forward, x)

    def enlarge(v: Vector, _: None) -> tuple[Vector, Float[Array, ""]]:
        image = forward(v)
        (back,) = backward(image)
        length = jnp.linalg.norm(back)
        ahead = jnp.where(length > 0, back / jnp.where(length > 0, length, 1.0), v)
        return ahead, jnp.linalg.norm(image)

    v, sizes = jax.lax.scan(enlarge, start, length=iterations)
    return Linearised(value, jnp.max(sizes), v)


@eqx.filter_jit
def growth(
    field: Field,
    coupled: Coupled,
    condition: Any,
    *,
    iterations: int = ITERATIONS,
    segment: int = SEGMENT,
) -> Growth:
    """Growth between nominal and guided states at every grid point.

    The theorem's proof needs |f(z) - f(y)| <= L |z - y| of these pairs alone, and by the mean value theorem the
    largest |J| between y and z is such an L. Here it is the largest found: by power iteration, at a few
    points of the segment; the pair's own quotient is among the candidates, so that the proof holds for these
    samples whatever was missed. Of a Lipschitz constant for all states it is an estimate from below.

    Args:
        field: Nominal vector field.
        coupled: Pairs of states.
        condition: The one they were generated under.
        iterations: Of power iteration, per grid point.
        segment: Points per pair and grid point, at least 2.
    """
    if segment < 2:
        raise ValueError(f"`segment` must be at least 2, both ends; got {segment}.")
    samples, _, agents, dim = coupled.nominal.shape
    share = jnp.linspace(0.0, 1.0, segment)[:, None]

    def pair(
        tau: Float[Array, ""], y: Vector, z: Vector, start: Float[Array, "segment size"]
    ) -> tuple[Growth, Float[Array, "segment size"]]:
        def joint(x: Vector) -> Vector:
            return field(tau, x.reshape(agents, dim), condition).reshape(-1)

        at = jax.vmap(lambda x, v: linearised(joint, x, v, iterations))(
            (1 - share) * y[None] + share * z[None], start
        )
        gap, parted = z - y, at.value[-1] - at.value[0]
        square = jnp.dot(gap, gap)
        # Of states closer than this the difference of f is mostly rounding.
        apart = square > jnp.finfo(y.dtype).eps * (jnp.dot(y, y) + jnp.dot(z, z))
        safe = jnp.where(apart, square, 1.0)
        most = jnp.max(at.norm)
        quotient = jnp.where(apart, jnp.linalg.norm(parted) / jnp.sqrt(safe), most)
        secant = jnp.where(apart, jnp.dot(gap, parted) / safe, most)
        return Growth(jnp.maximum(most, quotient), quotient, secant), at.direction

    def point(
        start: Float[Array, "samples segment size"], at: tuple[Array, Array, Array]
    ) -> tuple[Float[Array, "samples segment size"], Growth]:
        out, found = jax.vmap(pair, (None, 0, 0, 0))(*at, start)
        return found, out

    start = jax.random.normal(jax.random.key(0), (samples, segment, agents * dim), share.dtype)
    paths = (jnp.moveaxis(path, 1, 0).reshape(-1, samples, agents * dim) for path in coupled[1:3])
    along = jax.tree.map(
        lambda leaf: jnp.concatenate([jnp.repeat(leaf[:1], REPEATED, axis=0), leaf]),
        (coupled.tau, *paths),
    )
    _, found = jax.lax.scan(point, start / jnp.linalg.norm(start, axis=-1, keepdims=True), along)
    return jax.tree.map(lambda leaf: leaf[REPEATED:].T, found)


def decoder_lipschitz(
    decoder: Callable[[Float[Array, "agents dim"]], Any], z: Float[Array, "agents dim"]
) -> float:
    """L_D: the largest singular value of the decoder's Jacobian at z; exact, and the same at every z, if it is affine.

    Args:
        decoder: From a joint state to a tree of arrays, whose units make the metric. Absent agents' entries must
            not be among them.
        z: Where its Jacobian is taken.
    """

    def flat(x: Float[Array, " inputs"]) -> Float[Array, " outputs"]:
        return ravel_pytree(decoder(x.reshape(z.shape)))[0]

    matrix = jax.jit(jax.jacfwd(flat))(z.reshape(-1))
    return float(np.linalg.norm(np.asarray(matrix, np.float64), 2))
