"""How requirements read a state: what the `dim` numbers of each agent are."""

import math
from typing import Any, SupportsIndex

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .values import Value, resolve


class Layout(eqx.Module):
    """How the numbers of an agent are read: a point, a pose, or a trajectory of either.

    A trajectory has its waypoints one after the other. Where `start` or `goal` is given, it stands in place of the first
    or last waypoint of z: the ends are held exactly, whatever the field does with these numbers.

    Attributes:
        axes: Coordinates of a position, 2 or 3; None: all numbers of a state that is a point.
        heading: None; "angle": one more number, in rad; "vector": two more, a cosine and a sine of any length but zero.
        waypoints: Of a trajectory; 1: no trajectory.
        dt: Time between waypoints, in s or in steps.
        start: First waypoint, shape (agents, entries); a constant, the name of an entry of the condition, or a function
            of it. None: as in z.
        goal: Last waypoint, likewise.
        unit: Of positions.
        modes: A matrix from amplitudes to waypoints, with rows of zeros at both ends: each coordinate of a path is then
            the straight line from start to goal, which must be given, and `modes @ amplitudes`, and the numbers of an
            agent are all amplitudes of the first mode, then of the second. None: they are waypoints.

    Example:
        >>> layout = Layout(axes=2, waypoints=3)
        >>> layout.decode(jnp.arange(6.0)[None], None)[:, 0]
        Array([[0., 2., 4.],
               [1., 3., 5.]], dtype=float32)
    """

    axes: int | None = eqx.field(static=True, default=None)
    heading: str | None = eqx.field(static=True, default=None)
    waypoints: int = eqx.field(static=True, default=1)
    dt: float = eqx.field(static=True, default=1.0)
    start: Value | None = None
    goal: Value | None = None
    unit: str = eqx.field(static=True, default="m")
    modes: Float[Array | np.ndarray, "waypoints modes"] | None = None

    def __check_init__(self) -> None:
        if self.axes not in (None, 2, 3):
            raise ValueError(f"`axes` must be 2 or 3, or None; got {self.axes!r}.")
        if self.heading not in (None, "angle", "vector"):
            raise ValueError(f'`heading` must be None, "angle" or "vector"; got {self.heading!r}.')
        if self.axes is None and (self.heading is not None or self.waypoints > 1):
            raise ValueError(
                "`axes` must be 2 or 3 where states are poses or trajectories; got None."
            )
        if self.heading is not None and self.axes != 2:
            raise ValueError(f"`axes` must be 2 where states have a heading; got {self.axes}.")
        if not isinstance(self.waypoints, int) or self.waypoints < 1:
            raise ValueError(f"`waypoints` must be a positive number; got {self.waypoints!r}.")
        if not 0 < self.dt < math.inf:
            raise ValueError(f"`dt` must be a positive time between waypoints; got {self.dt}.")
        if self.waypoints < 3 and (self.start is not None or self.goal is not None):
            raise ValueError(
                f"`waypoints` must be at least 3 where ends are held; got {self.waypoints}."
            )
        if self.modes is not None:
            self._check_modes(self.modes)

    def _check_modes(self, modes: Float[Array | np.ndarray, "..."]) -> None:
        if self.start is None or self.goal is None or self.heading is not None:
            raise ValueError("`modes` need `start` and `goal`, and positions without a heading.")
        if modes.ndim != 2 or len(modes) != self.waypoints or modes[[0, -1]].any():
            raise ValueError(
                f"`modes` must have {self.waypoints} rows, one per waypoint, of zeros at both ends; got shape {modes.shape}."
            )

    @property
    def swept(self) -> bool:
        """Whether there is motion between waypoints."""
        return self.waypoints > 1

    @property
    def entries(self) -> int | None:
        """Numbers of each waypoint; None: all of a state."""
        if self.axes is None:
            return None
        return self.axes + {None: 0, "angle": 1, "vector": 2}[self.heading]

    def decode(
        self, z: Float[Array, "agents dim"], condition: Any
    ) -> Float[Array, "entries agents waypoints"]:
        """All entries of all waypoints, with the ends that are held.

        Raises:
            ValueError: `dim` is not that of the layout.
        """
        if self.modes is not None:
            return self._from_modes(self.modes, z, condition)
        entries = z.shape[1] if self.entries is None else self.entries
        if z.shape[1] != entries * self.waypoints:
            raise ValueError(
                f"a state must have {entries * self.waypoints} numbers per agent, {self.waypoints} waypoint(s) of {entries}; "
                f"got z of shape {z.shape}."
            )
        x = jnp.moveaxis(z.reshape(len(z), self.waypoints, entries), 2, 0)
        first, last = x[:, :, :1], x[:, :, -1:]
        if self.start is None and self.goal is None:
            return x
        if self.start is not None:
            first = self._end("start", self.start, first, condition)
        if self.goal is not None:
            last = self._end("goal", self.goal, last, condition)
        return jnp.concatenate([first, x[:, :, 1:-1], last], axis=2)

    def _from_modes(
        self,
        modes: Float[Array | np.ndarray, "waypoints modes"],
        z: Float[Array, "agents dim"],
        condition: Any,
    ) -> Float[Array, "entries agents waypoints"]:
        count, axes = modes.shape[1], self.axes or 0
        if z.shape[1] != count * axes:
            raise ValueError(
                f"a state must have {count * axes} numbers per agent, {count} mode(s) of {axes}; got z of shape {z.shape}."
            )
        amplitudes = jnp.moveaxis(z.reshape(len(z), count, axes), 2, 0)
        none = jnp.zeros((axes, len(z), 1), z.dtype)
        start = self._end("start", self.start, none, condition)
        goal = self._end("goal", self.goal, none, condition)
        part = jnp.asarray(np.arange(self.waypoints) / (self.waypoints - 1), z.dtype)
        waves = jnp.einsum("axk,tk->axt", amplitudes, jnp.asarray(modes, z.dtype))
        path = start + part[None, None] * (goal - start) + waves
        return jnp.concatenate([start, path[:, :, 1:-1], goal], axis=2)

    def _end(
        self, name: str, value: Value | None, own: Float[Array, "entries agents 1"], condition: Any
    ) -> Float[Array, "entries agents 1"]:
        end = resolve(value, condition, own.dtype)
        agents, entries = own.shape[1], own.shape[0]
        if end.ndim != 2 or end.shape[0] != agents or not 1 <= end.shape[1] <= entries:
            raise ValueError(
                f"`{name}` must have shape ({agents}, {entries}), one waypoint per agent; got {end.shape}."
            )
        return jnp.concatenate([end.T[..., None], own[end.shape[1] :]], axis=0)

    def positions(
        self, z: Float[Array, "agents dim"], condition: Any
    ) -> Float[Array, "axes agents waypoints"]:
        """Positions, in m."""
        return self.decode(z, condition)[: self.axes]

    def directions(
        self, z: Float[Array, "agents dim"], condition: Any
    ) -> tuple[Float[Array, "agents waypoints"], Float[Array, "agents waypoints"]]:
        """Cosine and sine of the headings; of a vector of length zero, those of the heading 0."""
        if self.heading is None:
            raise ValueError('`layout` must have a heading, "angle" or "vector"; got None.')
        x = self.decode(z, condition)[self.axes :]
        if self.heading == "angle":
            return jnp.cos(x[0]), jnp.sin(x[0])
        square = x[0] ** 2 + x[1] ** 2
        zero = square == 0
        length = jnp.sqrt(jnp.where(zero, 1.0, square))
        return jnp.where(zero, 1.0, x[0] / length), x[1] / length

    def paths(
        self, z: Float[Array | np.ndarray, "*samples agents dim"], condition: Any = None
    ) -> Float[Array, "*samples agents waypoints entries"]:
        """Waypoints of every agent, with the ends that are held: what is judged.

        Args:
            z: Of one sample, or of many.
            condition: One for all samples.

        Example:
            >>> held = Layout(axes=2, waypoints=3, goal=np.ones((1, 2)))
            >>> held.paths(jnp.zeros((1, 6)))[0]
            Array([[0., 0.],
                   [0., 0.],
                   [1., 1.]], dtype=float32)
        """
        if z.ndim == 3:
            return jax.vmap(lambda one: self.paths(one, condition))(jnp.asarray(z))
        return jnp.moveaxis(self.decode(jnp.asarray(z), condition), 0, 2)

    def when(self, step: int, between: bool) -> str:
        """A waypoint in words, or the motion from one to the next."""
        if not self.swept:
            return ""
        return f" between waypoints {step} and {step + 1}" if between else f" at waypoint {step}"


POINTS = Layout()
"""Each state is a point."""


def poses(vector: bool = False) -> Layout:
    """States x, y, heading in rad; with `vector`, x, y and a cosine and a sine.

    Example:
        >>> poses().entries, poses(vector=True).entries
        (3, 4)
    """
    return Layout(axes=2, heading="vector" if vector else "angle")


def trajectories(
    waypoints: SupportsIndex,
    *,
    axes: int = 2,
    heading: str | None = None,
    dt: float = 1.0,
    start: Value | None = None,
    goal: Value | None = None,
) -> Layout:
    """States of so many waypoints, one after the other: `dim = waypoints * entries`.

    Args:
        waypoints: How many.
        axes: 2 or 3 coordinates of a position.
        heading: None, "angle" or "vector", as of `Layout`.
        dt: Time between waypoints; speeds are in m per unit of it.
        start: First waypoints, held exactly; shape (agents, axes), the name of an entry of the condition or a function
            of it. None: as in z.
        goal: Last waypoints, likewise.

    Example:
        >>> trajectories(64, start="start", goal="goal").waypoints
        64
    """
    count: Any = int(waypoints) if isinstance(waypoints, np.integer) else waypoints
    return Layout(axes, heading, count, dt, start, goal)
