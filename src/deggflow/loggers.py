"""Callbacks that follow a training run or a call of `sample`: bars, lines, TensorBoard, W&B and what is compatible.

Each is an `on_progress` of `deggflow.train.train` and of `deggflow.sample`; `together` joins several.
"""

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple, Protocol, runtime_checkable

from .sampling import Progress
from .train import Curve

Report = Curve | Progress
OnProgress = Callable[[Any], None]
"""Told of a `Curve` or a `Progress`."""


class Scalars(NamedTuple):
    """A report as numbers with names.

    Attributes:
        step: Completed training steps, or completed samples of all draws so far.
        values: Numbers by name, such as "validation/loss".
    """

    step: int
    values: dict[str, float]


def scalars(report: Report) -> Scalars:
    """What a report says, as loggers store it.

    Raises:
        TypeError: `report` is neither a `Curve` nor a `Progress`.

    Example:
        >>> scalars(Curve(step=20, training=0.5, validation=0.4))
        Scalars(step=20, values={'training/loss': 0.5, 'validation/loss': 0.4})
    """
    if isinstance(report, Curve):
        losses = {"training/loss": report.training, "validation/loss": report.validation}
        return Scalars(report.step, losses)
    if isinstance(report, Progress):
        values = {
            "sample/draw": float(report.draw),
            "sample/completed": float(report.completed),
            "sample/satisfied": report.satisfied / report.total,
        }
        return Scalars(report.total - report.pending + report.completed, values)
    raise TypeError(f"`report` must be a `Curve` or a `Progress`; got {type(report).__name__}.")


@runtime_checkable
class SummaryWriter(Protocol):
    """The method of TensorBoard's `SummaryWriter` (torch.utils.tensorboard, tensorboardX) that is used here."""

    def add_scalar(self, tag: str, scalar_value: float, global_step: int) -> Any:
        """Stores one number."""


@runtime_checkable
class Run(Protocol):
    """The method of a run of W&B, of trackio or of another logger with their interface that is used here."""

    def log(self, data: dict[str, Any], step: int) -> Any:
        """Stores numbers by name."""


def to_tensorboard(writer: SummaryWriter) -> OnProgress:
    """Writes every report to TensorBoard.

    Args:
        writer: A `SummaryWriter`, of torch.utils.tensorboard or tensorboardX; close it yourself.

    Example:
        >>> class Writer:
        ...     def add_scalar(self, tag, scalar_value, global_step):
        ...         print(tag, scalar_value, global_step)
        >>> to_tensorboard(Writer())(Curve(20, 0.5, 0.4))
        training/loss 0.5 20
        validation/loss 0.4 20
    """

    def on_progress(report: Report) -> None:
        step, values = scalars(report)
        for name, value in values.items():
            writer.add_scalar(name, value, step)

    return on_progress


def to_run(run: Run) -> OnProgress:
    """Logs every report to a run: `wandb.init(...)`, `trackio.init(...)` (which stays on this machine) and others.

    Args:
        run: Anything with `log(numbers by name, step=...)`; finish it yourself.

    Example:
        >>> class Printed:
        ...     def log(self, data, step):
        ...         print(step, data)
        >>> to_run(Printed())(Curve(20, 0.5, 0.4))
        20 {'training/loss': 0.5, 'validation/loss': 0.4}
    """

    def on_progress(report: Report) -> None:
        step, values = scalars(report)
        run.log(values, step=step)

    return on_progress


@runtime_checkable
class Stream(Protocol):
    """Where lines of text go: an open file."""

    def write(self, text: str, /) -> Any:
        """Writes some text."""

    def flush(self) -> Any:
        """Writes what is buffered."""


def lines(stream: Stream | None = None, *, every: float = 0.0) -> OnProgress:
    """Prints one line for each report, for logs of batch jobs.

    Args:
        stream: Where to; stderr by default.
        every: Seconds between two lines; reports in between are left out.

    Example:
        >>> lines(sys.stdout)(Curve(20, 0.5, 0.4))
        step 20: training/loss 0.5, validation/loss 0.4
    """
    last = -float("inf")

    def on_progress(report: Report) -> None:
        nonlocal last
        if time.monotonic() - last < every:
            return
        last = time.monotonic()
        step, values = scalars(report)
        text = ", ".join(f"{name} {value:.4g}" for name, value in values.items())
        print(f"step {step}: {text}", file=stream or sys.stderr, flush=True)

    return on_progress


@contextmanager
def bar(total: int, label: str = "") -> Iterator[OnProgress]:
    """A progress bar on a terminal's stderr; without a terminal, lines at least ten seconds apart.

    Args:
        total: Training steps, or samples.
        label: What is said beside it.

    Example:
        >>> with bar(100, "training") as on_progress:
        ...     on_progress(Curve(100, 0.5, 0.4))
    """
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn
    from rich.progress import Progress as Bars

    if not sys.stderr.isatty():
        yield lines(every=10.0)
        return
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
    )
    with Bars(*columns, console=Console(stderr=True)) as bars:
        task = bars.add_task(label, total=total)

        def on_progress(report: Report) -> None:
            step, values = scalars(report)
            text = ", ".join(f"{name} {value:.4g}" for name, value in values.items())
            bars.update(task, completed=step, description=f"{label} ({text})")

        yield on_progress


def together(*callbacks: OnProgress) -> OnProgress:
    """Calls several callbacks, in order.

    Example:
        >>> together(lines(sys.stdout), lambda curve: print("step", curve.step))(Curve(20, 0.5, 0.4))
        step 20: training/loss 0.5, validation/loss 0.4
        step 20
    """

    def on_progress(report: Report) -> None:
        for each in callbacks:
            each(report)

    return on_progress
