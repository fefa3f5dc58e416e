"""The six commands of every task: data, train, generate, certify, evaluate, render."""

import inspect
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro
from tyro.extras import SubcommandApp

from deggflow.jsonl import InputError
from deggflow.shards import parse_shard
from deggflow.task import check_range

from .engine import LOCAL, SPELLED_OUT, AnyEngine
from .logs import Log, logged
from .registry import AbstractEntry
from .session import NOT_SATISFIED, SATISFIED, console, prepare_jax, progress

if TYPE_CHECKING:
    from deggflow.flow import Field
    from deggflow.train import TrainingConfig

PICTURES = 12  # lines of a file that are drawn by default


def task_app(entry: AbstractEntry) -> SubcommandApp:
    """The commands of a task."""
    options, app = entry.load_options(), SubcommandApp()
    for name, command, kind in (
        ("data", _data, options.data),
        ("train", _train, options.train),
        ("generate", _generate, options.generate),
        ("certify", _certify, options.certify),
        ("evaluate", _evaluate, options.evaluate),
        ("render", _render, options.render),
    ):
        app.command(name=name)(_with_options(entry, command(entry), kind))
    return app


def _with_options(
    entry: AbstractEntry, command: Callable[..., int], kind: type[Any]
) -> Callable[..., int]:
    """A command with one option for each field of the dataclass; its help calls results by the task's noun."""
    nouns = f"{entry.noun}s"
    for function in (command, inspect.unwrap(command)):  # tests check types in a wrapper
        text = function.__doc__ or ""
        function.__doc__ = text.replace("results", nouns).replace("result", entry.noun)
        function.__annotations__["options"] = Annotated[kind, SPELLED_OUT]
        if "file" in function.__annotations__:
            positional = tyro.conf.arg(metavar=nouns.upper())
            function.__annotations__["file"] = Annotated[Path, tyro.conf.Positional, positional]
    return command


def _data(entry: AbstractEntry) -> Callable[..., int]:
    def data(out: Path, options: Any, engine: AnyEngine = LOCAL, shard: str | None = None) -> int:
        """Make training and validation data.

        Args:
            out: Folder that receives training.jsonl and validation.jsonl. Rerun the command to resume an interrupted run.
            options: Which demonstrations to make.
            engine: Which processes make them.
            shard: k/n: make only shard number k of n; `deggflow merge` joins the folders.
        """
        part = parse_shard(shard)
        prepare_jax()
        from deggflow.output import check_written
        from deggflow.task import write_data

        model, demonstrator = entry.load_task().model, None
        if engine.ray:
            from .cluster import Cluster, demonstrator_by

            cluster = Cluster(engine.address, engine.cpus)
            demonstrator = demonstrator_by(cluster, entry.name, options)
        with progress() as bars:
            bar = bars.add_task(model.noun, total=None)
            write_data(
                model, out, options,
                lambda count, total: bars.update(bar, completed=count, total=total),
                shard=part, demonstrator=demonstrator,
            )  # fmt: skip
        for line in () if part else model.describe(out):
            console().print(line)
        console().print(f"Training and validation {model.noun} are in {out}.")
        check_written(out / "training.jsonl", out / "validation.jsonl")
        return SATISFIED

    return data


def _training_config(options: Any) -> "TrainingConfig":
    from deggflow.train import TrainingConfig

    try:
        return TrainingConfig(
            steps=options.steps, batch=options.batch, learning_rate=options.learning_rate,
            seed=options.seed,
        )  # fmt: skip
    except ValueError as error:
        raise InputError(str(error)) from None


def _train(entry: AbstractEntry) -> Callable[..., int]:
    def train(
        data: Path,
        out: Path,
        options: Any,
        validation: Path | None = None,
        devices: int = 1,
        coordinator: str | None = None,
        process: str | None = None,
        log: Log = "none",
    ) -> int:
        """Train a nominal field. Rerun the command to resume an interrupted run; more steps extend a finished one.

        Args:
            data: Folder with training.jsonl and validation.jsonl, or .parquet; or a file of training data, with --validation.
            out: Folder that receives config.json, checkpoints, curves.csv, curves.png, field.safetensors and its card field.json.
            options: How to train.
            validation: File of validation data, if --data is a file.
            devices: Number of devices that divide each batch; with --coordinator, of each process. 0: all.
            coordinator: HOST:PORT of the first process, if several processes train together; they share the folders.
            process: k/n: this is process number k of n, with --coordinator.
            log: Also write the losses for TensorBoard, into OUT/tensorboard, or for trackio, into its own store.
        """
        check_range("devices", devices, 0, 10_000)
        prepare_jax()
        from deggflow.loggers import together
        from deggflow.output import check_written
        from deggflow.task import data_files, train_field

        from .distributed import connect, is_first, selected_devices
        from .remake import remake
        from .runs import training_progress

        connect(coordinator, process)

        config = _training_config(options)
        sizes = options.architecture()
        with (
            logged(log if is_first() else "none", out) as store,
            training_progress(options.steps, out, hidden=not is_first()) as show,
        ):
            train_field(
                entry.load_task().model, data_files(data, validation), out, config, sizes, together(show, store),
                commands=remake(entry.name, entry.load_options().data, sizes),
                devices=selected_devices(devices, options.batch),
            )  # fmt: skip
        if is_first():
            console().print(f"Weights, card and curves are in {out}.")
            check_written(out / "field.safetensors", out / "field.json", out / "curves.csv")
        return SATISFIED

    return train


def _generate(entry: AbstractEntry) -> Callable[..., int]:
    def generate(options: Any, engine: AnyEngine = LOCAL, shard: str | None = None) -> int:
        """Generate results, each with its certificate, as JSON Lines.

        Exit code 0: every result satisfies its requirements (or --guidance none); 3: some do not, and their lines
        say why; 2: bad input.

        Args:
            options: What to generate, and how.
            engine: Which processes generate.
            shard: k/n: generate only shard number k of n; `deggflow merge` joins the files into that of the whole run.
        """
        part = parse_shard(shard)
        prepare_jax()
        from .generating import generate_file

        return generate_file(entry, options, engine, part)

    return generate


def _certify(entry: AbstractEntry) -> Callable[..., int]:
    def certify(file: Path, options: Any) -> int:
        """Check the results of a file again, regardless of origin, and each line against itself.

        The check shares no code with the generation. Exit code 0: every result satisfies its requirements; 3: some
        do not, or a line contains false statements; 2: bad input.

        Args:
            file: File of results, as `generate` writes it.
            options: Which lines to check, and against which conditions.
        """
        from .certifying import certify_file

        return certify_file(entry.load_task(), file, options)

    return certify


def _evaluate(entry: AbstractEntry) -> Callable[..., int]:
    def evaluate(options: Any, engine: AnyEngine = LOCAL, shard: str | None = None) -> int:
        """Measure the success of nominal and guided generation; an independent oracle checks every claim.

        Args:
            options: What to measure, and on how many cases.
            engine: Which processes measure.
            shard: k/n: measure only shard number k of n of the rows. With the merged file as --out, the command without --shard prints the tables.
        """
        part = parse_shard(shard, options.out)
        prepare_jax()
        from deggflow.output import check_written

        from .cluster import Cluster, Work, measure_row, rows_by
        from .runs import digest_of_weights, provenance, run_jobs
        from .tables import show

        if not options.sizes:
            raise InputError("--sizes must name at least one size")
        task, digest = entry.load_task(), digest_of_weights(options.weights)
        evaluation = task.evaluation(task.model.load(options.weights), options, digest)
        jobs = evaluation.jobs
        if engine.ray:
            work = Work(entry.name, options, provenance(task.model, options.weights))
            cluster = Cluster(engine.address, engine.cpus)
            calls = [(work, digest, number) for number in range(len(jobs))]
            jobs = rows_by(cluster, measure_row, calls, evaluation.row, part)
        rows = run_jobs(jobs, evaluation.row, evaluation.settings, options.out, part)
        if part is None:
            for table in evaluation.tables(rows):
                show(table)
            entry.load_pictures().draw_evaluation(evaluation, options)
        check_written(options.out)
        return SATISFIED if evaluation.complete(rows) else NOT_SATISFIED

    return evaluate


def _render(entry: AbstractEntry) -> Callable[..., int]:
    def render(file: Path, options: Any) -> int:
        """Draw results of a file; violations are red.

        Args:
            file: File of results, as `generate` writes it.
            options: What to draw.
        """
        prepare_jax()
        from functools import cache

        from deggflow.task import PictureRequest

        task = entry.load_task()
        results = task.read_results(file)
        lines = options.lines or tuple(range(1, min(len(results), PICTURES) + 1))
        for line in lines:
            check_range("lines", line, 1, len(results))
        pictures = entry.load_pictures()
        say = partial(console().print, soft_wrap=True, markup=False)
        field: Callable[[], Field] = cache(lambda: task.model.load(options.weights))
        for line in lines:
            request = PictureRequest(results[line - 1][0], line, options, field, say)
            try:
                for path in pictures.write(request):
                    print(path, flush=True)
            except InputError as error:
                raise InputError(error.reason, file=file, line=line) from None
        return SATISFIED

    return render
