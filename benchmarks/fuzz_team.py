"""Files of a team task, that of docs/extending.md, for `fuzz.py`."""

import contextlib
import importlib.util
import io
import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax

from deggflow.app.certifying import certify_file
from deggflow.task import CertifyOptions, GenerateOptions, RunSettings, TrainingData, write_data
from deggflow.task.options import Recipe
from deggflow.train import Dataset
from deggflow.weights import save_weights

PAGE = Path(__file__).parents[1] / "docs" / "extending.md"
SIZES = {"width": 8, "rounds": 1, "head_width": 8}


def page_task(home: Path) -> Any:
    """The page's own task."""
    source = home / "drones_of_the_page.py"
    source.write_text(PAGE.read_text().split("```python\n")[1].split("```")[0])
    spec = importlib.util.spec_from_file_location(source.stem, source)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[source.stem] = module  # where dataclasses look their annotations up
    spec.loader.exec_module(module)
    return module.DroneTask()


def team_files(home: Path) -> list[tuple[str, Path, Callable[[], object]]]:
    """(name, file, what reads it) of conditions, samples, demonstrations, card and weights."""
    task = page_task(home)
    conditions, samples, weights = (
        home / name for name in ("formations.jsonl", "samples.jsonl", "team.safetensors")
    )
    options = GenerateOptions(size=3, seed=1)
    drawn = task.random_conditions(3, 3, 0, options)
    conditions.write_text("".join(json.dumps(each.to_json()) + "\n" for each in drawn))
    write_data(task.model, home / "team", Recipe(training=1, validation=1, sizes=(2, 3)))
    demonstrations = home / "team" / "training.jsonl"
    none: Any = Dataset(None, None, None)  # type: ignore[arg-type]
    data = TrainingData(none, none, statistics=(1.0, 1.0))
    field = task.model.build(jax.random.key(0), data, SIZES)
    card = {"task": task.name, "architecture": SIZES, "spread": [1.0, 1.0]}
    save_weights(weights, field, card)
    generator = task.generator(field, options)
    (made,) = generator.generate(drawn, RunSettings(seed=1), on_status=lambda status: None)
    samples.write_text("".join(json.dumps(each.to_json()) + "\n" for each in made))

    def certify() -> None:
        with contextlib.redirect_stdout(io.StringIO()):
            certify_file(task, samples, CertifyOptions(quiet=True))

    return [
        ("team conditions", conditions, lambda: task.read_conditions(conditions)),
        ("team samples", samples, certify),
        ("team demonstrations", demonstrations, lambda: task.model.load_data(demonstrations, demonstrations)),
        ("team card", weights.with_suffix(".json"), lambda: task.model.load(weights)),
        ("team weights", weights, lambda: task.model.load(weights)),
    ]  # fmt: skip
