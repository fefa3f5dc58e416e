"""The bridge's nominal vector field: the paper's network; what does not change along tau is computed once."""

from collections.abc import Callable, Mapping
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from deggflow.field import TIME_FEATURES, time_features
from deggflow.files import StrPath
from deggflow.jsonl import InputError, expect_list, expect_number, expect_object
from deggflow.shapes import Scalar, States
from deggflow.weights import load_by_card, packaged_weights

from .condition import CONTACT_SIZE, OTHER_SIZE, OWN_SIZE, BridgeCondition, Scales, observe
from .world import AGENT_DIM, MAX_ROBOTS

MESSAGE_WIDTH = 160
HEAD_WIDTH = 256
LARGEST_SCALE = 1e6  # m/s and rad/s; the least is its inverse
SHIPPED = packaged_weights("deggflow.tasks.bridge")  # trained weights

Velocity = Callable[[Scalar, States, Any], States]


class BridgeField(eqx.Module):
    """f_theta of Task 1: messages psi_msg (77-160-160), averaged; psi_ag (258-256-256-256-24); SiLU.

    Source: paper, App. on Task 1 (network structure).
    """

    scales: Scales = eqx.field(static=True)
    message: eqx.nn.Linear
    message_out: eqx.nn.Linear
    entry: eqx.nn.Linear
    inner: tuple[eqx.nn.Linear, ...]
    exit: eqx.nn.Linear

    def __init__(self, scales: Scales, *, key: PRNGKeyArray) -> None:
        """Args: scales: statistics of the training set."""
        keys = jax.random.split(key, 6)
        message_inputs = AGENT_DIM + CONTACT_SIZE + OTHER_SIZE
        head_inputs = AGENT_DIM + CONTACT_SIZE + OWN_SIZE + MESSAGE_WIDTH + 1 + TIME_FEATURES
        self.scales = scales
        self.message = eqx.nn.Linear(message_inputs, MESSAGE_WIDTH, key=keys[0])
        self.message_out = eqx.nn.Linear(MESSAGE_WIDTH, MESSAGE_WIDTH, key=keys[1])
        self.entry = eqx.nn.Linear(head_inputs, HEAD_WIDTH, key=keys[2])
        self.inner = tuple(eqx.nn.Linear(HEAD_WIDTH, HEAD_WIDTH, key=k) for k in keys[3:5])
        self.exit = eqx.nn.Linear(HEAD_WIDTH, AGENT_DIM, key=keys[5])

    def __call__(self, tau: Scalar, z: States, condition: BridgeCondition) -> States:
        """dz/dtau of every robot."""
        return self.under(condition)(tau, z, condition)

    def under(self, condition: BridgeCondition) -> Velocity:
        """The field under one condition, a callable of the same form that ignores its own condition.

        Linear layers are split by their inputs; what depends on neither tau nor z is computed once, here. The
        second layer of the messages is linear, so it is applied to their mean and merged with the next layer.
        """
        observation = observe(condition, self.scales)
        at = AGENT_DIM, AGENT_DIM + CONTACT_SIZE
        of_state, of_contact, of_pair = jnp.split(self.message.weight, at, axis=1)
        pairs = (
            (observation.contact @ of_contact.T)[None]
            + observation.other @ of_pair.T
            + _bias(self.message)[None]
        )
        agents = condition.mask.shape[0]
        linked = condition.mask[None, :] & ~jnp.eye(agents, dtype=bool)
        others = jnp.sum(condition.mask) - 1
        weight = linked[..., None] / jnp.maximum(others, 1)
        parts = [AGENT_DIM, CONTACT_SIZE, OWN_SIZE, MESSAGE_WIDTH, 1]
        ends = [sum(parts[: k + 1]) for k in range(len(parts))]
        entry_z, entry_c, entry_own, entry_m, entry_n, entry_time = jnp.split(
            self.entry.weight, ends, axis=1
        )
        heard = entry_m @ self.message_out.weight
        constant = (
            observation.contact @ entry_c.T
            + observation.own @ entry_own.T
            + ((others / (MAX_ROBOTS - 1)) * entry_n[:, 0])[None]
            + (others > 0) * (_bias(self.message_out) @ entry_m.T)
            + _bias(self.entry)
        )

        def velocity(tau: Scalar, z: States, _: Any) -> States:
            messages = jax.nn.silu(pairs + (z @ of_state.T)[None])
            mean = jnp.sum(messages * weight, axis=1)
            hidden = (
                constant + z @ entry_z.T + mean @ heard.T + (entry_time @ time_features(tau))[None]
            )
            for layer in self.inner:
                hidden = jax.nn.silu(hidden) @ layer.weight.T + _bias(layer)
            return jax.nn.silu(hidden) @ self.exit.weight.T + _bias(self.exit)

        return velocity


def _bias(layer: eqx.nn.Linear) -> Float[Array, "1 width"]:
    assert layer.bias is not None
    return layer.bias[None]


def _scales(value: Any) -> Scales:
    """Statistics from a card: finite, of the right number, and positive where they are divisors."""
    entries = expect_object(value, "scales", Scales._fields, Scales._fields)
    values = {}
    for name, default in Scales._field_defaults.items():
        field = f"scales.{name}"
        numbers = expect_list(entries[name], field)
        if len(numbers) != len(default):
            raise InputError(f"must hold {len(default)} numbers; got {len(numbers)}", field=field)
        least = -LARGEST_SCALE if name == "continuation_mean" else 1 / LARGEST_SCALE
        values[name] = tuple(
            expect_number(number, f"{field}[{k}]", least, LARGEST_SCALE, "")
            for k, number in enumerate(numbers)
        )
    return Scales(**values)


def load_field(path: StrPath | None = None) -> BridgeField:
    """A trained field from a safetensors file and its card; the shipped one if no path is given.

    Raises:
        InputError: The card or the weights are not those of a bridge field.
    """

    def skeleton(card: Mapping[str, Any]) -> BridgeField:
        scales = _scales(card.get("scales"))
        return eqx.filter_eval_shape(lambda key: BridgeField(scales, key=key), jax.random.key(0))

    return load_by_card(SHIPPED if path is None else path, skeleton)
