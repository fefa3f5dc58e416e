"""How far guidance moves scenes from the nominal ones, and what the theorem promises of it."""

import math
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from deggflow.tasks.tabletop.changes import random_conditions
from deggflow.tasks.tabletop.deviation import PATHS, deviation_of_scenes, deviation_of_theorem
from deggflow.tasks.tabletop.field import load_field
from deggflow.tasks.tabletop.generator import TabletopGenerator
from deggflow.tasks.tabletop.requirements import OWN, tabletop_guidance

from .deviation_section import KINDS, section_of
from .experiment import UNMET, Experiment, Progress, Section, Settings
from .paper import TASK2_W2_SCENES

SIZES, QUICK_SIZES = (4, 5, 6, 7, 8), (4, 8)
MANY = 500  # scenes of the larger sample, in full
FAMILY = "changed"


class SceneDeviations:
    """fig:task2_w2 with its text, and thm:wasserstein evaluated."""

    name = "deviation"

    def measure(self, settings: Settings, say: Progress) -> Mapping[str, Any]:
        """As many scenes as the paper's, more of them, and one condition for the theorem's two sides."""
        scenes, paths = settings.cases(TASK2_W2_SCENES, 16), settings.cases(PATHS, 4)
        rows: list[dict[str, Any]] = []
        for size in QUICK_SIZES if settings.quick else SIZES:
            few = settings.quick and bool(
                rows
            )  # the theorem's programs are many: one size shows it
            rows.append(_measured(size, scenes, 0 if few else paths, settings, say))
        unmet = [text for row in rows for text in _broken(row)]
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


def _measured(
    size: int, scenes: int, paths: int, settings: Settings, say: Progress
) -> dict[str, Any]:
    field, seed = load_field(), settings.seed
    nominal = TabletopGenerator(field)
    guided = TabletopGenerator(field, tabletop_guidance())
    conditions = random_conditions(size, max(scenes, MANY), FAMILY, seed)
    wanted = {"scenes": (guided, conditions[:scenes])}
    if not settings.quick:
        papers = TabletopGenerator(field, tabletop_guidance(OWN, reanchored=False), guard=None)
        wanted["many"] = guided, conditions[:MANY]
        wanted["own"] = papers, conditions[:MANY]
        wanted["same"] = guided, conditions[:1] * scenes
    row: dict[str, Any] = {"size": size, "condition": conditions[0].to_json()}
    for kind, (generator, chosen) in wanted.items():
        say(f"N = {size}: W2, {KINDS[kind]}, {len(chosen)} scenes")
        row[kind] = asdict(deviation_of_scenes(nominal, generator, chosen, seed))
    if paths:
        say(f"N = {size}: both sides of the theorem, {paths} samples")
        row["theorem"] = asdict(deviation_of_theorem(guided, conditions[0], paths, seed))
    return row


def _broken(row: Mapping[str, Any]) -> list[str]:
    """Where the bound that holds for fixed Euler steps does not."""
    found = row.get("theorem")
    if found is None or found["log_bounds"]["held"] >= math.log(found["paired"]):
        return []
    return [f"deviation, N = {row['size']}: above the theorem's bound"]


EXPERIMENTS: tuple[Experiment, ...] = (SceneDeviations(),)
