"""`generate`: results for all conditions of a run or of a shard, written line by line."""

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

from deggflow.jsonl import InputError
from deggflow.output import check_written
from deggflow.runtime import TeamError
from deggflow.shards import Shard
from deggflow.task import AbstractTask, GenerateOptions, ProcessOptions

from .cluster import Cluster, Work, chunks_by
from .engine import EngineOptions
from .registry import AbstractEntry
from .runs import (
    ConditionSource,
    check_output,
    condition_source,
    digest_of_weights,
    generate_results,
    provenance,
    write_results,
)
from .session import NOT_SATISFIED, SATISFIED, UNFORESEEN, console

if TYPE_CHECKING:
    from rich.progress import Progress

Chunks = Callable[[int, "Progress"], Iterator[Any]]
"""Results from the number of the first one on, a few at a time."""


def generate_file(
    entry: AbstractEntry, options: GenerateOptions, engine: EngineOptions, shard: Shard | None
) -> int:
    """Generates results into a file or to stdout, and returns the exit code."""
    task = entry.load_task()
    source = condition_source(task, options)
    settings = _settings(entry, task, source, options)
    check_output(options.out, settings | ({} if shard is None else {"shard": str(shard)}))
    chunks: Chunks
    if isinstance(options, ProcessOptions) and options.processes is not None:
        if shard is not None or engine.ray:
            raise InputError("--processes has neither --shard nor --engine ray")
        from .team import team_results

        chunks = team_results(task, source, options)
    else:
        generator = task.generator(task.model.load(options.weights), options)
        chunking = generator.chunking(*source.part(0, 1))
        if shard is not None:
            part = shard.equal_part(source.count, chunking.size)
            settings |= shard.settings(part)
            source = source.of_part(part)

        def chunks(first: int, bars: "Progress") -> Iterator[Any]:
            if engine.ray:
                work = Work(entry.name, options, settings["made_with"])
                cluster = Cluster(engine.address, engine.cpus)
                return chunks_by(cluster, work, source, chunking.size, first)
            return generate_results(generator, source, options, first, bars, chunking)

    return _write(task, options, settings, source, chunks)


def _settings(
    entry: AbstractEntry,
    task: AbstractTask[Any, Any],
    source: ConditionSource[Any],
    options: GenerateOptions,
) -> dict[str, Any]:
    """JSON values that distinguish the run from others."""
    return {
        "command": f"{entry.name} generate",
        "conditions": source.digest,
        "size": source.size,
        "count": source.count,
        **options.settings(),
        "weights": digest_of_weights(options.weights),
        "made_with": provenance(task.model, options.weights),
    }


def _write(
    task: AbstractTask[Any, Any],
    options: GenerateOptions,
    settings: dict[str, Any],
    source: ConditionSource[Any],
    chunks: Chunks,
) -> int:
    def fails(row: Any) -> bool:
        return task.fails(row, guided=options.guided)

    try:
        failed = write_results(options.out, settings, source, f"{task.noun}s", fails, chunks)
    except TeamError as error:
        console().print(f"deggflow: {error}", markup=False)
        return UNFORESEEN
    where = "" if options.out is None else f" They are in {options.out}."
    totals = f"{source.count - failed} of {source.count} {task.claim.of(source.count)}"
    console().print(f"{totals}.{where}")
    check_written(options.out)
    return NOT_SATISFIED if failed and options.guided else SATISFIED
