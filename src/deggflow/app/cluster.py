"""`--engine ray`: chunks and rows are computed by the workers of a Ray cluster, and written here in order.

A chunk depends on its number alone, so Ray may compute it anywhere and, after the death of a worker or a node, again. All
files are written by this process as without Ray; after its own death, the command resumes from them.
"""

import json
import warnings
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import cache, partial
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

from deggflow import __version__
from deggflow.extras import imported
from deggflow.jsonl import InputError
from deggflow.schema import parse_as
from deggflow.shards import Part, Shard
from deggflow.task.data import Chunk, Demonstrator
from deggflow.task.options import Recipe

from .registry import AbstractEntry, entry_named

if TYPE_CHECKING:
    from .runs import FinishedLines

Row = TypeVar("Row")

AHEAD = 16  # tasks in flight for each that runs: results are written in order, and others go on while one is computed again


class Work(NamedTuple):
    """What all tasks of a run have in common.

    Attributes:
        task: Name of the task.
        options: Options of the command.
        made_with: Version and weights of this process, which the workers' must equal.
    """

    task: str
    options: Any
    made_with: Mapping[str, Any]


class Cluster:
    """A Ray cluster, connected to or started here."""

    def __init__(self, address: str | None, cpus: int) -> None:
        """Args: address: Of a running cluster, as for `ray.init`; None: one on this machine; cpus: Of each Ray task."""
        self._ray = imported("ray", "ray", "--engine ray")
        self._cpus = cpus
        settings: dict[str, Any] = {"logging_level": "warning", "log_to_driver": False}
        if address is None:
            # Otherwise the cluster would be reached under the machine's own address.
            settings |= {"include_dashboard": False, "_node_ip_address": "127.0.0.1"}
        try:
            with warnings.catch_warnings():
                # Ray forks only to start other programs at once.
                warnings.filterwarnings("ignore", "os.fork", RuntimeWarning)
                self._ray.init(address=address, **settings)
        except (ConnectionError, ValueError, RuntimeError) as error:
            raise InputError(f"--address: Ray can't be reached: {error}") from None
        nodes = [node for node in self._ray.nodes() if node["Alive"]]
        largest = max((int(node["Resources"].get("CPU", 0)) for node in nodes), default=0)
        if largest < cpus:  # its tasks would wait for ever
            self._ray.shutdown()
            raise InputError(
                f"--cpus must be at most {largest}, those of the largest node; got {cpus}"
            )

    def each(self, function: Callable[..., Any], calls: Iterable[tuple[Any, ...]]) -> Iterator[Any]:
        """Results of a function for all arguments, in order; some more calls are under way meanwhile."""
        ray = self._ray
        # Retried for as long as it takes: only the death of a worker or a node leads to another try.
        remote = ray.remote(num_cpus=self._cpus, max_retries=-1, scheduling_strategy="SPREAD")(
            function
        )
        coming: deque[Any] = deque()
        following = iter(calls)
        try:
            while True:
                running = max(1, int(ray.cluster_resources().get("CPU", 1)) // self._cpus)
                while len(coming) < AHEAD * running and (call := next(following, None)) is not None:
                    coming.append(remote.remote(*call))
                if not coming:
                    return
                yield ray.get(coming.popleft())
        except ray.exceptions.RayTaskError as error:
            if isinstance(error.cause, InputError):
                raise InputError(error.cause.reason) from None
            raise
        finally:
            for each in coming:
                ray.cancel(each, force=True)

    def close(self) -> None:
        """Leaves the cluster, or ends the one that was started here."""
        self._ray.shutdown()


@cache
def _entry(name: str) -> AbstractEntry:
    from .session import prepare_jax

    prepare_jax()
    return entry_named(name)


def _check(work: Work, made_with: Mapping[str, Any]) -> None:
    """Raises `InputError` unless a worker has the driver's version and weights."""
    if made_with != work.made_with:
        raise InputError(f"a worker has other weights or another version: {json.dumps(made_with)}")


_GENERATORS: dict[str, Any] = {}  # of a worker; its programs stay compiled


def generate_chunk(
    work: Work, part: Part, chunk: int, conditions: Sequence[Any] | None
) -> tuple[str, list[bool]]:
    """On a worker: the lines of one chunk as one text, and whether each failed.

    Args:
        work: What all chunks have in common.
        part: The chunk's part of the run.
        chunk: Size of the run's chunks.
        conditions: JSON objects of its conditions; None if they are drawn.
    """
    from deggflow.task import Chunking

    from .runs import ConditionSource, finished_lines, generate_results, provenance
    from .session import progress

    task, options = _entry(work.task).load_task(), work.options
    _check(work, provenance(task.model, options.weights))
    key = repr((work.task, options))
    if key not in _GENERATORS:
        _GENERATORS[key] = task.generator(task.model.load(options.weights), options)

    def draw(first: int, many: int) -> list[Any]:
        if conditions is None:
            return task.random_conditions(options.size, many, part.first + first, options)
        return [task.parse_condition(each) for each in conditions[first : first + many]]

    source: ConditionSource[Any] = ConditionSource(part.lines, 0, draw, first=part.first)
    with progress(hidden=True) as bars:
        some = generate_results(_GENERATORS[key], source, options, 0, bars, Chunking(chunk))
        results = [result for part_of_chunk in some for result in part_of_chunk]
    finished = finished_lines(results, lambda row: task.fails(row, guided=options.guided))
    return "\n".join(finished.lines), list(finished.failed)


def measure_row(work: Work, weights: str | None, number: int) -> str:
    """On a worker: one row of an evaluation, as text. Args: number: of the row."""
    from .runs import provenance

    task = _entry(work.task).load_task()
    _check(work, provenance(task.model, work.options.weights))
    evaluation = task.evaluation(task.model.load(work.options.weights), work.options, weights)
    return json.dumps(evaluation.jobs[number]().to_json(), allow_nan=False)


def measure_method(work: Work, size: int, name: str, hyperparameters: Mapping[str, float]) -> str:
    """On a worker: one row of a comparison of guidance methods, as text.

    Args:
        work: What all rows have in common; its options are the number of cases and their seed.
        size: Number of objects.
        name: Of the method.
        hyperparameters: Of the method.
    """
    from .runs import provenance

    task, (cases, seed) = _entry(work.task).load_task(), work.options
    _check(work, provenance(task.model, None))
    from deggflow.tasks.tabletop.baselines import METHODS
    from deggflow.tasks.tabletop.frontier import jobs

    (method,) = (each for each in METHODS if each.name == name)
    (job,) = jobs(task.model.load(None), [(size, method, dict(hyperparameters))], cases, seed)
    return json.dumps(job().to_json(), allow_nan=False)


def demonstrate_chunk(work: Work, chunk: Chunk) -> str:
    """On a worker: the lines of one chunk of training data, as a JSON list.

    Args:
        work: What all chunks have in common; its options are the recipe.
        chunk: Which demonstrations.
    """
    model = _entry(work.task).load_task().model
    _check(work, {"deggflow": __version__})
    size, first, count, seed = chunk
    return json.dumps(model.demonstrate(size, first, count, work.options, seed), allow_nan=False)


def demonstrator_by(cluster: Cluster, task: str, recipe: Recipe) -> Demonstrator:
    """Makes the chunks of a task's training data on a cluster. Args: task: its name; recipe: of the data."""
    work = Work(task, recipe, {"deggflow": __version__})

    def demonstrator(chunks: Iterable[Chunk]) -> Iterator[Sequence[Mapping[str, Any]]]:
        return map(json.loads, cluster.each(demonstrate_chunk, ((work, each) for each in chunks)))

    return demonstrator


def chunks_by(
    cluster: Cluster, work: Work, source: Any, chunk: int, first: int
) -> "Iterator[FinishedLines]":
    """Results of a run or a shard from number `first` on, chunk by chunk."""
    from .runs import FinishedLines

    starts = range(first // chunk * chunk, source.count, chunk)

    def calls() -> Iterator[tuple[Any, ...]]:
        for start in starts:
            count = min(chunk, source.count - start)
            part = Part(source.first + start, count, source.count)
            given = None if source.size else [c.to_json() for c in source.part(start, count)]
            yield work, part, chunk, given

    for start, (text, failed) in zip(starts, cluster.each(generate_chunk, calls()), strict=True):
        written = max(0, first - start)
        # Not parsed here: this process handles the lines of all workers.
        yield FinishedLines(text.split("\n")[written:], failed[written:])


def rows_by(
    cluster: Cluster,
    measure: Callable[..., str],
    calls: Sequence[tuple[Any, ...]],
    kind: type[Row],
    shard: Shard | None,
) -> Sequence[Callable[[], Row]]:
    """Jobs that take their rows from the cluster, which begins with the first row that is asked for.

    Args:
        cluster: The cluster.
        measure: Measures a row on a worker, and returns its JSON object as text.
        calls: Its arguments for each row.
        kind: Dataclass of the rows.
        shard: Of which rows are asked for; None: all.
    """
    stop = len(calls) if shard is None else shard.chunks(len(calls)).stop
    coming: list[Iterator[str]] = []

    def job(number: int) -> Row:
        if not coming:
            coming.append(cluster.each(measure, calls[number:stop]))
        return parse_as(kind, json.loads(next(coming[0])))

    return [partial(job, number) for number in range(len(calls))]
