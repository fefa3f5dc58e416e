"""How fast a field separates two states: the norm of its Jacobian between them, by power iteration."""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float

from deggflow.flow import Field
from deggflow.shapes import Scalar, States

from .coupling import Coupled

ITERATIONS = 4  # per grid point, from the direction at the previous grid point
REPEATED = 5  # additional passes at the first grid point, where no direction is known
SEGMENT = 3  # points from the nominal state to the guided state, both included

Vector = Float[Array, " size"]


class Growth(NamedTuple):
    """Growth between each pair (nominal y, guided z) at the same tau.

    Attributes:
        lipschitz: Largest norm of the field's Jacobian that was found between y and z.
        quotient: |f(z) - f(y)| / |z - y|.
        secant: (z - y) . (f(z) - f(y)) / |z - y|^2.
    """

    lipschitz: Float[Array, "samples points"]
    quotient: Float[Array, "samples points"]
    secant: Float[Array, "samples points"]


class Linearised(NamedTuple):
    """A joint field linearised at one state.

    Attributes:
        value: The field.
        norm: Spectral norm of its Jacobian.
        direction: Unit vector that the Jacobian stretches most.
    """

    value: Vector
    norm: Scalar
    direction: Vector


def linearised(
    field: Callable[[Vector], Vector], x: Vector, start: Vector, iterations: int
) -> Linearised:
    """A lower estimate of the spectral norm of a Jacobian, by power iteration.

    Args:
        field: Joint field.
        x: State at which the field is linearised.
        start: Unit vector with which the iteration starts.
        iterations: Number of products with the Jacobian, and as many with its transpose; the matrix is not formed.
    """
    value, forward = jax.linearize(field, x)
    backward = jax.linear_transpose(forward, x)

    def enlarge(v: Vector, _: None) -> tuple[Vector, Scalar]:
        image = forward(v)
        (product,) = backward(image)
        length = jnp.linalg.norm(product)
        direction = jnp.where(length > 0, product / jnp.where(length > 0, length, 1.0), v)
        return direction, jnp.linalg.norm(image)

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

    The theorem's proof needs |f(z) - f(y)| <= L |z - y| for these pairs only. By the mean value theorem, the largest
    |J| between y and z is such an L. Here, L is the largest value found by power iteration at a few points of the
    segment and by the pair's own quotient. Because of the quotient, the proof holds for these samples even if power
    iteration misses the maximum. L is a lower estimate of the Lipschitz constant over all states.

    Args:
        field: Nominal vector field.
        coupled: Pairs of states.
        condition: Condition of the generation.
        iterations: Number of power iterations per grid point.
        segment: Number of points per pair and grid point, at least 2.

    Raises:
        ValueError: `segment` is less than 2.
    """
    if segment < 2:
        raise ValueError(f"`segment` must be at least 2 to include both ends; got {segment}.")
    samples, _, agents, dim = coupled.nominal.shape
    share = jnp.linspace(0.0, 1.0, segment)[:, None]

    def pair(
        tau: Scalar, y: Vector, z: Vector, start: Float[Array, "segment size"]
    ) -> tuple[Growth, Float[Array, "segment size"]]:
        def joint(x: Vector) -> Vector:
            return field(tau, x.reshape(agents, dim), condition).reshape(-1)

        at = jax.vmap(lambda x, v: linearised(joint, x, v, iterations))(
            (1 - share) * y[None] + share * z[None], start
        )
        gap, difference = z - y, at.value[-1] - at.value[0]
        square = jnp.dot(gap, gap)
        # For states closer than this, the difference of f is mostly rounding error.
        apart = square > jnp.finfo(y.dtype).eps * (jnp.dot(y, y) + jnp.dot(z, z))
        safe = jnp.where(apart, square, 1.0)
        largest = jnp.max(at.norm)
        quotient = jnp.where(apart, jnp.linalg.norm(difference) / jnp.sqrt(safe), largest)
        secant = jnp.where(apart, jnp.dot(gap, difference) / safe, largest)
        return Growth(jnp.maximum(largest, quotient), quotient, secant), at.direction

    def point(
        start: Float[Array, "samples segment size"], at: tuple[Array, Array, Array]
    ) -> tuple[Float[Array, "samples segment size"], Growth]:
        growth_here, directions = jax.vmap(pair, (None, 0, 0, 0))(*at, start)
        return directions, growth_here

    start = jax.random.normal(jax.random.key(0), (samples, segment, agents * dim), share.dtype)
    paths = (jnp.moveaxis(path, 1, 0).reshape(-1, samples, agents * dim) for path in coupled[1:3])
    points = jax.tree.map(
        lambda leaf: jnp.concatenate([jnp.repeat(leaf[:1], REPEATED, axis=0), leaf]),
        (coupled.tau, *paths),
    )
    start = start / jnp.linalg.norm(start, axis=-1, keepdims=True)
    _, growths = jax.lax.scan(point, start, points)
    return jax.tree.map(lambda leaf: leaf[REPEATED:].T, growths)


def decoder_lipschitz(decoder: Callable[[States], Any], z: States) -> float:
    """L_D: the largest singular value of the decoder's Jacobian at z; for an affine decoder it is the same at every z.

    Args:
        decoder: From a joint state to a tree of arrays, whose units define the metric. It must not contain entries of
            absent agents.
        z: State at which the Jacobian is evaluated.
    """

    def flat(x: Float[Array, " inputs"]) -> Float[Array, " outputs"]:
        return ravel_pytree(decoder(x.reshape(z.shape)))[0]

    matrix = jax.jit(jax.jacfwd(flat))(z.reshape(-1))
    return float(np.linalg.norm(np.asarray(matrix, np.float64), 2))
