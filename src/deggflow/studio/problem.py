"""A generation of any problem in the plane, as a page draws it."""

from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from deggflow.certification import certify
from deggflow.generation import Generation
from deggflow.guidance import AbstractRequirement, DecoupledGuidance
from deggflow.guidance.decoupled import as_guidance
from deggflow.recording import agent_names
from deggflow.requirements.layout import Layout

MAX_NUMBERS = 2_000_000  # of all states: a page of some 20 MB

Regions = Sequence[Float[np.ndarray, "_corners 2"]]


def problem_json(
    sample: Generation,
    requirements: DecoupledGuidance | Sequence[AbstractRequirement],
    condition: Any = None,
    *,
    layout: Layout,
    mask: Bool[Array | np.ndarray, " agents"] | None = None,
    agents: Sequence[str] | None = None,
    regions: Regions = (),
) -> dict[str, Any]:
    """States over tau, margins, values against bounds and inputs, as a JSON object; arguments as of `show`."""
    guidance = as_guidance(requirements)
    if not isinstance(sample, Generation):
        raise TypeError(
            f"`sample` must be a `Generation`, as of `generate`; got {type(sample).__name__}."
        )
    if sample.path is None or sample.trace is None or np.ndim(sample.z) != 2:
        raise ValueError(
            "`sample` must be one generation with its path and trace: generate(..., keep_path=True, keep_trace=True)."
        )
    if layout.axes != 2:
        raise ValueError(f"`layout` must have 2 axes, as a page has; got {layout.axes}.")
    states = _states(sample, condition, layout)
    count = states.shape[1]
    present = np.ones(count, bool) if mask is None else np.asarray(mask)
    certificate = certify(sample, guidance, condition, mask=mask, agents=agents, keep_trace=True)
    record = certificate.generation
    inputs = np.nan_to_num(np.asarray(sample.trace.input_norm, np.float64), posinf=1e300)
    return {
        "agents": list(agent_names(agents, count)),
        "present": present.tolist(),
        "heading": layout.heading is not None,
        "unit": layout.unit,
        "tau": np.asarray(sample.trace.tau, np.float64).tolist(),
        "states": np.round(states, 5).tolist(),
        "regions": [np.asarray(each, np.float64).tolist() for each in regions],
        "inputs": inputs.tolist(),
        "satisfied": certificate.satisfied,
        "reason": certificate.reason,
        "hypotheses": "not known" if record is None else record.first_failure or "hold",
        "verdicts": [vars(each) for each in certificate.verdicts],
        "margins": _margins(sample, guidance, condition, mask, present),
        "trace": None if record is None or record.trace is None else vars(record.trace),
    }


def _states(
    sample: Generation, condition: Any, layout: Layout
) -> Float[np.ndarray, "points agents waypoints entries"]:
    """Positions, and headings in rad if there are any, of every waypoint of every agent."""
    states = np.asarray(layout.paths(jnp.asarray(sample.path), condition), np.float64)
    if states.size > MAX_NUMBERS:
        raise ValueError(
            f"`sample` has {states.size} numbers on its path; a page shows at most {MAX_NUMBERS}."
        )
    if not np.isfinite(states).all():
        raise ValueError("`sample` must have finite states on its path; it has diverged.")
    if layout.heading == "vector":
        angle = np.arctan2(states[..., 3], states[..., 2])
        states = np.concatenate([states[..., :2], angle[..., None]], axis=-1)
    return states


def _margins(
    sample: Generation,
    guidance: DecoupledGuidance,
    condition: Any,
    mask: Bool[Array | np.ndarray, " agents"] | None,
    present: Bool[np.ndarray, " agents"],
) -> list[list[float | None]]:
    """Least margin of each agent in each row, in float64; None where a row is the team's or an agent is absent."""
    rows: list[list[float | None]] = []
    with jax.enable_x64(True):
        z = jnp.asarray(np.asarray(sample.z, np.float64))
        exact = jax.tree.map(_double, condition)
        here = None if mask is None else jnp.asarray(mask)
        for requirement in guidance.requirements:
            for margins in requirement.margins_at_end(z, exact, here):
                each = np.asarray(margins)
                if each.ndim == 0:
                    rows.append([None] * len(present))
                    continue
                least = each.reshape(len(present), -1).min(axis=1, initial=np.inf)
                rows.append([float(m) if np.isfinite(m) else None for m in least])
    return rows


def _double(leaf: Any) -> Any:
    if isinstance(leaf, np.ndarray | jax.Array) and jnp.issubdtype(leaf.dtype, jnp.floating):
        return jnp.asarray(np.asarray(leaf, np.float64))
    return leaf
