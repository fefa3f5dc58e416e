"""`--log` of training commands: the points of the curves, for the dashboards that people know."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from deggflow.extras import imported

if TYPE_CHECKING:
    from deggflow.loggers import OnProgress

Log = Literal["none", "tensorboard", "trackio"]
PROJECT = "deggflow"  # of trackio


@contextmanager
def logged(log: Log, folder: Path) -> "Iterator[OnProgress]":
    """A callback that stores what it receives, until the end of the block.

    Args:
        log: tensorboard: event files in `folder`/tensorboard; trackio: a run of the project "deggflow" in trackio's own
            store, named by the path of `folder`, which a later call resumes; none: nothing is stored.
        folder: Of the training run.

    Raises:
        InputError: The package is not installed.
    """
    from deggflow.loggers import to_run, to_tensorboard

    if log == "tensorboard":
        package = imported("tensorboardX", "tensorboard", "--log tensorboard")
        with package.SummaryWriter(str(folder / "tensorboard")) as writer:
            yield to_tensorboard(writer)
    elif log == "trackio":
        package = imported("trackio", "trackio", "--log trackio")
        with _trackio_run(package, str(folder.resolve())) as run:
            yield to_run(run)
    else:
        yield lambda report: None


@contextmanager
def _trackio_run(package: Any, name: str) -> Iterator[Any]:
    """A run of trackio, whose messages go to stderr as all others do."""
    with redirect_stdout(sys.stderr):
        run = package.init(project=PROJECT, name=name, resume="allow")
    try:
        yield run
    finally:
        with redirect_stdout(sys.stderr):
            run.finish()
