"""Every code block of the documentation runs, in the order of its page, and so do the tutorials; public names have
examples; links lead somewhere."""

import doctest
import importlib
import re
import sys
from pathlib import Path

import jax
import jax.numpy as jnp
import matplotlib as mpl
import numpy as np
import pytest

import deggflow
from deggflow import requirements

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
sys.path.insert(0, str(DOCS / "_ext"))
import tutorials  # noqa: E402

PAGES = [
    path for path in sorted([*DOCS.glob("*.md"), *DOCS.glob("api/*.md")])
    if "```python" in path.read_text() and path.name not in ("extending.md", "foreign.md")
]  # fmt: skip
"""Those two have tests of their own."""
SCRIPTS = sorted(tutorials.SCRIPTS.glob("*.py"))


def blocks(path):
    return re.findall(r"^```python\n(.*?)^```", path.read_text(), re.DOTALL | re.MULTILINE)


def field(tau, z, condition):
    return -z


def margins(z, condition):
    return deggflow.distances(z).clip(max=5.0) - 0.3


def guidance_names():
    """What the page on guidance takes for granted."""
    from deggflow import Extrapolated

    return {
        "margins": margins, "Extrapolated": Extrapolated, "task_end": lambda condition: 0.0,
        "q_task": lambda tau, z, condition: jnp.sum(z**2) - 9.0,
        "q_safe": lambda tau, z, condition: jnp.max(z) - 5.0, "who_is_near": lambda condition: None,
        "condition": None,
    }  # fmt: skip


def requirements_names():
    """What the page on named requirements takes for granted."""
    starts = jnp.stack([jnp.zeros(3), jnp.arange(3.0)], axis=-1)
    condition = {
        "start": starts, "goal": starts + jnp.array([4.0, 0.0]),
        "obstacles": requirements.Disc((2.0, 0.5), 0.2),
    }  # fmt: skip
    everything = {name: getattr(requirements, name) for name in requirements.__all__}
    pick, key, gate, goal = (requirements.Disc((float(k), 0.0), 0.4) for k in range(4))
    of_formulas = {"pick": pick, "gate": gate, "goal": goal}
    return {**everything, **of_formulas, "condition": condition, "region_key": key}


def runtime_names():
    """What the page on processes takes for granted: here the team has one agent, which needs no other."""
    from deggflow import runtime

    class Alone:
        def send(self, data):
            pass

        def receive(self, timeout):
            return []

        def close(self):
            pass

    apart = deggflow.PrivateRequirement(lambda z, condition: 1.0 - z, 0.05, name="near")
    return {
        **{name: getattr(runtime, name) for name in runtime.__all__},
        "guidance": deggflow.DecoupledGuidance((apart,)), "z0": jnp.zeros((5, 2)), "condition": None,
        "number": 0, "transport": Alone(),
    }  # fmt: skip


FEW = {"count": 2, "grid": deggflow.refined_grid(8), "max_draws": 1}
