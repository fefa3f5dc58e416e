"""The tabletop's guidance: private affordance requirements, and a shared one on the centre of mass."""

from collections.abc import Callable
from typing import Any

import jax.numpy as jnp
from jaxtyping import Array, Float

from deggflow.guidance import (
    AbstractAllocation,
    AbstractSchedule,
    DecoupledGuidance,
    LinearSchedule,
    Local,
    Own,
    Pooled,
    PrivateRequirement,
    Recovering,
    SharedFactor,
    SharedRequirements,
    TighteningBound,
)
from deggflow.shapes import Scalar

from .codec import Pose, decode
from .condition import TabletopCondition
from .margins import LABELS, TABLETOP
from .verdict import BUFFER

OWN, POOLED, LOCAL = Own(), Pooled(), Local()
INSIDE = 0.98  # of the circle's radius is what guidance aims at: the rest pays for rounding
RECOVERY = 40.0  # gain of alpha above the bound

FactorValue = Callable[[Scalar, Float[Array, "agents 3"], Any], Scalar]


def affordance(
    allocation: AbstractAllocation = POOLED,
    *,
    buffer: float = BUFFER,
    reanchored: bool = True,
    omega: AbstractSchedule | None = None,
) -> PrivateRequirement:
    """Every object apart from the others, its regions free, all of it on the table.

    Args:
        allocation: `OWN` (the paper's), `POOLED` or `LOCAL`.
        buffer: delta^PE, m.
        reanchored: Take c afresh from the present violation instead of V(0).
        omega: When violations are brought down; the paper's schedule if None.
    """
    return PrivateRequirement(
        TABLETOP,
        buffer,
        allocation=allocation,
        reanchored=reanchored,
        omega=LinearSchedule() if omega is None else omega,
        name="affordance",
        margin_labels=LABELS,
    )


def tabletop_guidance(
    allocation: AbstractAllocation = POOLED, *, reanchored: bool = True
) -> DecoupledGuidance:
    """Guidance for the tabletop's private requirements, with the paper's constants.

    Args:
        allocation: `OWN` (the paper's), `POOLED` or `LOCAL`.
        reanchored: Take c afresh from the present violation instead of V(0).
    """
    return DecoupledGuidance((affordance(allocation, reanchored=reanchored),))


def imbalance(tau: Scalar, z: Float[Array, "agents 3"], condition: TabletopCondition) -> Scalar:
    """q: squared distance of the centre of mass from the circle's centre over the squared radius, less one; halved."""
    return imbalance_of(decode(z, condition), condition.mass, condition.balance)


def imbalance_of(pose: Pose, masses: Float[Array, " agents"], circle: Float[Array, " 3"]) -> Scalar:
    """The same of poses, masses (kg) and the circle's x, y and radius (m)."""
    mass = masses / jnp.sum(masses)
    x, y = jnp.sum(mass * pose.x), jnp.sum(mass * pose.y)
    x0, y0, radius = circle
    return (((x - x0) ** 2 + (y - y0) ** 2) / radius**2 - 1) / 2


def balance_of(value: FactorValue) -> SharedRequirements:
    """The shared requirement that keeps q below zero at the end."""
    bound = TighteningBound(least=0.0)
    return SharedRequirements(
        (
            SharedFactor(
                value,
                bound,
                alpha=Recovering(RECOVERY),
                buffer=(1 - INSIDE**2) / 2,  # q where the centre of mass is at INSIDE of the radius
                name="balance",
            ),
        )
    )


BALANCE = balance_of(imbalance)


def with_balance(guidance: DecoupledGuidance) -> DecoupledGuidance:
    """The same guidance and the shared requirement on the centre of mass, in one generation."""
    return DecoupledGuidance((*guidance.requirements, BALANCE))
