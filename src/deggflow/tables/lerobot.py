"""LeRobot data sets, layout v3.0: frames of all episodes in Parquet files, episodes, tasks and statistics beside them.

Source: huggingface/lerobot, src/lerobot/datasets (codebase_version v3.0).
"""

import json
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from deggflow.extras import imported
from deggflow.files import StrPath
from deggflow.jsonl import InputError

VERSION = "v3.0"
CHUNK = 1000  # files of a folder
FILE = 100  # MB, from which another file is begun
_DATA = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
_EPISODES = "meta/episodes/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
_COUNTERS = ("frame_index", "episode_index", "index", "task_index")
_SUCCESS, _DONE = "next.success", "next.done"
STATE, ENVIRONMENT, ACTION = "observation.state", "observation.environment_state", "action"


@dataclass(frozen=True)
class EpisodeFormat:
    """What all episodes of a data set have in common.

    Attributes:
        robot: Type of the robots.
        fps: Frames per second, a whole number.
        features: Names of the numbers of every feature, by the feature's name.
    """

    robot: str
    fps: int
    features: Mapping[str, Sequence[str]]


@dataclass(frozen=True)
class Episode:
    """One episode.

    Attributes:
        features: Every feature of the format, frames x numbers.
        success: Whether it succeeded; true of its last frame alone.
        satisfied: Whether its certificate is satisfied.
        task: What the robots do, as a sentence.
    """

    features: Mapping[str, Float[np.ndarray, "frames _size"]]
    success: bool
    satisfied: bool
    task: str


def misfit(episode: Episode, form: EpisodeFormat) -> str | None:
    """Why an episode can't be in a data set; None if it can."""
    for name, names in form.features.items():
        size = episode.features[name].shape[1]
        if size != len(names):
            return (
                f"has {size} numbers in {name}, and the first episode {len(names)}: write each number of agents into a data "
                "set of its own"
            )
    return None


class _Statistics:
    """Least, greatest, mean and standard deviation of a feature over all frames."""

    def __init__(self, size: int) -> None:
        self.count, self.mean, self.square = 0, np.zeros(size), np.zeros(size)
        self.least, self.most = np.full(size, np.inf), np.full(size, -np.inf)

    def add(self, values: Float[np.ndarray, "frames size"]) -> None:
        """Chan, Golub and LeVeque's update by a batch."""
        count, mean = len(values), values.mean(axis=0)
        total, shift = self.count + count, mean - self.mean
        self.square += ((values - mean) ** 2).sum(axis=0) + shift**2 * self.count * count / total
        self.mean, self.count = self.mean + shift * count / total, total
        self.least = np.minimum(self.least, values.min(axis=0))
        self.most = np.maximum(self.most, values.max(axis=0))

    def to_json(self) -> dict[str, list[float]]:
        return {
            "min": self.least.tolist(),
            "max": self.most.tolist(),
            "mean": self.mean.tolist(),
            "std": np.sqrt(self.square / self.count).tolist(),
            "count": [self.count],
        }


class _Files:
    """Parquet files of one kind, numbered, each begun when the one before is large."""

    def __init__(self, root: Path, pattern: str, schema: Any) -> None:
        self._root, self._pattern, self._schema = root, pattern, schema
        self._number, self._writer, self._path = -1, None, root

    @property
    def place(self) -> tuple[int, int]:
        """Numbers of the current folder and file."""
        return self._number // CHUNK, self._number % CHUNK

    def next_if_full(self) -> None:
        """Begins a file if there is none yet or the current one is large."""
        if self._writer is not None and self._path.stat().st_size < FILE << 20:
            return
        self.close()
        self._number += 1
        chunk, file = self.place
        self._path = self._root / self._pattern.format(chunk_index=chunk, file_index=file)
        self._path.parent.mkdir(parents=True, exist_ok=True)
        parquet = imported("pyarrow.parquet", "data", "a LeRobot data set")
        self._writer = parquet.ParquetWriter(self._path, self._schema, compression="snappy")

    def write(self, table: Any) -> None:
        assert self._writer is not None
        self._writer.write_table(table)

    def close(self) -> None:
        if self._writer is not None:
            self._writer.close()
            self._writer = None


def write_lerobot(folder: StrPath, form: EpisodeFormat, episodes: Iterable[Episode]) -> int:
    """Writes a data set; needs memory for some episodes.

    Args:
        folder: The data set's folder, which must not exist yet; it appears once the set is complete.
        form: What all episodes have in common.
        episodes: The episodes.

    Raises:
        InputError: The folder exists, there is no episode, or pyarrow is missing.

    Returns:
        The number of episodes.
    """
    arrow = imported("pyarrow", "data", "a LeRobot data set")
    folder = Path(folder)
    if folder.exists():
        raise InputError("exists; choose another --out, or remove it first", file=folder)
    folder.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=folder.parent, prefix=f".{folder.name}.") as temporary:
        whole = Path(temporary) / folder.name
        count = _write(arrow, whole, form, episodes)
        if not count:
            raise InputError("there is no episode to write", file=folder)
        whole.rename(folder)
    return count


def _write(arrow: Any, folder: Path, form: EpisodeFormat, episodes: Iterable[Episode]) -> int:
    schema = _frame_schema(arrow, form)
    data = _Files(folder, _DATA, schema)
    entries = _Files(folder, _EPISODES, _episode_schema(arrow))
    statistics = {name: _Statistics(len(names)) for name, names in form.features.items()}
    tasks: dict[str, int] = {}  # their numbers
    count = frames = 0
    for episode in episodes:
        data.next_if_full()
        entries.next_if_full()
        task = tasks.setdefault(episode.task, len(tasks))
        columns = _columns(form, episode, count, frames, task)
        length = len(columns["index"])
        data.write(_table(arrow, schema, columns))
        entries.write(_entry(arrow, episode, count, frames, length, data, entries))
        for name, each in statistics.items():
            each.add(np.asarray(episode.features[name], np.float64))
        count, frames = count + 1, frames + length
    data.close()
    entries.close()
    if count:
        _write_meta(arrow, folder, form, statistics, tasks, count, frames)
    return count


def _frame_schema(arrow: Any, form: EpisodeFormat) -> Any:
    vectors = [
        arrow.field(name, arrow.list_(arrow.float32(), len(names)))
        for name, names in form.features.items()
    ]
    flags = [arrow.field(name, arrow.bool_()) for name in (_SUCCESS, _DONE)]
    counters = [arrow.field(name, arrow.int64()) for name in _COUNTERS]
    return arrow.schema([*vectors, *flags, arrow.field("timestamp", arrow.float32()), *counters])


def _columns(
    form: EpisodeFormat, episode: Episode, number: int, first: int, task: int
) -> dict[str, Any]:
    length = len(next(iter(episode.features.values())))
    frame = np.arange(length)
    last = frame == length - 1
    return {
        **{name: np.asarray(episode.features[name], np.float32) for name in form.features},
        _SUCCESS: last & episode.success,
        _DONE: last,
        "timestamp": (frame / form.fps).astype(np.float32),
        "frame_index": frame,
        "episode_index": np.full(length, number),
        "index": first + frame,
        "task_index": np.full(length, task),
    }


def _table(arrow: Any, schema: Any, columns: Mapping[str, np.ndarray]) -> Any:
    arrays = []
    for field in schema:
        values = columns[field.name]
        flat = arrow.array(values.reshape(-1), field.type if values.ndim == 1 else arrow.float32())
        if values.ndim == 2:
            flat = arrow.FixedSizeListArray.from_arrays(flat, values.shape[1])
        arrays.append(flat)
    return arrow.Table.from_arrays(arrays, schema=schema)


_ENTRY = ("episode_index", "length", "dataset_from_index", "dataset_to_index")
_PLACES = ("data/chunk_index", "data/file_index", "meta/episodes/chunk_index", "meta/episodes/file_index")  # fmt: skip


def _episode_schema(arrow: Any) -> Any:
    numbers = [arrow.field(name, arrow.int64()) for name in (*_ENTRY, *_PLACES)]
    flags = [arrow.field(name, arrow.bool_()) for name in ("success", "satisfied")]
    return arrow.schema([arrow.field("tasks", arrow.list_(arrow.string())), *numbers, *flags])


def _entry(
    arrow: Any, episode: Episode, number: int, first: int, length: int,
    data: _Files, entries: _Files,
) -> Any:  # fmt: skip
    row = {
        "tasks": [episode.task],
        **dict(zip(_ENTRY, (number, length, first, first + length), strict=True)),
        **dict(zip(_PLACES, (*data.place, *entries.place), strict=True)),
        "success": episode.success,
        "satisfied": episode.satisfied,
    }
    return arrow.Table.from_pylist([row], _episode_schema(arrow))


def _write_meta(
    arrow: Any, folder: Path, form: EpisodeFormat, statistics: Mapping[str, _Statistics],
    tasks: Mapping[str, int], episodes: int, frames: int,
) -> None:  # fmt: skip
    parquet = imported("pyarrow.parquet", "data", "a LeRobot data set")
    scalar = {"shape": [1], "names": None}
    info = {
        "codebase_version": VERSION,
        "robot_type": form.robot,
        "total_episodes": episodes,
        "total_frames": frames,
        "total_tasks": len(tasks),
        "chunks_size": CHUNK,
        "data_files_size_in_mb": FILE,
        "video_files_size_in_mb": 200,
        "fps": form.fps,
        "splits": {"train": f"0:{episodes}"},
        "data_path": _DATA,
        "video_path": None,
        "features": {
            **{
                name: {"dtype": "float32", "shape": [len(names)], "names": list(names)}
                for name, names in form.features.items()
            },
            **{name: {"dtype": "bool", **scalar} for name in (_SUCCESS, _DONE)},
            "timestamp": {"dtype": "float32", **scalar},
            **{name: {"dtype": "int64", **scalar} for name in _COUNTERS},
        },
    }
    meta = folder / "meta"
    (meta / "info.json").write_text(json.dumps(info, indent=4) + "\n")
    numbers = {name: each.to_json() for name, each in statistics.items()}
    (meta / "stats.json").write_text(json.dumps(numbers, indent=4) + "\n")
    table = arrow.table({"task_index": list(tasks.values()), "task": list(tasks)})
    # The reader looks tasks up by the index of a pandas frame.
    index = {"index_columns": ["task"], "column_indexes": [], "pandas_version": "2.0", "columns": [
        {"name": "task_index", "field_name": "task_index", "pandas_type": "int64", "numpy_type": "int64", "metadata": None},
        {"name": "task", "field_name": "task", "pandas_type": "unicode", "numpy_type": "object", "metadata": None},
    ]}  # fmt: skip
    table = table.replace_schema_metadata({"pandas": json.dumps(index)})
    parquet.write_table(table, meta / "tasks.parquet")
