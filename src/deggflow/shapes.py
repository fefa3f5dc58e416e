"""Array types that recur in signatures."""

from jaxtyping import Array, Bool, Float

Scalar = Float[Array, ""]
"""One number, such as tau."""

States = Float[Array, "agents dim"]
"""One vector per agent, of its state's dimension: states, drifts, corrections, gradients."""

AgentValues = Float[Array, " agents"]
"""One number per agent."""

Mask = Bool[Array, " agents"] | None
"""True for the agents that are meant; None: all of them."""

RowValues = Float[Array, " rows"]
"""One number per row of the requirements."""

RowFlags = Bool[Array, " rows"]
"""One flag per row of the requirements."""
