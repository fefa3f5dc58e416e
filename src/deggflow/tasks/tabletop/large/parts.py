"""Which objects of a large scene may bind one another, for processes that have several objects each."""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from deggflow.guidance import Pairs
from deggflow.tasks.tabletop.verdict import BUFFER

from .condition import LargeSceneCondition, LargeSceneParts, decode
from .margins import LargeSceneMargins, between_neighbours

SKIN = 0.05  # m


class ObjectNeighbourhood:
    """A `Neighbourhood` of objects: those between which a margin is below the buffer, or may come below it.

    Attributes:
        skin: The way that two objects may come towards each other before neighbours are listed again, m.
    """

    skin = SKIN

    def __init__(self, slots: int) -> None:
        """Args: slots: neighbours for which each part of an object has room."""
        self._margins = LargeSceneMargins(slots)

    def pairs(
        self, z: Float[Array, "agents 3"], condition: LargeSceneCondition
    ) -> tuple[Pairs, Bool[Array, ""]]:
        """Objects between which a margin is at most the buffer and the skin, and whether all were found."""
        wider = condition._replace(
            body_reach=condition.body_reach + self.skin,
            region_reach=condition.region_reach + self.skin,
        )
        found = between_neighbours(z, wider, self._margins.slots)
        complete = ~(found.beside.missed | found.around.missed)
        return self._margins.dependence(z, wider, BUFFER + self.skin), complete

    def way(
        self,
        before: Float[Array, "agents 3"],
        after: Float[Array, "agents 3"],
        condition: LargeSceneCondition,
    ) -> Float[Array, " agents"]:
        """The most that any point of an object or of its regions has moved, m."""
        one, other = decode(before, condition), decode(after, condition)
        straight = jnp.hypot(other.x - one.x, other.y - one.y)
        return straight + _extent(condition) * jnp.abs(other.theta - one.theta)

    def only(
        self, known: Bool[Array, " agents"], condition: LargeSceneCondition
    ) -> LargeSceneCondition:
        """The condition with no other objects on the table."""

        def of_known(parts: LargeSceneParts) -> LargeSceneParts:
            return parts._replace(valid=parts.valid & known[parts.owner])

        return condition._replace(
            mask=condition.mask & known,
            bodies=of_known(condition.bodies),
            regions=of_known(condition.regions),
        )


def _extent(condition: LargeSceneCondition) -> Float[Array, " agents"]:
    """How far each object and its regions reach from the object's origin, m."""
    farthest = jnp.zeros(len(condition.mask), condition.anchor.dtype)
    for parts in (condition.bodies, condition.regions):
        reach = jnp.hypot(parts.x, parts.y) + jnp.hypot(parts.half_x, parts.half_y) + parts.radius
        farthest = farthest.at[parts.owner].max(jnp.where(parts.valid, reach, 0.0))
    return farthest
