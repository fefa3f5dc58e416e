"""How far guidance moves scenes from the nominal ones, and the theorem's bound on it."""

import math
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from deggflow.tasks.tabletop.changes import random_conditions
from deggflow.tasks.tabletop.deviation import PATHS, deviation_of_scenes, deviation_of_theorem
from deggflow.tasks.tabletop.field import load_field
from deggflow.tasks.tabletop.generator import TabletopGenerator, default_drift
from deggflow.tasks.tabletop.requirements import OWN, tabletop_guidance

from .deviation_section import KINDS, section_of
from .experiment import UNMET, Experiment, Progress, Section, Settings
from .paper import TASK2_W2_SCENES

SIZES, QUICK_SIZES = (4, 5, 6, 7, 8), (4, 8)
MANY = 500  # scenes of the larger sample, in full
FAMILY = "changed"


class SceneDeviations:
    """fig:task2_w2 with its text, and both sides of thm:wasserstein."""

    name = "deviation"

    def measure(self, settings: Settings, say: Progress) -> Mapping[str, Any]:
        """Scenes as many as in the paper, a larger sample, and one condition for the theorem's two sides."""
        scenes, paths = settings.cases(TASK2_W2_SCENES, 16), settings.cases(PATHS, 4)
        rows: list[dict[str, Any]] = []
        for size in QUICK_SIZES if settings.quick else SIZES:
            # The theorem compiles many programs: a quick run evaluates it for one size.
            skip = settings.quick and bool(rows)
            rows.append(_measure(size, scenes, 0 if skip else paths, settings, say))
        unmet = [text for row in rows for text in _bound_violations(row)]
        return {
            "seed": settings.seed,
            "scenes": scenes,
            "paths": paths,
            "rows": rows,
            UNMET: unmet,
        }

    def present(self, result: Mapping[str, Any], settings: Settings) -> Section:
        """Ratios over N beside the paper's, and the theorem's two sides."""
        return section_of(result)


def _measure(
    size: int, scenes: int, paths: int, settings: Settings, say: Progress
) -> dict[str, Any]:
    field, seed = load_field(), settings.seed
    nominal = TabletopGenerator(field)
    drift = default_drift(
        phase="during"
    )  # the paper's: its theorem is of the guided path from z(0)
    guided = TabletopGenerator(field, tabletop_guidance(), drift=drift)
    conditions = random_conditions(size, max(scenes, MANY), FAMILY, seed)
    samples = {"scenes": (guided, conditions[:scenes])}
    if not settings.quick:
        own = tabletop_guidance(OWN, reanchored=False)
        papers = TabletopGenerator(field, own, drift=drift, guard=None)
        samples["many"] = guided, conditions[:MANY]
        samples["own"] = papers, conditions[:MANY]
        samples["same"] = guided, conditions[:1] * scenes
    row: dict[str, Any] = {"size": size, "condition": conditions[0].to_json()}
    for kind, (generator, part) in samples.items():
        say(f"N = {size}: W2, {KINDS[kind]}, {len(part)} scenes")
        row[kind] = asdict(deviation_of_scenes(nominal, generator, part, seed))
    if paths:
        say(f"N = {size}: both sides of the theorem, {paths} samples")
        row["theorem"] = asdict(deviation_of_theorem(guided, conditions[0], paths, seed))
    return row


def _bound_violations(row: Mapping[str, Any]) -> list[str]:
    """A message if a row violates the bound, which must hold for fixed Euler steps."""
    theorem = row.get("theorem")
    if theorem is None or theorem["log_bounds"]["held"] >= math.log(theorem["paired"]):
        return []
    return [f"deviation, N = {row['size']}: above the theorem's bound"]


EXPERIMENTS: tuple[Experiment, ...] = (SceneDeviations(),)
