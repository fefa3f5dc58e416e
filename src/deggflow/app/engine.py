"""`--engine`: which processes compute the results of a run."""

from dataclasses import dataclass
from typing import Annotated, Literal

import tyro

from deggflow.jsonl import InputError
from deggflow.task import check_range


@dataclass(frozen=True)
class EngineOptions:
    """Which processes compute the results; the lines are the same.

    Attributes:
        engine: local: this process; ray: the workers of a Ray cluster, with the same lines.
        address: Address of a running Ray cluster; default: one that is started on this machine.
        cpus: With --engine ray, CPUs of each piece of the run that is computed at a time.

    Raises:
        InputError: The options do not go together.
    """

    engine: Literal["local", "ray"] = "local"
    address: str | None = None
    cpus: int = 2

    def __post_init__(self) -> None:
        check_range("cpus", self.cpus, 1, 1024)
        if self.address is not None and not self.ray:
            raise InputError("--address goes with --engine ray")

    @property
    def ray(self) -> bool:
        """Whether a Ray cluster computes them."""
        return self.engine == "ray"


# A dataclass's fields are options of their own.
SPELLED_OUT = tyro.conf.arg(name="", prefix_name=False)
AnyEngine = Annotated[EngineOptions, SPELLED_OUT]
LOCAL = EngineOptions()
