"""Both factors along the generation of one policy, with guidance and without it from the same z(0)."""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Float

from deggflow.guidance import DecoupledGuidance

from .condition import BridgeCondition
from .policies import PolicyGenerator, rounded
from .world import MAX_ROBOTS

FACTORS = ("task", "safe")  # rows of the guidance, in this order
SAFE = FACTORS.index("safe")


class Course(NamedTuple):
    """q_task and q_safe, and the bounds that z(0) and the condition give them, at every grid point."""

    tau: Float[np.ndarray, " points"]
    value: Float[np.ndarray, "points 2"]
    bound: Float[np.ndarray, "points 2"]
    hypotheses_hold: bool  # of the theorem; no value was above its limit

    def to_json(self) -> dict[str, Any]:
        """tau, q_task, beta_task, q_safe, beta_safe as lists, and whether the hypotheses hold."""
        out: dict[str, Any] = {"hypotheses_hold": self.hypotheses_hold, "tau": self.tau.tolist()}
        for row, name in enumerate(FACTORS):
            out[f"q_{name}"] = self.value[:, row].tolist()
            out[f"beta_{name}"] = self.bound[:, row].tolist()
        return out


def guided_course(
    policies: PolicyGenerator, noise: Float[np.ndarray, "agents dim"], condition: BridgeCondition
) -> Course:
    """The course of a guided generation; the values at tau = 1 are those of the verdict, in float64.

    Args:
        policies: With the guidance.
        noise: z(0).
        condition: Of one trial; numpy arrays in float64.
    """
    trace = policies.trace(noise, _padded(condition))  # one program for teams of all sizes
    end = policies.batch(noise[None], _lead(condition))
    tau = np.asarray(trace.tau, np.float64)
    value, bound = np.asarray(trace.value, np.float64), np.asarray(trace.bound, np.float64)
    before = tau < 1.0
    record = end.record(0, int(condition.mask.sum()))
    return Course(
        np.append(tau[before], 1.0),
        np.vstack([value[before], [end.q_task[0], end.q_safe[0]]]),
        np.vstack([bound[before], [end.bound[0], 0.0]]),
        record is not None and record.hypotheses_hold,
    )


def nominal_values(
    policies: PolicyGenerator,
    guidance: DecoupledGuidance,
    noise: Float[np.ndarray, "agents dim"],
    condition: BridgeCondition,
) -> Float[np.ndarray, "points 2"]:
    """q_task and q_safe of a nominal generation at the points of `guided_course`.

    Args:
        policies: Without guidance.
        guidance: Its factors are evaluated; it is not applied.
        noise: z(0).
        condition: Of one trial; numpy arrays in float64.
    """
    whole = _padded(condition)
    path = policies.path(noise, whole)
    value = np.array(_values(guidance, policies.grid, path, rounded(whole)), np.float64)
    end = policies.batch(noise[None], _lead(condition))
    value[-1] = end.q_task[0], end.q_safe[0]
    return value


@eqx.filter_jit
def _values(
    guidance: DecoupledGuidance,
    grid: Float[Array, " points"],
    path: Float[Array, "points agents dim"],
    condition: BridgeCondition,
) -> Float[Array, "points 2"]:
    return jax.vmap(lambda tau, z: guidance.values(tau, z, condition))(grid, path)


def _lead(condition: BridgeCondition) -> BridgeCondition:
    return jax.tree.map(lambda leaf: leaf[None], condition)


def _padded(condition: BridgeCondition) -> BridgeCondition:
    """The condition, padded to the largest number of robots."""
    lacking = MAX_ROBOTS - len(condition.mask)
    contacts: Any = np.pad(condition.contacts, ((0, lacking), (0, 0)))
    mask: Any = np.pad(condition.mask, (0, lacking))
    return condition._replace(contacts=contacts, mask=mask)
