"""`deggflow demo`: a first example for new users."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from .session import NOT_SATISFIED, SATISFIED, output, prepare_jax

if TYPE_CHECKING:
    from deggflow.task import Table
    from deggflow.tasks.tabletop.scene import Scene


def demo(out: Path = Path("demo"), count: int = 8, size: int = 8, seed: int = 0) -> int:
    """Generate nominal and guided scenes under changed requirements, with certificates and pictures.

    Args:
        out: Folder that receives scenes.jsonl, pictures and a video; files of an earlier demo are replaced.
        count: Number of scenes.
        size: Number of objects in each.
        seed: Seed of scenes and of z(0).
    """
    from deggflow.jsonl import InputError

    if not (1 <= count <= 100 and 1 <= size <= 12 and 0 <= seed < 2**31):
        raise InputError(
            "--count must lie in [1, 100], --size in [1, 12] and --seed in [0, 2147483647]"
        )
    prepare_jax()
    import json

    from deggflow.files import write_atomically
    from deggflow.tasks.tabletop.changes import random_conditions
    from deggflow.tasks.tabletop.field import load_field
    from deggflow.tasks.tabletop.generator import TabletopGenerator
    from deggflow.tasks.tabletop.task import scene_generator
    from deggflow.view.tabletop.results import regenerate, write_pictures

    from .tables import show

    generator = scene_generator(load_field())
    conditions = random_conditions(size, count, "changed", seed)
    nominal = TabletopGenerator(generator.field).scenes(conditions, seed=seed, max_draws=1)
    guided = generator.scenes(conditions, seed=seed)
    show(_table(nominal, guided, size))
    lines = [json.dumps(scene.to_json()) for scene in guided]
    write_atomically(out / "scenes.jsonl", "\n".join(lines) + "\n")
    for line, scene in enumerate(guided, start=1):
        target, first = out / f"scene_{line:04d}.png", line == 1
        generations = regenerate(generator, scene, line)
        write_pictures(scene, target, "auto", generations, nominal=True, video=first, mjcf=first)
    output().print(
        f"Scenes: {out / 'scenes.jsonl'}\n"
        f"Pictures of the nominal and the guided scene: {out / 'scene_0001.png'} to {out / f'scene_{count:04d}.png'}\n"
        f"The first scene being generated: {out / 'scene_0001.mp4'}; as a MuJoCo model: {out / 'scene_0001.xml'}"
    )
    return SATISFIED if all(scene.certificate.satisfied for scene in guided) else NOT_SATISFIED


def _table(nominal: "Sequence[Scene]", guided: "Sequence[Scene]", size: int) -> "Table":
    """One row for each pair of scenes."""
    from deggflow.task import Table

    def row(number: int, before: "Scene", after: "Scene") -> tuple[str, ...]:
        certificate = after.certificate
        return (
            str(number),
            before.certificate.reason or "all requirements hold",
            "all requirements hold" if certificate.satisfied else str(certificate.reason),
            f"{1000 * certificate.min_margin:+.1f} mm",
            str(certificate.draws),
            "satisfied" if certificate.satisfied else "not satisfied",
        )

    return Table(
        f"{len(guided)} scenes of {size} objects under changed requirements, from the same z(0)",
        ("scene", "nominal", "guided", "least margin", "draws", "certificate"),
        [row(k, *pair) for k, pair in enumerate(zip(nominal, guided, strict=True), start=1)],
    )
