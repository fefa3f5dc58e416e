"""A team's sample and its line in a file; a demonstration is a sample without a certificate."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, make_dataclass
from functools import cache
from typing import Any

import numpy as np
from jaxtyping import Float

from deggflow.certificate import Certificate
from deggflow.jsonl import InputError, expect_integer, expect_list, expect_number, expect_object
from deggflow.lines import CertificateLine
from deggflow.records import parse_certificate
from deggflow.schema import parse_as

from .options import MAX_SEED

MAX_COORDINATE = 1e6  # in the task's units


@dataclass(frozen=True)
class TeamCondition:
    """The condition of a sample; a task derives its own dataclass from it, with JSON values as fields."""

    def to_json(self) -> Mapping[str, Any]:
        """The JSON object for a file."""
        return asdict(self)


@dataclass(frozen=True)
class TeamSample:
    """States of a team.

    Attributes:
        condition: The condition that they were generated or demonstrated for.
        states: States of all agents in the task's units, shape (agents, dim).
        seed: Seed of the run.
        certificate: The certificate; None for a demonstration.
    """

    condition: TeamCondition
    states: Float[np.ndarray, "agents dim"]
    seed: int
    certificate: Certificate | None = None

    def to_json(self) -> dict[str, Any]:
        """The JSON object for a file."""
        certificate = (
            {} if self.certificate is None else {"certificate": self.certificate.to_json()}
        )
        return {
            "condition": self.condition.to_json(),
            "agents": self.states.tolist(),
            **certificate,
            "seed": self.seed,
        }


@cache
def sample_lines(condition: Any) -> tuple[type[Any], type[Any]]:
    """Types of the lines of samples and of demonstrations, by the dataclass of their conditions."""
    before = [("condition", condition), ("agents", Sequence[Sequence[float]])]
    certificate = [("certificate", CertificateLine)]
    return (
        make_dataclass("SampleLine", [*before, *certificate, ("seed", int)]),
        make_dataclass("DemonstrationLine", [*before, ("seed", int)]),
    )


def parse_sample(value: Any, kind: type[TeamCondition], dim: int, *, certified: bool) -> TeamSample:
    """A sample from its JSON object.

    Args:
        value: The output of `json.loads`.
        kind: Dataclass of the condition.
        dim: Dimension of each agent's state.
        certified: Whether the sample has a certificate; demonstrations have none.

    Raises:
        InputError: A field is invalid; names the field.
    """
    keys = ("condition", "agents", *(("certificate",) if certified else ()), "seed")
    line = expect_object(value, "", keys, keys)
    return TeamSample(
        parse_as(kind, line["condition"], "condition"),
        _states(line["agents"], dim),
        expect_integer(line["seed"], "seed", 0, MAX_SEED),
        parse_certificate(line["certificate"], "certificate") if certified else None,
    )


def _states(value: Any, dim: int) -> Float[np.ndarray, "agents dim"]:
    rows = []
    for k, item in enumerate(expect_list(value, "agents")):
        field = f"agents[{k}]"
        row = expect_list(item, field)
        if len(row) != dim:
            raise InputError(f"must hold {dim} numbers; got {len(row)}", field=field)
        rows.append([
            expect_number(number, f"{field}[{j}]", -MAX_COORDINATE, MAX_COORDINATE, "")
            for j, number in enumerate(row)
        ])  # fmt: skip
    if not rows:
        raise InputError("must hold at least one agent", field="agents")
    return np.array(rows)
