"""The default generators, which evaluate the field a few times, against an evaluation at every step of the guidance, in the same run."""

import importlib.util
from collections.abc import Iterator

from deggflow.drift import EveryStep
from deggflow.flow import Field
from deggflow.tasks.bridge.field import load_field as load_bridge
from deggflow.tasks.bridge.policies import PolicyGenerator
from deggflow.tasks.bridge.requirements import bridge_guidance
from deggflow.tasks.tabletop.field import load_field
from deggflow.tasks.tabletop.generator import TabletopGenerator
from deggflow.tasks.tabletop.requirements import tabletop_guidance

from .clock import Call, Patience, in_turn
from .generation import policy_call, scene_call
from .rows import Row, Way, rows_of

EVALUATIONS = 16
SIZE = 8
WIDTH = 2230  # of a network with ten million parameters
DRIFTS = {"every step": EveryStep(), "default": None}


def few_evaluations(patience: Patience, quick: bool) -> Iterator[Row]:
    """Scenes, single ones and many, and a policy; ratio: to an evaluation at every step."""
    field, bridge = load_field(), load_bridge()
    guidance, team = tabletop_guidance(), bridge_guidance(bridge.scales)
    for batch in (1,) if quick else (1, 512):
        calls = {
            name: scene_call(TabletopGenerator(field, guidance, drift=drift), SIZE, batch)
            for name, drift in DRIFTS.items()
        }
        yield from _against_every_step(f"scenes/{batch}", calls, batch, patience)
    calls = {
        name: policy_call(PolicyGenerator(bridge, team, drift=drift), SIZE, 1)
        for name, drift in DRIFTS.items()
    }
    yield from _against_every_step("policies/1", calls, 1, patience)
    yield from _of_pytorch(patience, quick)


def _against_every_step(
    name: str, calls: dict[str, Call], batch: int, patience: Patience
) -> list[Row]:
    every, few = (f"few/{name}/{drift}" for drift in calls)
    what = f"guided {name.split('/')[0]}, N = {SIZE}, batch {batch}, field evaluated"
    ways = {
        every: Way(f"{what} at every step", batch),
        few: Way(f"{what} as often as by default", batch, every),
    }
    return rows_of(ways, in_turn(dict(zip(ways, calls.values(), strict=True)), patience))


def _of_pytorch(patience: Patience, quick: bool) -> Iterator[Row]:
    """Scenes with a PyTorch field of ten million parameters; ratio: to the nominal generation of sixteen evaluations."""
    batch = 16 if quick else 128
    where = f"PyTorch field of ten million parameters, batch {batch}"
    if importlib.util.find_spec("torch") is None:
        yield Row("few/torch", where, note="not installed")
        return
    field, guidance = _large_torch_field(), tabletop_guidance()
    generators = {
        "nominal": TabletopGenerator(field, steps=EVALUATIONS, power=1.5),
        "guided": TabletopGenerator(field, guidance),
        "guided, field at every step": TabletopGenerator(field, guidance, drift=EveryStep()),
    }
    calls = {f"few/torch/{name}": scene_call(one, SIZE, batch) for name, one in generators.items()}
    nominal = next(iter(calls))
    ways = {
        name: Way(f"{kind}, {where}", batch, None if name == nominal else nominal)
        for name, kind in zip(calls, generators, strict=True)
    }
    yield from rows_of(ways, in_turn(calls, patience))


def _large_torch_field() -> Field:
    """A perceptron of the states of all objects, untrained: only its time counts."""
    import torch

    from deggflow.field.torch import TorchField, joined

    torch.manual_seed(0)
    joint = 3 * SIZE
    network = torch.nn.Sequential(
        torch.nn.Linear(joint + 1, WIDTH),
        torch.nn.SiLU(),
        torch.nn.Linear(WIDTH, WIDTH),
        torch.nn.SiLU(),
        torch.nn.Linear(WIDTH, WIDTH),
        torch.nn.SiLU(),
        torch.nn.Linear(WIDTH, joint),
    ).eval()
    return TorchField(network, joined, flat=True)
