"""The fleet's nominal vector field: message passing among paths, conditioned on map, starts and goals."""

from collections.abc import Mapping
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PRNGKeyArray

from deggflow.field import TIME_FEATURES, time_features
from deggflow.field.message_passing import Links, MessageRound, apply
from deggflow.files import StrPath
from deggflow.jsonl import InputError, expect_list, expect_number
from deggflow.shapes import Scalar, States
from deggflow.weights import expect_sizes, load_by_card, packaged_weights

from .condition import FleetArrays
from .paths import BASIS, DIM, MODES, SCALES, WAYPOINTS
from .surroundings import surroundings

ACTIVE = 24  # modes of a path that the network moves; the others are those of Gaussian data
POINTS = 32  # along each path where the map is sampled
MEETINGS = 16  # of these points at which robots see each other
GRID = 16  # points per side at which the whole map is sampled
NEAR, FAR = 0.05, 0.2  # map units, length scales at which distances are resolved
CLOSE = 0.2  # map units, length scale of closeness of two robots
CROWD = 3.0  # sum of closeness up to which messages are added, not averaged
OWN_SIZE = 2 * ACTIVE + 6 * POINTS + 5 + TIME_FEATURES
PAIR_SIZE = 3 * MEETINGS
LARGEST = {"width": 8192, "rounds": 64, "blocks": 64}  # that a card may name
SHIPPED = packaged_weights("deggflow.tasks.fleet")  # trained weights

_AT = np.round(np.linspace(1, WAYPOINTS - 2, POINTS)).astype(int)
_SHARE = _AT / (WAYPOINTS - 1)


class Block(eqx.Module):
    """A residual layer of every robot, with a bias that depends on the map.

    Attributes:
        inner: From hidden state to hidden layer.
        of_map: From the map's code to a bias of the hidden layer.
        outer: Back to the hidden state.
    """

    inner: eqx.nn.Linear
    of_map: eqx.nn.Linear
    outer: eqx.nn.Linear

    def __init__(self, width: int, *, key: PRNGKeyArray) -> None:
        keys = jax.random.split(key, 3)
        self.inner, self.of_map, self.outer = (eqx.nn.Linear(width, width, key=k) for k in keys)

    def __call__(
        self, hidden: Float[Array, "agents width"], code: Float[Array, "1 width"]
    ) -> Float[Array, "agents width"]:
        """Args: hidden: states of the robots; code: of the map."""
        inner = jax.nn.silu(apply(self.inner, hidden) + apply(self.of_map, code))
        return hidden + apply(self.outer, inner)


class FleetField(eqx.Module):
    """f_theta(tau, z | map, starts, goals): the same parameters for every robot, equivariant under permutations.

    As in `MessagePassingField`, the output is preconditioned by the data's standard deviation. What robots read is the
    path that is expected of Gaussian data, given z: a straight line at tau = 0, the path itself at tau = 1.

    Attributes:
        spread: Standard deviation of the data in z, of each mode.
        embed: From a robot's inputs to its hidden state.
        of_map: From the map's sampled distances to its code.
        blocks: Residual layers, as many before as after each exchange of messages.
        rounds: Exchanges of messages.
        head: From a hidden state to velocities of the active modes.
    """

    spread: tuple[float, ...] = eqx.field(static=True)
    embed: eqx.nn.Linear
    of_map: eqx.nn.Linear
    blocks: tuple[tuple[Block, ...], ...]
    rounds: tuple[MessageRound, ...]
    head: eqx.nn.Linear

    def __init__(
        self,
        spread: tuple[float, ...],
        *,
        key: PRNGKeyArray,
        width: int = 192,
        rounds: int = 1,
        blocks: int = 1,
    ) -> None:
        """Initialises the weights.

        Args:
            spread: Standard deviation of the data in z, of each mode.
            key: Random key of the weights.
            width: Size of hidden states, messages and the map's code.
            rounds: Number of exchanges of messages.
            blocks: Residual layers before the first exchange and after every one.
        """
        first, second, last, *others = jax.random.split(key, 3 + rounds + (rounds + 1) * blocks)
        self.spread = spread
        self.embed = eqx.nn.Linear(OWN_SIZE, width, key=first)
        self.of_map = eqx.nn.Linear(GRID**2, width, key=second)
        self.head = eqx.nn.Linear(width, 2 * ACTIVE, key=last)
        self.rounds = tuple(MessageRound(width, PAIR_SIZE, key=k) for k in others[:rounds])
        made = [Block(width, key=k) for k in others[rounds:]]
        self.blocks = tuple(
            tuple(made[k : k + blocks]) for k in range(0, (rounds + 1) * blocks, blocks)
        )

    def __call__(self, tau: Scalar, z: States, condition: FleetArrays) -> States:
        """The velocity dz/dtau of every robot."""
        spread = jnp.repeat(jnp.asarray(self.spread, z.dtype), 2)[None]
        variance = (tau * spread) ** 2 + (1 - tau) ** 2  # of x(tau)
        paths = _paths(tau * spread**2 / variance * z, condition)
        time = jnp.broadcast_to(time_features(tau), (z.shape[0], TIME_FEATURES))
        scaled = (z * jax.lax.rsqrt(variance))[:, : 2 * ACTIVE]
        own = jnp.concatenate([scaled, _own(paths, condition), time], axis=-1)
        pair, links = _pairs(paths, condition)
        code = jax.nn.silu(apply(self.of_map, _map(condition)[None]))
        hidden = jax.nn.silu(apply(self.embed, own) + code)
        for k, blocks in enumerate(self.blocks):
            if k:
                hidden = self.rounds[k - 1](hidden, pair, links)
            for block in blocks:
                hidden = block(hidden, code)
        rest = jnp.zeros((z.shape[0], DIM - 2 * ACTIVE), z.dtype)
        residual = jnp.concatenate([apply(self.head, hidden), rest], axis=-1)
        linear = (tau * spread**2 - (1 - tau)) / variance * z
        return linear + spread * jax.lax.rsqrt(variance) * residual


def _ends(condition: FleetArrays) -> tuple[Float[Array, "agents 2"], Float[Array, "agents 2"]]:
    present = condition.mask[:, None]
    return jnp.where(present, condition.start, 0.0), jnp.where(present, condition.goal, 0.0)


def _paths(z: States, condition: FleetArrays) -> Float[Array, "agents points 2"]:
    """Paths at the points where the map is sampled; of absent robots about the origin."""
    start, goal = _ends(condition)
    modes = z[:, : 2 * ACTIVE].reshape(z.shape[0], ACTIVE, 2)
    weights = jnp.asarray((BASIS * SCALES)[_AT, :ACTIVE], z.dtype)
    share = jnp.asarray(_SHARE, z.dtype)[None, :, None]
    return (1 - share) * start[:, None] + share * goal[:, None] + weights @ modes


def _own(
    paths: Float[Array, "agents points 2"], condition: FleetArrays
) -> Float[Array, "agents own"]:
    """What a robot reads of its own path: places, distances and directions; ends; the speed limit."""
    agents = paths.shape[0]
    flat = paths.reshape(-1, 2)
    distance, along_x, along_y = surroundings(flat[:, 0], flat[:, 1], condition)
    fade = jnp.exp(-jnp.maximum(distance, 0.0) / FAR)
    graded = [jax.nn.soft_sign(distance / NEAR), jax.nn.soft_sign(distance / FAR)]
    rows = [*graded, fade * along_x, fade * along_y]
    limit = jnp.broadcast_to(10 * condition.speed_limit, (agents, 1))
    return jnp.concatenate(
        [
            paths.reshape(agents, -1),
            *(row.reshape(agents, -1) for row in rows),
            *_ends(condition),
            limit,
        ],
        axis=-1,
    )


def _map(condition: FleetArrays) -> Float[Array, " cells"]:
    """Distances on a lattice that spans the bounds."""
    left, low, right, high = condition.bounds
    share = (jnp.arange(GRID) + 0.5) / GRID
    x, y = left + share * (right - left), low + share * (high - low)
    x, y = jnp.repeat(x, GRID), jnp.tile(y, GRID)
    return jax.nn.soft_sign(surroundings(x, y, condition)[0] / FAR)


def _pairs(
    paths: Float[Array, "agents points 2"], condition: FleetArrays
) -> tuple[Float[Array, "agents others pair"], Links]:
    """Relative places, faded with distance; messages weigh by closeness, and no more than a few count in a crowd."""
    at = paths[:, :: POINTS // MEETINGS]
    agents = paths.shape[0]
    gap = at[None] - at[:, None]
    closeness = 1 / (1 + jnp.sum((gap / CLOSE) ** 2, axis=-1))
    pair = jnp.concatenate(
        [closeness, closeness * gap[..., 0] / CLOSE, closeness * gap[..., 1] / CLOSE], axis=-1
    )
    linked = condition.mask[None, :] & condition.mask[:, None] & ~jnp.eye(agents, dtype=bool)
    weight = jnp.where(linked, jnp.max(closeness, axis=-1), 0.0)
    crowd = jnp.maximum(jnp.sum(weight, axis=1, keepdims=True) / CROWD, 1.0)
    return pair, Links(None, weight / crowd)


def load_field(path: StrPath | None = None) -> FleetField:
    """A trained field from a safetensors file and its card; the shipped one if no path is given.

    Raises:
        InputError: The card or the weights are not those of a fleet field.
    """

    def skeleton(card: Mapping[str, Any]) -> FleetField:
        if card.get("task") != "fleet":
            raise InputError(f"must be 'fleet'; got {card.get('task')!r}", field="task")
        sizes = expect_sizes(card, LARGEST)
        entries = expect_list(card.get("spread"), "spread")
        if len(entries) != MODES:
            raise InputError(f"must hold {MODES} numbers; got {len(entries)}", field="spread")
        spread = tuple(
            expect_number(each, f"spread[{k}]", 1e-6, 1e6, "") for k, each in enumerate(entries)
        )
        return eqx.filter_eval_shape(
            lambda key: FleetField(spread, key=key, **sizes), jax.random.key(0)
        )

    return load_by_card(SHIPPED if path is None else path, skeleton)
